"""How the page shows a kind of test: figures, curve, facts and tables, joined to it by its name.

To show a new kind: a module of its name in the folder ``views`` with an object ``VIEW`` (`View`).
Below is what views read from the posterior of a fit.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from types import MappingProxyType
from typing import Any

import numpy as np
from markupsafe import Markup

from pyburgers.common.array_types import BoolArray
from pyburgers.common.draws import FloatArray, all_draws
from pyburgers.drawing.page_parts import FigureRecipe, PageFigure, PageTable
from pyburgers.drawing.panels import HALF_WIDTH, FittedCurve, ReadCurve
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.likelihood import NAMES, likelihood_of
from pyburgers.model.read_quantities import Quantity, ReadQuantity
from pyburgers.posterior.labelled_draws import response_in


@dataclass(frozen=True)
class View:
    """How the page shows a kind of test; its functions take a test or a fit of one.

    `figures`: those beside the posterior's, the curve first. `read`, `curve`: readings along the
    clock, and with the response of the fit. `reference_text`: about `Likelihood.reference`.
    """

    figures: tuple[FigureRecipe, ...]
    read: Callable[[Any], ReadCurve]
    curve: Callable[[FittedTest], FittedCurve]
    facts: Callable[[Any], Sequence[tuple[str, str]]]
    reference_text: Markup
    tables: Callable[[FittedTest], tuple[PageTable, ...]] = lambda _: ()
    joint_figures: Callable[[Sequence[FittedTest]], tuple[PageFigure, ...]] = lambda _: ()


@cache
def views() -> Mapping[str, View]:
    """Return the view of every kind of test by the name of the kind."""
    return MappingProxyType(
        {name: import_module(f"pyburgers.drawing.views.{name}").VIEW for name in NAMES}
    )


def view_of(experiment: Experiment) -> View:
    """Return the view of a test's kind."""
    return views()[experiment.protocol]


def marks_text(fits: Sequence[FittedTest]) -> str:
    """Return what a caption says of dotted vertical lines, nothing if the fits have none."""
    if not any(view_of(fit.experiment).read(fit.experiment).marks for fit in fits):
        return ""
    return "Dotted vertical lines mark where the imposed load or rate changes. "


def predicted(fit: FittedTest, name: str) -> FloatArray:
    """Return the predictions of a quantity (SI) along the clock, shape (n_draws, n_grid)."""
    return all_draws(fit.posterior["predictions"].to_dataset()[name]).astype("float64")


def positions(fit: FittedTest) -> FloatArray:
    """Return the positions of the predictions on the clock of the test (SI), shape (n_grid,)."""
    clock = likelihood_of(fit.experiment).clock.name
    return np.asarray(fit.posterior["predictions"].to_dataset()[clock].to_numpy())


def residuals(fit: FittedTest) -> FloatArray:
    """Return readings minus the median response of the model (SI), shape (n_points,)."""
    median = response_in(fit.posterior, "model_response").median(("chain", "draw"))
    return np.asarray(fit.experiment.response - median.to_numpy())


def reading_errors(fit: FittedTest) -> FloatArray:
    """Return the standard deviation (SI) of each reading about the response, shape (n_points,)."""
    replicated, response = (
        response_in(fit.posterior, group) for group in ("posterior_predictive", "model_response")
    )
    return np.asarray((replicated - response).std(("chain", "draw")).to_numpy())


def shown_clock(experiment: Experiment) -> Quantity:
    """Return the clock of a test in the unit in which it is shown."""
    return likelihood_of(experiment).shown_clock(experiment.span[1])


def residual_size(fit: FittedTest, noise: str) -> float:
    """Return the posterior mean of the size of residuals (SI), those of a law's discrepancy too."""
    draws = fit.posterior["posterior"].to_dataset()
    if noise not in draws:
        return 0.0
    return float((draws[noise] * np.hypot(1.0, draws.get("discrepancy", 0.0))).mean())


def curve_of(
    fit: FittedTest,
    read: ReadCurve,
    quantity: ReadQuantity,
    label: str = "",
    *,
    rows: BoolArray | slice = slice(None),
) -> FittedCurve:
    """Return the curve of a quantity from the readings of it, some rows of all, and predictions."""
    name, factor = quantity.name, quantity.display_factor
    return FittedCurve(
        **vars(read),
        grid=positions(fit) * shown_clock(fit.experiment).display_factor,
        solutions=predicted(fit, name) * factor,
        replicated=predicted(fit, f"{name}_replicated") * factor,
        residuals=residuals(fit)[rows] * factor,
        noise_band=HALF_WIDTH * residual_size(fit, quantity.noise) * factor,
        residual_label=label or f"residual ({quantity.display_unit})",
        data_label=f"{fit.experiment.provenance.kind} data",
    )
