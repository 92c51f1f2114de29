"""Laws of residuals: how priors tell them, their priors, and residuals drawn by them."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.model.fitted_test import Test
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.model.prior_families import (
    Prior,
    SomePriors,
    fixed_by_variant,
    is_standard,
    priors_of_freed_parameters,
)

ResidualsLaw = Literal["independent", "autocorrelated", "discrepancy"]

SHARE = "residual_correlated_share"
DISCREPANCY = "discrepancy"
TIME = "residual_correlation_time"

READING_ERROR_SCALE = 0.25
"""Standard deviation of ln(reading error/stated one): 90 % lies within a factor of 1.5."""


def residuals_law(priors: Mapping[str, Prior], length: str) -> ResidualsLaw:
    """Tell the law from priors; `length` is the parameter along which residuals may correlate."""
    if is_standard(priors, length):
        return "independent"
    return "autocorrelated" if is_standard(priors, DISCREPANCY) else "discrepancy"


def changes_of_residuals(given: SomePriors, test: Test, choice: str) -> list[Prior]:
    """Free the correlation of residuals and the size of what correlates, or fix it at none.

    The median of a correlation time is a tenth of the duration (s) of the readings.
    """
    priors, length, freed = given.priors, test.residual_correlation, priors_of_freed_parameters()
    law, source = residuals_law(priors, length), f"residuals={choice}"
    changed = []
    has_discrepancy = not is_standard(priors, DISCREPANCY)
    if has_discrepancy and choice != "discrepancy":
        changed.append(fixed_by_variant(DISCREPANCY, 0.0, source))
    has_share = not is_standard(priors, SHARE)
    if has_share and choice in ("independent", "discrepancy") and law != choice:
        changed.append(fixed_by_variant(SHARE, 1.0, source))
    if choice == "independent":
        # In time residuals correlate unless priors say otherwise.
        if law != choice or (length == TIME and length not in priors):
            changed.append(fixed_by_variant(length, 0.0, source))
        return changed
    if is_standard(priors, length):
        correlation = freed[length]
        if length == TIME and test.duration > 0:
            correlation = replace(correlation, location=float(f"{0.1 * test.duration:.0e}"))
        changed.append(correlation)
    if law == choice:
        return changed
    if choice == "discrepancy":
        changed += [] if has_discrepancy else [freed[DISCREPANCY]]
    elif not has_share:
        changed.append(freed[SHARE])
    return changed


def reading_error_priors(
    priors: Mapping[str, Prior], noises: Mapping[str, float | None]
) -> tuple[Prior, ...]:
    """Return priors of noises (SI) whose size a file states, where the law has a discrepancy.

    The noise is then the reading error alone.
    """
    if is_standard(priors, DISCREPANCY):
        return ()
    return tuple(
        Prior.of_family(
            name,
            "lognormal",
            {"location": stated, "scale": READING_ERROR_SCALE},
            unit=PARAMETER_BY_NAME[name].si_unit,
            source="reading error stated in the file of the test",
        )
        for name, stated in noises.items()
        if stated and not priors[name].is_fixed
    )


def residual_parts(values: Mapping[str, float]) -> tuple[float, float]:
    """Return standard deviation of residuals over their noise, and share w that correlates.

    As `residual_over_noise` and `share_that_correlates` of `stan/physics/parameters.stan`.
    """
    squared = values.get(DISCREPANCY, 0.0) ** 2
    share = squared / (1 + squared) if squared else values.get(SHARE, 1.0)
    return (1 + squared) ** 0.5, share


def draw_residuals(
    experiment: Test,
    noise: FloatArray,
    part: IntArray,
    values: Mapping[str, float],
    rng: np.random.Generator,
) -> FloatArray:
    """Return residuals (SI), (n_points,), as `stan/statistics/residuals.stan` describes them.

    `noise`, `part` (n_points,): standard deviations (SI), and parts between which none correlates.
    """
    n, correlation_length = experiment.n_points, values.get(experiment.residual_correlation, 0.0)
    if correlation_length == 0:
        return np.asarray(noise * rng.standard_normal(n))
    whole, share = residual_parts(values)
    correlated: FloatArray = np.sqrt(share) * rng.standard_normal(n)
    step = np.diff(experiment.position) / correlation_length
    correlation, spread = np.exp(-step), np.sqrt(-np.expm1(-2 * step))
    for k in np.flatnonzero(np.diff(part) == 0):
        correlated[k + 1] = correlation[k] * correlated[k] + spread[k] * correlated[k + 1]
    return np.asarray(whole * noise * (correlated + np.sqrt(1 - share) * rng.standard_normal(n)))
