"""Figure of what a fit predicts of another test."""

import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pyburgers.common.draws import FloatArray
from pyburgers.drawing.panels import draw_data, figure_of
from pyburgers.drawing.style import BLUE, ORANGE, VERMILION
from pyburgers.fitting.prediction import Prediction
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.model.read_quantities import Quantity, ReadQuantity
from pyburgers.predictions.other_tests import answers, clock_of, read_quantities, shown_draws

TITLE_WIDTH = 95
"""Letters in a line above the panel."""


def prediction_figure(prediction: Prediction) -> Figure:
    """Draw bands of the solution and of new readings, data where the test has some, and cautions.

    Each quantity that the test answers with has a panel. The title has the cautions.

    Parameters
    ----------
    prediction : Prediction
        Of `Fit.predict`.

    Examples
    --------
    >>> figure = pyburgers.prediction_figure(fit.predict(test))
    """
    shown = answers(prediction)
    with figure_of(8.0, 1.6 + 3.6 * len(shown)) as figure:
        # Tables of cycles have each quantity at places of its own.
        sharex = len({one.name for one in shown}) == len(shown)
        panels = figure.subplots(len(shown), 1, sharex=sharex, squeeze=False)[:, 0]
        for axes, quantity in zip(panels, shown, strict=True):
            _draw(axes, prediction, quantity)
        said = [
            line
            for sentence in (prediction.title, *prediction.cautions)
            for line in textwrap.wrap(sentence, TITLE_WIDTH)
        ]
        figure.legend(
            *panels[0].get_legend_handles_labels(),
            loc="outside upper left",
            ncols=3,
            title="\n".join(said),
            alignment="left",
        )
        panels[-1].set_xlabel(_clock(prediction.experiment).label)
    return figure


def _clock(experiment: Experiment) -> Quantity:
    return likelihood_of(experiment).shown_clock(experiment.span[1])


def _draw(axes: Axes, prediction: Prediction, quantity: ReadQuantity) -> None:
    """Draw bands of a quantity, and data where there are some."""
    experiment = prediction.experiment
    clock, factor = _clock(experiment), quantity.shown.display_factor
    places = clock_of(prediction, quantity)
    # Lines end with a spectrum: the next one begins at its shortest period.
    period = experiment.conditions_at(places).get("period_s", places)
    ends = np.flatnonzero(np.diff(period) < 0) + 1
    position = np.insert(places * clock.display_factor, ends, np.nan)
    solved, new = (
        np.insert(factor * draws, ends, np.nan, axis=1)
        for draws in shown_draws(prediction, quantity)
    )
    _fill(axes, position, new, 90, ORANGE, 0.35, "90 % of new readings")
    _fill(axes, position, solved, 90, BLUE, 0.25, "90 % of solutions")
    _fill(axes, position, solved, 50, BLUE, 0.45, "50 % of solutions")
    median = np.median(solved, axis=0)
    axes.plot(position, median, color=VERMILION, linewidth=1.6, label="predictive median")
    own = np.array([one == quantity for one in read_quantities(experiment)], dtype=bool)
    if own.any():
        response = experiment.response[own]
        draw_data(
            axes,
            experiment.position[own] * clock.display_factor,
            (response if quantity.logarithm_of is None else np.exp(response)) * factor,
            None,
            f"{experiment.provenance.kind} data",
        )
    axes.margins(x=0.01)
    axes.set(
        ylabel=quantity.shown.label, yscale="linear" if quantity.logarithm_of is None else "log"
    )


def _fill(
    axes: Axes,
    position: FloatArray,
    draws: FloatArray,
    percent: int,
    colour: str,
    opacity: float,
    label: str,
) -> None:
    """Fill the central part of draws."""
    tail = (1 - percent / 100) / 2
    low, high = np.quantile(draws, [tail, 1 - tail], axis=0)
    axes.fill_between(position, low, high, color=colour, alpha=opacity, linewidth=0, label=label)
