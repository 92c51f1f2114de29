"""What a file says is imposed, as stages: the tables [[stages]]."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.common.units import counted, span_text
from pyburgers.kinds.loading_history.driver import (
    TOLERANCE,
    TURNED_TOLERANCE,
    line_through,
    looked_at,
    reading_error,
    scatter,
    tolerance_of,
    tolerances,
)
from pyburgers.kinds.loading_history.readings import (
    Readings,
    Series,
    one_reading_each,
    own_readings,
    strain_at_start,
    too_long_a_gap,
    with_ends,
)
from pyburgers.kinds.loading_history.stages import (
    DRIVEN,
    Control,
    Driven,
    Measure,
    Stage,
    StageTable,
    check_keys,
    legs_of,
)
from pyburgers.kinds.loading_history.true_readings import true_stress

DISPLACEMENT_STEP = 0.01
"""At constant displacement rate the true strain rate changes with the length: legs this long in
true strain follow it to half a percent."""


@dataclass(frozen=True, eq=False)
class StageSource:
    """What stages are read with: how the numbers of a file are meant, and what was read.

    `path`, `temperature`: the file, for messages; K, of stages that name none.
    `time_unit`, `second`, `pascal`: of times in [[stages]], in s; of stresses there, in Pa.
    `sign`, `stress_measure`, `strain_measure`: of a compression; true or engineering.
    `bounds` (n_stages + 1,): starts of stages and the last end (s on the clock of the file).
    `readings`: true ones.
    `stress_error`, `strain_error`: stated standard deviations of readings (Pa, fraction).
    `first_strain`, `compliance`: zero of strain and its error; of the apparatus (1/Pa).
    """

    path: Path
    temperature: float
    time_unit: str
    second: float
    pascal: float
    sign: int
    stress_measure: Measure
    strain_measure: Measure
    bounds: FloatArray
    readings: Readings
    stress_error: float | None
    strain_error: float | None
    first_strain: tuple[float, float]
    compliance: float

    def time_text(self, time: float) -> str:
        """Return a time since the start of the test (s) on the clock of the file, in its unit."""
        return f"{(time + self.bounds[0]) / self.second:g} {self.time_unit}"


def stage_bounds(path: Path, tables: Sequence[StageTable], time_factor: float) -> FloatArray:
    """Return starts of the stages and the end of the last (s), which leave no gap or overlap."""
    for number, table in enumerate(tables, start=1):
        if table.end_time <= table.start_time:
            raise InputError(
                f"{path}: key 'end_time' in [[stages]] number {number}: found {table.end_time:g}, "
                f"expected more than {table.start_time:g}, where the stage starts."
            )
        before = tables[number - 2].end_time if number > 1 else table.start_time
        if table.start_time != before:
            what = "an overlap" if table.start_time < before else "a gap"
            raise InputError(
                f"{path}: key 'start_time' in [[stages]] number {number}: found "
                f"{table.start_time:g}, {what}, expected {before:g}, where the stage before ends."
            )
    times = [*(table.start_time for table in tables), tables[-1].end_time]
    return np.array(times) * time_factor


def read_stages(
    test: StageSource, tables: Sequence[StageTable]
) -> tuple[tuple[Stage, ...], list[str]]:
    """Return the stages, and sentences about what was turned or smoothed."""
    stages: list[Stage] = []
    notices: list[str] = []
    for number, table in enumerate(tables):
        check_keys(test.path, number, table)
        after = tables[number + 1] if number + 1 < len(tables) else None
        strain_follows = after is not None and DRIVEN[after.control] == "strain"
        reader = _StageReader(test, table, tables[:number], tuple(stages), strain_follows, notices)
        stages.append(reader.read())
    return tuple(stages), notices


def check_given_strains(
    source: StageSource, tables: Sequence[StageTable], stages: Sequence[Stage]
) -> None:
    """Refuse knots of strain that do not start where earlier stages end."""
    for number, (table, stage) in enumerate(zip(tables, stages, strict=True)):
        if table.knots is not None and stage.driven == "strain":
            values = [value for _, value in stage.knots]
            allowed = TURNED_TOLERANCE * float(np.ptp(values))
            _check_jump(source, stages[:number], values[0], allowed, given=True)


def _check_jump(
    source: StageSource,
    before: Sequence[Stage],
    strain: float,
    tolerance: float,
    *,
    given: bool = False,
) -> None:
    """Refuse a series that jumps in strain; knots, `given`, may hold the zero of the readings."""
    zero, sd = source.first_strain
    start = strain_at_start(before, source.readings, zero, read_there=False)
    if start is None:
        return
    value, slack = start
    jumps = [strain - zero - value, *([strain - value] if given else [])]
    if min(map(abs, jumps)) > tolerance + slack + TOLERANCE * sd:
        raise InputError(
            f"{source.path}: [[stages]] number {len(before) + 1}: found a jump of the strain, from "
            f"{zero + value:g} to {strain:g}, expected a series that starts where the strain "
            "is (a zero of strain stands in [strain_offset])."
        )


def _given_end(tables: Sequence[StageTable]) -> float | None:
    """Return the stress at the end of stages, in their unit, as far as keys alone say it."""
    if not tables:
        return 0.0
    *before, last = tables
    if last.control == "stress":
        return last.stress
    if last.control != "stress_rate":
        return None
    start = last.start_stress if last.start_stress is not None else _given_end(before)
    duration = last.end_time - last.start_time
    return None if start is None else start + (last.stress_rate or 0.0) * duration


@dataclass(frozen=True, eq=False)
class _StageReader:
    """Reads the next stage, given those before it."""

    test: StageSource
    table: StageTable
    tables_before: Sequence[StageTable]
    before: Sequence[Stage]
    strain_follows: bool
    notices: list[str]

    @property
    def number(self) -> int:
        """From 1."""
        return len(self.before) + 1

    @property
    def where(self) -> str:
        return f"{self.test.path}: [[stages]] number {self.number}"

    @property
    def start(self) -> float:
        return float(self.test.bounds[self.number - 1] - self.test.bounds[0])

    @property
    def end(self) -> float:
        return float(self.test.bounds[self.number] - self.test.bounds[0])

    def read(self) -> Stage:
        table, test = self.table, self.test
        sign, stress = test.sign, test.sign * test.pascal
        match table.control:
            case "hold_strain":
                return self._stage("hold_strain")
            case "strain_rate":
                rate = sign * (table.strain_rate_per_s or 0.0)
                if test.strain_measure == "engineering":
                    return self._displacement(rate)
                return self._stage("strain_rate", value=rate)
            case "stress":
                return self._load(stress * (table.stress or 0.0), 0.0)
            case "stress_rate":
                rate = stress * (table.stress_rate or 0.0) / test.second
                return self._load(self._start_stress(stress), rate)
            case _:
                if table.knots is None:
                    return self._measured_series()
                return self._given_series(table.knots, stress)

    def _stage(
        self,
        control: Control,
        value: float = 0.0,
        start_stress: float | None = None,
        knots: tuple[tuple[float, float], ...] = (),
    ) -> Stage:
        own = self.table.temperature_K
        temperature = self.test.temperature if own is None else own
        return Stage(control, self.start, self.end, temperature, value, start_stress, knots)

    def _series(self, control: Control, time: FloatArray, value: FloatArray) -> Stage:
        knots = tuple(zip(time.tolist(), value.tolist(), strict=True))
        return self._stage(control, knots=knots)

    def _start_stress(self, factor: float) -> float:
        """Stress (Pa) at which a rate starts: the key, or where the stage before ends."""
        if self.table.start_stress is not None:
            return factor * self.table.start_stress
        is_true = self.test.stress_measure == "true"
        if is_true and self.before and self.before[-1].driven == "stress":
            return legs_of(self.before)[-1].end_value
        given = _given_end(self.tables_before)
        if given is not None:
            return factor * given
        raise InputError(
            f"{self.where}: key 'start_stress' is missing, expected the stress at the start: "
            f"the stage before has control {self.tables_before[-1].control!r}."
        )

    def _load(self, start: float, rate: float) -> Stage:
        """Stress given by its start (Pa) and rate (Pa/s); as a series where it is a force."""
        # No force is no stress, whatever the area.
        is_force = self.test.stress_measure == "engineering" and (start != 0 or rate != 0)
        if not is_force or self.test.readings.source is None:
            stage = (
                self._stage("stress", value=start)
                if self.table.control == "stress"
                else self._stage("stress_rate", value=rate, start_stress=start)
            )
            return replace(stage, is_force=is_force)
        series = self._readings("strain", "the area under the force")
        time, strain = series.time, series.value - self.test.first_strain[0]
        force = start + rate * (time - self.start)
        value = true_stress(force, strain, self.test.compliance, where=self.where)
        stated = self.test.strain_error
        error = reading_error(time, value) if stated is None else stated * np.abs(value).max()
        corners, line = line_through(*looked_at(time, value), tolerance_of(value, error))
        self.notices.append(
            f"Stage {self.number}: the force over the first area became a true stress in "
            f"{counted(corners.size - 1, 'leg')}, by the measured strain.{series.unread}"
        )
        return self._series("stress_series", corners, line)

    def _displacement(self, rate: float) -> Stage:
        """Constant displacement rate: over the first length (1/s), as legs of true strain."""
        zero = self.test.first_strain[0]
        start = strain_at_start(self.before, self.test.readings, zero, read_there=True)
        if start is None:
            raise InputError(
                f"{self.where}: found an engineering strain rate after an imposed stress without a "
                "reading of the strain, expected 'strain_column' in [data] to tell the length."
            )
        first = -np.expm1(-start[0])
        last = first + rate * (self.end - self.start)
        if last >= 1:
            raise InputError(
                f"{self.where}: found an engineering strain of {last:g} at its end, expected less "
                "than 1 in compression."
            )
        n_legs = int(np.ceil(abs(np.log((1 - last) / (1 - first))) / DISPLACEMENT_STEP))
        time = np.linspace(self.start, self.end, max(n_legs, 1) + 1)
        strain = -np.log1p(-(first + rate * (time - self.start)))
        self.notices.append(
            f"Stage {self.number}: a constant displacement rate became true strain rates in "
            f"{counted(time.size - 1, 'leg')}."
        )
        return self._series("strain_series", time, strain)

    def _given_series(self, knots: Sequence[Sequence[float]], stress: float) -> Stage:
        """Corners as they stand in the file."""
        test, control = self.test, self.table.control
        quantity = DRIVEN[control]
        strain_driven = quantity == "strain"
        measure = test.strain_measure if strain_driven else test.stress_measure
        key = f"{self.where}: key 'knots'"
        if measure == "engineering":
            raise InputError(
                f"{key}: found it with key '{quantity}_measure' 'engineering', expected knots of a "
                "true measure."
            )
        wrong = next((knot for knot in knots if len(knot) != 2), None)
        if wrong is not None:
            raise InputError(f"{key}: found {wrong}, expected pairs of a time and a value.")
        if len(knots) < 2:
            raise InputError(
                f"{key}: found {len(knots)} of them, expected at least two, one at each end of the "
                "stage."
            )
        if self.table.tolerance is not None:
            raise InputError(
                f"{self.where}: key 'tolerance': found it beside 'knots', expected it for readings "
                "alone, since knots are taken as they are."
            )
        given, value = np.transpose(knots)
        if given[0] != self.table.start_time or given[-1] != self.table.end_time:
            raise InputError(
                f"{key}: found times from {given[0]:g} to {given[-1]:g}, expected the ends of the "
                f"stage, {self.table.start_time:g} and {self.table.end_time:g}."
            )
        if np.any(np.diff(given) <= 0):
            repeated = given[1:][np.diff(given) <= 0][0]
            raise InputError(
                f"{key}: found the time {repeated:g} after a time that is not earlier, expected "
                "times that increase."
            )
        time = given * test.second - test.bounds[0]
        value = (test.sign if strain_driven else stress) * value
        return self._series(control, time, value)

    def _measured_series(self) -> Stage:
        """Legs through readings."""
        quantity = DRIVEN[self.table.control]
        strain_driven = quantity == "strain"
        series = self._readings(quantity, "what is imposed")
        time, value = series.time, series.value
        stated = self.test.strain_error if strain_driven else self.test.stress_error
        if strain_driven:
            error = scatter(time, value) if stated is None else stated
            allowed = max(TOLERANCE * error, TURNED_TOLERANCE * float(np.ptp(value)))
            _check_jump(self.test, self.before, float(value[0]), allowed)
        time, value = looked_at(time, value)
        factor = 1.0 if strain_driven else self.test.pascal
        if self.table.tolerance is not None:
            tolerance = np.array([factor * self.table.tolerance])
        elif stated is not None:
            tolerance = np.array([tolerance_of(value, stated)])
        else:
            tolerance = tolerances(time, value)
        corners, line = line_through(time, value, tolerance)
        unit, scale = ("", 1.0) if strain_driven else (" MPa", 1e-6)
        distance = span_text((scale * tolerance.min(), scale * tolerance.max()), digits=2) + unit
        averaged = f", averaged to {time.size}," if time.size < series.time.size else ""
        self.notices.append(
            f"Stage {self.number}: {series.n_read} readings of the {quantity}{averaged} became "
            f"{counted(corners.size - 1, 'leg')}, which "
            f"{'passes' if corners.size == 2 else 'pass'} each of them within about {distance}."
            f"{series.unread}"
        )
        return self._series(self.table.control, corners, line)

    def _readings(self, quantity: Driven, purpose: str) -> Series:
        """Return what was read over the stage."""
        span, test, number = (self.start, self.end), self.test, self.number
        shared = (DRIVEN[self.table.control] == "strain", self.strain_follows)
        own = one_reading_each(
            test.readings.source,
            *own_readings(test.readings, quantity, number - 1, span, shared),
            test.time_text,
        )
        if own[0].size < 2:
            raise InputError(
                f"{self.where}: found fewer than two readings of the {quantity} in it, expected "
                f"'{quantity}_column' in [data] to hold {purpose} (a reading at the time of a "
                "change belongs to the later stage, unless a stage column says another one)."
            )
        if too_long_a_gap(own[0], span):
            first, last, start, end = map(test.time_text, (own[0][0], own[0][-1], *span))
            raise InputError(
                f"{self.where}: found readings of the {quantity} from {first} to {last} only, "
                f"expected them to hold {purpose} from {start} to {end}; what lies outside may be "
                "a stage of its own."
            )
        return with_ends(test.readings, quantity, own, span)
