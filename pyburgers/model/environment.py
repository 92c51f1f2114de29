"""Pressure, water and melt: checks of their values, and what they make of a rate in words."""

from collections.abc import Iterator, Mapping

import numpy as np
import numpy.typing as npt

from pyburgers.common.errors import InputError, nearest
from pyburgers.model.parameters import ALL_ENVIRONMENT_NUMBERS, ENVIRONMENT, PARAMETER_BY_NAME
from pyburgers.model.prior_families import Prior, is_fixed_at


def environment_faults(values: Mapping[str, npt.ArrayLike]) -> Iterator[str]:
    """Yield what is wrong with values (SI) of `ENVIRONMENT`; NaN is an unknown one."""
    for name in ENVIRONMENT:
        found = np.asarray(values.get(name, np.nan), dtype=np.float64)
        if name == "water_fugacity":
            wrong, expected = found <= 0, "more than 0"
        elif name == "melt_fraction":
            wrong, expected = (found < 0) | (found >= 1), "at least 0 and less than 1"
        else:
            wrong, expected = found < 0, "at least 0"
        wrong = wrong | np.isinf(found)
        if wrong.any():
            unit = PARAMETER_BY_NAME[name].si_unit.replace("1", "")
            value = f"{found[wrong].flat[0]:g} {unit}".rstrip()
            yield f"the {name.replace('_', ' ')} is {value}, expected {expected}."


def check_environment(values: Mapping[str, npt.ArrayLike]) -> None:
    """Raise InputError for an environment that a prediction cannot have."""
    for name in values:
        if name not in ENVIRONMENT:
            raise InputError(f"environment: unknown name {name!r}, {nearest(name, ENVIRONMENT)}")
    if faults := [*environment_faults(values)]:
        raise InputError(*(f"environment: {fault}" for fault in faults))


def acting_environment(values: Mapping[str, npt.ArrayLike]) -> tuple[str, ...]:
    """Return those of `ENVIRONMENT` on which a rate depends, by the parameters of a material."""
    return tuple(
        name
        for k, name in enumerate(ENVIRONMENT)
        if any(
            np.any(values.get(number, 0.0))
            for number in ALL_ENVIRONMENT_NUMBERS[k :: len(ENVIRONMENT)]
        )
    )


def environment_law(priors: Mapping[str, Prior], whose: str = "", of: str = "") -> str:
    """Return the factors of a rate by pressure, water and melt; empty where it has none.

    Names of priors are those of `ENVIRONMENT_NUMBERS` between `whose` and `of`.
    """
    factors = {
        "activation_volume": "exp(-pressure*{}/(R*temperature))",
        "water_exponent": "(water_fugacity/1e6)^{}",
        "melt_factor": "exp({}*melt_fraction)",
    }
    names = {factor: f"{whose}{name}{of}" for name, factor in factors.items()}
    return "".join(
        f"*{factor.format(name)}"
        for factor, name in names.items()
        if name in priors and not is_fixed_at(priors[name], 0.0)
    )
