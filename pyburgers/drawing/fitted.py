"""What views read from the posterior of a fit."""

from typing import Any

from pyburgers.common.draws import FloatArray, all_draws
from pyburgers.drawing.panels import FittedCurve, ReadCurve
from pyburgers.kinds.kind import FittedTest


def predicted(fit: FittedTest, name: str) -> FloatArray:
    """Return the predictions of a quantity (SI) along the clock, shape (n_draws, n_grid)."""
    return all_draws(fit.posterior["predictions"].to_dataset()[name]).astype("float64")


def positions(fit: FittedTest, clock: str) -> FloatArray:
    """Return the positions of the predictions on the clock (SI), shape (n_grid,)."""
    found: FloatArray = fit.posterior["predictions"].to_dataset()[clock].to_numpy()
    return found


def residuals(fit: FittedTest, read: str, data: FloatArray) -> FloatArray:
    """Return readings minus the median response of the model, shape (n_points,)."""
    median: FloatArray = fit.posterior["model_response"][read].median(("chain", "draw")).to_numpy()
    return data - median


def mean_of(fit: FittedTest, parameter: str) -> float:
    """Return the posterior mean of a parameter (SI), 0 where the fit does not have it."""
    draws = fit.posterior["posterior"].to_dataset()
    return float(draws[parameter].mean()) if parameter in draws else 0.0


def curve_of(
    fit: FittedTest, name: str, read: ReadCurve, factor: float = 1.0, **parts: Any
) -> FittedCurve:
    """Return the curve of a quantity from readings and predictions; the parts are other fields."""
    found: dict[str, Any] = {
        "solutions": predicted(fit, name) * factor,
        "replicated": predicted(fit, f"{name}_replicated") * factor,
        "data_label": f"{fit.experiment.provenance.kind} data",
    }
    return FittedCurve(**(vars(read) | found | parts))
