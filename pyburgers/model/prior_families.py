"""Prior of one parameter: its family, what its table in a prior file holds, what it may be.

Values are SI after reading. Priors are data of the Stan programs: changing one, or fixing a
parameter, needs no change of Stan code.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, Self

import numpy as np
from pydantic import Field
from scipy import stats
from scipy.special import ndtr, ndtri_exp

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError, nearest, require_type
from pyburgers.common.paths import shipped_folder
from pyburgers.common.toml_files import Table, Word, factor_to_si, read_toml
from pyburgers.model.parameters import (
    BELOW_ONE,
    BOUNDED_AWAY_FROM_ZERO,
    CONSTANTS,
    ENDS_AT_ONE,
    LOWER_LIMITS,
    MAY_BE_ZERO,
    PARAMETER_BY_NAME,
    STANDARD_VALUES,
    UNSIGNED,
    Parameter,
)

if TYPE_CHECKING:
    from scipy.stats._distn_infrastructure import rv_continuous_frozen

Family = Literal["uniform", "normal", "half_normal", "lognormal", "fixed"]

MAX_STRESS = "max_stress"
"""Unit of a stress that is a share of the largest measured stress, known only with the data."""


@dataclass(frozen=True)
class FamilyRules:
    """Number keys that a family needs and may have, and its code in `stan/statistics/priors.stan`.

    `least` is the lower bound of its values if no key says one; `sign_key` is the key that decides
    the sign of its values.
    """

    required: tuple[str, ...]
    code: int
    optional: tuple[str, ...] = ()
    least: float = -math.inf
    sign_key: str = "lower"

    @property
    def keys(self) -> tuple[str, ...]:
        """All number keys; no other is allowed."""
        return (*self.required, *self.optional)


FAMILIES: Mapping[Family, FamilyRules] = {
    "uniform": FamilyRules(("lower", "upper"), 1),
    "normal": FamilyRules(("location", "scale"), 2, optional=("lower", "upper")),
    # A normal that is cut at zero.
    "half_normal": FamilyRules(("scale",), 2, least=0.0, sign_key="family"),
    "lognormal": FamilyRules(("location", "scale"), 3, least=0.0),
    "fixed": FamilyRules(("value",), 0),
}

LEAST_MASS = 1e-12
"""Of a normal between the bounds of its prior: the programs take it from two numbers up to 1."""

SCORE_AT_BOUND = 8.0
"""Normal score that stands for infinity: of a draw that rounding has put on a bound."""


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
        Origin of the prior.
    relative_to_max_stress : bool
        Whether the numbers are shares of the largest measured stress, see `PriorSet.resolved`.
    read_off : tuple of str
        Words in the id, source or DOI of the data that the prior was read off.

    Examples
    --------
    >>> priors["stress_exponent"].is_fixed
    True
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
    read_off: tuple[str, ...] = ()

    @property
    def is_fixed(self) -> bool:
        """Whether the parameter has one value and is not inferred."""
        return self.family == "fixed"

    @property
    def physical_bounds(self) -> tuple[bool, bool]:
        """Whether the lower and the upper bound are where the model itself ends."""
        zero = -math.inf if self.parameter in UNSIGNED else 0.0
        lower = self.lower <= LOWER_LIMITS.get(self.parameter, (zero, ""))[0]
        return lower, self.upper == 1.0 and self.parameter in ENDS_AT_ONE

    def distribution(self) -> "rv_continuous_frozen[Any, Any]":
        """Return the prior as a frozen distribution of `scipy.stats`, SI units.

        Raises
        ------
        ValueError
            If the parameter is fixed, or the numbers are still shares of the largest stress.

        Examples
        --------
        >>> prior = pyburgers.priors("ice")["stress_exponent"]
        >>> low, high = prior.distribution().ppf([0.05, 0.95])
        """
        if self.relative_to_max_stress:
            raise InputError(
                f"{self.parameter}: found a prior that is a share of the largest stress, expected "
                "one in Pa, as of PriorSet.resolved."
            )
        if self.family == "uniform":
            return stats.uniform(loc=self.lower, scale=self.upper - self.lower)
        if self.family == "lognormal":
            return stats.lognorm(s=self.scale, scale=self.location)
        if self.family == "fixed":
            raise InputError(
                f"{self.parameter}: found a fixed prior, which has no distribution, expected a "
                "free one."
            )
        lower, upper = ((end - self.location) / self.scale for end in (self.lower, self.upper))
        return stats.truncnorm(lower, upper, loc=self.location, scale=self.scale)

    def sample(self, rng: np.random.Generator) -> float:
        """Draw one value (SI); a fixed parameter gives its value."""
        if self.is_fixed:
            return self.location
        return float(self.distribution().rvs(random_state=rng))

    def mean_sd(self) -> tuple[float, float]:
        """Mean and standard deviation (SI)."""
        if self.is_fixed:
            return self.location, 0.0
        law = self.distribution()
        return float(law.mean()), float(law.std())

    @classmethod
    def of_family(
        cls, parameter: str, family: Family, numbers: Mapping[str, float], **others: Any
    ) -> Self:
        """Return a prior from the numbers of its family; `others` are the remaining fields.

        Raises
        ------
        InputError
            If there is no such family, or it needs other numbers.

        Examples
        --------
        >>> prior = pyburgers.Prior.of_family(
        ...     "stress_exponent", "normal", {"location": 3, "scale": 1}, unit="1", source="mine"
        ... )
        """
        if family not in FAMILIES:
            raise InputError(f"{parameter}: unknown family {family!r}, {nearest(family, FAMILIES)}")
        _check_keys(parameter, family, numbers)
        lower = numbers.get("lower", FAMILIES[family].least)
        upper = numbers.get("upper", math.inf)
        if family == "uniform":
            location, scale = 0.5 * (lower + upper), 0.5 * (upper - lower)
        elif family == "fixed":
            location, scale = numbers["value"], 0.0
        else:
            location, scale = numbers.get("location", 0.0), numbers["scale"]
        return cls(parameter, family, location, scale, lower, upper, **others)

    def numbers(self) -> dict[str, float]:
        """Return the numbers under the keys of the family, as `of_family` takes them."""
        keys = FAMILIES[self.family].keys
        values = {key: self.location if key == "value" else getattr(self, key) for key in keys}
        return {key: value for key, value in values.items() if math.isfinite(value)}

    def resolved(self, max_stress: float) -> "Prior":
        """Return the prior in Pa, where it is a share of the largest stress (Pa)."""
        if not self.relative_to_max_stress:
            return self
        require_type("max_stress", max_stress, Real, "a stress in Pa")
        if not 0 < max_stress < math.inf:
            raise InputError(f"max_stress: found {max_stress:g} Pa, expected a positive stress.")
        numbers = _scaled(self.numbers(), max_stress, self.family)
        return Prior.of_family(
            self.parameter,
            self.family,
            numbers,
            unit="Pa",
            source=self.source,
            read_off=self.read_off,
        )


def normal_scores(law: "rv_continuous_frozen[Any, Any]", values: FloatArray) -> FloatArray:
    """Map values, in the unit of a continuous `law`, to a scale on which it is standard normal."""
    below, above = law.logcdf(values), law.logsf(values)
    scores = np.where(below < above, ndtri_exp(below), -ndtri_exp(above))
    return np.where(np.isinf(scores), np.sign(scores) * SCORE_AT_BOUND, scores)


class SomePriors(Protocol):
    """A set of priors."""

    @property
    def priors(self) -> Mapping[str, Prior]:
        """By parameter."""


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
    read_off: list[Word] = Field(
        default=[],
        description="words in the id, source or DOI of the data that the prior was read off",
    )

    def numbers(self) -> dict[str, float]:
        """Return the number keys that are present."""
        return self.model_dump(exclude={"family", "unit", "source", "read_off"}, exclude_none=True)


def load_prior(path: Path, parameter: Parameter, table: PriorTable) -> Prior:
    """Check the table of a parameter and convert it to SI.

    Raise InputError if a key, a unit or a number is not what it has to be; the message names the
    file `path`.
    """
    where = f"{path}: [parameters.{parameter.name}]"
    numbers = table.numbers()
    _check_keys(where, table.family, numbers)
    relative = parameter.name == "stress_noise" and table.unit == MAX_STRESS
    factor = (
        1.0 if relative else factor_to_si(table.unit, parameter.quantity, f"{where}: key 'unit'")
    )
    prior = Prior.of_family(
        parameter.name,
        table.family,
        _scaled(numbers, factor, table.family),
        unit=table.unit,
        source=table.source,
        relative_to_max_stress=relative,
        read_off=tuple(table.read_off),
    )
    check_prior(where, prior)
    return prior


def fixed_prior(parameter: Parameter, value: float, source: str) -> Prior:
    """Return the prior of a parameter that has one value (SI), and where that comes from."""
    return Prior.of_family(
        parameter.name, "fixed", {"value": value}, unit=parameter.si_unit, source=source
    )


def fixed_by_variant(name: str, value: float, choice: str) -> Prior:
    """Return the prior of a parameter that a choice such as ``fabric=constant`` fixes (SI)."""
    return fixed_prior(PARAMETER_BY_NAME[name], value, f"Variant {choice}")


def normal_prior(parameter: Parameter, mean: float, sd: float, source: str) -> Prior:
    """Return a normal prior (SI), cut at zero where the parameter cannot be negative."""
    numbers = {"location": mean, "scale": sd}
    if parameter.name not in UNSIGNED:
        numbers["lower"] = 0.0
    return Prior.of_family(parameter.name, "normal", numbers, unit=parameter.si_unit, source=source)


def is_standard(priors: Mapping[str, Prior], name: str) -> bool:
    """Whether priors leave a parameter of a variant at its standard value."""
    return name not in priors or is_fixed_at(priors[name], STANDARD_VALUES[name])


def is_fixed_at(prior: Prior, value: float) -> bool:
    """Whether a parameter has a given value (SI) and no other."""
    return prior.is_fixed and prior.location == value


class _FreedParametersFile(Table):
    parameters: dict[str, PriorTable] = Field(description="one table for each parameter")


@cache
def priors_of_freed_parameters() -> Mapping[str, Prior]:
    """Return the shipped priors of parameters that a variant frees, by name."""
    path = shipped_folder("data") / "priors" / "variants" / "free_parameters.toml"
    tables = read_toml(path, _FreedParametersFile).parameters
    return {name: load_prior(path, PARAMETER_BY_NAME[name], one) for name, one in tables.items()}


def _check_keys(where: str, family: Family, numbers: Mapping[str, float]) -> None:
    """Check that a family has the numbers that it needs and no others."""
    rules = FAMILIES[family]
    for key in rules.required:
        if key not in numbers:
            raise InputError(f"{where}: key {key!r} is missing, the family {family!r} needs it.")
    for key in numbers:
        if key not in rules.keys:
            raise InputError(
                f"{where}: key {key!r} does not go with the family {family!r}, "
                f"expected {' and '.join(rules.keys)}."
            )


def _scaled(numbers: Mapping[str, float], factor: float, family: Family) -> dict[str, float]:
    """Multiply all numbers except the dimensionless scale of a lognormal prior."""
    return {
        key: value if (family, key) == ("lognormal", "scale") else value * factor
        for key, value in numbers.items()
    }


def check_prior(where: str, prior: Prior) -> None:
    """Check that a prior is a distribution over values that the model allows.

    Raise InputError if it is none; the message begins with `where`, the file and table.
    """
    if prior.lower >= prior.upper:
        raise InputError(
            f"{where}: key 'lower' is not below key 'upper', found {prior.lower:g} and "
            f"{prior.upper:g} in SI units."
        )
    for key, found in (("location", prior.location), ("scale", prior.scale)):
        if not math.isfinite(found) or (key == "scale" and found <= 0 and not prior.is_fixed):
            expected = "a positive number" if key == "scale" else "a number"
            raise InputError(f"{where}: key {key!r}: found {found:g}, expected {expected}.")
    if prior.family == "lognormal" and prior.location <= 0:
        raise InputError(
            f"{where}: key 'location': found {prior.location:g}, expected a positive median."
        )
    if prior.family == "normal" and not (mass := _mass_inside(prior)) >= LEAST_MASS:
        raise InputError(
            f"{where}: its bounds, {prior.lower:g} to {prior.upper:g} in SI units, hold {mass:.1g} "
            f"of the mass of a normal with mean {prior.location:g} and standard deviation "
            f"{prior.scale:g}, expected at least {LEAST_MASS:g}; check both, or use family "
            "'uniform'."
        )
    if prior.parameter not in UNSIGNED:
        _check_sign(where, prior)
    if prior.parameter in CONSTANTS and not prior.is_fixed:
        raise InputError(
            f"{where}: key 'family': found {prior.family!r}, expected 'fixed' because the number "
            "is a constant of the model."
        )
    limit, meaning = LOWER_LIMITS.get(prior.parameter, (-math.inf, ""))
    found = prior.location if prior.is_fixed else prior.lower
    if found < limit:
        key = "value" if prior.is_fixed else "lower"
        raise InputError(f"{where}: key {key!r}: found {found:g}, expected {meaning}.")
    found = prior.location if prior.is_fixed else prior.upper
    if prior.parameter in BELOW_ONE and found >= 1:
        key = "value" if prior.is_fixed else "upper"
        raise InputError(f"{where}: key {key!r}: found {found:g}, expected less than 1.")


def _mass_inside(prior: Prior) -> float:
    """Share of a normal that lies between the bounds of its prior, also far in its tails."""
    below, above = ((end - prior.location) / prior.scale for end in (prior.lower, prior.upper))
    if below > 0:
        below, above = -above, -below
    return float(ndtr(above) - ndtr(below))


def check_beta(where: str, prior: Prior, material: str) -> None:
    """Refuse the sign of beta that Table 1 of the paper prints for ice.

    Raise InputError if beta is not negative. The prior is of beta of a power-law dashpot: A of a
    linear one, in 1/(Pa s), may well exceed 1. In the message, `where` is the file and table.
    """
    if prior.location < 0:
        return
    key = {"uniform": "upper", "half_normal": "family", "fixed": "value"}.get(
        prior.family, "location"
    )
    why = (
        "Table 1 of the paper prints +7.29e-4 mol/J for ice, which in SI units gives strain rates "
        "of about 1e35 1/s at laboratory stress, so the sign is a misprint; use -7.29e-4."
        if material == "ice"
        else "beta is ln(A)/Q_M, and A of a power law is far below 1 in SI units; check its sign."
    )
    raise InputError(
        f"{where}: key {key!r} puts beta at {prior.location:g} mol/J, expected a negative value: "
        f"{why}"
    )


def _check_sign(where: str, prior: Prior) -> None:
    """Refuse mass below zero, and mass near zero for parameters that divide."""
    if prior.is_fixed:
        if prior.location < 0 or (prior.location == 0 and prior.parameter not in MAY_BE_ZERO):
            raise InputError(
                f"{where}: key 'value': found {prior.location:g}, expected a positive number."
            )
        return
    key = FAMILIES[prior.family].sign_key
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
            "the model breaks down at zero, or follows another law."
        )
