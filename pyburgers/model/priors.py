"""Prior distributions of the model's parameters, read from TOML files.

Values are SI after reading. Priors are data of the Stan programs: changing one, or fixing a
parameter, needs no change of Stan code.
"""

import importlib.resources
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field
from scipy import stats

from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table, nearest, read_toml, write_toml
from pyburgers.common.units import factor_to_si
from pyburgers.model.flow_law_prior import Conditions, FlowLawPrior
from pyburgers.model.parameters import (
    CONSTANTS,
    KELVIN_REFERENCES,
    PARAMETER_BY_NAME,
    PARAMETERS,
    PROGRAM_PARAMETERS,
    STANDARD_VALUES,
    Parameter,
)

if TYPE_CHECKING:
    from scipy.stats._distn_infrastructure import rv_continuous_frozen

Family = Literal["uniform", "normal", "half_normal", "lognormal", "fixed"]

MAX_STRESS = "max_stress"
"""Unit of a stress that is a share of the largest measured stress, known only with the data."""

REQUIRED_KEYS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "uniform": ("lower", "upper"),
        "normal": ("location", "scale"),
        "half_normal": ("scale",),
        "lognormal": ("location", "scale"),
        "fixed": ("value",),
    }
)
OPTIONAL_KEYS: Mapping[str, tuple[str, ...]] = MappingProxyType({"normal": ("lower", "upper")})
"""Number keys of each family; no other is allowed."""

MAY_BE_ZERO = frozenset(
    {
        "grain_size_exponent",
        "kelvin_activation_enthalpy",
        "residual_correlation_strain",
        "piezometer_reference_grain_size",
    }
)
"""Parameters that may be fixed at zero."""

UNSIGNED = frozenset({"beta", "activation_enthalpy"})
"""Parameters whose priors may reach below zero."""

FLOW_LAW = ("stress_exponent", "grain_size_exponent", "activation_enthalpy", "beta")
"""Parameters that a joint prior of the flow law is about."""

BOUNDED_AWAY_FROM_ZERO = frozenset(
    {"steady_state_fabric_factor", "critical_strain_grain_size", "critical_strain_fabric"}
)
"""Parameters that divide: at zero the model breaks down, so priors may not pile up there.

The lower bound of zero that the paper prints for the critical strain of olivine is one of these.
"""


@dataclass(frozen=True)
class Prior:
    """Prior of one parameter in SI units.

    Attributes
    ----------
    parameter : str
        A name of `pyburgers.model.parameters.PROGRAM_PARAMETERS`.
    family : {"uniform", "normal", "half_normal", "lognormal", "fixed"}
        Normal priors may be truncated to [lower, upper].
    location : float
        Normal: mean before truncation. Half-normal: 0. Lognormal: median. Uniform: midpoint.
        Fixed: the value.
    scale : float
        Normal and half-normal: standard deviation of the normal before truncation. Lognormal:
        standard deviation of the logarithm. Uniform: half the range. Fixed: 0.
    lower, upper : float
        Support; infinite where there is no bound.
    unit : str
        Unit in the file that was read: a record, `location` and the others are SI.
    source : str
        Where the prior comes from.
    relative_to_max_stress : bool
        Whether the numbers are shares of the largest measured stress, see `PriorSet.resolved`.
    """

    parameter: str
    family: Family
    location: float
    scale: float
    lower: float
    upper: float
    unit: str = field(compare=False)
    source: str
    relative_to_max_stress: bool = False

    @property
    def is_fixed(self) -> bool:
        """Whether the parameter has one value and is not inferred."""
        return self.family == "fixed"

    def distribution(self) -> "rv_continuous_frozen[Any, Any]":
        """Return the prior as a frozen distribution of `scipy.stats`, SI units.

        Raises
        ------
        ValueError
            If the parameter is fixed, or the numbers are still shares of the largest stress.
        """
        if self.relative_to_max_stress:
            raise ValueError(f"the prior of {self.parameter} needs PriorSet.resolved first")
        if self.family == "uniform":
            return stats.uniform(loc=self.lower, scale=self.upper - self.lower)
        if self.family == "lognormal":
            return stats.lognorm(s=self.scale, scale=self.location)
        if self.family == "fixed":
            raise ValueError(f"{self.parameter} is fixed and has no distribution")
        lower, upper = ((end - self.location) / self.scale for end in (self.lower, self.upper))
        return stats.truncnorm(lower, upper, loc=self.location, scale=self.scale)

    def sample(self, rng: np.random.Generator) -> float:
        """Draw one value (SI); a fixed parameter gives its value."""
        if self.is_fixed:
            return self.location
        return float(self.distribution().rvs(random_state=rng))


@dataclass(frozen=True)
class PriorSet:
    """Priors of all parameters for one material.

    Attributes
    ----------
    material, title : str
        What the priors are for.
    priors : mapping of str to Prior
        Every one of `pyburgers.model.parameters.PARAMETERS`, in their order, then those of variants
        that are given; the others have their standard values.
    name : str
        Name of the file without its ending.
    notes : str or None
        Remarks for the reader.
    flow_law : FlowLawPrior or None
        Joint prior of `FLOW_LAW` in place of their own, which are then its marginals.
    """

    material: str
    title: str
    priors: Mapping[str, Prior]
    name: str = field(compare=False)
    notes: str | None = None
    flow_law: FlowLawPrior | None = None

    def __getitem__(self, parameter: str) -> Prior:
        """Return the prior of a parameter; one of a variant may be left to its standard value."""
        found = self.priors.get(parameter)
        return _standard(parameter) if found is None else found

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that are inferred."""
        return tuple(name for name, prior in self.priors.items() if not prior.is_fixed)

    def sample(self, rng: np.random.Generator) -> dict[str, float]:
        """Draw every parameter (SI); fixed ones have their value."""
        values = {name: prior.sample(rng) for name, prior in self.priors.items()}
        return values if self.flow_law is None else {**values, **self.flow_law.sample(rng)}

    def resolved(self, max_stress: float) -> "PriorSet":
        """Return the set with shares of the largest stress turned into Pa.

        Parameters
        ----------
        max_stress : float
            Largest measured absolute stress (Pa).
        """
        return replace(
            self,
            priors=MappingProxyType(
                {
                    name: _in_pascal(prior, max_stress) if prior.relative_to_max_stress else prior
                    for name, prior in self.priors.items()
                }
            ),
        )


def with_flow_law(priors: PriorSet, flow_law: FlowLawPrior, where: str) -> PriorSet:
    """Put a flow law in the place of the priors of n, p, Q_M and beta.

    Parameters
    ----------
    priors : PriorSet
        Priors of every parameter.
    flow_law : FlowLawPrior
        Joint prior of the four.
    where : str
        Where it comes from, for messages.

    Raises
    ------
    InputError
        If it is of another material, or one of the four parameters is fixed.
    """
    if flow_law.material != priors.material:
        raise InputError(
            f"{where}: is a flow law of {flow_law.material}, expected one of {priors.material}."
        )
    fixed = [name for name in FLOW_LAW if priors[name].is_fixed]
    if fixed:
        raise InputError(
            f"{where}: {fixed[0]} is fixed by the priors {priors.title!r}, expected the whole flow "
            "law free where a joint prior takes its place."
        )
    source = f"Marginal of the joint prior of the flow law, {flow_law.source}"
    marginals = {
        name: _prior(
            name,
            "normal",
            {"location": mean, "scale": spread, **({} if name in UNSIGNED else {"lower": 0.0})},
            unit=PARAMETER_BY_NAME[name].si_unit,
            source=source,
            relative=False,
        )
        for name, (mean, spread) in flow_law.marginals().items()
    }
    return replace(
        priors,
        priors=MappingProxyType({**priors.priors, **marginals}),
        title=f"{priors.title}; flow law from {flow_law.source}",
        flow_law=flow_law,
    )


class PriorTable(Table):
    """The table of one parameter in a prior file."""

    family: Family = Field(description="the family of the prior")
    unit: str = Field(description="the unit of the numbers")
    source: str = Field(min_length=1, description="where the prior comes from")
    location: float | None = Field(None, description="the mean, or median of a lognormal prior")
    scale: float | None = Field(None, gt=0, description="the spread of the prior")
    lower: float | None = Field(None, description="the lower bound")
    upper: float | None = Field(None, description="the upper bound")
    value: float | None = Field(None, description="the value of a fixed parameter")

    def numbers(self) -> dict[str, float]:
        """Return the number keys that are present."""
        keys = ("location", "scale", "lower", "upper", "value")
        return {key: value for key in keys if (value := getattr(self, key)) is not None}


class _FlowLawTable(Table):
    source: str = Field(min_length=1, description="where the flow law comes from")
    quantities: list[str] = Field(description="n, p, ln(flow rate s) and beta by their names")
    mean: list[float] = Field(description="the mean of each quantity, SI")
    covariance: list[list[float]] = Field(description="the covariance of the quantities, SI")
    temperature: float = Field(description="of the flow rate, in kelvin")
    stress: float = Field(description="of the flow rate, in Pa")
    grain_size: float = Field(description="of the flow rate, in m")


class _PriorFile(Table):
    material: str = Field(min_length=1, description="the material, such as ice")
    title: str = Field(min_length=1, description="a title for tables and figures")
    notes: str | None = None
    parameters: dict[str, PriorTable] = Field(description="one table for each parameter")
    flow_law: _FlowLawTable | None = None


def load_priors(path: str | Path) -> PriorSet:
    """Read and check a prior file.

    Parameters
    ----------
    path : str or Path
        TOML with material, title and one table ``[parameters.NAME]`` for every parameter; those of
        variants (`pyburgers.model.parameters.VARIANT_PARAMETERS`) may be left out.

    Raises
    ------
    InputError
        If the file, a key, a unit or a number is not what it has to be, or a prior gives mass to
        values that the model excludes.
    """
    path = Path(path)
    file = read_toml(path, _PriorFile)
    for name in file.parameters:
        if name not in PARAMETER_BY_NAME:
            raise InputError(
                f"{path}: unknown parameter {name!r} in [parameters], "
                f"{nearest(name, PARAMETER_BY_NAME)}"
            )
    for parameter in PARAMETERS:
        if parameter.name not in file.parameters:
            raise InputError(
                f"{path}: table [parameters.{parameter.name}] is missing, expected a prior or a "
                f"fixed value of the {parameter.label}."
            )
    priors = {
        p.name: load_prior(path, p.name, file.parameters[p.name])
        for p in PROGRAM_PARAMETERS
        if p.name in file.parameters
    }
    _check_kelvin_references(path, priors)
    if not is_fixed_at(priors["stress_exponent"], 1.0):
        check_beta(f"{path}: [parameters.beta]", priors["beta"])
    return PriorSet(
        material=file.material,
        title=file.title,
        priors=MappingProxyType(priors),
        name=path.stem,
        notes=file.notes,
        flow_law=None if file.flow_law is None else _flow_law(path, file.material, file.flow_law),
    )


def _flow_law(path: Path, material: str, table: _FlowLawTable) -> FlowLawPrior:
    """Build the joint prior of a file's table [flow_law]."""
    flow_law = FlowLawPrior(
        quantities=tuple(table.quantities),
        mean=np.array(table.mean),
        covariance=np.array(table.covariance),
        conditions=Conditions(table.temperature, table.stress, table.grain_size),
        material=material,
        source=table.source,
    )
    return flow_law.checked(f"{path}: [flow_law]")


def _flow_law_table(flow_law: FlowLawPrior) -> dict[str, Any]:
    """Return the table [flow_law] of a joint prior, the inverse of `_flow_law`."""
    return {
        "source": flow_law.source,
        "quantities": list(flow_law.quantities),
        "mean": flow_law.mean.tolist(),
        "covariance": flow_law.covariance.tolist(),
        **asdict(flow_law.conditions),
    }


def save_priors(
    priors: PriorSet, path: Path, parameters: Sequence[Parameter] = PROGRAM_PARAMETERS
) -> None:
    """Write a prior file in SI units; `load_priors` reads back an equal set.

    Parameters
    ----------
    priors : PriorSet
        What to write.
    path : Path
        The TOML file; its folder must exist.
    parameters : sequence of Parameter
        In their order; those that the set does not give are left out.
    """
    tables = {}
    for parameter in parameters:
        prior = priors.priors.get(parameter.name)
        if prior is None:
            continue
        tables[parameter.name] = {
            "family": prior.family,
            **prior_numbers(prior),
            "unit": MAX_STRESS if prior.relative_to_max_stress else parameter.si_unit,
            "source": prior.source,
        }
    table = {
        "material": priors.material,
        "title": priors.title,
        "notes": priors.notes,
        "parameters": tables,
        "flow_law": None if priors.flow_law is None else _flow_law_table(priors.flow_law),
    }
    write_toml(path, table)


def default_priors(material: str) -> PriorSet:
    """Return the priors that come with the package for a material.

    Parameters
    ----------
    material : str
        For example ``"ice"``.

    Raises
    ------
    InputError
        If there are none; the message names the materials that have some.
    """
    return load_priors(shipped_prior_file(material))


def shipped_prior_file(material: str, folder: str = ".", *, of: str = "") -> Path:
    """Return the prior file that comes with the package for a material.

    Parameters
    ----------
    material : str
        For example ``"ice"``.
    folder : str
        Folder inside that of the priors.
    of : str
        What the priors are for, as the error message puts it after "no default priors".

    Raises
    ------
    InputError
        If there is none; the message names the materials that have one.
    """
    files = shipped_prior_files(folder)
    if material not in files:
        raise InputError(
            f"material {material!r} has no default priors{of}, expected one of "
            f"{', '.join(files)}, or a prior file of your own."
        )
    return files[material]


def shipped_prior_files(folder: str = ".") -> dict[str, Path]:
    """Return the prior files that come with the package, in a folder of theirs, by material."""
    package = Path(str(importlib.resources.files("pyburgers")))
    # In a wheel the data lie inside the package, in a checkout beside it.
    folders = [root / "data" / "priors" / folder for root in (package, package.parent)]
    return {path.stem: path for place in folders for path in sorted(place.glob("*.toml"))}


def load_prior(path: Path, name: str, table: PriorTable) -> Prior:
    """Check one table and convert it to SI."""
    where = f"{path}: [parameters.{name}]"
    numbers = table.numbers()
    _check_keys(where, table.family, numbers)
    quantity = PARAMETER_BY_NAME[name].quantity
    relative = name == "stress_noise" and table.unit == MAX_STRESS
    factor = 1.0 if relative else factor_to_si(table.unit, quantity, f"{where}: key 'unit'")
    prior = _prior(
        name,
        table.family,
        _scaled(numbers, factor, table.family),
        unit=table.unit,
        source=table.source,
        relative=relative,
    )
    _check_prior(where, prior)
    return prior


def fixed_prior(parameter: Parameter, value: float, source: str) -> Prior:
    """Return the prior of a parameter that has one value.

    Parameters
    ----------
    parameter : Parameter
        Which.
    value : float
        SI.
    source : str
        Where the value comes from.
    """
    numbers = {"value": value}
    return _prior(
        parameter.name, "fixed", numbers, unit=parameter.si_unit, source=source, relative=False
    )


def is_fixed_at(prior: Prior, value: float) -> bool:
    """Whether a parameter has a given value (SI) and no other."""
    return prior.is_fixed and prior.location == value


def _standard(name: str) -> Prior:
    """Prior of a parameter of a variant of which nothing is said."""
    value = STANDARD_VALUES[name]
    return fixed_prior(PARAMETER_BY_NAME[name], value, "standard value, without effect")


def _check_kelvin_references(path: Path, priors: Mapping[str, Prior]) -> None:
    """Ask what the Kelvin viscosity is given for, where it varies."""
    for name, reference in KELVIN_REFERENCES.items():
        standard = STANDARD_VALUES[name]
        varies = name in priors and not is_fixed_at(priors[name], standard)
        if varies and reference not in priors:
            raise InputError(
                f"{path}: table [parameters.{reference}] is missing, expected a fixed value "
                f"because {name} is not fixed at {standard:g}."
            )


def _check_keys(where: str, family: Family, numbers: Mapping[str, float]) -> None:
    """Check that a family has the numbers that it needs and no others."""
    required = REQUIRED_KEYS[family]
    allowed = (*required, *OPTIONAL_KEYS.get(family, ()))
    for key in required:
        if key not in numbers:
            raise InputError(f"{where}: key {key!r} is missing, the family {family!r} needs it.")
    for key in numbers:
        if key not in allowed:
            raise InputError(
                f"{where}: key {key!r} does not go with the family {family!r}, "
                f"expected {' and '.join(allowed)}."
            )


def _scaled(numbers: Mapping[str, float], factor: float, family: Family) -> dict[str, float]:
    """Multiply all numbers except the dimensionless scale of a lognormal prior."""
    return {
        key: value if (family, key) == ("lognormal", "scale") else value * factor
        for key, value in numbers.items()
    }


def _prior(
    name: str,
    family: Family,
    numbers: Mapping[str, float],
    *,
    unit: str,
    source: str,
    relative: bool,
) -> Prior:
    """Build a prior from the numbers of its family."""
    positive = family in ("half_normal", "lognormal")
    lower = numbers.get("lower", 0.0 if positive else -math.inf)
    upper = numbers.get("upper", math.inf)
    if family == "uniform":
        location, scale = 0.5 * (lower + upper), 0.5 * (upper - lower)
    elif family == "fixed":
        location, scale = numbers["value"], 0.0
    else:
        location, scale = numbers.get("location", 0.0), numbers["scale"]
    return Prior(name, family, location, scale, lower, upper, unit, source, relative)


def prior_numbers(prior: Prior) -> dict[str, float]:
    """Return the numbers of a prior under the keys of its family, the inverse of `_prior`."""
    values = {
        "location": prior.location,
        "scale": prior.scale,
        "lower": prior.lower,
        "upper": prior.upper,
        "value": prior.location,
    }
    keys = (*REQUIRED_KEYS[prior.family], *OPTIONAL_KEYS.get(prior.family, ()))
    return {key: values[key] for key in keys if math.isfinite(values[key])}


def _in_pascal(prior: Prior, max_stress: float) -> Prior:
    return _prior(
        prior.parameter,
        prior.family,
        _scaled(prior_numbers(prior), max_stress, prior.family),
        unit=PARAMETER_BY_NAME[prior.parameter].si_unit,
        source=prior.source,
        relative=False,
    )


def _check_prior(where: str, prior: Prior) -> None:
    """Check that a prior is a distribution over values that the model allows."""
    if prior.lower >= prior.upper:
        raise InputError(
            f"{where}: key 'lower' is not below key 'upper', found {prior.lower:g} and "
            f"{prior.upper:g} in SI units."
        )
    if prior.family == "lognormal" and prior.location <= 0:
        raise InputError(
            f"{where}: key 'location': found {prior.location:g}, expected a positive median."
        )
    if prior.parameter not in UNSIGNED:
        _check_sign(where, prior)
    if prior.parameter in CONSTANTS and not prior.is_fixed:
        raise InputError(
            f"{where}: key 'family': found {prior.family!r}, expected 'fixed' because the number "
            "is a constant of the model."
        )
    if prior.parameter == "kelvin_stress_exponent":
        least = prior.location if prior.is_fixed else prior.lower
        if least < 1:
            key = "value" if prior.is_fixed else "lower"
            raise InputError(
                f"{where}: key {key!r}: found {least:g}, expected at least 1, a linear dashpot, "
                "because below it creep starts infinitely fast."
            )
    if prior.parameter == "steady_state_fabric_factor":
        largest = prior.location if prior.is_fixed else prior.upper
        if largest > 1:
            key = "value" if prior.is_fixed else "upper"
            raise InputError(
                f"{where}: key {key!r}: found {largest:g}, expected at most 1, the value of an "
                "isotropic fabric."
            )


def check_beta(where: str, prior: Prior) -> None:
    """Refuse the sign of beta that Table 1 of the paper prints for ice.

    Parameters
    ----------
    where : str
        File and table, for the message.
    prior : Prior
        Of beta, for a power-law dashpot: A of a linear one, in 1/(Pa s), may well exceed 1.

    Raises
    ------
    InputError
        If beta is not negative.
    """
    if prior.location < 0:
        return
    key = {"uniform": "upper", "half_normal": "family", "fixed": "value"}.get(
        prior.family, "location"
    )
    raise InputError(
        f"{where}: key {key!r} puts beta at {prior.location:g} mol/J, expected a negative value: "
        "Table 1 of the paper prints +7.29e-4 mol/J for ice, which in SI units gives strain rates "
        "of about 1e35 1/s at laboratory stress, so the sign is a misprint; use -7.29e-4."
    )


def _check_sign(where: str, prior: Prior) -> None:
    """Refuse mass below zero, and mass near zero for parameters that divide."""
    if prior.is_fixed:
        if prior.location < 0 or (prior.location == 0 and prior.parameter not in MAY_BE_ZERO):
            raise InputError(
                f"{where}: key 'value': found {prior.location:g}, expected a positive number."
            )
        return
    key = "family" if prior.family == "half_normal" else "lower"
    found = "no lower bound" if math.isinf(prior.lower) else f"a lower bound of {prior.lower:g}"
    if prior.lower < 0:
        raise InputError(
            f"{where}: key {key!r}: found {found}, expected at least 0 because the parameter "
            "cannot be negative."
        )
    strict = prior.parameter in BOUNDED_AWAY_FROM_ZERO and prior.family != "lognormal"
    if strict and prior.lower == 0:
        raise InputError(
            f"{where}: key {key!r}: found {found}, expected a positive one (such as 1e-3) because "
            "the model breaks down at zero."
        )
