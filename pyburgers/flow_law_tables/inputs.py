"""Tables of tests, one point each, and the priors of their flow law, from TOML files.

A point is the peak stress of a test at a rate, temperature and grain size. A table is a TOML file
beside a text file of columns, like an experiment; everything is converted to SI on reading. At its
peak stress undeformed material flows at the imposed rate, so a table holds the flow law
(`pyburgers.flow_law_tables.fit`).
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from pyburgers.common.columns import Column, TextFilesTable, read_columns, write_columns
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table, read_toml, write_toml
from pyburgers.model.flow_law_prior import Conditions
from pyburgers.model.parameters import PARAMETER_BY_NAME, Parameter
from pyburgers.model.prior_families import PriorTable, check_beta, load_prior
from pyburgers.model.priors import PriorFile, PriorSet, save_priors, shipped_prior_file
from pyburgers.protocols.experiment import (
    Provenance,
    ProvenanceTable,
)

FloatArray = npt.NDArray[np.float64]

LEAST_POINTS = 3
"""Points below which not even the flow rate, the stress exponent and the scatter can be told."""

ZERO_CELSIUS = 273.15
"""Kelvin at 0 degrees Celsius."""

QUANTITIES: Mapping[str, str | None] = {
    "temperature": None,
    "stress": "stress",
    "strain_rate": "strain rate",
    "grain_size": "length",
}
"""Columns of every table, and what they are in `pyburgers.common.units.UNITS`."""

SI_UNITS: Mapping[str, str] = {
    "temperature": "K",
    "stress": "Pa",
    "strain_rate": "1/s",
    "grain_size": "m",
}


@dataclass(frozen=True, eq=False)
class PeakStressData:
    """Points of the flow law of one material, a test each, in SI units.

    Attributes
    ----------
    id, material : str
        Name of the table; the material names the default priors.
    temperature, stress, strain_rate, grain_size : array, shape (n_points,)
        K, Pa, 1/s and m; all positive.
    relative_stress_uncertainty : array, shape (n_points,)
        Standard deviation of each stress as a fraction of it; 0 where it is taken as exact.
    provenance : Provenance
        Where the numbers come from.
    """

    id: str
    material: str
    temperature: FloatArray
    stress: FloatArray
    strain_rate: FloatArray
    grain_size: FloatArray
    relative_stress_uncertainty: FloatArray
    provenance: Provenance

    @property
    def n_points(self) -> int:
        """Number of tests."""
        return self.stress.size

    @property
    def mean_conditions(self) -> Conditions:
        """Means in which ln(strain rate) is linear: of 1/T, ln(stress) and ln(grain size)."""
        return Conditions(
            temperature=float(1 / np.mean(1 / self.temperature)),
            stress=float(np.exp(np.mean(np.log(self.stress)))),
            grain_size=float(np.exp(np.mean(np.log(self.grain_size)))),
        )


class _DataTable(TextFilesTable):
    file: str = Field(description="the data file")
    temperature_column: Column
    temperature_unit: Literal["K", "degC"] = Field(description="K or degC")
    stress_column: Column
    stress_unit: str = Field(description="Pa, MPa or GPa")
    strain_rate_column: Column
    strain_rate_unit: str = Field(description="1/s or 1e-6/s")
    grain_size_column: Column
    grain_size_unit: str = Field(description="m, mm or um")
    relative_stress_uncertainty_column: Column | None = None


class _PeakStressFile(Table):
    id: str = Field(
        pattern=r"^[A-Za-z0-9._-]+$", description="the table's name, part of file names"
    )
    material: str = Field(min_length=1, description="the material, such as ice")
    protocol: Literal["peak_stress"] = Field(description="the kind of table")
    data: _DataTable = Field(description="the table that says where the columns are")
    provenance: ProvenanceTable = Field(description="the table that says where data come from")


def load_peak_stress(path: str | Path) -> PeakStressData:
    """Read and check a table of peak stresses and the data file that it names.

    Parameters
    ----------
    path : str or Path
        The TOML file.

    Raises
    ------
    InputError
        If a file, key, unit or number is not what it has to be, or there are fewer than
        `LEAST_POINTS` points.
    """
    path = Path(path)
    file = read_toml(path, _PeakStressFile)
    data = file.data
    wanted = dict(QUANTITIES)
    if data.relative_stress_uncertainty_column is not None:
        wanted["relative_stress_uncertainty"] = None
    columns = {
        f"{name}_column": None if quantity is None else (f"{name}_unit", quantity)
        for name, quantity in wanted.items()
    }
    source = data.folder(path) / data.file
    read = read_columns(source, data, columns, where=path, file_key="'file' in [data]")
    values = dict(zip(wanted, read, strict=True))
    if data.temperature_unit == "degC":
        values["temperature"] = values["temperature"] + ZERO_CELSIUS
    _check_values(source, values)
    return PeakStressData(
        id=file.id,
        material=file.material,
        **{"relative_stress_uncertainty": np.zeros(read[0].size), **values},
        provenance=Provenance(**file.provenance.model_dump()),
    )


def save_peak_stress(data: PeakStressData, directory: Path) -> Path:
    """Write a self-contained copy, ``peak_stress.toml`` and ``peak_stress.csv``, in SI units.

    `load_peak_stress` reads back equal contents.

    Parameters
    ----------
    data : PeakStressData
        What to write.
    directory : Path
        An existing folder.

    Returns
    -------
    Path
        The TOML file.
    """
    names = [*SI_UNITS, "relative_stress_uncertainty"]
    write_columns(directory / "peak_stress.csv", {name: getattr(data, name) for name in names})
    table = {
        "id": data.id,
        "material": data.material,
        "protocol": "peak_stress",
        "data": {
            "file": "peak_stress.csv",
            **{f"{name}_column": name for name in names},
            **{f"{name}_unit": unit for name, unit in SI_UNITS.items()},
        },
        "provenance": asdict(data.provenance),
    }
    target = directory / "peak_stress.toml"
    write_toml(target, table)
    return target


def least_squares(data: PeakStressData) -> dict[str, tuple[float, float]]:
    """Exponents by plain least squares of ln(strain rate), without any effect of temperature.

    Parameters
    ----------
    data : PeakStressData
        The table.

    Returns
    -------
    dict
        Value and standard error of stress_exponent and, where grain sizes differ,
        grain_size_exponent.
    """
    columns = {"stress_exponent": np.log(data.stress)}
    if np.ptp(data.grain_size) > 0:
        columns["grain_size_exponent"] = -np.log(data.grain_size)
    log_rate = np.log(data.strain_rate)
    design = np.column_stack([np.ones(data.n_points), *columns.values()])
    coefficients, *_ = np.linalg.lstsq(design, log_rate, rcond=None)
    residual = log_rate - design @ coefficients
    variance = float(residual @ residual) / (data.n_points - design.shape[1])
    errors = np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design)))
    return {
        name: (float(coefficients[k]), float(errors[k])) for k, name in enumerate(columns, start=1)
    }


def _check_values(source: Path, values: Mapping[str, FloatArray]) -> None:
    """Check what the columns hold, in SI units."""
    n_points = values["stress"].size
    if n_points < LEAST_POINTS:
        raise InputError(f"{source}: found {n_points} rows, expected at least {LEAST_POINTS}.")
    for name, column in values.items():
        lowest = 0.0 if name == "relative_stress_uncertainty" else np.nextafter(0.0, 1.0)
        wrong = np.flatnonzero(column < lowest)
        if wrong.size > 0:
            wanted = "at least 0" if lowest == 0.0 else "more than 0"
            raise InputError(
                f"{source}: data row {wrong[0] + 1}: the {name.replace('_', ' ')} is "
                f"{column[wrong[0]]:g} in SI units, expected {wanted}."
            )
    largest = float(values.get("relative_stress_uncertainty", np.zeros(1)).max())
    if largest >= 1:
        raise InputError(
            f"{source}: found a relative stress uncertainty of {largest:g}, expected a fraction "
            "below 1."
        )
    coldest, warmest = values["temperature"].min(), values["temperature"].max()
    if not (coldest >= 50 and warmest <= 3000):
        wrong_one = coldest if coldest < 50 else warmest
        raise InputError(
            f"{source}: found a temperature of {wrong_one:g} K, expected kelvin between 50 and "
            "3000 (key 'temperature_unit' in [data] may be K or degC)."
        )
    if np.ptp(np.log(values["stress"])) == 0:
        raise InputError(
            f"{source}: all stresses are {values['stress'][0]:g} Pa, expected different ones."
        )


RATE_SCATTER = Parameter(
    "rate_scatter", r"s_{\dot\epsilon}", "scatter of ln(strain rate)", "dimensionless", "1", "1"
)
"""Standard deviation of ln(strain rate) between tests, beyond what known uncertainties explain."""

FLOW_LAW_PARAMETERS: tuple[Parameter, ...] = (
    *(
        PARAMETER_BY_NAME[name]
        for name in ("stress_exponent", "grain_size_exponent", "activation_enthalpy", "beta")
    ),
    RATE_SCATTER,
)
"""Parameters of the fit, in the order of `stan/peak_stress.stan`."""


class _RateScatterTable(PriorTable):
    family: Literal["half_normal"] = Field(description="the family of the prior")


class _ParameterTables(Table):
    stress_exponent: PriorTable = Field(description="a prior or a fixed value")
    grain_size_exponent: PriorTable = Field(description="a prior or a fixed value")
    activation_enthalpy: PriorTable = Field(description="a prior or a fixed value")
    beta: PriorTable = Field(description="a prior or a fixed value")
    rate_scatter: _RateScatterTable = Field(description="a half-normal prior")


class _PeakStressPriorFile(PriorFile):
    parameters: _ParameterTables = Field(description="one table for each parameter")


def load_peak_stress_priors(path: str | Path) -> PriorSet:
    """Read and check a prior file for tables of peak stresses.

    Parameters
    ----------
    path : str or Path
        TOML as for `pyburgers.model.priors.load_priors`, with a table for each of
        `FLOW_LAW_PARAMETERS`; the scatter has a half-normal prior.

    Raises
    ------
    InputError
        If the file, a key, a unit or a number is not what it has to be.
    """
    path = Path(path)
    file = read_toml(path, _PeakStressPriorFile)
    priors = {
        p.name: load_prior(path, p, getattr(file.parameters, p.name)) for p in FLOW_LAW_PARAMETERS
    }
    check_beta(f"{path}: [parameters.beta]", priors["beta"])
    return file.prior_set(path, priors)


def save_peak_stress_priors(priors: PriorSet, path: Path) -> None:
    """Write a prior file in SI units; `load_peak_stress_priors` reads back an equal set.

    Parameters
    ----------
    priors : PriorSet
        Priors of `FLOW_LAW_PARAMETERS`.
    path : Path
        The TOML file; its folder must exist.
    """
    save_priors(priors, path, FLOW_LAW_PARAMETERS)


def default_peak_stress_priors(material: str) -> PriorSet:
    """Return the weak priors that come with the package for a material.

    Parameters
    ----------
    material : str
        For example ``"ice"``.

    Raises
    ------
    InputError
        If there are none; the message names the materials that have some.
    """
    file = shipped_prior_file(material, "peak_stress", of=" for peak stresses")
    return load_peak_stress_priors(file)


def with_curve_enthalpy(priors: PriorSet, curve: PriorSet) -> PriorSet:
    """Take the priors of Q_M and beta from those of a curve.

    A table at one temperature says little about either. Where its flow law is handed on to a curve,
    in place of the curve's own priors of the flow law, they would be lost without this.

    Parameters
    ----------
    priors : PriorSet
        For a table of peak stresses.
    curve : PriorSet
        For a curve of the same material.
    """
    taken = {name: curve[name] for name in ("activation_enthalpy", "beta")}
    return replace(
        priors,
        priors=MappingProxyType({**priors.priors, **taken}),
        title=f"{priors.title}; Q_M and beta from {curve.title}",
    )
