"""What a file says is imposed, as stages: the tables [[stages]]."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
from pydantic import Field

from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table, factor_to_si
from pyburgers.protocols.experiment import FloatArray
from pyburgers.protocols.loading_history.driver import (
    TOLERANCE,
    line_through,
    reading_error,
    tolerance_of,
)
from pyburgers.protocols.loading_history.readings import Measure, Readings
from pyburgers.protocols.loading_history.stages import Control, Stage, legs_of

DISPLACEMENT_STEP = 0.01
"""At constant displacement rate the true strain rate changes with the length: legs this long in
true strain follow it to half a percent."""

OWN_KEYS: Mapping[Control, tuple[str, ...]] = MappingProxyType(
    {
        "strain_rate": ("strain_rate_per_s",),
        "stress": ("stress",),
        "stress_rate": ("stress_rate", "start_stress"),
        "strain_series": ("knots", "tolerance"),
        "stress_series": ("knots", "tolerance"),
        "hold_strain": (),
    }
)
"""Keys of a stage that only some controls have; the first is needed, but for knots."""


class StageTable(Table):
    """One of [[stages]]."""

    control: Control = Field(description="what is imposed")
    start_time: float = Field(description="the time at the start in the unit stage_time_unit")
    end_time: float = Field(description="the time at the end in the unit stage_time_unit")
    temperature_K: float | None = Field(  # noqa: N815 - a key with its unit
        None, ge=50, le=3000, description="the temperature in kelvin where it is another"
    )
    strain_rate_per_s: float | None = Field(None, description="the imposed strain rate in 1/s")
    stress: float | None = Field(
        None, description="the imposed stress in the unit stage_stress_unit"
    )
    stress_rate: float | None = Field(None, description="stress over time, in the units of stages")
    start_stress: float | None = Field(
        None, description="the stress at which the rate starts, in the unit stage_stress_unit"
    )
    knots: list[list[float]] | None = Field(
        None, min_length=2, description="pairs of time and strain (fraction) or stress"
    )
    tolerance: float | None = Field(
        None, gt=0, description="how far legs pass from readings of strain (fraction) or stress"
    )


@dataclass(frozen=True)
class Conventions:
    """How the numbers of a file are meant.

    Attributes
    ----------
    time, stress : float
        Factors to SI of times and stresses in [[stages]].
    sign : {1, -1}
        Of a compression.
    stress_measure, strain_measure : {"true", "engineering"}
        Their measures.
    """

    time: float
    stress: float
    sign: int
    stress_measure: Measure
    strain_measure: Measure

    @classmethod
    def of(
        cls,
        path: Path,
        *,
        time_unit: str,
        stress_unit: str,
        compression: Literal["positive", "negative"],
        measures: tuple[Measure, Measure],
    ) -> "Conventions":
        """Check the units of a file."""
        return cls(
            factor_to_si(time_unit, "time", f"{path}: key 'stage_time_unit'"),
            factor_to_si(stress_unit, "stress", f"{path}: key 'stage_stress_unit'"),
            1 if compression == "positive" else -1,
            *measures,
        )


@dataclass(frozen=True, eq=False)
class Test:
    """What stages are read with.

    Attributes
    ----------
    path : Path
        The file, for messages.
    temperature : float
        K, of stages that name none.
    conventions : Conventions
        How numbers are meant.
    bounds : array, shape (n_stages + 1,)
        Starts of the stages and the end of the last (s on the clock of the file).
    readings : Readings
        True ones.
    stress_error, strain_error : float or None
        Stated standard deviations of readings (Pa, fraction).
    first_strain : tuple of (float, float)
        Zero of strain and its standard deviation.
    """

    path: Path
    temperature: float
    conventions: Conventions
    bounds: FloatArray
    readings: Readings
    stress_error: float | None
    strain_error: float | None
    first_strain: tuple[float, float]


def stage_bounds(path: Path, tables: Sequence[StageTable], time_factor: float) -> FloatArray:
    """Check the times of stages.

    Parameters
    ----------
    path : Path
        The file, for messages.
    tables : sequence of StageTable
        At least one.
    time_factor : float
        To s.

    Returns
    -------
    array, shape (n_stages + 1,)
        Starts of the stages and the end of the last (s).

    Raises
    ------
    InputError
        If a stage ends before it starts, overlaps the one before, or leaves a gap.
    """
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


def read_stages(test: Test, tables: Sequence[StageTable]) -> tuple[tuple[Stage, ...], list[str]]:
    """Return the stages, and sentences about what was turned or smoothed.

    Raises
    ------
    InputError
        If a key is missing, is not one of its control, or does not fit the stages before.
    """
    stages: list[Stage] = []
    notices: list[str] = []
    for number, table in enumerate(tables):
        _check_keys(test.path, number, table)
        before = tables[number - 1] if number else None
        stages.append(_StageReader(test, table, before, tuple(stages), notices).read())
    return tuple(stages), notices


def _check_keys(path: Path, number: int, table: StageTable) -> None:
    own = OWN_KEYS[table.control]
    where = f"in [[stages]] number {number + 1}"
    for key in sorted({key for keys in OWN_KEYS.values() for key in keys}):
        if getattr(table, key) is not None and key not in own:
            raise InputError(
                f"{path}: key {key!r} {where}: found it with control {table.control!r}, expected "
                f"{' or '.join(map(repr, own)) if own else 'no such key'}."
            )
    if own and own[0] != "knots" and getattr(table, own[0]) is None:
        raise InputError(
            f"{path}: key {own[0]!r} {where} is missing, expected it because the control is "
            f"{table.control!r}."
        )


@dataclass(frozen=True, eq=False)
class _StageReader:
    """Reads the next stage, given those before it."""

    test: Test
    table: StageTable
    table_before: StageTable | None
    before: Sequence[Stage]
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
        table, conventions = self.table, self.test.conventions
        sign, stress = conventions.sign, conventions.sign * conventions.stress
        match table.control:
            case "hold_strain":
                return self._stage("hold_strain")
            case "strain_rate":
                rate = sign * (table.strain_rate_per_s or 0.0)
                if conventions.strain_measure == "engineering":
                    return self._displacement(rate)
                return self._stage("strain_rate", value=rate)
            case "stress":
                return self._load(stress * (table.stress or 0.0), 0.0)
            case "stress_rate":
                rate = stress * (table.stress_rate or 0.0) / conventions.time
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
        before = self.table_before
        if self.table.start_stress is not None:
            return factor * self.table.start_stress
        if before is None:
            return 0.0
        if before.control == "stress":
            return factor * (before.stress or 0.0)
        if self.before[-1].driven == "stress" and self.test.conventions.stress_measure == "true":
            return legs_of(self.before)[-1].end_value
        raise InputError(
            f"{self.where}: key 'start_stress' is missing, expected the stress at the start: "
            f"the stage before has control {before.control!r}."
        )

    def _load(self, start: float, rate: float) -> Stage:
        """Stress given by its start (Pa) and rate (Pa/s); as a series where it is a force."""
        if self.test.conventions.stress_measure == "true":
            if self.table.control == "stress":
                return self._stage("stress", value=start)
            return self._stage("stress_rate", value=rate, start_stress=start)
        time, strain = self._readings("strain", "the area under the force")
        value = (start + rate * (time - self.start)) * np.exp(self.test.first_strain[0] - strain)
        corners, line = line_through(time, value, tolerance_of(value, 0.0))
        self.notices.append(
            f"Stage {self.number}: the force over the first area became a true stress in "
            f"{corners.size - 1} legs, by the measured strain."
        )
        return self._series("stress_series", corners, line)

    def _displacement(self, rate: float) -> Stage:
        """Constant displacement rate: over the first length (1/s), as legs of true strain."""
        first = -np.expm1(-self._true_strain())
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
            f"{time.size - 1} legs."
        )
        return self._series("strain_series", time, strain)

    def _imposed_strain(self) -> float | None:
        """Return the true strain that stages before imposed; None where one imposed stress."""
        if any(stage.driven == "stress" for stage in self.before):
            return None
        return sum(leg.rate * (leg.end_time - leg.start_time) for leg in legs_of(self.before))

    def _true_strain(self) -> float:
        """Strain at the start: imposed so far, or measured where a stage before imposed stress."""
        imposed = self._imposed_strain()
        if imposed is not None:
            return imposed
        time, strain = self.test.readings.of("strain")
        earlier = np.flatnonzero(time <= self.start)
        if earlier.size == 0:
            raise InputError(
                f"{self.where}: found an engineering strain rate after an imposed stress without a "
                "reading of the strain, expected 'strain_column' in [data] to tell the length."
            )
        return float(strain[earlier[-1]]) - self.test.first_strain[0]

    def _given_series(self, knots: Sequence[Sequence[float]], stress: float) -> Stage:
        """Corners as they stand in the file."""
        conventions, control = self.test.conventions, self.table.control
        strain_driven = control == "strain_series"
        quantity = "strain" if strain_driven else "stress"
        measure = conventions.strain_measure if strain_driven else conventions.stress_measure
        if measure == "engineering":
            raise InputError(
                f"{self.where}: key 'knots': found it with key '{quantity}_measure' 'engineering', "
                "expected knots of a true measure."
            )
        if any(len(knot) != 2 for knot in knots):
            raise InputError(f"{self.where}: key 'knots': expected pairs of a time and a value.")
        given, value = np.transpose(knots)
        if given[0] != self.table.start_time or given[-1] != self.table.end_time:
            raise InputError(
                f"{self.where}: key 'knots': found times from {given[0]:g} to {given[-1]:g}, "
                f"expected the ends of the stage, {self.table.start_time:g} and "
                f"{self.table.end_time:g}."
            )
        if np.any(np.diff(given) <= 0):
            repeated = given[1:][np.diff(given) <= 0][0]
            raise InputError(
                f"{self.where}: key 'knots': found the time {repeated:g} after a time that is not "
                "earlier, expected times that increase."
            )
        time = given * conventions.time - self.test.bounds[0]
        return self._series(control, time, (conventions.sign if strain_driven else stress) * value)

    def _measured_series(self) -> Stage:
        """Legs through readings."""
        strain_driven = self.table.control == "strain_series"
        quantity: Literal["stress", "strain"] = "strain" if strain_driven else "stress"
        time, value = self._readings(quantity, "what is imposed")
        stated = self.test.strain_error if strain_driven else self.test.stress_error
        error = reading_error(time, value) if stated is None else stated
        if strain_driven:
            self._check_jump(float(value[0]), max(TOLERANCE * error, 1e-3 * float(np.ptp(value))))
        tolerance = tolerance_of(value, error)
        if self.table.tolerance is not None:
            factor = 1.0 if strain_driven else self.test.conventions.stress
            tolerance = factor * self.table.tolerance
        corners, line = line_through(time, value, tolerance)
        distance = f"{tolerance:.2g}" if strain_driven else f"{tolerance / 1e6:.2g} MPa"
        self.notices.append(
            f"Stage {self.number}: {time.size} readings of the {quantity} became "
            f"{corners.size - 1} legs, which pass each of them within about {distance}."
        )
        return self._series(self.table.control, corners, line)

    def _check_jump(self, strain: float, tolerance: float) -> None:
        """Check that a series starts at the strain that stages before it end at."""
        imposed = self._imposed_strain()
        zero, sd = self.test.first_strain
        if imposed is not None and abs(strain - zero - imposed) > tolerance + TOLERANCE * sd:
            raise InputError(
                f"{self.where}: found a jump of the strain, from {zero + imposed:g} to {strain:g}, "
                "expected a series that starts where the strain is (a zero of strain stands in "
                "[strain_offset])."
            )

    def _readings(
        self, quantity: Literal["stress", "strain"], purpose: str
    ) -> tuple[FloatArray, FloatArray]:
        """Return readings inside the stage and, from those beside them, values at its ends."""
        time, value = self.test.readings.of(quantity)
        inside = (time > self.start) & (time < self.end)
        if np.count_nonzero((time >= self.start) & (time <= self.end)) < 2:
            raise InputError(
                f"{self.where}: found fewer than two readings of the {quantity} in it, expected "
                f"'{quantity}_column' in [data] to hold {purpose}."
            )
        ends = np.interp([self.start, self.end], time, value)
        return (
            np.concatenate([[self.start], time[inside], [self.end]]),
            np.concatenate([ends[:1], value[inside], ends[1:]]),
        )
