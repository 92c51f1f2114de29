"""Readings of a loading history by stage, compression positive, and up to both ends of a stage."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field

from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.common.columns import Column, DataFile, TextFilesTable, read_columns
from pyburgers.common.errors import InputError
from pyburgers.common.units import UNITS, count_points, units_text
from pyburgers.kinds.experiment_file import MAX_DEPARTURE_SHARE, MaxReadings
from pyburgers.kinds.loading_history.driver import MAX_READINGS
from pyburgers.kinds.loading_history.stages import Driven, Stage, legs_of
from pyburgers.kinds.odd_readings import order_text

ROUNDING = 1e-14
"""Relative difference of equal times that were turned from different units into s."""


class HistoryDataTable(TextFilesTable):
    """The table [data]. An empty cell is no reading."""

    file: DataFile = Field(description="the data file")
    time_column: Column
    time_unit: str = Field(description=units_text("time"))
    stress_column: Column | None = None
    stress_unit: str | None = Field(None, description=units_text("stress"))
    stress_uncertainty: float | None = Field(
        None, gt=0, description="the standard deviation of a reading in the unit of the stress"
    )
    relaxation_strain: float | None = Field(
        None,
        gt=0,
        description="the strain (fraction) over which the stresses of the column are divided: it "
        "holds a modulus of relaxation",
    )
    strain_column: Column | None = None
    strain_unit: str | None = Field(None, description=units_text("strain"))
    strain_uncertainty: float | None = Field(
        None, gt=0, description="the standard deviation of a reading in the unit of the strain"
    )
    stage_column: Column | None = Field(
        None, description="the column that holds the number of the stage, from 1"
    )
    max_readings: MaxReadings = MAX_READINGS
    readings_in_file: int | None = Field(
        None, ge=0, description="the number of readings before an earlier thinning"
    )

    @property
    def is_copy(self) -> bool:
        """Whether the test was written out after it was read: what is judged then is judged."""
        return self.readings_in_file is not None

    def time_number(self, time: float) -> str:
        """Return a time (s) as it stands in the file."""
        return f"{time / UNITS['time'][self.time_unit]:g}"

    def time_text(self, time: float) -> str:
        """Return a time (s) as it stands in the file, with its unit."""
        return f"{self.time_number(time)} {self.time_unit}"


@dataclass(frozen=True, eq=False)
class Readings:
    """Rows of a table, in SI, each (n_rows,); NaN stands for no reading, compression is positive.

    `source`: the file, for messages; None for none.
    `time`, `stage`: seconds since the start of the first stage; from 0.
    `stress`, `strain`: Pa, fraction.
    `notes`: sentences about what was done to read them.
    """

    source: Path | None
    time: FloatArray
    stage: IntArray
    stress: FloatArray
    strain: FloatArray
    notes: tuple[str, ...] = ()

    def of(self, quantity: Driven, stage: int | None = None) -> tuple[FloatArray, FloatArray]:
        """Return times and values of the readings of a quantity, of all stages or of one."""
        values: FloatArray = getattr(self, quantity)
        there = np.isfinite(values)
        if stage is not None:
            there &= self.stage == stage
        return self.time[there], values[there]


Response = tuple[FloatArray, IntArray, FloatArray]
"""Times (s), stages from 0, and values (Pa, fraction) of the readings of the response."""


NO_READINGS = Readings(None, np.empty(0), np.empty(0, dtype=np.int64), np.empty(0), np.empty(0))


def read_readings(
    path: Path, data: HistoryDataTable, bounds: FloatArray, sign: int, held: float = 0.0
) -> Readings:
    """Read the table of a test, measures as in the file; `bounds` are ends of stages (s).

    `held`: the strain that stages impose before they hold it, compression positive; 0 if unknown.
    """
    columns: dict[str, tuple[str, str] | None] = {"time_column": ("time_unit", "time")}
    for quantity in ("stress", "strain"):
        _check_pair(path, data, quantity)
        if getattr(data, f"{quantity}_column") is not None:
            columns[f"{quantity}_column"] = (f"{quantity}_unit", quantity)
    if len(columns) == 1:
        raise InputError(
            f"{path}: key 'stress_column' or 'strain_column' in [data] is missing, expected the "
            "column of the response."
        )
    if data.stage_column is not None:
        columns["stage_column"] = None
    source = data.source(path)
    may_be_empty = ("stress_column", "strain_column")
    table, notes = read_columns(path, data, columns, may_be_empty=may_be_empty)
    time = _at_bounds(table["time_column"], bounds)
    nothing = np.full_like(time, np.nan)
    rows = f"{source}{data.selection}"
    stage = _stages(rows, data, time, bounds, table.get("stage_column"))
    _check_order(rows, data, time, stage)
    strain = sign * table.get("strain_column", nothing)
    stress = table.get("stress_column", nothing)
    if data.relaxation_strain is None:
        stress = sign * stress
    else:
        stated = data.relaxation_strain
        # A positive modulus gives stresses of the sign of the strain.
        stress = np.copysign(stated, held or np.nan_to_num(strain).sum()) * stress
        if held and abs(abs(held) - stated) > MAX_DEPARTURE_SHARE * abs(held):
            notes += (
                f"Key 'relaxation_strain' is {stated:g}, but the stages impose a strain of "
                f"{abs(held):g} before they hold it: check both.",
            )
    return Readings(source, time - bounds[0], stage, stress, strain, notes)


def responses(path: Path, readings: Readings, stages: Sequence[Stage]) -> Response:
    """Return times, stages and values of the response; a stage with rows has to have one."""
    is_strain = np.array([stage.driven == "stress" for stage in stages])
    value = np.where(is_strain[readings.stage], readings.strain, readings.stress)
    there = np.isfinite(value)
    for number in np.unique(readings.stage):
        if not there[readings.stage == number].any():
            imposed = stages[number].driven
            quantity = "strain" if imposed == "stress" else "stress"
            raise InputError(
                f"{path}: stage {number + 1} imposes a {imposed} but {readings.source} holds no "
                f"{quantity} in it, expected its response ('{quantity}_column' in [data]) or no "
                "rows at its times."
            )
    return readings.time[there], readings.stage[there], value[there]


def _check_pair(path: Path, data: HistoryDataTable, quantity: str) -> None:
    data.check_pairs(path, quantity)
    has_unit = getattr(data, f"{quantity}_unit") is not None
    if getattr(data, f"{quantity}_uncertainty") is not None and not has_unit:
        raise InputError(
            f"{path}: key '{quantity}_uncertainty' in [data]: found it without "
            f"'{quantity}_column', expected both or neither."
        )


def _at_bounds(time: FloatArray, bounds: FloatArray) -> FloatArray:
    """Return times, those of bounds exactly where only rounding tells them apart."""
    for bound in bounds:
        time = np.where(np.abs(time - bound) <= ROUNDING * abs(bound), bound, time)
    return time


def _stages(
    rows: str,
    data: HistoryDataTable,
    time: FloatArray,
    bounds: FloatArray,
    numbers: FloatArray | None,
) -> IntArray:
    """Stage of every row; a row at the time of a change belongs to the later stage."""
    column = data.stage_column
    outside = np.flatnonzero((time < bounds[0]) | (time > bounds[-1]))
    if outside.size:
        raise InputError(
            f"{rows}: {count_points(outside.size)} outside every stage, the first at "
            f"{data.time_text(time[outside[0]])} (data row {outside[0] + 1}), expected times "
            f"between {data.time_number(bounds[0])} and {data.time_text(bounds[-1])}: add what was "
            "imposed there as a stage."
        )
    if numbers is None:
        return np.clip(np.searchsorted(bounds, time, side="right") - 1, 0, bounds.size - 2)
    n_stages = bounds.size - 1
    unknown = np.flatnonzero(~np.isin(numbers, np.arange(1, bounds.size)))
    if unknown.size:
        expected = f"a whole number from 1 to {n_stages}" if n_stages > 1 else "1, the only stage"
        raise InputError(
            f"{rows}: stage column {column!r}, data row {unknown[0] + 1}: found "
            f"{numbers[unknown[0]]:g}, expected {expected}."
        )
    stage = numbers.astype(np.int64) - 1
    wrong = np.flatnonzero((time < bounds[stage]) | (time > bounds[stage + 1]))
    if wrong.size:
        k = stage[wrong[0]]
        raise InputError(
            f"{rows}: stage column {column!r}, data row {wrong[0] + 1}: found {k + 1} at "
            f"{data.time_text(time[wrong[0]])}, expected times from "
            f"{data.time_number(bounds[k])} to {data.time_text(bounds[k + 1])} in that stage."
        )
    return stage


def _check_order(rows: str, data: HistoryDataTable, time: FloatArray, stage: IntArray) -> None:
    """Refuse rows that go back; several readings of one moment go with what is constant."""
    wrong = np.flatnonzero((np.diff(stage) < 0) | (np.diff(time) < 0))
    if wrong.size:
        k = int(wrong[0])
        raise InputError(
            f"{rows}: data row {k + 2}: the time {data.time_text(time[k + 1])} comes after "
            f"{data.time_text(time[k])}, expected times that do not go back within a stage."
            f"{order_text(time)}"
        )


def one_reading_each(
    source: Path | None, time: FloatArray, value: FloatArray, text: Callable[[float], str]
) -> tuple[FloatArray, FloatArray]:
    """Return readings (n,) that drive a stage, of equal ones of one moment the first."""
    again = np.diff(time, prepend=-np.inf) == 0
    if np.any(again[1:] & (np.diff(value) != 0)):
        moments, counts = np.unique(time[again], return_counts=True)
        listed = ", ".join(
            f"{text(moment)} ({count + 1} readings)"
            for moment, count in zip(moments, counts, strict=True)
        )
        raise InputError(
            f"{source}: found times that occur more than once with different readings, {listed}; "
            "expected one reading of a moment, because these drive the stage: if the times were "
            "rounded, write them in full; if one moment was read several times, write the mean; if "
            'the stress is constant, impose it (control = "stress"), and all readings are kept.'
        )
    return time[~again], value[~again]


MAX_GAP_SHARE = 0.05
"""Share of a stage at either end in which nothing need be read; more where readings lie as far
apart."""


TIME_ROUNDING = 1e-9
"""Relative error of differences of times."""


@dataclass(frozen=True, eq=False)
class Series:
    """What was read of a quantity over a stage: s since the start of the test; Pa or fraction.

    `time`, `value` (n,): the first and the last are at the ends of the stage.
    `n_read`, `gaps`: readings among them; shares of the stage before the first and after the last.
    """

    time: FloatArray
    value: FloatArray
    n_read: int
    gaps: tuple[float, float]

    @property
    def unread(self) -> str:
        """Words about the ends in which nothing was read, to follow a sentence; empty for none."""
        ends = [
            f"its {name} {100 * gap:.2g} %"
            for name, gap in zip(("first", "last"), self.gaps, strict=True)
            if gap > 0
        ]
        return f" Nothing was read in {' and '.join(ends)}." if ends else ""


def own_readings(
    readings: Readings,
    quantity: Driven,
    stage: int,
    span: tuple[float, float],
    shared: tuple[bool, bool],
) -> tuple[FloatArray, FloatArray]:
    """Return times (s) and values of the readings that are of a stage; `span` are its ends (s)."""
    time, value = readings.of(quantity, stage)
    every, values = readings.of(quantity)
    for end, nothing_jumps in zip(span, shared, strict=True):
        there = np.flatnonzero(every == end)
        if nothing_jumps and there.size and end not in time:
            place = int(np.searchsorted(time, end))
            time = np.insert(time, place, end)
            value = np.insert(value, place, values[there[0]])
    return time, value


def too_long_a_gap(time: FloatArray, span: tuple[float, float]) -> bool:
    """Whether readings (s) leave more of an end of a stage out than they may."""
    start, end = span
    allowed = MAX_GAP_SHARE * (end - start)
    spacing = np.diff(time)
    return bool(
        time[0] - start > max(allowed, spacing[0]) * (1 + TIME_ROUNDING)
        or end - time[-1] > max(allowed, spacing[-1]) * (1 + TIME_ROUNDING)
    )


def with_ends(
    readings: Readings,
    quantity: Driven,
    own: tuple[FloatArray, FloatArray],
    span: tuple[float, float],
) -> Series:
    """Add values at the ends of a stage (s) where none was read; at least two readings are."""
    time, value = own
    n_read, duration = time.size, span[1] - span[0]
    gaps = float(time[0] - span[0]) / duration, float(span[1] - time[-1]) / duration
    beside = np.interp(span, *readings.of(quantity))
    if gaps[0] > 0:
        first = _gone_on(time[1::-1], value[1::-1], span[0], beside[0])
        time, value = np.insert(time, 0, span[0]), np.insert(value, 0, first)
    if gaps[1] > 0:
        last = _gone_on(time[-2:], value[-2:], span[1], beside[1])
        time, value = np.append(time, span[1]), np.append(value, last)
    return Series(time, value, n_read, gaps)


def _gone_on(time: FloatArray, value: FloatArray, end: float, beside: float) -> float:
    """Value at an end of a stage (s) to which the line through two readings is drawn on.

    Not beyond `beside`, so that a ramp goes on and a jump does not; nor over a time longer than
    theirs.
    """
    share = (end - time[1]) / (time[1] - time[0])
    if share > 1 + TIME_ROUNDING:
        return float(value[1])
    drawn = value[1] + share * (value[1] - value[0])
    return float(np.clip(drawn, min(value[1], beside), max(value[1], beside)))


def strain_at_start(
    before: Sequence[Stage], readings: Readings, zero: float, *, read_there: bool
) -> tuple[float, float] | None:
    """Return the true strain of the sample at the end of stages, and its slack.

    None where stress was imposed and no strain read. After an imposed stress the strain is the last
    reading, without the zero of the readings, and what was imposed since. Its slack is the change
    from the reading before, for the time that stress was imposed after it; else 0.
    """
    loaded = [number for number, stage in enumerate(before) if stage.driven == "stress"]
    if not loaded:
        return _imposed(before, 0.0), 0.0
    last, now = loaded[-1], before[-1].end_time
    there = (readings.stage >= last) & (readings.time <= now) & np.isfinite(readings.strain)
    there &= (readings.stage < len(before)) | read_there
    time, strain = readings.time[there], readings.strain[there] - zero
    if time.size == 0:
        return None
    value = float(strain[-1]) + _imposed(before[last + 1 :], float(time[-1]))
    earlier = np.flatnonzero(time < time[-1])
    if earlier.size == 0:
        return value, abs(float(strain[0]))
    k = earlier[-1]
    longer = (before[last].end_time - time[-1]) / (time[-1] - time[k])
    return value, float(abs(strain[-1] - strain[k]) * max(1.0, longer))


def _imposed(stages: Sequence[Stage], since: float) -> float:
    """Strain that stages impose after a time (s)."""
    return sum(
        leg.rate * max(0.0, leg.end_time - max(leg.start_time, since)) for leg in legs_of(stages)
    )
