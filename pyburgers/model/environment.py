"""What pressure, water and melt make of a rate, in words."""

from collections.abc import Mapping

from pyburgers.model.prior_families import Prior, is_fixed_at


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
