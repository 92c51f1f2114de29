"""Figure of what a fit predicts of another test."""

import textwrap

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pyburgers.common.draws import all_draws
from pyburgers.drawing.panels import draw_data
from pyburgers.drawing.style import BLUE, ORANGE, VERMILION, style
from pyburgers.fitting.prediction import Prediction
from pyburgers.protocols.protocol import protocol_of

FloatArray = npt.NDArray[np.float64]

TITLE_WIDTH = 95
"""Letters in a line above the panel."""

PREDICTION_CAPTION = (
    "The response of a test that took no part in the fit: predictive median (line), the areas that "
    "hold 50 % and 90 % of solutions for single draws (dark and light blue), and the band that "
    "should hold 90 % of new readings, noise of the fit included (orange). Circles, where there "
    "are some, are the readings of the test."
)


def prediction_figure(prediction: Prediction) -> Figure:
    """Draw bands of the solution and of new readings, data where the test has some, and cautions.

    What may make the prediction worthless stands in the title.
    """
    with style():
        figure = Figure(figsize=(8.0, 5.2), layout="constrained")
        axes = figure.subplots()
        draw_prediction(axes, prediction)
        said = [
            line
            for sentence in (prediction.title, *prediction.cautions)
            for line in textwrap.wrap(sentence, TITLE_WIDTH)
        ]
        figure.suptitle("\n".join(said), fontsize=9, x=0.01, ha="left")
        axes.legend(loc="best")
    return figure


def draw_prediction(axes: Axes, prediction: Prediction) -> None:
    """Draw bands of a prediction, and data where there are some."""
    experiment = prediction.experiment
    protocol = protocol_of(experiment)
    clock, response = protocol.clock, protocol.response
    predictions = prediction.posterior["predictions"].to_dataset()
    position = predictions[clock.name].to_numpy() * clock.display_factor
    solved, new = (
        all_draws(predictions[name]) * response.display_factor
        for name in (response.name, f"{response.name}_replicated")
    )
    _fill(axes, position, new, 90, ORANGE, 0.35, "90 % of new readings")
    _fill(axes, position, solved, 90, BLUE, 0.25, "90 % of solutions")
    _fill(axes, position, solved, 50, BLUE, 0.45, "50 % of solutions")
    axes.plot(
        position,
        np.median(solved, axis=0),
        color=VERMILION,
        linewidth=1.6,
        label="predictive median",
    )
    if experiment.n_points > 0:
        draw_data(
            axes,
            experiment.position * clock.display_factor,
            experiment.response * response.display_factor,
            None,
            f"{experiment.provenance.kind} data",
        )
    axes.margins(x=0.01)
    axes.set_xlabel(clock.label)
    axes.set_ylabel(response.label)


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
