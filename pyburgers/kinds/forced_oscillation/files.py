"""Files of forced oscillation tests, and such tests simulated."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from pyburgers.common.array_types import FloatArray
from pyburgers.common.columns import Column, DataFile, TextFilesTable, read_columns
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table, all_of, read_toml
from pyburgers.common.units import units_text
from pyburgers.kinds.experiment_file import (
    ExperimentFile,
    Kind,
    MaxReadings,
    shared_values,
)
from pyburgers.kinds.forced_oscillation.experiment import (
    NO_RECORD,
    ImposedCycles,
    OscillationExperiment,
)
from pyburgers.kinds.forced_oscillation.preparation import (
    Background,
    OscillationRecord,
    OscillationSettings,
    prepare,
)
from pyburgers.kinds.loading_history.driver import MAX_READINGS


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
    max_readings: MaxReadings = MAX_READINGS

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
    """Read and check the file of a forced oscillation; `prepare` chooses what it leaves open."""
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
    record = OscillationRecord(*strain_columns, *stress_columns)
    table = file.oscillation
    degrees = table.strain_trend_degree, table.stress_trend_degree
    wanted = OscillationSettings(
        table.period_s, *degrees, table.background, table.start_stress_Pa, data.max_readings
    )
    prepared = prepare(record, wanted, str(path))
    notices = (*file.notices, *strain_notes, *stress_notes, *prepared.notices)
    return OscillationExperiment(
        **values,
        record=record,
        settings=prepared.settings,
        prepared=prepared,
        spin_up_cycles=table.spin_up_cycles,
        notices=tuple(dict.fromkeys(notices)),
    )


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
    table, notes = read_columns(
        path,
        data,
        columns,
        key=f"{name}_file",
        has_own_clock=data.strain_time_column == data.stress_time_column and data.is_one_file,
    )
    time, value, *spread = table.values()
    if not spread:
        spread = [np.full_like(value, data.in_si(number, *unit, path))]
    return (time, value, *spread), notes


KIND = Kind(OscillationFile, load_forced_oscillation)
