"""Files of tables of attenuation and modulus (`docs/attenuation_data.md`)."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import Field

from pyburgers.common.array_types import FloatArray
from pyburgers.common.columns import Column, DataFile, TextFilesTable, read_columns
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table, all_of, factor_to_si, read_toml
from pyburgers.common.units import UNIT_TABLE, units_text
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.table import (
    NO_READINGS,
    CycleConditions,
    Deformation,
    Elasticity,
    Form,
    Readings,
    SpectrumTable,
    check_sign,
    check_table,
    conditions_of,
    tan_delta_of,
)
from pyburgers.kinds.experiment import CONDITION_KEYS
from pyburgers.kinds.experiment_file import ExperimentFile, Kind, shared_values

MODULI = ("modulus_column", "storage_modulus_column")
"""Keys of columns of which |M| is one, or follows."""


class _AttenuationTable(Table):
    deformation: Deformation = Field(
        description="axial (stress is axial, the modulus Young's) or shear"
    )
    poisson_ratio: float | None = Field(
        None, gt=-1, lt=0.5, description="Poisson's ratio, in shear"
    )
    bulk_modulus_Pa: float | None = Field(  # noqa: N815 - a key with its unit
        None, gt=0, description="the bulk modulus in Pa, in shear"
    )
    median_stress_Pa: float | None = Field(  # noqa: N815
        None, ge=0, description="the median stress of every row in Pa"
    )
    amplitude_Pa: float | None = Field(  # noqa: N815
        None,
        gt=0,
        description="the amplitude of the stress of every row in Pa; of torsion about 0.8 of that "
        "at the outer radius",
    )


class _DataTable(TextFilesTable):
    file: DataFile = Field(description="the data file")
    period_column: Column | None = None
    period_unit: str | None = Field(None, description=units_text("time"))
    frequency_column: Column | None = None
    frequency_unit: str | None = Field(None, description=units_text("frequency"))
    temperature_column: Column | None = None
    temperature_unit: str = Field("K", description=units_text("temperature"))
    least_temperature: float | None = Field(
        None, description="the temperature below which rows are left out, in its unit"
    )
    stress_unit: str = Field("MPa", description=units_text("stress"))
    median_stress_column: Column | None = Field(
        None, description="the column of the median stress, in stress_unit"
    )
    amplitude_column: Column | None = Field(
        None, description="the column of the stress amplitude, in stress_unit"
    )
    attenuation_column: Column | None = None
    attenuation_form: Form | None = Field(
        None, description="tan_delta (1/Q is the same), log10_tan_delta or loss_angle"
    )
    attenuation_unit: str | None = Field(
        None, description=f"{units_text('angle')}, of a loss_angle"
    )
    loss_modulus_column: Column | None = Field(
        None, description="the column of M'' in modulus_unit, in place of attenuation_column"
    )
    attenuation_uncertainty_column: Column | None = None
    attenuation_uncertainty: float | None = Field(
        None, gt=0, description="the standard deviation of every tan delta, or of every loss_angle"
    )
    limit_column: Column | None = None
    limit: float | None = Field(
        None, description="a reading at or below which attenuation is only known to be at most it"
    )
    modulus_column: Column | None = Field(None, description="the column of |M|")
    storage_modulus_column: Column | None = Field(
        None, description="the column of M' in place of modulus_column: |M| follows from tan delta"
    )
    modulus_unit: str | None = Field(None, description=units_text("stress"))
    modulus_uncertainty_column: Column | None = None
    modulus_uncertainty: float | None = Field(
        None, gt=0, description="the standard deviation of every modulus, in its unit"
    )


class AttenuationFile(ExperimentFile):
    """The keys of the file of a table of attenuation."""

    protocol: Literal["attenuation"] = Field(description="the kind of test")
    temperature_K: float = Field(  # noqa: N815
        description="the temperature in kelvin for which the flow rate is given, and of rows "
        "without their own"
    )
    initial_grain_size_m: float = Field(description="the mean grain size in metres")
    attenuation: _AttenuationTable = Field(description="the table about the cycles")
    spectra: list[SpectrumTable] = Field(
        default_factory=list,
        description="the rows of an imagined table, in place of [data]: to be simulated",
    )
    data: _DataTable | None = Field(None, description="the table that names the data file")


def load_attenuation(path: Path, tables: Mapping[str, Any] | None = None) -> AttenuationExperiment:
    """Read and check a table of attenuation, or one of spectra that can only be simulated."""
    file = read_toml(path, AttenuationFile, tables)
    for key, _ in CONDITION_KEYS.values():
        if getattr(file, key) is not None:
            raise InputError(
                f"{path}: key {key!r}: found {getattr(file, key):g}, expected none, because tables "
                "of attenuation are fitted at their stated conditions."
            )
    values, elasticity, (conditions, readings, notes) = all_of(
        lambda: shared_values(path, file),
        lambda: _elasticity(path, file.attenuation),
        lambda: _table(path, file),
    )
    notices = (*file.notices, *notes, *_notices(conditions, readings, elasticity))
    return AttenuationExperiment(
        **values,
        conditions=conditions.ordered(conditions.rows_in_order),
        readings=readings.ordered(conditions.rows_in_order),
        elasticity=elasticity,
        notices=tuple(dict.fromkeys(notices)),
    )


def _table(path: Path, file: AttenuationFile) -> tuple[CycleConditions, Readings, tuple[str, ...]]:
    """Return the rows, measured or imagined, and notes on their file."""
    if (file.data is None) == (not file.spectra):
        found = "neither" if file.data is None else "both"
        raise InputError(
            f"{path}: found {found} of the tables [data] and [[spectra]], expected one: spectra "
            "are listed where nothing was measured."
        )
    if file.data is not None:
        return _measured(path, file, file.data)
    stresses = file.attenuation.median_stress_Pa, file.attenuation.amplitude_Pa
    where = f"{path}: [[spectra]]"
    return conditions_of(file.spectra, file.temperature_K, *stresses, where=where), NO_READINGS, ()


def _measured(
    path: Path, file: AttenuationFile, data: _DataTable
) -> tuple[CycleConditions, Readings, tuple[str, ...]]:
    """Read and check the rows, in the order of the data file; return notes on it with them."""
    source = data.source(path)
    periods = _one_of(path, data, "period_column", "frequency_column")
    found, notes = read_columns(path, data, _columns(path, data))
    if data.least_temperature is not None:
        found = _from_temperature(path, data, found, data.least_temperature)
    order = found[periods]
    n_rows = order.size
    with np.errstate(divide="ignore"):  # a frequency of 0 is refused below
        period = order if periods == "period_column" else 1 / order
    conditions = CycleConditions(
        period=period,
        temperature=found.get("temperature_column", np.full(n_rows, file.temperature_K)),
        median_stress=_stress(path, file.attenuation, data, found, "median_stress", n_rows),
        amplitude=_stress(path, file.attenuation, data, found, "amplitude", n_rows),
    )
    readings = _readings(path, data, found, str(source))
    order_name = "period" if periods == "period_column" else "frequency"
    advice = ""
    if "temperature_column" not in found:
        advice = "; no temperature_column is named, so that all rows have temperature_K"
    check_table(conditions, readings, order, str(source), order_name, advice)
    is_stated = "median_stress_column" in found or file.attenuation.median_stress_Pa is not None
    if conditions.amplitude.all() and not is_stated:
        notes = (*notes, "The median stress of the cycles is not stated: it is taken as 0.")
    return conditions, readings, notes


def _one_of(path: Path, data: _DataTable, first: str, second: str) -> str:
    """Return which of two keys is given; it has to be one."""
    given = [key for key in (first, second) if getattr(data, key) is not None]
    if len(given) != 1:
        found = "both" if given else "neither"
        raise InputError(
            f"{path}: found {found} of the keys {first!r} and {second!r} in [data], expected one."
        )
    return given[0]


def _columns(path: Path, data: _DataTable) -> dict[str, tuple[str, str] | None]:
    """Return the columns to read, with the keys of their units."""
    _check_forms(path, data)
    units: dict[str, tuple[str, str] | None] = {
        "period_column": ("period_unit", "time"),
        "frequency_column": ("frequency_unit", "frequency"),
        "temperature_column": ("temperature_unit", "temperature"),
        "median_stress_column": ("stress_unit", "stress"),
        "amplitude_column": ("stress_unit", "stress"),
        "attenuation_column": None,
        "loss_modulus_column": ("modulus_unit", "stress"),
        "attenuation_uncertainty_column": ("attenuation_unit", "angle")
        if data.attenuation_form == "loss_angle"
        else None,
        "limit_column": None,
        "modulus_column": ("modulus_unit", "stress"),
        "storage_modulus_column": ("modulus_unit", "stress"),
        "modulus_uncertainty_column": ("modulus_unit", "stress"),
    }
    wanted = {key: unit for key, unit in units.items() if getattr(data, key) is not None}
    for key, unit in wanted.items():
        if unit is not None and getattr(data, unit[0]) is None:
            raise InputError(
                f"{path}: key {unit[0]!r} in [data] is missing, expected the unit of {key!r}."
            )
    stated_once = ("attenuation_uncertainty", "limit", "modulus_uncertainty")
    for one, other in (*((name, f"{name}_column") for name in stated_once), MODULI):
        if getattr(data, one) is not None and other in wanted:
            raise InputError(
                f"{path}: found both of the keys {one!r} and {other!r} in [data], expected at most "
                "one."
            )
    for key in ("modulus_uncertainty", "modulus_uncertainty_column"):
        if getattr(data, key) is not None and not wanted.keys() & set(MODULI):
            raise InputError(f"{path}: key {key!r} in [data] needs the key 'modulus_column'.")
    return wanted


def _check_forms(path: Path, data: _DataTable) -> None:
    """Check that the keys that say how attenuation and modulus are written fit together."""
    if _one_of(path, data, "attenuation_column", "loss_modulus_column") == "loss_modulus_column":
        needed = {"storage_modulus_column": True, "attenuation_form": False}
    else:
        needed = {"attenuation_form": True}
    needed["attenuation_unit"] = data.attenuation_form == "loss_angle"
    for key, is_needed in needed.items():
        if (getattr(data, key) is not None) != is_needed:
            found, expected = ("no", "it") if is_needed else ("a", "none")
            raise InputError(
                f"{path}: found {found} key {key!r} in [data], expected {expected} with that form "
                "of attenuation."
            )


def _from_temperature(
    path: Path, data: _DataTable, found: Mapping[str, FloatArray], least: float
) -> dict[str, FloatArray]:
    """Take the rows at least as hot as the file asks for."""
    if "temperature_column" not in found:
        raise InputError(
            f"{path}: key 'least_temperature' in [data] needs the key 'temperature_column'."
        )
    unit = UNIT_TABLE["temperature"][data.temperature_unit]
    temperature = found["temperature_column"]
    kept = temperature >= unit.zero + unit.factor * least
    if not kept.any():
        highest = (temperature.max() - unit.zero) / unit.factor
        raise InputError(
            f"{path}: key 'least_temperature' in [data]: found {least:g}, "
            f"expected at most the highest of the table, {highest:g}."
        )
    return {key: column[kept] for key, column in found.items()}


def _stress(
    path: Path,
    table: _AttenuationTable,
    data: _DataTable,
    found: Mapping[str, FloatArray],
    name: str,
    n_rows: int,
) -> FloatArray:
    """Median stress or amplitude (Pa) of every row, 0 where it is not said."""
    column, number = f"{name}_column", getattr(table, f"{name}_Pa")
    if column not in found:
        return np.full(n_rows, number or 0.0)
    if number is not None:
        raise InputError(
            f"{path}: found the key '{name}_Pa' in [attenuation] and {column!r} in [data], "
            "expected at most one."
        )
    if name == "amplitude" and not np.all(found[column] > 0):
        raise InputError(
            f"{path}: column {getattr(data, column)!r} holds amplitudes that are not "
            "positive, expected all or none to be stated."
        )
    return found[column]


def _readings(
    path: Path, data: _DataTable, found: Mapping[str, FloatArray], source: str
) -> Readings:
    """Return what was read, in SI."""
    n_rows = next(iter(found.values())).size

    def every(name: str, factor: float = 1.0) -> FloatArray:
        """Return a column, or one number for all rows."""
        number = getattr(data, name)
        constant = np.full(n_rows, 0.0 if number is None else factor * number)
        return found.get(f"{name}_column", constant)

    def factor(key: str, quantity: str) -> float:
        unit = getattr(data, key)
        return factor_to_si(unit, quantity, f"{path}: key {key!r} in [data]") if unit else 1.0

    def tan_delta(values: FloatArray) -> FloatArray:
        radian, where = factor("attenuation_unit", "angle"), f"{path}: key 'attenuation_form'"
        return tan_delta_of(data.attenuation_form or "tan_delta", values, radian, where)

    has_limit = data.limit is not None or "limit_column" in found
    storage = found.get("storage_modulus_column")
    if storage is not None and "loss_modulus_column" in found:
        check_sign(storage > 0, storage, source, "storage modulus", "a positive number")
        loss = found["loss_modulus_column"] / storage
    else:
        loss = tan_delta(found["attenuation_column"])
    loss_error = every("attenuation_uncertainty", factor("attenuation_unit", "angle"))
    if data.attenuation_form == "loss_angle":
        loss_error = loss_error * (1 + loss**2)
    modulus = found.get("modulus_column", np.empty(0))
    error = every("modulus_uncertainty", factor("modulus_unit", "stress"))
    if storage is not None:
        modulus, error = storage * np.hypot(1, loss), error * np.hypot(1, loss)
    return Readings(
        tan_delta=loss,
        tan_delta_error=loss_error,
        limit=tan_delta(every("limit")) if has_limit else np.zeros(n_rows),
        modulus=modulus,
        modulus_error=error[: modulus.size],
    )


def _elasticity(path: Path, table: _AttenuationTable) -> Elasticity:
    """Check and return how shear and axial quantities are related."""
    given = [key for key in ("poisson_ratio", "bulk_modulus_Pa") if getattr(table, key) is not None]
    expected = "none: they turn axial quantities into those of shear"
    if table.deformation == "shear":
        expected = "exactly one of the keys 'poisson_ratio' and 'bulk_modulus_Pa'"
    if len(given) != (table.deformation == "shear"):
        raise InputError(
            f"{path}: key 'deformation' in [attenuation] is {table.deformation!r}, found "
            f"{' and '.join(given) or 'neither elastic constant'}, expected {expected}."
        )
    return Elasticity(table.deformation, table.poisson_ratio, table.bulk_modulus_Pa)


def _notices(conditions: CycleConditions, readings: Readings, elasticity: Elasticity) -> list[str]:
    """Say what the table leaves open, and what was turned."""
    notices = []
    steps = np.diff(conditions.period)[np.diff(conditions.spectrum) == 0]
    n_spectra = conditions.ordered(conditions.rows_in_order).n_spectra
    if ((steps > 0).any() and (steps < 0).any()) or n_spectra < conditions.n_spectra:
        notices.append("Rows were sorted by temperature and stress, and then by period.")
    if not np.all(conditions.amplitude > 0):
        notices.append(
            "The amplitude of the stress is not stated: cycles are taken as so small that the "
            "dashpot is linear."
        )
    elif elasticity.deformation == "shear":
        notices.append(
            "In torsion of a solid cylinder the stress grows from the axis: if n is above 1, state "
            "about 0.8 of the amplitude at the outer radius."
        )
    if n_limits := int(readings.is_limit.sum()):
        notices.append(
            f"{n_limits} of {conditions.n_rows} attenuations are upper limits, not values."
        )
    return notices


KIND = Kind(AttenuationFile, load_attenuation)
