"""What names of columns say: the quantity that a column holds, and its unit.

Names are compared in lower case and without accents; units are in `pyburgers.common.units`.
"""

import re
import unicodedata
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from pyburgers.common.units import FOREIGN_UNIT_NAMES, unit_in, unit_spelled

CONFINING = re.compile(
    r"confin|(?<![a-z])p?conf(?![a-z])|cell.?p|hydrostat|(?:seiten|mantel|umlagerungs|zell)druck"
    r"|(?<![a-z])gas.{0,2}p(?:ress|(?![a-z]))|(?:radial|lateral).?(?:stress|spannung)"
    r"|^(?:sigma|sig|σ|s)[_ ]?[23](?![0-9a-z])|^pc?(?=$| ?[(\[](?:[mgk]?pa|bar))"
)
"""Pattern of columns of the pressure on a sample, or of stresses across its axis."""


RATE = (
    r"(?<![a-z])(?:strain|stress|(?:def|ver|dehn|stauch)\w*)?.?rate(?![a-z])|(?<![a-z])taux"
    r"|eps\w*dot"
)
"""Pattern of columns of rates."""


OTHER_QUANTITIES = re.compile(
    rf"{RATE}"
    r"|^(?!.*freq|.*omega|.*ω|[fw](?![a-z])).*(?<!rad)(?:/ ?|(?= ?s\^?-1))s(?:ec|\^?-1)? ?[)\]]"
    rf"|{CONFINING.pattern}|^pc?(?![a-z])|pore|radial|lateral|quer|(?<![a-z])vol"
    r"|(?:oil|fluid|water|ambient).{0,2}press|compliance|viscos|strain.?ampl|vitesse|geschwindigkeit"
    r"|bulk.?mod|kompressionsmod|unrelax"
)
"""Pattern of columns that resemble a quantity and are another one: strain rates, compliances,
bulk and unrelaxed moduli, pressures and strains across the axis."""


OTHER_WORDS = "another quantity, such as a rate or what acts beside the axis"
"""What the columns of `OTHER_QUANTITIES` hold, in words."""


SET_POINT = (
    r"(?<![a-z])set(?![a-z])|setpoint|target|command|demand|(?<![a-z])(?:sp|soll)|sollwert|consigne"
)
"""Pattern of columns of set points, which are no readings."""


ENGINEERING = (
    r"engineering|nominal|(?<![a-z])(?:eng(?![a-z])|nenn)|technisch|ingenieur|conventionnel"
    r"|(?:load|force|kraft|(?<![a-z])[fp]) ?/ ?a_?0|(?<![a-z])[dδ]_?l ?/ ?l"
)
"""Pattern of columns of engineering stress or strain."""


PART_OF_STRAIN = r"plasti|elasti|permanent|residual|bleibend|creep|kriech|fluage|viscous"
"""Pattern of columns of a part of the strain."""


@dataclass(frozen=True)
class ColumnNames:
    """Patterns of the names that columns of one quantity have.

    `kind`: the kind of its unit, a key of `UNIT_TABLE`, or "limit", which has no unit.
    `names`: patterns, the surest first.
    `words`: patterns with ranks among rivals, of which the lowest counts; 2 without any word.
    """

    kind: str
    names: tuple[str, ...]
    words: tuple[tuple[str, int], ...] = ()


COLUMN_NAMES: Mapping[str, ColumnNames] = {
    "relaxation_modulus": ColumnNames(
        "stress", (r"relax\w*.{0,3}mod|mod\w* (?:of|de) relax|(?<![a-z])[eg]\(t\)",)
    ),
    "loss_modulus": ColumnNames(
        "stress",
        (r"loss.?mod|verlustmod|(?<![a-z])[egm](?:''|\"|′′|’’|”)|imag.*mod|mod.*(?:imag|perte)",),
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
            r"^(?!.*(?:ang|circular|omega|ω|kreis|winkel|rad)).*(?:freq|(?:^|log10 )f\b)",
            r"freq|omega|ω|^w(?![a-z])|pulsation",
        ),
    ),
    "temperature": ColumnNames(
        "temperature",
        (r"temp(?!s(?![a-z]))|temps? ?[(\[]°?[cfk]|^t ?[(\[/_]? ?(?:deg)?°?[kcf](?![a-z])",),
        (
            (r"room|ambient|(?<![a-z])(?:lab|air|box)|junction|raum", 4),
            (r"furnace|oven|ofen|heater|bath|four", 3),
            (r"sample|specimen|probe|echantillon", 0),
        ),
    ),
    "median_stress": ColumnNames(
        "stress", (r"median|mean.?stress|bias|mitt(?:el|lere.?)spannung|contrainte.?moyenne",)
    ),
    "amplitude": ColumnNames("stress", (r"(?<![a-z])ampl",)),
    "limit": ColumnNames("limit", (r"limit",)),
    "stress": ColumnNames(
        "stress",
        (
            r"stress|sigma|(?<![a-z])sig(?![a-z])|σ|(?<![a-z])tau|τ|deviator|spannung|contrainte|s_?diff"
            r"|^q ?[(\[_].*pa",
            r"^s_?1(?![0-9a-z])",
            r"load|force|pressure|(?<!com)pression|kraft|druck|charge",
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
            r"strain|(?<![a-z])eps|ε|shorten|dehnung|stauchung|gamma|γ|deformation|verformung|raccourc"
            r"|compression[ (\[]*(?:%|p)",
        ),
        (
            (rf"{ENGINEERING}|(?<![a-z])raw(?![a-z])|uncorr|machine", 3),
            (r"true|(?<![a-z])(?:log|ist|wahr|ax)|hencky|sample|actual|corr", 1),
        ),
    ),
    "time": ColumnNames(
        "time",
        (
            r"time|elapsed|^t(?![a-z])|^(?:s|sec|h|hours?|min|days)$|zeit|temps|(?<![a-z])dauer|duree",
        ),
        ((r"cycle|stage|segment|block|day", 3), (r"test|elapsed|total|run", 1)),
    ),
}
"""Patterns by quantity; a column holds the first quantity whose patterns match its name."""


SHEAR = (
    r"^(?!.*(?:√|sqrt|equiv|mises|vergleich)).*"
    r"(?:(?<![a-z])(?:g\(t\)|tau|gamma)|shear|schub|scher|cisaill|octahedral|τ|γ)"
)
"""Pattern of columns of shear, which hold no stress, strain or modulus along the axis."""


def deformation_in(name: str) -> str | None:
    """Return the deformation that the name of a modulus states."""
    letter = re.match(r"\|?([eg])(?![a-z])", name)
    if re.search(SHEAR, name) or (letter and letter[1] == "g"):
        return "shear"
    return "axial" if letter or "young" in name else None


ALONG_AXIS = frozenset({"stress", "strain", "relaxation_modulus"})
"""Quantities that files state along the axis alone."""


FORCES = re.compile(r"load|force|pressure|(?<!com)pression|kraft|druck(?!spann)|charge")
"""Pattern of columns that hold a stress only if their unit is one of stress."""


ANGLES = re.compile(r"^(?!.*tan).*(?:angle|winkel|phase|^delta|^δ)")
"""Pattern of columns of loss angles, whose unit has to be stated."""


ERRORS = re.compile(
    r"err|(?<![a-z])unc|^(?!.*(?:zeit|dauer)).*(?<![a-z])std(?![a-z])"
    r"|(?<![a-z])st(?:d|andard)?.{0,2}dev|(?:^|[_ ])sd(?![a-z])|±|(?:^|[_ ])se(?:$|[_ (\[])"
    r"|(?<![\d.])[12] ?_?(?:σ|sigma)(?![_ ]?\d)"
)
"""Pattern of columns of standard deviations; beside a German time, std are hours."""


ERROR_AHEAD = re.compile(
    r"^(?:abs\w* )?(?:err(?:or)?|unc(?:ert\w*)?|s[de]|st(?:d|andard)[ _.]*dev\w*|std)"
    r"(?![a-z])\.?[ _]*(?:(?:of|in|on|von|de)[ _]+)?(?:the )?"
)
"""Pattern of what stands ahead of the quantity in the name of a column of its errors."""


ERROR_SIGN = re.compile(r"^[dδσ][ _]?\(?([^()\[\] /]+)\)?(?=$|[ (\[])")
"""Pattern of a sign of an error ahead of a symbol: σ_G, dG; a stress may have such a name."""


OTHER_ERRORS = re.compile(r"(?<![\d.])2 ?_?(?:σ|sigma|s\.?[de](?![a-z]))|95 ?(?:%|percent|_?ci)")
"""Pattern of errors that are another multiple than one standard deviation."""


RELATIVE = r"(?<![a-z])rel"
SHARES = rf"{RELATIVE}|%|percent|prozent|pourcent|pct"
"""Pattern of relative errors, also in percent if the quantity is none in percent itself."""


LOGARITHM = re.compile(
    r"(?<![a-z])(?:log(?!g|i[ns]|o|s(?![a-z])|[a-z]*[ ._]*de[ck]rement)|ln(?![a-z]))"
)
"""Pattern of columns of logarithms, which are read for attenuation alone."""


STATED_UNIT = re.compile(r".*(?<![a-z])in (\S+)$|.*[(\[]([^()\[\]]*)[)\]]")
"""Pattern of the part of a name that is its unit: behind "in" at the end, or in brackets."""


NO_UNIT = re.compile(
    r"true|eng\w*|nominal|technisch|wahr\w*|log|hencky|ax\w*|diff\w*|deviat\w*|total|(?:un)?corr\w*|raw"
    r"|meas\w*|calc\w*|filt\w*|smooth\w*|abs\w*|avg|average|mean|median|sample|specimen|probe"
    r"|furnace|oven|ofen|room|ambient|lab|test|run|elapsed|stage|cycle|segment|block|of|the|at|from"
    r"|since|start|to|for|and|by|von|im|de|compress\w*|tensi\w*|pos\w*|neg\w*|(?:lvdt|tc|ch|ai|no|nr)\d*"
    r"|channel|sensor|gauge|set|target|soll|ist|actual|command\w*|dimensionless|unitless|none|complex"
    r"|internal|friction|loss|storage|modul\w*|real|imag\w*|shear|young\w*|stress|strain|time|temp\w*"
    r"|[teqgf]|1/s|s\^?-1|[α-ω][\w'*-]*|(?:sigma|sig|eps|tau|gamma|delta|phi|tan)[\w-]*|tan.*"
    r"|1/q\w*|q\w*\^?[{]?-1[}]?|\|?[egm]\*?\|?|[egm]['\"′’]+|sd|se|std|-*|\d[\d.:/-]*"
)
"""Pattern of words in brackets that state no unit."""


FACTOR = re.compile(
    r"(?<![\d.])10(?:\^|\*\*|-)-?\d(?!\d?-)|[x×*·] ?10\d|(?<![a-z\d.])1e-?\d"
    r"|(?:(?<![a-z])x|[×*·]) ?10+(?!\d)|(?<![a-z\d.])[\d.]*\d ?(?:x(?![a-z])|[×*·](?!\*))"
    r"|(?:[)\]%]|(?:[a-z]{3,}|[σεγτ])\w*) ?/ ?(?:2|10+)(?![\d/])|1⁄2|^\(?1/2(?![\d/])"
    r"|(?<![a-z])(?<!first )(?<!second )half"
    r"|peak.?to.?peak|pk-?pk|(?<![a-z])(?:p-p|rms)(?![a-z])|spitze.?spitze"
)
"""Pattern of a factor, such as of a half or an amplitude from peak to peak; a date has none."""


def plain(name: str) -> str:
    """Return a name in lower case, without accents and with plain signs."""
    parts = unicodedata.normalize("NFKD", name.lower().replace("º", "°"))
    letters = "".join(sign for sign in parts if not unicodedata.combining(sign))
    return letters.replace("\u2212", "-").replace("\u2013", "-")


def quantity_in(name: str) -> str | None:
    """Return the quantity that a name looks like, unless its unit is one of another."""
    kinds = kinds_in(name)
    for quantity, patterns in COLUMN_NAMES.items():
        if any(re.search(pattern, name) for pattern in patterns.names):
            if not kinds or patterns.kind in kinds:
                return quantity
            if re.search(FOREIGN_UNIT_NAMES.get(patterns.kind, "$^"), name):
                return quantity
    return None


def error_in(name: str, others: Collection[str | None]) -> str | None:
    """Return the quantity whose errors a column holds by its name; `others`: what is beside it."""
    if ERRORS.search(name):
        return quantity_in(ERROR_AHEAD.sub("", name)) or quantity_in(name)
    found = ERROR_SIGN.match(name)
    quantity = quantity_in(found[1]) if found else None
    is_modulus = quantity in ("modulus", "storage_modulus", "loss_modulus", "attenuation")
    return quantity if is_modulus and quantity in others else None


def kinds_in(name: str) -> set[str]:
    """Return kinds of the unit in brackets of a name; strain and angles alone count for none."""
    units = re.findall(r"[(\[] ?([^()\[\]]+?) ?[)\]]", name)

    def is_one_of(kind: str) -> bool:
        return bool(units) and unit_spelled(units[-1], kind) is not None

    kinds = {kind for kind in ("stress", "time", "temperature", "frequency") if is_one_of(kind)}
    return kinds | {"attenuation"} if kinds and is_one_of("angle") else kinds


def unit_in_name(name: str, kind: str) -> str | None:
    """Return the unit in a name, a key of `UNIT_TABLE`; empty for another one, None for none."""
    return unit_of_name(plain(name), kind, is_chosen=True)


def unit_of_name(name: str, kind: str, *, is_chosen: bool) -> str | None:
    """Return the unit in the name of a column, empty for one that files do not know, else None."""
    is_angle = kind == "attenuation" and ANGLES.search(name) is not None
    looks = "angle" if is_angle else kind
    unit, stated = unit_in(name, looks), stated_unit(name)
    has_factor = FACTOR.search(name) and not FACTOR.search(unit or "")
    is_other = kind != "attenuation" and (LOGARITHM.search(name) or has_factor)
    if is_other or (unit == "rad/s" and "hz" in name) or _is_other_error(name, kind):
        return ""
    if stated and kind not in ("limit", "strain rate"):
        return unit_spelled(stated, looks) or ""
    needs_unit = is_angle or (kind == "stress" and FORCES.search(name) and not is_chosen)
    if unit is None and (needs_unit or re.search(FOREIGN_UNIT_NAMES.get(looks, "$^"), name)):
        return ""
    return unit


def stated_unit(name: str) -> str:
    """Return the words of a name that can only be its unit, of which there may be none."""
    found = STATED_UNIT.match(name)
    words = re.split(r"[\s,;:]+", (found[1] or found[2] or "").strip()) if found else []
    if all(NO_UNIT.fullmatch(word) for word in words):
        return ""
    return " ".join(word for word in words if word[0].isdigit() or not NO_UNIT.fullmatch(word))


def _is_other_error(name: str, kind: str) -> bool:
    """Whether a name is that of an error that is no standard deviation of the quantity itself."""
    shares = {"strain": RELATIVE, "relative error": "$^"}.get(kind, SHARES)
    is_logarithm = kind == "attenuation" and LOGARITHM.search(name)
    is_other = OTHER_ERRORS.search(name) or re.search(shares, name) or is_logarithm
    return bool(ERRORS.search(name) and is_other)
