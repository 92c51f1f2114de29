"""Laws of the dashpot (`pyburgers.model.laws`): how priors tell them, and beta of a linear one."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pyburgers.common.errors import InputError
from pyburgers.model.laws import DASHPOT_STRESSES
from pyburgers.model.prior_families import Prior, is_fixed_at, is_standard


def dashpot_law(priors: Mapping[str, Prior], where: str) -> str:
    """Tell the law of the dashpot from priors by parameter; `where` is for messages.

    Raises InputError if there is more than one stress of a law's own.
    """
    on = [name for name in DASHPOT_STRESSES if not is_standard(priors, name)]
    if len(on) > 1:
        raise InputError(
            f"{where}: found effects of {' and '.join(on)} in the priors, expected one law of the "
            "dashpot."
        )
    if on:
        return DASHPOT_STRESSES[on[0]].name
    return "linear" if is_fixed_at(priors["stress_exponent"], 1.0) else "power_law"


def beta_of_linear(beta: Prior, exponent: Prior, per_exponent: float) -> Prior:
    """Return the prior of beta moved to n = 1, where a rate moves it by so much for each n."""
    mean, spread = exponent.mean_sd()
    return replace(
        beta,
        location=float(beta.location + (mean - 1) * per_exponent),
        scale=0.0 if beta.is_fixed else float(np.hypot(beta.scale, spread * per_exponent)),
        source=f"Variant maxwell=linear: moved to n = 1 at the largest stress; {beta.source}",
    )
