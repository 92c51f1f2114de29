"""The one place that matches names of columns to quantities and units.

Names are compared in lower case and without accents; units are in `pyburgers.common.units`.
"""

import re
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from pyburgers.common.array_types import FloatArray
from pyburgers.common.cells import as_number, has_date
from pyburgers.common.text_tables import TextTable
from pyburgers.common.units import FOREIGN_UNIT_NAMES, UNIT_TABLE, Unit, unit_in, unit_spelled

OTHER_QUANTITIES = re.compile(
    r"(?<![a-z])(?:strain|stress|(?:def|ver|dehn|stauch)\w*)?.?rate(?![a-z])|(?<![a-z])taux|eps\w*dot"
    r"|^(?!.*freq|.*omega|.*ω|[fw](?![a-z])).*(?<!rad)(?:/ ?|(?= ?s\^?-1))s(?:ec|\^?-1)? ?[)\]]"
    r"|confin|cell.?p|pore|radial|lateral|quer|(?<![a-z])vol|(?:seiten|mantel|umlagerungs|zell)druck"
    r"|(?:gas|oil|fluid|water|ambient).{0,2}press|hydrostat|compliance|viscos|strain.?ampl|vitesse|geschwindigkeit"
    r"|^(?:sigma|sig|σ|s)_?[23](?![0-9a-z])|^p(?:c|conf)?(?![a-z])"
)
"""Pattern of columns that resemble a quantity and are another one: strain rates, compliances,
pressures and strains across the axis."""


CONFINING = re.compile(r"confin|cell.?p|hydrostat|(?:seiten|mantel|umlagerungs|zell)druck")
"""Pattern of columns of the pressure on a sample."""


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
    `words`: patterns with ranks among rivals, of which the lowest counts; 2 without any word.
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
        "median_stress": ColumnNames("stress", (r"median|mean_?stress|bias",)),
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
                r"time|elapsed|^t(?![a-z])|^(?:s|sec|h|hours?|min)$|zeit|temps|(?<![a-z])dauer|duree",
            ),
            ((r"cycle|stage|segment|block|day", 3), (r"test|elapsed|total|run", 1)),
        ),
    }
)
"""Patterns by quantity; a column holds the first quantity whose patterns match its name."""


SHEAR = r"(?<![a-z])(?:g\(t\)|tau|gamma)|shear|schub|scher|cisaill|octahedral|τ|γ"
"""Pattern of columns of shear, which hold no stress, strain or modulus along the axis."""


ALONG_AXIS = frozenset({"stress", "strain", "relaxation_modulus"})
"""Quantities that files state along the axis alone."""


FORCES = re.compile(r"load|force|pressure|(?<!com)pression|kraft|druck(?!spann)|charge")
"""Pattern of columns that hold a stress only if their unit is one of stress."""


ANGLES = re.compile(r"^(?!.*tan).*(?:angle|winkel|phase|^delta|^δ)")
"""Pattern of columns of loss angles, whose unit has to be stated."""


ERRORS = re.compile(
    r"err|(?<![a-z])unc|std(?:ev|dev|_|$)|(?:^|[_ ])sd(?![a-z])|±|(?:^|[_ ])se(?:$|[_ (\[])"
    r"|(?<![\d.])[12] ?_?(?:σ|sigma)(?![_ ]?\d)"
)
"""Pattern of columns of standard deviations."""


OTHER_ERRORS = re.compile(
    r"(?<![a-z])rel|(?<![\d.])2 ?_?(?:σ|sigma|s\.?[de](?![a-z]))|95 ?(?:%|percent|_?ci)"
)
"""Pattern of errors that are relative, or another multiple than one standard deviation."""


SHARES = re.compile(r"%|percent|prozent|pourcent|pct")
"""Pattern of errors in percent, which are relative if the quantity is none in percent itself."""


LOGARITHM = re.compile(r"(?<![a-z])(?:log(?!g|i[ns]|o|s(?![a-z]))|ln(?![a-z]))")
"""Pattern of columns of logarithms, which are read for attenuation alone."""


STATED_UNIT = re.compile(r"[(\[]([^()\[\]]*)[)\]][^()\[\]]*$|(?<![a-z])in (\S+)$")
"""Pattern of the part of a name that is its unit: in the last brackets, or behind "in"."""


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


POWER_OF_TEN = re.compile(r"(?<![\d.])10(?:\^|\*\*|-)-?\d(?!\d?-)|[x×*·] ?10\d|(?<![a-z\d.])1e-?\d")
"""Pattern of units with a factor, which files do not know; a date has none."""


MIN_PERCENT, MAX_MEGAPASCAL, MAX_CELSIUS = 1.0, 1e5, 200.0
"""Numbers from which strain is taken as percent, and up to which stress as MPa, or temperature as
degrees Celsius, where names say nothing."""


DIFFERENTIAL_PLACE, MIN_CONFINING_SHARE = 0, 0.05
"""Place of names of differential stresses; a stress beside the axis below this share is none."""


MAX_RELATIVE_DIFFERENCE = 1e-3
"""Relative difference of columns that hold the same numbers in different units."""


@dataclass(frozen=True, eq=False)
class GuessedColumn:
    """A column of a text file.

    `quantity`, `column`, `name`: a key of `COLUMN_NAMES`, or that with ``_uncertainty``; its name
        or number from 1; its name with the unit under it.
    `unit`, `told_by`: its unit or None; its name, numbers, another column or nothing says so.
    `numbers` (n_rows,): what it holds in its unit; NaN where there is no number.
    `is_foreign`: whether its name has a unit that files do not know, or says logarithm.
    `rivals`, `is_decided`: other columns that may hold the quantity; whether it is put before them.
    `confined_by`: column of what acts beside a stress that may be the total one along the axis.
    """

    quantity: str
    column: str | int
    name: str
    unit: str | None
    told_by: str
    numbers: FloatArray
    is_foreign: bool = False
    rivals: "tuple[GuessedColumn, ...]" = ()
    is_decided: bool = True
    confined_by: str | int | None = None

    @property
    def kind(self) -> str:
        """What its unit is one of, a key of `UNIT_TABLE` where it has one."""
        return COLUMN_NAMES[self.quantity.removesuffix("_uncertainty")].kind

    @property
    def si(self) -> FloatArray:
        """Its numbers in SI, where units have factors, shape (n_rows,)."""
        unit = UNIT_TABLE.get(self.kind, UNIT_TABLE["angle"]).get(self.unit or "", Unit())
        return unit.zero + unit.factor * self.numbers

    @property
    def is_logarithm(self) -> bool:
        """Whether it holds logarithms to base 10, by its name or by numbers of attenuation."""
        is_below_0 = self.quantity == "attenuation" and bool((self.numbers < 0).any())
        return is_below_0 or LOGARITHM.search(_plain(self.name)) is not None

    @property
    def tan_delta(self) -> FloatArray:
        """Tan(delta) of a column of attenuation, shape (n_rows,)."""
        if self.unit is not None:
            return np.tan(self.si)
        return 10**self.numbers if self.is_logarithm else self.numbers

    @property
    def shares_unit_with(self) -> str | None:
        """Return the other quantity whose unit a file states for both, if there is one."""
        if self.quantity.endswith("_uncertainty"):
            return self.quantity.removesuffix("_uncertainty")
        return {"amplitude": "median_stress", "loss_modulus": "storage_modulus"}.get(self.quantity)

    @property
    def says(self) -> str:
        """What it holds, in words."""
        return self.quantity.replace("_", " ")

    @property
    def sentence(self) -> str:
        """What was guessed."""
        unit = "" if self.unit is None else f" in {self.unit} (by {self.told_by})"
        if self.is_foreign:
            unit = " in a unit that experiment files do not know (by its name)"
        return f"{self.says}: column {self.column!r}{unit}"


def guess_columns(
    table: TextTable, chosen: Mapping[str, str | int] = MappingProxyType({})
) -> dict[str, GuessedColumn]:
    """Return what columns hold, by quantity; their errors are under QUANTITY_uncertainty."""
    candidates: dict[str, list[tuple[tuple[float, ...], GuessedColumn]]] = {}
    by_name = {column: q for column, q in _named(table).items() if column not in chosen.values()}
    for column, quantity in by_name.items():
        if quantity not in chosen:
            guessed = _with_unit(table, column, quantity)
            candidates.setdefault(quantity, []).append((_place(guessed), guessed))
    found = {
        quantity: _with_unit(table, column, quantity, is_chosen=True)
        for quantity, column in chosen.items()
    }
    for quantity, own in candidates.items():
        own.sort(key=lambda one: one[0])
        (place, first), *others = own
        is_tied = any(other == place and not _are_alike(first.si, one.si) for other, one in others)
        rivals = tuple(one for _, one in others)
        confined_by = _confined_by(table, first) if quantity == "stress" else None
        found[quantity] = replace(
            first, rivals=rivals, is_decided=not is_tied, confined_by=confined_by
        )
    order = [*COLUMN_NAMES, *(f"{name}_uncertainty" for name in COLUMN_NAMES)]
    return {name: _with_shared_unit(found[name], found) for name in order if name in found}


def left_out(
    table: TextTable,
    columns: Mapping[str, GuessedColumn],
    read: Mapping[str, GuessedColumn],
    used: Mapping[str, str] = MappingProxyType({}),
) -> Iterator[str]:
    """Say which columns a file does not name, and why, a sentence each."""
    taken = {guessed.column for guessed in read.values()}
    reasons: dict[str | int, str] = {}
    for guessed in columns.values():
        beside = f"such a file names no {guessed.says} beside the columns that are taken"
        if guessed.is_foreign and guessed.quantity not in used:
            beside = f"its name states no unit of {guessed.kind} that files know"
        if guessed.quantity == "frequency" and "period" in read:
            beside += _difference(np.ones(guessed.si.size), read["period"].si * guessed.si)
        if guessed.quantity == "loss_modulus" and {"attenuation", "storage_modulus"} <= {
            *read,
            *columns,
        }:
            loss = read["attenuation"].tan_delta * columns["storage_modulus"].si
            beside += _difference(loss, guessed.si)
        reasons.setdefault(guessed.column, used.get(guessed.quantity, beside))
        for rival in guessed.rivals:
            reason = f"{guessed.column!r} is taken as the {guessed.says}"
            if {guessed.told_by, rival.told_by} == {"its name"}:
                reason += _difference(guessed.si, rival.si)
            reasons[rival.column] = reason
    for column in table.columns:
        if column not in taken:
            name = _plain(table.described(column))
            unit = " or ".join(sorted(_kinds_in(name)))
            by_itself = (
                f"no quantity has such a name{f'; its unit is one of {unit}' if unit else ''}"
            )
            if OTHER_QUANTITIES.search(name):
                by_itself = "its name is that of a rate, or of what acts beside the axis"
                if numbers := table.numbers(column):
                    ends = dict.fromkeys(f"{end:g}" for end in (min(numbers), max(numbers)))
                    by_itself += f"; it holds {' to '.join(ends)}"
            if CONFINING.search(name):
                by_itself = "laws depend on one pressure at most, which the key pressure_Pa states"
            if not table.numbers(column):
                by_itself = "it holds no numbers"
                if has_date(next(iter(table.cleaned(table.columns.index(column))), "")):
                    by_itself = "dates are read with the times of day beside them alone"
            yield f"column {column!r}, because {reasons.get(column, by_itself)}"


def _plain(name: str) -> str:
    """Return a name in lower case, without accents and with plain signs."""
    parts = unicodedata.normalize("NFKD", name.lower().replace("º", "°"))
    plain = "".join(sign for sign in parts if not unicodedata.combining(sign))
    return plain.replace("\u2212", "-").replace("\u2013", "-")


def _named(table: TextTable) -> dict[str | int, str]:
    """Return what each column that is known holds."""
    columns = table.columns
    if table.names is None and table.hidden_names is None:
        order = {2: ["strain", "stress"], 3: ["time", "strain", "stress"]}
        in_order = zip(columns, order.get(len(columns), ()), strict=False)
        return {column: quantity for column, quantity in in_order if table.numbers(column)}
    found: dict[str | int, str] = {}
    for column in columns:
        name = _plain(table.described(column))
        quantity = None if OTHER_QUANTITIES.search(name) else _quantity_of(name)
        if quantity is None and table.is_time_stamps(column):
            quantity = "time"
        if quantity is not None and table.numbers(column):
            found[column] = quantity + "_uncertainty" * bool(ERRORS.search(name))
    return found


def _quantity_of(name: str) -> str | None:
    """Return the quantity that a name looks like, unless its unit is one of another."""
    kinds = _kinds_in(name)
    for quantity, patterns in COLUMN_NAMES.items():
        if any(re.search(pattern, name) for pattern in patterns.names):
            if not kinds or patterns.kind in kinds:
                return quantity
            if re.search(FOREIGN_UNIT_NAMES.get(patterns.kind, "$^"), name):
                return quantity
    return None


def _kinds_in(name: str) -> set[str]:
    """Return kinds of the unit in brackets of a name; strain and angles alone count for none."""
    units = re.findall(r"[(\[] ?([^()\[\]]+?) ?[)\]]", name)

    def is_one_of(kind: str) -> bool:
        spellings = [unit.spelling for unit in UNIT_TABLE[kind].values()]
        return bool(units) and any(re.fullmatch(one, units[-1]) for one in spellings)

    kinds = {kind for kind in ("stress", "time", "temperature", "frequency") if is_one_of(kind)}
    return kinds | {"attenuation"} if kinds and is_one_of("angle") else kinds


def _place(guessed: GuessedColumn) -> tuple[float, ...]:
    """Return the place of a column among rivals, by its name and then its unit."""
    name = _plain(guessed.name)
    patterns = COLUMN_NAMES[guessed.quantity.removesuffix("_uncertainty")]
    pattern = next((k for k, one in enumerate(patterns.names) if re.search(one, name)), 0)
    word = next((place for words, place in patterns.words if re.search(words, name)), 2)
    has_unit = guessed.told_by == "its name" and not guessed.is_foreign
    is_set_point = re.search(SET_POINT, name) is not None
    return pattern, is_set_point, word, 0 if has_unit else 1 + guessed.is_foreign


def _are_alike(mine: FloatArray, yours: FloatArray) -> bool:
    """Whether two columns hold the same numbers in SI, be it in different units."""
    scale = float(np.nanmax(np.abs(mine), initial=0.0))
    near = MAX_RELATIVE_DIFFERENCE
    return bool(np.allclose(mine, yours, rtol=near, atol=near * scale, equal_nan=True))


def _difference(mine: FloatArray, yours: FloatArray) -> str:
    """Say by how much the numbers of a column that is left out differ; empty if they do not."""
    if _are_alike(mine, yours):
        return ""
    share = np.nanmax(np.abs(mine - yours)) / np.nanmax(np.abs(mine))
    return f"; the two differ by up to {share:.2g} of the largest number"


def _confined_by(table: TextTable, stress: GuessedColumn) -> str | int | None:
    """Return the column beside the axis that a column of stress may contain, if any."""
    if _place(stress)[2] == DIFFERENTIAL_PLACE:
        return None
    for column in table.columns:
        name = _plain(table.described(column))
        if column == stress.column or not OTHER_QUANTITIES.search(name) or "rate" in name:
            continue
        unit = _unit_in(name, "stress", is_chosen=True)
        if unit and table.numbers(column):
            beside = float(np.median(table.numbers(column))) * UNIT_TABLE["stress"][unit].factor
            least, largest = np.nanmin(stress.si), np.nanmax(stress.si)
            if MIN_CONFINING_SHARE * largest < beside <= (1 + MIN_CONFINING_SHARE) * least:
                return column
    return None


def _with_unit(
    table: TextTable, column: str | int, quantity: str, *, is_chosen: bool = False
) -> GuessedColumn:
    """Add the unit of a column, as its name or its numbers have it."""
    cells = map(as_number, table.cleaned(table.columns.index(column)))
    numbers = np.array([np.nan if value is None else value for value in cells])
    name = table.described(column)
    kind = COLUMN_NAMES[quantity.removesuffix("_uncertainty")].kind
    found = GuessedColumn(quantity, column, name, None, "its name", numbers)
    if table.is_time_stamps(column):
        return replace(found, unit="s", told_by="its time stamps")
    unit = _unit_in(_plain(name), kind, is_chosen=is_chosen)
    if quantity in ALONG_AXIS and not is_chosen and re.search(SHEAR, _plain(name)):
        unit = ""
    if unit is None:
        by_numbers, told_by = _unit_of_numbers(kind, numbers[np.isfinite(numbers)])
        return replace(found, unit=by_numbers, told_by=told_by)
    return replace(found, unit=unit or None, is_foreign=not unit)


def unit_in_name(name: str, kind: str) -> str | None:
    """Return the unit in a name, a key of `UNIT_TABLE`; empty for another one, None for none."""
    return _unit_in(_plain(name), kind, is_chosen=True)


def _unit_in(name: str, kind: str, *, is_chosen: bool) -> str | None:
    """Return the unit in the name of a column, empty for one that files do not know, else None."""
    is_angle = kind == "attenuation" and ANGLES.search(name) is not None
    looks = "angle" if is_angle else kind
    unit, stated = unit_in(name, looks), _stated_unit(name)
    is_other = kind != "attenuation" and (LOGARITHM.search(name) or POWER_OF_TEN.search(name))
    if is_other or (unit == "rad/s" and "hz" in name) or _is_other_error(name, kind):
        return ""
    if stated and kind != "limit":
        return unit_spelled(stated, looks) or ""
    needs_unit = is_angle or (kind == "stress" and FORCES.search(name) and not is_chosen)
    if unit is None and (needs_unit or re.search(FOREIGN_UNIT_NAMES.get(looks, "$^"), name)):
        return ""
    return unit


def _stated_unit(name: str) -> str:
    """Return the words of a name that can only be its unit, of which there may be none."""
    found = STATED_UNIT.search(name)
    words = re.split(r"[\s,;:]+", (found[1] or found[2] or "").strip()) if found else []
    if all(NO_UNIT.fullmatch(word) for word in words):
        return ""
    return " ".join(word for word in words if word[0].isdigit() or not NO_UNIT.fullmatch(word))


def _is_other_error(name: str, kind: str) -> bool:
    """Whether a name is that of an error that is no standard deviation of the quantity itself."""
    is_share = kind != "strain" and SHARES.search(name)
    is_logarithm = kind == "attenuation" and LOGARITHM.search(name)
    is_other = OTHER_ERRORS.search(name) or is_share or is_logarithm
    return bool(ERRORS.search(name) and is_other)


def _with_shared_unit(guessed: GuessedColumn, found: Mapping[str, GuessedColumn]) -> GuessedColumn:
    """Return a column with the unit that it shares with another, where its name says none."""
    other = found.get(guessed.shares_unit_with or "")
    if other is None or guessed.told_by == "its name":
        return guessed
    return replace(guessed, unit=other.unit, told_by=f"that of {other.column!r}")


def _unit_of_numbers(kind: str, numbers: FloatArray) -> tuple[str | None, str]:
    """Return the unit that numbers look like, and what says so."""
    largest = float(np.max(np.abs(numbers)))
    by_size = {
        "strain": "percent" if largest > MIN_PERCENT else "fraction",
        "stress": "MPa" if largest < MAX_MEGAPASCAL else "Pa",
        "temperature": "C" if largest < MAX_CELSIUS else "K",
    }
    if kind in by_size:
        return by_size[kind], "its numbers"
    unit = {"time": "s", "frequency": "Hz"}.get(kind)
    return unit, "its name" if unit is None else "nothing; check it"
