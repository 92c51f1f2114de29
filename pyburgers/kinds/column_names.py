"""Patterns of the names that columns of text files have, by quantity.

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
"""Pattern of columns that resemble a quantity and are another one: strain rates, compliances,
pressures and strains across the axis."""

SET_POINT = (
    r"(?<![a-z])set(?![a-z])|setpoint|target|command|demand|(?<![a-z])(?:sp|soll)|sollwert|consigne"
)
"""Pattern of columns of set points, which are no readings."""


ENGINEERING = r"engineering|nominal|(?<![a-z])eng(?![a-z])|technisch"
"""Pattern of columns of engineering stress or strain."""


@dataclass(frozen=True)
class ColumnNames:
    """Patterns of the names that columns of one quantity have.

    `kind`: the kind of its unit, a key of `UNIT_TABLE`, or "limit", which has no unit.
    `names`: patterns, the surest first.
    `words`: pairs of a pattern and a rank. If several columns match one of `names`, the lowest rank
        is taken; a name without any of the words has the rank 2.
    """

    kind: str
    names: tuple[str, ...]
    words: tuple[tuple[str, int], ...] = ()


COLUMN_NAMES: Mapping[str, ColumnNames] = MappingProxyType(
    {
        "relaxation_modulus": ColumnNames(
            "stress", (r"relax\w*.{0,3}mod|mod\w* (?:of|de) relax|(?<![a-z])[eg]\(t\)",)
        ),
        "loss_modulus": ColumnNames(
            "stress",
            (
                r"loss.?mod|verlustmod|(?<![a-z])[egm](?:''|\"|′′|’’|”)|imag.*mod|mod.*(?:imag|perte)",
            ),
        ),
        "storage_modulus": ColumnNames(
            "stress",
            (r"storage.?mod|speichermod|(?<![a-z])[egm]['′’]|real.*mod|mod.*(?:real|conserv)",),
        ),
        "attenuation": ColumnNames(
            "attenuation",
            (
                r"(?<![a-z])(?:log_?(?:10)?_?)?tan(?!g)|loss.?(?:factor|tangent)|verlustfaktor",
                r"1/q|q\^?[({]?-?1|inverse_?q|q_?inv",
                r"(?:loss|verlust|phase).?(?:angle|winkel)|phase|^(?:delta|δ) ?(?:[(\[]|$)",
                r"attenuation|loss|internal.?friction|^q$|quality.?factor|gutefaktor",
            ),
        ),
        "modulus": ColumnNames(
            "stress",
            (r"modul|\|[egm]\*?\||(?<![a-z])[egm]\*", r"^[ge](?![a-z])"),
            ((r"\||\*|complex|dynami|absol", 0),),
        ),
        "period": ColumnNames("time", (r"period|^t_?[o0](?![a-z0-9])",)),
        "frequency": ColumnNames(
            "frequency",
            (
                r"^(?!.*(?:ang|circular|omega|ω|kreis|winkel|rad)).*(?:freq|^f(?![a-z]))",
                r"freq|omega|ω|^w(?![a-z])|pulsation",
            ),
        ),
        "temperature": ColumnNames(
            "temperature",
            (r"temp(?!s(?![a-z]))|temps? ?[(\[]°?[cfk]|^t ?[(\[/_]? ?°?[kcf](?![a-z])",),
            (
                (r"room|ambient|(?<![a-z])(?:lab|air|box)|junction|raum", 4),
                (r"furnace|oven|ofen|heater|bath|four", 3),
                (r"sample|specimen|probe|echantillon", 0),
            ),
        ),
        "median_stress": ColumnNames("stress", (r"median|mean_?stress|bias",)),
        "amplitude": ColumnNames("stress", (r"(?<![a-z])ampl",)),
        "limit": ColumnNames("limit", (r"limit",)),
        "stress": ColumnNames(
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
        "strain": ColumnNames(
            "strain",
            (
                r"strain|(?<![a-z])eps|ε|shorten|dehnung|stauchung|gamma|γ|deformation|verformung|raccourc",
            ),
            (
                (rf"{ENGINEERING}|(?<![a-z])raw(?![a-z])|uncorr|machine", 3),
                (r"true|(?<![a-z])(?:log|ist|wahr|ax)|hencky|sample|actual|corr", 1),
            ),
        ),
        "time": ColumnNames(
            "time",
            (r"time|^t(?![a-z])|^(?:s|sec|h|hours?|min)$|zeit|temps|(?<![a-z])dauer|duree",),
            ((r"cycle|stage|segment|block|day", 3), (r"test|elapsed|total|run", 1)),
        ),
    }
)
"""Patterns by quantity; a column holds the first quantity whose patterns match its name."""

SHEAR = r"(?<![a-z])(?:g\(t\)|tau|gamma)|shear|schub|octahedral|τ|γ"
"""Pattern of columns of shear, which hold no stress, strain or modulus along the axis."""

ALONG_AXIS = frozenset({"stress", "strain", "relaxation_modulus"})
"""Quantities that files state along the axis alone."""

FORCES = re.compile(r"load|force|pressure|pression|kraft|druck(?!spann)|charge")
"""Pattern of columns that hold a stress only if their unit is one of stress."""

ANGLES = re.compile(r"^(?!.*tan).*(?:angle|winkel|phase|^delta|^δ)")
"""Pattern of columns of loss angles, whose unit has to be stated."""

ERRORS = re.compile(
    r"err|(?<![a-z])unc|std(?:ev|dev|_|$)|(?:^|[_ ])sd(?![a-z])|±|(?:^|[_ ])se(?:$|[_ (\[])"
)
"""Pattern of columns of standard deviations."""

LOGARITHM = re.compile(r"(?<![a-z])(?:log|ln)(?![a-z])|(?<![a-z])log_?10")
"""Pattern of columns of logarithms, which are read for attenuation alone."""
