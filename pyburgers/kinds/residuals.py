"""Noise of readings that correlate along a test, for simulated data."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from pyburgers.kinds.experiment import Experiment

FloatArray = npt.NDArray[np.float64]


def draw_residuals(
    experiment: Experiment,
    noise: FloatArray,
    part: npt.NDArray[np.int64],
    values: Mapping[str, float],
    rng: np.random.Generator,
) -> FloatArray:
    """Return residuals (SI), (n_points,), as `stan/statistics/residuals.stan` describes them.

    `noise`, `part` (n_points,): their standard deviations (SI), and segment or stage, between
    which nothing correlates.
    """
    n, correlation_length = experiment.n_points, values.get(experiment.residual_correlation, 0.0)
    if correlation_length == 0:
        return np.asarray(noise * rng.standard_normal(n))
    share = values.get("residual_correlated_share", 1.0)
    correlated: FloatArray = np.sqrt(share) * rng.standard_normal(n)
    step = np.diff(experiment.position) / correlation_length
    correlation, spread = np.exp(-step), np.sqrt(-np.expm1(-2 * step))
    for k in np.flatnonzero(np.diff(part) == 0):
        correlated[k + 1] = correlation[k] * correlated[k] + spread[k] * correlated[k + 1]
    return np.asarray(noise * (correlated + np.sqrt(1 - share) * rng.standard_normal(n)))
