"""Isochronous view of creep tests: stress against the strain after a given time."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure

from pyburgers.common.draws import all_draws, central_band
from pyburgers.drawing.page_parts import PageFigure
from pyburgers.drawing.style import BLUE, GREEN, ORANGE, VERMILION, style
from pyburgers.model.display import (
    STRAIN_FACTOR,
    STRAIN_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
    time_unit,
)
from pyburgers.protocols.loading_history.experiment import LoadingHistory
from pyburgers.protocols.loading_history.figures import loading_history_test
from pyburgers.protocols.protocol import FittedTest

FloatArray = npt.NDArray[np.float64]

MIN_TESTS = 2

SHARES = (0.01, 0.05, 0.25, 1.0)
"""Times, over the longest that all tests last under their first load."""

COLOURS = (BLUE, GREEN, ORANGE, VERMILION)
"""Of these times."""

NEAR = 0.1
"""Share of its time by which a reading may be earlier or later and still be drawn."""

CAPTION = (
    "The isochronous view of the creep tests: the stress of each against its strain after the same "
    "times under its first load. Bars are medians and central 90 % of the solutions, noise not "
    "included, joined by a line for each time; circles are readings at that time. Straight lines "
    "through the origin would be a linear material; they bend as flow of a power law sets in."
)


def isochronous_figure(fits: Sequence[FittedTest]) -> tuple[PageFigure, ...]:
    """Return the figure of tests that begin with creep, if there are at least two stresses."""
    creeping = [fit for fit in fits if _creeps_from_the_start(loading_history_test(fit))]
    if len({loading_history_test(fit).stages[0].value for fit in creeping}) < MIN_TESTS:
        return ()
    draw = partial(isochronous, creeping)
    return (PageFigure("isochronous", "Isochronous view", CAPTION, draw),)


def isochronous(fits: Sequence[FittedTest]) -> Figure:
    """Draw stress against strain at a few times.

    Parameters
    ----------
    fits : sequence of FittedTest
        Tests whose first stage is creep at constant stress.
    """
    fits = sorted(fits, key=lambda fit: loading_history_test(fit).stages[0].value)
    stress = np.array([loading_history_test(fit).stages[0].value for fit in fits])
    shortest = min(map(loading_history_test, fits), key=lambda test: test.stages[0].end_time)
    unit, seconds = time_unit(shortest.end_time)
    times = shortest.stages[0].end_time * np.array(SHARES)
    after = np.stack([_strain_after(fit, times) for fit in fits], axis=-1)
    with style():
        figure = Figure(figsize=(6.4, 4.4), layout="constrained")
        axes = figure.subplots()
        for time, colour, (low, middle, high) in zip(times, COLOURS, after, strict=True):
            axes.errorbar(
                STRAIN_FACTOR * middle,
                STRESS_FACTOR * stress,
                xerr=STRAIN_FACTOR * np.array([middle - low, high - middle]),
                color=colour,
                marker="_",
                capsize=3,
                label=f"{time / seconds:.3g} {unit}",
            )
            for fit, imposed in zip(fits, stress, strict=True):
                read = _reading_after(loading_history_test(fit), time)
                axes.plot(
                    STRAIN_FACTOR * read,
                    np.full(read.shape, STRESS_FACTOR * imposed),
                    "o",
                    markerfacecolor="none",
                    color=colour,
                )
        axes.set_xlabel(f"axial strain ({STRAIN_UNIT})")
        axes.set_ylabel(f"differential stress ({STRESS_UNIT})")
        axes.set_xlim(left=0.0)
        axes.set_ylim(0.0, 1.1 * STRESS_FACTOR * float(stress.max()))
        axes.locator_params(nbins=6)
        axes.legend(title="after")
    return figure


def _creeps_from_the_start(experiment: LoadingHistory) -> bool:
    first = experiment.stages[0]
    return first.control == "stress" and first.value > 0


def _strain_after(fit: FittedTest, times: FloatArray) -> FloatArray:
    """Quantiles (low, median, high) of the strain at each of some times (s), shape (times, 3)."""
    predictions = fit.posterior["predictions"].to_dataset()
    # The end of a stage comes twice, the first of the two is before the jump.
    at, first = np.unique(predictions["time"].to_numpy(), return_index=True)
    strain = all_draws(predictions["strain"]).astype(np.float64)[:, first]
    drawn = np.array([np.interp(times, at, one) for one in strain])
    return np.transpose(central_band(drawn))


def _reading_after(experiment: LoadingHistory, time: float) -> FloatArray:
    """Strain read nearest to a time under the first load; empty where none is near it."""
    first = experiment.reading_stage == 0
    if not first.any():
        return np.empty(0)
    away = np.abs(experiment.time[first] - time)
    nearest = int(np.argmin(away))
    is_near = bool(away[nearest] <= NEAR * time)
    read: FloatArray = experiment.reading[first][nearest : nearest + is_near]
    return read
