"""Forced oscillation tests: raw record, how it is prepared for the model, their files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from pyburgers.common.columns import Column, DataFile, TextFilesTable, read_columns
from pyburgers.common.errors import InputError, all_of
from pyburgers.common.toml_files import Table, read_toml
from pyburgers.common.units import units_text
from pyburgers.kinds.experiment import Experiment, FloatArray
from pyburgers.kinds.experiment_file import ExperimentFile, shared_values
from pyburgers.kinds.forced_oscillation.imposed_cycles import NO_RECORD, ImposedCycles
from pyburgers.kinds.forced_oscillation.preparation import (
    Background,
    OscillationRecord,
    OscillationSettings,
    PreparedOscillation,
    prepare,
)
from pyburgers.model.display import STRAIN_FACTOR, STRAIN_UNIT
from pyburgers.model.read_quantities import STRESS


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class OscillationExperiment(Experiment):
    """One forced oscillation test in SI units.

    `initial_grain_size` is that at the start of the record (`prepared.start`).

    Attributes
    ----------
    record : OscillationRecord
        The readings as they were taken.
    settings : OscillationSettings
        How the record is prepared; every choice is a number.
    prepared : PreparedOscillation
        Driving strain and readings for comparison, as the settings give them.
    spin_up_cycles : int
        Cycles of the model ahead of the record, so that no start-up transient is left.
    imposed : ImposedCycles or None
        Driving cycles of a test without a record, which can only be simulated.
    """

    protocol: ClassVar[str] = "forced_oscillation"
    points_together: ClassVar[str] = "a record of oscillations is prepared as a whole"
    laws: ClassVar[Mapping[str, Sequence[str]]] = MappingProxyType(
        {
            **Experiment.laws,
            "grain_size": ("piezometric", "constant"),
            "fabric": ("constant",),
            "residuals": ("independent",),
        }
    )
    record: OscillationRecord
    settings: OscillationSettings
    prepared: PreparedOscillation
    spin_up_cycles: int
    imposed: ImposedCycles | None = None

    @property
    def end(self) -> float:
        """Time (s) of the last stress, or of the end of imposed cycles."""
        if self.imposed is not None:
            return self.imposed.cycles * self.imposed.period
        return float(self.prepared.time[-1])

    @property
    def position(self) -> FloatArray:
        """Times (s) of the stresses."""
        return self.prepared.time

    @property
    def span(self) -> tuple[float, float]:
        """Start and end (s) of the record, or of imposed cycles."""
        return self.prepared.start, self.end

    @property
    def stress(self) -> FloatArray:
        """Stress (Pa) of `prepared`, for comparison with the model, shape (n_points,)."""
        return self.prepared.stress

    @property
    def response(self) -> FloatArray:
        """Stresses."""
        return self.stress

    @property
    def n_driving_errors(self) -> int:
        """Number of the errors of the driving strain that take part."""
        return len(self.prepared.strain_error)

    def driving_error(self, true: Self) -> FloatArray:
        """Return the errors of the strain's fit, given a test that knows the true strain."""
        found, wanted = (
            np.concatenate([one.strain_sine, one.strain_cosine, one.background_rate])
            for one in (self.prepared, true.prepared)
        )
        error = self.prepared.strain_error
        if len(error) == 0:
            return np.empty(0)
        size = np.sqrt(np.sum(error**2, axis=0))
        used = size > 0
        solved: FloatArray = np.linalg.lstsq(
            (error[:, used] / size[used]).T, (wanted - found)[used] / size[used]
        )[0]
        return solved

    @property
    def noises(self) -> Mapping[str, float | None]:
        """Noise of the stress, beside its stated errors."""
        return {STRESS.noise: None}

    @property
    def largest_stress(self) -> float:
        """Largest |σ| (Pa) that the model is compared with; only of an experiment with data."""
        return float(np.max(np.abs(self.stress)))

    @property
    def largest_strain(self) -> float | None:
        """Largest |ε| of the record; None of imposed cycles."""
        return float(np.max(np.abs(self.record.strain))) if self.record.strain.size else None

    @property
    def title(self) -> str:
        """Sample, material and kind of data; below them period, amplitude and background."""
        prepared = self.prepared
        amplitude, _ = prepared.strain_fit.amplitude()
        return (
            f"{self.id}: {self.material}, {self.temperature:g} K, {self.provenance.kind} data\n"
            f"period {prepared.period:g} s, strain amplitude "
            f"{amplitude * STRAIN_FACTOR:.2g} {STRAIN_UNIT}, background {prepared.background}"
        )

    def own_tables(self) -> dict[str, Any]:
        """Return how the record is prepared, and the record; or the imposed cycles."""
        imposed, record, settings = self.imposed, self.record, self.settings
        if imposed is not None:
            return {
                "oscillation": {
                    "period_s": imposed.period,
                    "spin_up_cycles": self.spin_up_cycles,
                    "start_stress_Pa": imposed.start_stress,
                },
                "imposed_cycles": {
                    "strain_amplitude": imposed.strain_amplitude,
                    "cycles": imposed.cycles,
                    "mean_strain_rate_per_s": imposed.mean_strain_rate,
                },
            }
        series = {
            "strain": ("fraction", record.strain_time, record.strain, record.strain_uncertainty),
            "stress": ("Pa", record.stress_time, record.stress, record.stress_uncertainty),
        }
        data: dict[str, Any] = {"missing": []}
        for name, (unit, *columns) in series.items():
            data |= {
                f"{name}_file": dict(zip(("time_s", name, "uncertainty"), columns, strict=True)),
                f"{name}_time_column": "time_s",
                f"{name}_time_unit": "s",
                f"{name}_column": name,
                f"{name}_unit": unit,
                f"{name}_uncertainty_column": "uncertainty",
            }
        oscillation = {
            "period_s": settings.period,
            "strain_trend_degree": settings.strain_trend_degree,
            "stress_trend_degree": settings.stress_trend_degree,
            "background": settings.background,
            "spin_up_cycles": self.spin_up_cycles,
            "start_stress_Pa": settings.start_stress,
        }
        return {"oscillation": oscillation, "data": data}


class _OscillationTable(Table):
    period_s: float | None = Field(None, gt=0, description="the period in seconds")
    strain_trend_degree: int | None = Field(
        None, ge=0, description="the degree of the polynomial trend of the strain"
    )
    stress_trend_degree: int | None = Field(
        None, ge=0, description="the degree of the polynomial trend of the stress"
    )
    background: Background = Field("kept", description="what becomes of bias and drift")
    start_stress_Pa: float | None = Field(  # noqa: N815 - a key with its unit
        None,
        description="where the model starts with the background kept (default: the bias, and 0 of "
        "imposed cycles)",
    )
    spin_up_cycles: int = Field(2, ge=1, le=10_000, description="cycles ahead of the record")


class _ImposedTable(Table):
    """The table [imposed_cycles]."""

    strain_amplitude: float = Field(
        gt=0, lt=1, description="the amplitude of the strain, a fraction"
    )
    cycles: float = Field(gt=0, le=10_000, description="how many cycles there are")
    mean_strain_rate_per_s: float = Field(
        0.0, description="the strain rate in 1/s about which the strain oscillates"
    )


class _DataTable(TextFilesTable):
    strain_file: DataFile = Field(description="the data file of the strain")
    strain_time_column: Column
    strain_time_unit: str = Field(description=units_text("time"))
    strain_column: Column
    strain_unit: str = Field(description=units_text("strain"))
    strain_uncertainty_column: Column | None = None
    strain_uncertainty: float | None = Field(
        None, gt=0, description="the standard deviation of every strain, in its unit"
    )
    stress_file: DataFile = Field(description="the data file of the stress")
    stress_time_column: Column
    stress_time_unit: str = Field(description=units_text("time"))
    stress_column: Column
    stress_unit: str = Field(description=units_text("stress"))
    stress_uncertainty_column: Column | None = None
    stress_uncertainty: float | None = Field(
        None, gt=0, description="the standard deviation of every stress, in its unit"
    )

    @property
    def is_one_file(self) -> bool:
        """Whether strain and stress are columns of one file, or of one table in memory."""
        one, other = self.strain_file, self.stress_file
        return one == other if isinstance(one, str) and isinstance(other, str) else one is other


class OscillationFile(ExperimentFile):
    """The keys of the file of a forced oscillation test."""

    protocol: Literal["forced_oscillation"] = Field(description="the kind of test")
    initial_grain_size_m: float = Field(
        description="the mean grain size at the start of the record in metres"
    )
    oscillation: _OscillationTable = Field(
        default_factory=lambda: _OscillationTable.model_validate({})
    )
    imposed_cycles: _ImposedTable | None = Field(
        None, description="the strain of an imagined test, in place of [data]: to be simulated"
    )
    data: _DataTable | None = Field(None, description="the table that names the data files")


def load_forced_oscillation(
    path: Path, tables: Mapping[str, Any] | None = None
) -> OscillationExperiment:
    """Read and check the file of a forced oscillation test, or its tables, and its data files.

    Strain and stress stand in files (or columns of one file) with clocks of their own that have a
    common origin. What [oscillation] leaves open is estimated or chosen while the record is
    prepared (`pyburgers.kinds.forced_oscillation.preparation.prepare`). A file with imposed
    cycles in their place is a test that can be simulated. Raise InputError if a file, key, unit or
    number is not what it has to be, or the record cannot be prepared.
    """
    file = read_toml(path, OscillationFile, tables)
    if file.data is None:
        return _imagined(path, file)
    if file.imposed_cycles is not None:
        raise InputError(
            f"{path}: found both of the tables [data] and [imposed_cycles], expected one: cycles "
            "are imposed where there is no record of them."
        )
    data = file.data
    values, (strain_columns, strain_notes), (stress_columns, stress_notes) = all_of(
        lambda: shared_values(path, file),
        lambda: _read_series(path, data, "strain"),
        lambda: _read_series(path, data, "stress"),
    )
    strain_time, strain, strain_uncertainty = strain_columns
    stress_time, stress, stress_uncertainty = stress_columns
    record = OscillationRecord(
        strain_time=strain_time,
        strain=strain,
        strain_uncertainty=strain_uncertainty,
        stress_time=stress_time,
        stress=stress,
        stress_uncertainty=stress_uncertainty,
    )
    wanted = OscillationSettings(
        period=file.oscillation.period_s,
        strain_trend_degree=file.oscillation.strain_trend_degree,
        stress_trend_degree=file.oscillation.stress_trend_degree,
        background=file.oscillation.background,
        start_stress=file.oscillation.start_stress_Pa,
    )
    prepared = prepare(record, wanted, str(path))
    return OscillationExperiment(
        **values,
        record=record,
        settings=prepared.settings,
        prepared=prepared,
        spin_up_cycles=file.oscillation.spin_up_cycles,
        notices=tuple(
            dict.fromkeys([*file.notices, *strain_notes, *stress_notes, *prepared.notices])
        ),
    )


def with_background(
    experiment: OscillationExperiment, background: Background
) -> OscillationExperiment:
    """Return the same test with its background removed or kept."""
    settings = replace(experiment.settings, background=background, start_stress=None)
    prepared = prepare(experiment.record, settings, experiment.id)
    others = [one for one in experiment.notices if one not in experiment.prepared.notices]
    notices = (*others, *prepared.notices)
    return replace(experiment, settings=prepared.settings, prepared=prepared, notices=notices)


def with_known_strain(experiment: OscillationExperiment) -> OscillationExperiment:
    """Return the same test with its driving strain taken as known, whatever its uncertainty."""
    prepared = experiment.prepared
    known = replace(prepared, strain_error=prepared.strain_error[:0])
    return replace(experiment, prepared=known)


def _imagined(path: Path, file: OscillationFile) -> OscillationExperiment:
    """Return a test with imposed cycles."""
    cycles, settings = file.imposed_cycles, file.oscillation
    if cycles is None:
        raise InputError(
            f"{path}: table [data] is missing, expected it, or [imposed_cycles] for a test that is "
            "only simulated."
        )
    if settings.period_s is None:
        raise InputError(
            f"{path}: key 'period_s' in [oscillation] is missing, expected the period in seconds "
            "of [imposed_cycles]."
        )
    for key in ("strain_trend_degree", "stress_trend_degree", "background"):
        if key in settings.model_fields_set and getattr(settings, key) != "kept":
            raise InputError(
                f"{path}: key {key!r} in [oscillation]: found {getattr(settings, key)!r}, expected "
                "none, because imposed cycles have no record to take a trend from."
            )
    imposed = ImposedCycles(
        period=settings.period_s,
        strain_amplitude=cycles.strain_amplitude,
        cycles=cycles.cycles,
        mean_strain_rate=cycles.mean_strain_rate_per_s,
        start_stress=settings.start_stress_Pa or 0.0,
    )
    prepared = imposed.prepared()
    return OscillationExperiment(
        **shared_values(path, file),
        record=NO_RECORD,
        settings=prepared.settings,
        prepared=prepared,
        spin_up_cycles=settings.spin_up_cycles,
        imposed=imposed,
        notices=tuple(file.notices),
    )


def _read_series(
    path: Path, data: _DataTable, name: str
) -> tuple[tuple[FloatArray, ...], tuple[str, ...]]:
    """Return times (s), readings and standard deviations (SI) of one series, and notes on them."""
    column, number = f"{name}_uncertainty_column", f"{name}_uncertainty"
    uncertainty = getattr(data, number)
    if (getattr(data, column) is None) == (uncertainty is None):
        found = "is missing" if uncertainty is None else "is given twice"
        raise InputError(
            f"{path}: the uncertainty of the {name} {found}, expected exactly one of the keys "
            f"{column!r} and {number!r} in [data]."
        )
    unit = (f"{name}_unit", name)
    columns = {f"{name}_time_column": (f"{name}_time_unit", "time"), f"{name}_column": unit}
    if uncertainty is None:
        columns[column] = unit
    (time, value, *spread), notes = read_columns(
        path,
        data,
        columns,
        key=f"{name}_file",
        has_own_clock=data.strain_time_column == data.stress_time_column and data.is_one_file,
    )
    if not spread:
        spread = [np.full_like(value, data.in_si(number, *unit, path))]
    return (time, value, *spread), notes
