"""What the columns of a text file are, and their units: guessed from names and numbers."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from pyburgers.common.text_tables import TextTable

QUANTITIES: Mapping[str, str] = MappingProxyType(
    {
        "attenuation": r"tan|1/q|q-?1|inverse_?q|q_?inv|attenuation|loss",
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
        "frequency": (("Hz", "hz"),),
    }
)
"""Units as the names of columns have them, in lower case."""

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
        What says so: its name, its numbers, or nothing.
    """

    quantity: str
    column: str | int
    unit: str | None
    told_by: str

    @property
    def sentence(self) -> str:
        """What was guessed."""
        unit = "" if self.unit is None else f" in {self.unit} (by {self.told_by})"
        return f"{self.quantity.replace('_', ' ')}: column {self.column!r}{unit}"


def guess_columns(table: TextTable) -> dict[str, GuessedColumn]:
    """Guess what columns hold, by quantity; their errors are under QUANTITY_uncertainty.

    Of a file without names of two or three columns the last is taken as stress.
    """
    found: dict[str, GuessedColumn] = {}
    for column, quantity in _named(table).items():
        if quantity not in found:
            found[quantity] = _with_unit(table, column, quantity)
    return found


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
        quantity = next((q for q, looks in QUANTITIES.items() if re.search(looks, plain)), None)
        if quantity is not None and table.numbers(column):
            found[column] = quantity + "_uncertainty" * bool(ERRORS.search(plain))
    return found


def _with_unit(table: TextTable, column: str | int, quantity: str) -> GuessedColumn:
    """Add the unit of a column, as its name or its numbers have it."""
    names = table.names or table.hidden_names
    name = str(column) if names is None else names[table.columns.index(column)]
    kind = quantity.removesuffix("_uncertainty")
    kind = SAME_UNIT.get(kind, kind)
    for named, looks in UNITS.get(kind, ()):
        if re.search(looks, name.lower()):
            return GuessedColumn(quantity, column, named, "its name")
    unit, told_by = _unit_of_numbers(kind, table.numbers(column))
    return GuessedColumn(quantity, column, unit, told_by)


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
