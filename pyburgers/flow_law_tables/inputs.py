"""Tables of tests, one point each, and the priors of their flow law, from TOML files.

A point is the peak stress of a test at a rate, temperature and grain size. A table is a TOML file
beside a text file of columns, like an experiment; everything is converted to SI on reading.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
from pydantic import Field

from pyburgers.common.columns import Column, TextFilesTable, read_columns, write_columns
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path
from pyburgers.common.toml_files import NAME, Table, checked, read_tables, read_toml, write_toml
from pyburgers.kinds.conditions import unlikely_stress
from pyburgers.kinds.experiment import (
    TEMPERATURES,
    Experiment,
    Provenance,
    impossible_conditions,
    refuse_impossible,
)
from pyburgers.kinds.experiment_file import ProvenanceTable
from pyburgers.model.flow_law_prior import Conditions
from pyburgers.model.parameters import PARAMETER_BY_NAME, STRESS_SCATTER, Parameter
from pyburgers.model.peak_test import PeakTest
from pyburgers.model.prior_families import PriorTable, check_beta, load_prior
from pyburgers.model.priors import FLOW_LAW, PriorFile, PriorSet, shipped_prior_file

KIND = "peak_stress"
"""Key `protocol` of such tables."""


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


UNCERTAINTY = "relative_stress_uncertainty"
"""Column that a table may have."""


COLUMNS = (*QUANTITIES, UNCERTAINTY)


SI_UNITS: Mapping[str, str] = {
    "temperature": "K",
    "stress": "Pa",
    "strain_rate": "1/s",
    "grain_size": "m",
}


@dataclass(frozen=True)
class PeakStrain:
    """Strain (fraction) at which tests peak: mean over the tests, and its standard deviation."""

    mean: float
    sd: float


@dataclass(frozen=True, eq=False)
class PeakStressData:
    """Points of the flow law of one material, a test each, in SI units.

    Attributes
    ----------
    id, material : str
        Name of the table; the material names the default priors.
    temperature, stress, strain_rate, grain_size : array, shape (n_points,)
        K, Pa at the peak, 1/s imposed and m at the start; all positive.
    relative_stress_uncertainty : array, shape (n_points,)
        Standard deviation of each stress as a fraction of it; 0 where it is taken as exact.
    provenance : Provenance
        Origin of the numbers.
    peak_strain : PeakStrain or None
        Strain of the peaks, if it is stated.
    notices : tuple of str
        Sentences about changes during reading.

    Examples
    --------
    >>> table.n_points == len(table.stress)
    True
    """

    id: str
    material: str
    temperature: FloatArray
    stress: FloatArray
    strain_rate: FloatArray
    grain_size: FloatArray
    relative_stress_uncertainty: FloatArray
    provenance: Provenance
    peak_strain: PeakStrain | None = None
    notices: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse numbers that no test has, wherever they come from."""
        refuse_impossible(self.id, self.temperature, self.grain_size, self.stress)

    @property
    def n_points(self) -> int:
        """Number of tests."""
        return self.stress.size

    @property
    def mean_conditions(self) -> Conditions:
        """Means in which a flow law is linear: of 1/T, ln(stress) and ln(grain size)."""
        return Conditions(
            temperature=float(1 / np.mean(1 / self.temperature)),
            stress=float(np.exp(np.mean(np.log(self.stress)))),
            grain_size=float(np.exp(np.mean(np.log(self.grain_size)))),
        )

    @property
    def mean_strain_rate(self) -> float:
        """Geometric mean (1/s)."""
        return float(np.exp(np.mean(np.log(self.strain_rate))))

    @property
    def tests(self) -> tuple[PeakTest, ...]:
        """The tests one by one."""
        columns = (self.strain_rate, self.stress, self.temperature, self.grain_size)
        return tuple(PeakTest(*map(float, row)) for row in zip(*columns, strict=True))


def without_test(data: PeakStressData, experiment: Experiment) -> PeakStressData:
    """Leave out rows that may be a test, so that the table can be the prior of its curve.

    Parameters
    ----------
    data : PeakStressData
        The table.
    experiment : Experiment
        The test.

    Raises
    ------
    InputError
        If the test has no peak, none of the rows may be it, or fewer than `LEAST_POINTS` are left.

    Examples
    --------
    >>> test = pyburgers.load_experiment(data / "ice" / "PIL40.toml")
    >>> rest = pyburgers.without_test(table, test)
    """
    test = experiment.peak
    if test is None:
        raise InputError(
            f"{experiment.id}: has no stress at a constant rate, expected a test that a table of "
            "peak stresses can have."
        )
    kept = np.flatnonzero([not row.may_be(test) for row in data.tests])
    if kept.size == data.n_points:
        raise InputError(f"{data.id}: no row may be {experiment.id} with {test}, expected one.")
    if kept.size < LEAST_POINTS:
        raise InputError(
            f"{data.id}: without {experiment.id} {kept.size} rows are left, expected at least "
            f"{LEAST_POINTS}."
        )
    return replace(data, **{name: getattr(data, name)[kept] for name in COLUMNS})


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


class _PeakStrainTable(Table):
    mean: float = Field(gt=0, lt=1, description="mean strain of the peaks, a fraction")
    sd: float = Field(gt=0, lt=1, description="standard deviation of what is known of the mean")


class _PeakStressFile(Table):
    id: str = Field(pattern=NAME, description="the table's name, part of file names")
    material: str = Field(min_length=1, description="the material, such as ice")
    protocol: Literal["peak_stress"] = Field(description="the kind of table")
    data: _DataTable = Field(description="the table that says where the columns are")
    peak_strain: _PeakStrainTable | None = Field(
        None, description="at which strain the peaks lie, where it was read"
    )
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

    Examples
    --------
    >>> table = pyburgers.load_peak_stress(data / "ice" / "peak_stress_qi_goldsby_2021.toml")
    """
    path = given_path(path)
    content = read_tables(path)
    # Of a file of another kind none of the keys that it lacks is worth a word.
    if content.get("protocol", KIND) != KIND:
        raise InputError(
            f"{path}: key 'protocol': found {content['protocol']!r}, expected {KIND!r} (the "
            "kind of table)."
        )
    file = checked(path, content, _PeakStressFile)
    data = file.data
    wanted = dict(QUANTITIES)
    if data.relative_stress_uncertainty_column is not None:
        wanted[UNCERTAINTY] = None
    columns = {
        f"{name}_column": None if quantity is None else (f"{name}_unit", quantity)
        for name, quantity in wanted.items()
    }
    source = data.source(path)
    read, notes = read_columns(path, data, columns)
    values = dict(zip(wanted, read.values(), strict=True))
    if data.temperature_unit == "degC":
        values["temperature"] = values["temperature"] + ZERO_CELSIUS
    _check_values(source, values)
    peak = file.peak_strain
    return PeakStressData(
        id=file.id,
        material=file.material,
        **{UNCERTAINTY: np.zeros(len(values["stress"])), **values},
        provenance=Provenance(**file.provenance.model_dump()),
        peak_strain=None if peak is None else PeakStrain(peak.mean, peak.sd),
        notices=(*notes, *unlikely_stress(file.material, float(values["stress"].max()))),
    )


def save_peak_stress(data: PeakStressData, directory: Path) -> Path:
    """Write ``peak_stress.toml``, which is returned, and ``peak_stress.csv``, in SI units."""
    columns = {name: getattr(data, name) for name in COLUMNS}
    write_columns(directory / "peak_stress.csv", columns)
    table = {
        "id": data.id,
        "material": data.material,
        "protocol": KIND,
        "data": {
            "file": "peak_stress.csv",
            **{f"{name}_column": name for name in COLUMNS},
            **{f"{name}_unit": unit for name, unit in SI_UNITS.items()},
        },
        **({} if data.peak_strain is None else {"peak_strain": asdict(data.peak_strain)}),
        "provenance": asdict(data.provenance),
    }
    target = directory / "peak_stress.toml"
    write_toml(target, table)
    return target


def least_squares(data: PeakStressData) -> dict[str, tuple[float, float]]:
    """Return exponents with standard errors from ln(stress) by ln(rate) and ln(grain size).

    The result is empty if rows are too few, or too much alike, to tell.
    """
    columns = [np.ones(data.n_points), np.log(data.strain_rate)]
    if np.ptp(data.grain_size) > 0:
        columns.append(np.log(data.grain_size))
    design = np.column_stack(columns)
    if data.n_points <= len(columns) or np.linalg.matrix_rank(design) < len(columns):
        return {}
    log_stress = np.log(data.stress)
    slopes, *_ = np.linalg.lstsq(design, log_stress, rcond=None)
    residual = log_stress - design @ slopes
    variance = float(residual @ residual) / (data.n_points - design.shape[1])
    covariance = variance * np.linalg.inv(design.T @ design)
    n = 1 / slopes[1]
    found = {"stress_exponent": (float(n), float(n**2 * np.sqrt(covariance[1, 1])))}
    if len(columns) > 2:
        p = slopes[2] * n
        by_slopes = np.array([0.0, -p * n, n])
        error = float(np.sqrt(by_slopes @ covariance @ by_slopes))
        found["grain_size_exponent"] = (float(p), error)
    return found


def _check_values(source: Path, values: Mapping[str, FloatArray]) -> None:
    """Check what the columns hold, in SI units."""
    n_points = values["stress"].size
    if n_points < LEAST_POINTS:
        raise InputError(f"{source}: found {n_points} rows, expected at least {LEAST_POINTS}.")
    for name, column in values.items():
        lowest = 0.0 if name == UNCERTAINTY else np.nextafter(0.0, 1.0)
        wrong = np.flatnonzero(column < lowest)
        if wrong.size > 0:
            wanted = "at least 0" if lowest == 0.0 else "more than 0"
            raise InputError(
                f"{source}: data row {wrong[0] + 1}: the {name.replace('_', ' ')} is "
                f"{column[wrong[0]]:g} in SI units, expected {wanted}."
            )
    largest = float(values.get(UNCERTAINTY, np.zeros(1)).max())
    if largest >= 1:
        raise InputError(
            f"{source}: found a relative stress uncertainty of {largest:g}, expected a fraction "
            "below 1."
        )
    coldest, warmest = values["temperature"].min(), values["temperature"].max()
    faults = impossible_conditions(
        coldest if coldest < TEMPERATURES[0] else warmest,
        values["grain_size"].max(),
        ("temperature (key 'temperature_unit' in [data] may be K or degC)", "grain size"),
    )
    if faults:
        raise InputError(*(f"{source}: {fault}" for fault in faults))
    if np.ptp(np.log(values["stress"])) == 0:
        raise InputError(
            f"{source}: all stresses are {values['stress'][0]:g} Pa, expected different ones."
        )


FLOW_LAW_PARAMETERS: tuple[Parameter, ...] = (
    *(PARAMETER_BY_NAME[name] for name in FLOW_LAW),
    STRESS_SCATTER,
)
"""Parameters of the fit, in the order of `stan/peak_stress.stan`."""


class _StressScatterTable(PriorTable):
    family: Literal["half_normal"] = Field(description="the family of the prior")


class _ParameterTables(Table):
    stress_exponent: PriorTable = Field(description="a prior or a fixed value")
    grain_size_exponent: PriorTable = Field(description="a prior or a fixed value")
    activation_enthalpy: PriorTable = Field(description="a prior or a fixed value")
    beta: PriorTable = Field(description="a prior or a fixed value")
    stress_scatter: _StressScatterTable = Field(description="a half-normal prior")


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

    Examples
    --------
    >>> ice = pyburgers.load_peak_stress_priors(data / "priors" / "peak_stress" / "ice.toml")
    """
    path = given_path(path)
    file = read_toml(path, _PeakStressPriorFile)
    priors = {
        p.name: load_prior(path, p, getattr(file.parameters, p.name)) for p in FLOW_LAW_PARAMETERS
    }
    check_beta(f"{path}: [parameters.beta]", priors["beta"])
    return file.prior_set(path, priors)


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

    Examples
    --------
    >>> pyburgers.default_peak_stress_priors("ice").material
    'ice'
    """
    file = shipped_prior_file(material, "peak_stress", of=" for peak stresses")
    return load_peak_stress_priors(file)


def with_curve_flow_law(priors: PriorSet, curve: PriorSet) -> PriorSet:
    """Take the priors of n, p, Q_M and beta of a table from those of a curve.

    If the fitted flow law replaces these priors of the curve, their information is kept. It then
    agrees with the softening, which is simulated with them.

    Parameters
    ----------
    priors : PriorSet
        For a table of peak stresses.
    curve : PriorSet
        For a curve of the same material.

    Examples
    --------
    >>> curve, of_table = pyburgers.priors("ice"), pyburgers.default_peak_stress_priors("ice")
    >>> changed = pyburgers.with_curve_flow_law(of_table, curve)
    """
    taken = {name: curve[name] for name in FLOW_LAW}
    return replace(
        priors,
        priors=MappingProxyType({**priors.priors, **taken}),
        title=f"{priors.title}; flow law from {curve.title}",
    )
