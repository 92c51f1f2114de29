"""What views read from the posterior of a fit."""

import numpy as np

from pyburgers.common.array_types import BoolArray
from pyburgers.common.draws import FloatArray, all_draws
from pyburgers.drawing.panels import HALF_WIDTH, FittedCurve, ReadCurve
from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.posterior.labelled_draws import response_in


def predicted(fit: FittedTest, name: str) -> FloatArray:
    """Return the predictions of a quantity (SI) along the clock, shape (n_draws, n_grid)."""
    return all_draws(fit.posterior["predictions"].to_dataset()[name]).astype("float64")


def positions(fit: FittedTest) -> FloatArray:
    """Return the positions of the predictions on the clock of the test (SI), shape (n_grid,)."""
    clock = likelihood_of(fit.experiment).clock.name
    found: FloatArray = fit.posterior["predictions"].to_dataset()[clock].to_numpy()
    return found


def residuals(fit: FittedTest) -> FloatArray:
    """Return readings minus the median response of the model (SI), shape (n_points,)."""
    median = response_in(fit.posterior, "model_response").median(("chain", "draw"))
    left: FloatArray = fit.experiment.response - median.to_numpy()
    return left


def reading_errors(fit: FittedTest) -> FloatArray:
    """Return the standard deviation (SI) of each reading about the response, shape (n_points,)."""
    replicated, response = (
        response_in(fit.posterior, group) for group in ("posterior_predictive", "model_response")
    )
    found: FloatArray = (replicated - response).std(("chain", "draw")).to_numpy()
    return found


def residual_size(fit: FittedTest, noise: str) -> float:
    """Return the posterior mean of the size of residuals (SI), those of a law's discrepancy too."""
    draws = fit.posterior["posterior"].to_dataset()
    if noise not in draws:
        return 0.0
    return float((draws[noise] * np.hypot(1.0, draws.get("discrepancy", 0.0))).mean())


def curve_of(
    fit: FittedTest,
    read: ReadCurve,
    name: str,
    noise: str,
    label: str,
    *,
    factor: float = 1.0,
    clock_factor: float = 1.0,
    rows: BoolArray | slice = slice(None),
) -> FittedCurve:
    """Return the curve of a quantity from the readings of it, some rows of all, and predictions."""
    return FittedCurve(
        **vars(read),
        grid=positions(fit) * clock_factor,
        solutions=predicted(fit, name) * factor,
        replicated=predicted(fit, f"{name}_replicated") * factor,
        residuals=residuals(fit)[rows] * factor,
        noise_band=HALF_WIDTH * residual_size(fit, noise) * factor,
        residual_label=label,
        data_label=f"{fit.experiment.provenance.kind} data",
    )
