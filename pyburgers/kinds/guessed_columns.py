"""Columns of a table matched to quantities and units, by their names and their numbers."""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.common.cells import has_date
from pyburgers.common.text_tables import TextTable
from pyburgers.common.units import UNIT_TABLE, Unit, counted, span_text
from pyburgers.kinds.column_names import (
    ALONG_AXIS,
    COLUMN_NAMES,
    CONFINING,
    LOGARITHM,
    OTHER_QUANTITIES,
    OTHER_WORDS,
    SET_POINT,
    SHEAR,
    error_in,
    kinds_in,
    plain,
    quantity_in,
    unit_of_name,
)

MIN_PERCENT, MAX_MEGAPASCAL, MAX_CELSIUS = 1.0, 1e5, 200.0
"""Numbers from which strain is taken as percent, and up to which stress as MPa, or temperature as
degrees Celsius, where names say nothing."""


BY_NAME, BY_NUMBERS, BY_NOTHING = "its name", "its numbers", "nothing; check it"
"""What says the unit of a column: a unit under its name is part of that."""


DIFFERENTIAL_PLACE, MIN_CONFINING_SHARE = 0, 0.05
"""Place of names of differential stresses; a stress beside the axis below this share is none."""


MAX_START_SHARE, MIN_END_SHARE = 0.05, 0.5
"""Of the largest stress: what the first of a test has at most, and the one before it at least."""


MAX_RELATIVE_DIFFERENCE = 1e-3
"""Relative difference of columns that hold the same numbers in different units."""


VALUE = re.compile(r"(?<![^\s:=])\d[\d.,e+-]* ?[^\W\d]+$", re.IGNORECASE)
"""Pattern of a number with its unit at the end, such as a duration: no unit of a column."""


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
        return self._is_below_0 or LOGARITHM.search(plain(self.name)) is not None

    @property
    def _is_below_0(self) -> bool:
        """Whether it holds attenuations that are all negative: weak ones may scatter about 0."""
        is_number = self.quantity == "attenuation" and self.unit is None
        return is_number and bool(np.nanmax(self.numbers) < 0)

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

    def at(self, rows: IntArray) -> "GuessedColumn":
        """Return the column at some rows, from 0."""
        rivals = tuple(one.at(rows) for one in self.rivals)
        return replace(self, numbers=self.numbers[rows], rivals=rivals)

    @property
    def goes_back(self) -> IntArray:
        """Rows, from 0, whose number is less than the one before."""
        there = np.flatnonzero(np.isfinite(self.numbers))
        return there[1:][np.diff(self.numbers[there]) < 0]

    @property
    def starts_again(self) -> IntArray:
        """Rows, from 0, whose number is about zero, as the first one, and far below the last."""
        size = np.abs(self.numbers)
        largest = float(np.nanmax(size))
        low, high = MAX_START_SHARE * largest, MIN_END_SHARE * largest
        return np.flatnonzero((size[1:] <= low) & (size[:-1] >= high) & (size[0] <= low)) + 1

    @property
    def sentence(self) -> str:
        """What was guessed."""
        unit = "" if self.unit is None else f" in {self.unit} (by {self.told_by})"
        if self.is_foreign:
            unit = " in a unit that experiment files do not know (by its name)"
        if self._is_below_0:
            unit = f" as logarithms to base 10 (by {BY_NUMBERS}; check it)"
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
    found = {q: _with_unit(table, column, q, is_chosen=True) for q, column in chosen.items()}
    for quantity, own in candidates.items():
        own.sort(key=lambda one: one[0])
        (place, first), *others = own
        is_tied = any(other == place and not _are_alike(first.si, one.si) for other, one in others)
        rivals = tuple(one for _, one in others)
        beside = confined_by(table, first.column) if quantity == "stress" else None
        found[quantity] = replace(first, rivals=rivals, is_decided=not is_tied, confined_by=beside)
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
            beside = f"its name states something else than {guessed.kind} in a unit that files know"
        if guessed.quantity == "frequency" and "period" in read:
            cycles = read["period"].si * guessed.si
            if not _are_alike(np.ones(cycles.size), cycles):
                beside += f"; times the period it is {np.nanmedian(cycles):.3g}, expected 1"
        reasons.setdefault(guessed.column, used.get(guessed.quantity, beside))
        for rival in guessed.rivals:
            reason = f"{guessed.column!r} is taken as the {guessed.says}"
            if not (guessed.is_foreign or rival.is_foreign):
                reason += _difference(guessed.si, rival.si)
            reasons[rival.column] = reason
    for column in table.columns:
        if column not in taken and not table.is_date_of(column, taken):
            name = plain(table.described(column))
            unit = " or ".join(sorted(kinds_in(name)))
            by_itself = (
                f"no quantity has such a name{f'; its unit is one of {unit}' if unit else ''}"
            )
            if OTHER_QUANTITIES.search(name):
                by_itself = f"its name is that of {OTHER_WORDS}"
                if CONFINING.search(name):
                    by_itself = "laws depend on one pressure at most, that of the key pressure_Pa"
                if numbers := table.numbers(column):
                    ends = span_text((min(numbers), max(numbers)), digits=6)
                    by_itself += f"; the column holds {ends}"
            if not table.numbers(column):
                cell = next(filter(None, table.cleaned(table.columns.index(column))), "")
                by_itself = f"it holds no numbers{f', but such as {cell[:20]!r}' if cell else ''}"
                if has_date(cell):
                    by_itself = "dates are read with the times of day beside them alone"
            yield f"column {column!r}, because {reasons.get(column, by_itself)}"


def units_in_comments(table: TextTable, read: Mapping[str, GuessedColumn]) -> Iterator[str]:
    """Say which lines ahead of a table state another unit than a column whose name states none."""
    parts = [
        (line, part, plain(part))
        for line, text in table.comments
        for part in map(str.strip, re.split(r"[,;\t]", text))
        if not VALUE.search(part)
    ]
    for quantity, guessed in read.items():
        if guessed.told_by not in (BY_NUMBERS, BY_NOTHING):
            continue
        for line, part, name in parts:
            is_about = quantity_in(name) == quantity and not OTHER_QUANTITIES.search(name)
            unit = unit_of_name(name, guessed.kind, is_chosen=True) if is_about else None
            if unit is not None and unit != guessed.unit:
                yield (
                    f"column {guessed.column!r} is taken in {guessed.unit}, but line {line} "
                    f"({part[:60]!r}) may state another unit: write the unit in the column's name"
                )


def first_of_tests(
    table: TextTable, columns: Mapping[str, GuessedColumn]
) -> tuple[Mapping[str, GuessedColumn], str | None]:
    """Return columns of the first of several tests, and what to check where the time goes back.

    Tests are told apart by a column that changes wherever the time, or else the strain, goes back,
    or else a stress starts again.
    """
    guide = columns.get("time", columns.get("strain"))
    if guide is None or {"period", "frequency"} & columns.keys():
        return columns, None
    back, does = guide.goes_back, "goes back"
    if not back.size and "time" not in columns and "stress" in columns:
        guide, does = columns["stress"], "starts again"
        back = guide.starts_again
    if not back.size:
        return columns, None
    line = f"{table.row_name} {table.rows[back[0]][0]}"
    taken = {guessed.column for guessed in columns.values()}
    others = [column for column in table.columns if column not in taken]
    for column in others if table.names is not None and 2 * back.size < len(table.rows) else ():
        cells = np.array(table.cells(table.columns.index(column)))
        if np.array_equal(back, np.flatnonzero(cells[1:] != cells[:-1]) + 1):
            key, cell = (json.dumps(str(text), ensure_ascii=False) for text in (column, cells[0]))
            return {name: one.at(np.arange(back[0])) for name, one in columns.items()}, (
                f"the {guide.says} {does} in {line}, where column {column!r} changes. If it "
                f"tells tests apart, read the first with rows = {{ {key} = {cell} }} in [data]"
            )
    if "time" not in columns:  # a strain may go back
        return columns, None
    return columns, (
        f"the time goes back in {counted(back.size, 'row')}, first in {line}: sort the rows, or "
        "keep those of one test"
    )


def sorted_by_time(columns: Mapping[str, GuessedColumn]) -> Mapping[str, GuessedColumn]:
    """Return columns in the order of a time that goes back; strains grow, as rows tell no way."""
    time = columns.get("time")
    if time is None or not time.goes_back.size:
        return columns
    rows = np.argsort(time.numbers, kind="stable")
    ordered = {name: one.at(rows) for name, one in columns.items()}
    if "strain" in columns:
        ordered["strain"] = columns["strain"].at(np.argsort(np.abs(columns["strain"].numbers)))
    return ordered


def _named(table: TextTable) -> dict[str | int, str]:
    """Return what each column that is known holds."""
    columns = table.columns
    if table.names is None and table.hidden_names is None:
        order = {2: ["strain", "stress"], 3: ["time", "strain", "stress"]}
        in_order = zip(columns, order.get(len(columns), ()), strict=False)
        return {column: quantity for column, quantity in in_order if table.numbers(column)}
    found: dict[str | int, str] = {}
    names = {column: plain(table.described(column)) for column in columns}
    own = {column: quantity_in(name) for column, name in names.items()}
    for column, name in names.items():
        of = error_in(name, [one for other, one in own.items() if other != column])
        quantity = None if OTHER_QUANTITIES.search(name) else of or own[column]
        if quantity is None and table.is_time_stamps(column):
            quantity = "time"
        if quantity is not None and table.numbers(column):
            found[column] = quantity + "_uncertainty" * (of is not None)
    held = {*found.values()}
    if "temperature" not in held and held & {"period", "frequency"}:
        # Beside periods a T is no time.
        found |= {column: "temperature" for column in found if table.described(column) == "T"}
    return found


def _place(guessed: GuessedColumn) -> tuple[float, ...]:
    """Return the place of a column among rivals, by its name and then its unit."""
    name = plain(guessed.name)
    patterns = COLUMN_NAMES[guessed.quantity.removesuffix("_uncertainty")]
    pattern = next((k for k, one in enumerate(patterns.names) if re.search(one, name)), 0)
    word = next((place for words, place in patterns.words if re.search(words, name)), 2)
    has_unit = guessed.told_by == BY_NAME and not guessed.is_foreign
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


def confined_by(table: TextTable, of_stress: str | int) -> str | int | None:
    """Return the column beside the axis that a column of stress may contain, if any."""
    stress = _with_unit(table, of_stress, "stress", is_chosen=True)
    if _place(stress)[2] == DIFFERENTIAL_PLACE:
        return None
    for column in table.columns:
        name = plain(table.described(column))
        is_pressure = CONFINING.search(name) or re.search(r"pressure|(?<!com)pression", name)
        is_other = OTHER_QUANTITIES.search(name) and "rate" not in name
        if column == stress.column or not (is_pressure or is_other):
            continue
        unit = unit_of_name(name, "stress", is_chosen=True)
        if unit is None and (CONFINING.search(name) or name.startswith("pressure")):
            unit = stress.unit
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
    numbers = np.array([np.nan if value is None else value for value in table.values(column)])
    name = table.described(column)
    kind = COLUMN_NAMES[quantity.removesuffix("_uncertainty")].kind
    found = GuessedColumn(quantity, column, name, None, BY_NAME, numbers)
    if table.is_time_stamps(column):
        return replace(found, unit="s", told_by="its time stamps")
    unit = unit_of_name(plain(name), kind, is_chosen=is_chosen)
    if quantity in ALONG_AXIS and not is_chosen and re.search(SHEAR, plain(name)):
        unit = ""
    if unit is None:
        by_numbers, told_by = _unit_of_numbers(kind, numbers[np.isfinite(numbers)])
        if "modulus" in quantity:
            by_numbers, told_by = "GPa", BY_NOTHING
        return replace(found, unit=by_numbers, told_by=told_by)
    return replace(found, unit=unit or None, is_foreign=not unit)


def _with_shared_unit(guessed: GuessedColumn, found: Mapping[str, GuessedColumn]) -> GuessedColumn:
    """Return a column with the unit that it shares with another, where its name says none."""
    other = found.get(guessed.shares_unit_with or "")
    if other is None or guessed.told_by == BY_NAME:
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
        return by_size[kind], BY_NUMBERS
    unit = {"time": "s", "frequency": "Hz"}.get(kind)
    return unit, BY_NAME if unit is None else BY_NOTHING
