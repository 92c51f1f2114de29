"""Quantities of text files, and what the names of their columns look like.

Names are compared in lower case and without accents. Units are in `pyburgers.common.units`.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

OTHER_QUANTITIES = re.compile(
    r"(?<![a-z])(?:strain|stress|def\w*)?.?rate(?![a-z])|confin|cell.?p|pore|radial|lateral|quer|(?<![a-z])vol"
    r"|(?:gas|oil|fluid|water|ambient).{0,2}press|hydrostat|compliance|viscos|strain.?ampl|manteldruck|vitesse|geschwindigkeit"
    r"|^(?:sigma|sig|σ|s)_?[23](?![0-9a-z])|^p(?:c|conf)?(?![a-z])"
)
"""What the name of a column has that is none of these, though it may look like one: strain rates,
pressures and strains beside the axis, compliances."""

SET_POINT = (
    r"(?<![a-z])set(?![a-z])|setpoint|target|command|demand|(?<![a-z])(?:sp|soll)|sollwert|consigne"
)
"""What the name of a column has that was asked for, not read."""


ENGINEERING = r"engineering|nominal|(?<![a-z])eng(?![a-z])|technisch"
"""What the name of a column of engineering stress or strain has."""


@dataclass(frozen=True)
class Quantity:
    """What the names of columns of a quantity look like, in lower case without accents.

    `kind`: what its unit is one of, a key of `UNIT_TABLE` where it has one.
    `names`: patterns, the surest first.
    `words`: places among columns of one pattern, the lowest first, by what else a name holds; 2 for
        names that hold none of it.
    """

    kind: str
    names: tuple[str, ...]
    words: tuple[tuple[str, int], ...] = ()


QUANTITIES: Mapping[str, Quantity] = MappingProxyType(
    {
        "relaxation_modulus": Quantity(
            "stress", (r"relax\w*.{0,3}mod|mod\w* (?:of|de) relax|(?<![a-z])[eg]\(t\)",)
        ),
        "loss_modulus": Quantity(
            "stress",
            (
                r"loss.?mod|verlustmod|(?<![a-z])[egm](?:''|\"|′′|’’|”)|imag.*mod|mod.*(?:imag|perte)",
            ),
        ),
        "storage_modulus": Quantity(
            "stress",
            (r"storage.?mod|speichermod|(?<![a-z])[egm]['′’]|real.*mod|mod.*(?:real|conserv)",),
        ),
        "attenuation": Quantity(
            "attenuation",
            (
                r"(?<![a-z])(?:log_?(?:10)?_?)?tan(?!g)|loss.?(?:factor|tangent)|verlustfaktor",
                r"1/q|q\^?[({]?-?1|inverse_?q|q_?inv",
                r"(?:loss|verlust|phase).?(?:angle|winkel)|phase|^(?:delta|δ) ?(?:[(\[]|$)",
                r"attenuation|loss|internal.?friction|^q$|quality.?factor|gutefaktor",
            ),
        ),
        "modulus": Quantity(
            "stress",
            (r"modul|\|[egm]\*?\||(?<![a-z])[egm]\*", r"^[ge](?![a-z])"),
            ((r"\||\*|complex|dynami|absol", 0),),
        ),
        "period": Quantity("time", (r"period|^t_?[o0](?![a-z0-9])",)),
        "frequency": Quantity(
            "frequency",
            (
                r"^(?!.*(?:ang|circular|omega|ω|kreis|winkel|rad)).*(?:freq|^f(?![a-z]))",
                r"freq|omega|ω|^w(?![a-z])|pulsation",
            ),
        ),
        "temperature": Quantity(
            "temperature",
            (r"temp(?!s(?![a-z]))|temps? ?[(\[]°?[cfk]|^t ?[(\[/_]? ?°?[kcf](?![a-z])",),
            (
                (r"room|ambient|(?<![a-z])(?:lab|air|box)|junction|raum", 4),
                (r"furnace|oven|ofen|heater|bath|four", 3),
                (r"sample|specimen|probe|echantillon", 0),
            ),
        ),
        "median_stress": Quantity("stress", (r"median|mean_?stress|bias",)),
        "amplitude": Quantity("stress", (r"(?<![a-z])ampl",)),
        "limit": Quantity("limit", (r"limit",)),
        "stress": Quantity(
            "stress",
            (
                r"stress|sigma|(?<![a-z])sig(?![a-z])|σ|(?<![a-z])tau|τ|deviator|spannung|contrainte|s_?diff"
                r"|^q ?[(\[_].*pa",
                r"^s_?1(?![0-9a-z])",
                r"load|force|pressure|pression|kraft|druck|charge",
            ),
            (
                (rf"{ENGINEERING}|(?<![a-z])raw(?![a-z])|uncorr", 3),
                (
                    r"diff|deviat|^q|^(?:δ|delta|d) ?_?(?:sigma|σ)|(?:sigma|σ)_?d(?![a-z])"
                    r"|(?:sigma|sig|σ|s)_?1 ?- ?(?:sigma|sig|σ|s)_?3",
                    0,
                ),
                (r"true|(?<![a-z])(?:ist|wahr|ax)|sample|actual|corr", 1),
                (r"^(?:sigma|sig|σ|s)_?1(?![0-9a-z])", 4),
            ),
        ),
        "strain": Quantity(
            "strain",
            (
                r"strain|(?<![a-z])eps|ε|shorten|dehnung|stauchung|gamma|γ|deformation|verformung|raccourc",
            ),
            (
                (rf"{ENGINEERING}|(?<![a-z])raw(?![a-z])|uncorr|machine", 3),
                (r"true|(?<![a-z])(?:log|ist|wahr|ax)|hencky|sample|actual|corr", 1),
            ),
        ),
        "time": Quantity(
            "time",
            (r"time|^t(?![a-z])|^(?:s|sec|h|hours?|min)$|zeit|temps|(?<![a-z])dauer|duree",),
            ((r"cycle|stage|segment|block|day", 3), (r"test|elapsed|total|run", 1)),
        ),
    }
)
"""Quantities; a column holds the first whose names look like its own."""

SHEAR = r"(?<![a-z])(?:g\(t\)|tau|gamma)|shear|schub|octahedral|τ|γ"
"""What the name of a column of shear has, which is no stress, strain or modulus along the axis."""

ALONG_AXIS = frozenset({"stress", "strain", "relaxation_modulus"})
"""Quantities that files take along the axis alone."""

FORCES = re.compile(r"load|force|pressure|pression|kraft|druck(?!spann)|charge")
"""What the name of a column has that is a stress only where its unit says so."""

ANGLES = re.compile(r"^(?!.*tan).*(?:angle|winkel|phase|^delta|^δ)")
"""What the name of a column of loss angles has, whose unit has to be said."""

ERRORS = re.compile(
    r"err|(?<![a-z])unc|std(?:ev|dev|_|$)|(?:^|[_ ])sd(?![a-z])|±|(?:^|[_ ])se(?:$|[_ (\[])"
)
"""What the name of a column of standard deviations looks like."""

LOGARITHM = re.compile(r"(?<![a-z])(?:log|ln)(?![a-z])|(?<![a-z])log_?10")
"""What the name of a column of logarithms looks like, which are read of attenuation alone."""
