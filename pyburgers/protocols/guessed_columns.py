"""What the columns of a text file are, and their units: guessed from names and numbers."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from pyburgers.common.text_tables import TextTable

OTHER_QUANTITIES = re.compile(
    r"rate(?![a-z])|confin|pore|radial|lateral|volum|loss.?modul|strain.?ampl"
)
"""What the name of a column has that is none of these, though it may look like one: strain rates,
pressures and strains beside the axis, loss moduli, which are no tan(delta)."""

QUANTITIES: Mapping[str, str] = MappingProxyType(
    {
        "attenuation": r"tan|1/q|q\^?[({]?-?1|q⁻¹|inverse_?q|q_?inv|attenuation|loss",
        "modulus": r"modulus|^[ge](?![a-z])",
        "period": r"period",
        "frequency": r"freq|^f(?![a-z])|omega",
        "temperature": r"temp|^t_?[kc](?![a-z])|^t ?[(\[]°?[kc]",
        "median_stress": r"median|mean_?stress|bias",
        "amplitude": r"(?<![a-z])ampl",
        "limit": r"limit",
        "stress": r"stress|sigma|σ|tau|τ|load|pressure",
        "strain": r"strain|eps|ε|gamma|γ|shorten|deformation",
        "time": r"time|^t(?![a-z])|^(?:s|sec|h|hours?|min)$",
    }
)
"""What the name of a column of each quantity looks like, in lower case; the first that fits."""

ERRORS = re.compile(r"err|unc|std|(?:^|[_ ])sd|±|(?:^|[_ ])se(?:$|[_ (\[])")
"""What the name of a column of standard deviations looks like."""

UNITS: Mapping[str, tuple[tuple[str, str], ...]] = MappingProxyType(
    {
        "strain": (("percent", r"percent|%|pct"), ("fraction", r"fraction|m/m|\(-\)|\[-\]")),
        "stress": (("GPa", "gpa"), ("MPa", "mpa"), ("Pa", r"(?<![a-z])pa(?![a-z])")),
        "time": (
            ("min", r"(?<![a-z])min"),
            ("h", r"hour|(?<![a-z])hr?s?(?![a-z])"),
            ("s", r"(?<![a-z])s(?:ec)?(?:onds?)?(?![a-z])"),
        ),
        "temperature": (
            ("C", r"celsius|°c|(?<![a-z])deg_?c|(?<![a-z])c(?![a-z])"),
            ("K", r"kelvin|(?<![a-z])k(?![a-z])"),
        ),
        "frequency": (("Hz", r"(?<![a-z])hz"),),
    }
)
"""Units as the names of columns have them, in lower case."""

FOREIGN_UNITS: Mapping[str, str] = MappingProxyType(
    {
        "strain": r"[mµμ](?:icro|illi)?_?(?:strain|[εϵ])|ppm|‰|10\^?-\d|1e-\d"
        r"|[mµμu]m/m(?!m)|(?<![a-z/])(?:mm|cm|µm|μm|um)(?![a-z/])",
        "stress": r"[khm]bar|(?<![a-z])(?:[kh]pa|psi|ksi|bar|atm|kn|kgf?|lbf?)(?![a-z])"
        r"|[(\[]n[)\]]|load_?n$",
        "time": r"day|week|month|year|(?<![a-z])(?:d|yrs?|[mµμun]s(?:ec)?)(?![a-z])",
        "temperature": r"fahrenheit|°f|(?<![a-z])f(?![a-z])",
        "frequency": r"(?<![a-z])[kmµμun]hz|rad|omega|ω",
        "attenuation": r"(?<![a-z])ln(?![a-z])|%|percent|10\^?-[2-9]|1e-\d",
    }
)
"""Units as the names of columns have them, in lower case, that experiment files do not know; an
angular frequency is one."""

LOGARITHM = re.compile(r"(?<![a-z])(?:log|ln)(?![a-z])|(?<![a-z])log_?10")
"""What the name of a column of logarithms looks like, which are read of attenuation alone."""

SAME_UNIT = {
    "modulus": "stress",
    "median_stress": "stress",
    "amplitude": "stress",
    "period": "time",
}
"""Quantities with the units of another."""

PERCENT_FROM, MEGAPASCAL_UP_TO, CELSIUS_UP_TO = 1.0, 1e5, 200.0
"""Numbers from which strain is taken as percent, and up to which stress as MPa, or temperature as
degrees Celsius, where names say nothing."""

LEAST_CYCLES = 2
"""Cycles from which values count as oscillating."""


@dataclass(frozen=True)
class GuessedColumn:
    """A column of a text file.

    Attributes
    ----------
    quantity : str
        What it holds, a key of `QUANTITIES`.
    column : str or int
        Its name, or its number from 1.
    unit : str or None
        Its unit; None where it has none.
    told_by : str
        What says so: its name, its numbers, the column that it shares its unit with, or nothing.
    is_foreign : bool
        Whether its name has a unit that experiment files do not know, or says that its numbers are
        logarithms; it has no unit then.
    """

    quantity: str
    column: str | int
    unit: str | None
    told_by: str
    is_foreign: bool = False

    @property
    def kind(self) -> str:
        """What its unit is one of, a key of `UNITS` where it has one."""
        return _kind_of(self.quantity)

    @property
    def shares_unit_with(self) -> str | None:
        """Return the other quantity whose unit a file states for both, if there is one."""
        if self.quantity.endswith("_uncertainty"):
            return self.quantity.removesuffix("_uncertainty")
        return "median_stress" if self.quantity == "amplitude" else None

    @property
    def sentence(self) -> str:
        """What was guessed."""
        unit = "" if self.unit is None else f" in {self.unit} (by {self.told_by})"
        if self.is_foreign:
            unit = " in a unit that experiment files do not know (by its name)"
        return f"{self.quantity.replace('_', ' ')}: column {self.column!r}{unit}"


def guess_columns(table: TextTable) -> dict[str, GuessedColumn]:
    """Guess what columns hold, by quantity; their errors are under QUANTITY_uncertainty.

    Of a file without names of two or three columns the last is taken as stress.
    """
    found: dict[str, GuessedColumn] = {}
    for column, quantity in _named(table).items():
        if quantity not in found:
            found[quantity] = _with_unit(table, column, quantity)
    return {quantity: _with_shared_unit(guessed, found) for quantity, guessed in found.items()}


def _named(table: TextTable) -> dict[str | int, str]:
    """Return what each column that is known holds."""
    columns = table.columns
    names = table.names or table.hidden_names
    if names is None:
        order = {2: ["strain", "stress"], 3: ["time", "strain", "stress"]}
        return dict(zip(columns, order.get(len(columns), ()), strict=False))
    found: dict[str | int, str] = {}
    for column, name in zip(columns, names, strict=True):
        plain = name.lower()
        if OTHER_QUANTITIES.search(plain):
            continue
        quantity = next((q for q, looks in QUANTITIES.items() if re.search(looks, plain)), None)
        if quantity is not None and table.numbers(column):
            found[column] = quantity + "_uncertainty" * bool(ERRORS.search(plain))
    return found


def _kind_of(quantity: str) -> str:
    """Return what the unit of a quantity, or of its error, is one of."""
    plain = quantity.removesuffix("_uncertainty")
    return SAME_UNIT.get(plain, plain)


def _with_unit(table: TextTable, column: str | int, quantity: str) -> GuessedColumn:
    """Add the unit of a column, as its name or its numbers have it."""
    names = table.names or table.hidden_names
    name = str(column) if names is None else names[table.columns.index(column)]
    plain, kind = name.lower(), _kind_of(quantity)
    is_logarithm = kind != "attenuation" and LOGARITHM.search(plain) is not None
    for named, looks in UNITS.get(kind, ()):
        if re.search(looks, plain) and not is_logarithm:
            return GuessedColumn(quantity, column, named, "its name")
    if is_logarithm or (kind in FOREIGN_UNITS and re.search(FOREIGN_UNITS[kind], plain)):
        return GuessedColumn(quantity, column, None, "its name", is_foreign=True)
    unit, told_by = _unit_of_numbers(kind, table.numbers(column))
    return GuessedColumn(quantity, column, unit, told_by)


def _with_shared_unit(guessed: GuessedColumn, found: Mapping[str, GuessedColumn]) -> GuessedColumn:
    """Return a column with the unit that it shares with another, where its name says none."""
    other = found.get(guessed.shares_unit_with or "")
    if other is None or guessed.told_by == "its name":
        return guessed
    return replace(guessed, unit=other.unit, told_by=f"that of {other.column!r}")


def _unit_of_numbers(kind: str, numbers: Sequence[float]) -> tuple[str | None, str]:
    largest = float(np.max(np.abs(numbers)))
    match kind:
        case "strain":
            return ("percent" if largest > PERCENT_FROM else "fraction"), "its numbers"
        case "stress":
            return ("MPa" if largest < MEGAPASCAL_UP_TO else "Pa"), "its numbers"
        case "temperature":
            return ("C" if largest < CELSIUS_UP_TO else "K"), "its numbers"
        case "time":
            return "s", "nothing; check it"
        case "frequency":
            return "Hz", "nothing; check it"
        case _:
            return None, "its name"


def numbers_of(
    table: TextTable, columns: Mapping[str, GuessedColumn], quantity: str
) -> npt.NDArray[np.float64]:
    """Return the numbers of the column of a quantity that is there."""
    return np.array(table.numbers(columns[quantity].column))


def goes_back_and_forth(values: npt.NDArray[np.float64]) -> bool:
    """Whether values oscillate about a straight trend."""
    return _crossings(values) >= 2 * LEAST_CYCLES


def _crossings(values: npt.NDArray[np.float64]) -> int:
    """How often values cross their straight trend."""
    place = np.arange(values.size)
    left = values - np.polyval(np.polyfit(place, values, 1), place)
    far = left[np.abs(left) > 0.2 * np.max(np.abs(left), initial=0.0)]
    return int(np.count_nonzero(np.diff(np.sign(far)) != 0))
