"""Isochronous view of creep tests: stress against the strain after a given time."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from pyburgers.common.draws import FloatArray, central_band
from pyburgers.drawing.fitted import positions, predicted
from pyburgers.drawing.page_parts import PageFigure
from pyburgers.drawing.panels import STRAIN_LABEL, STRESS_LABEL, figure_of
from pyburgers.drawing.style import BLUE, GREEN, ORANGE, VERMILION
from pyburgers.kinds.experiment import of_kind
from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.loading_history.experiment import (
    NEARLY_CONSTANT,
    CreepInterval,
    HistoryExperiment,
    creep_intervals,
)
from pyburgers.model.display import (
    STRAIN_FACTOR,
    STRESS_FACTOR,
    time_unit,
)

SHARES = (0.01, 0.05, 0.25, 1.0)
"""Times, over the longest that all tests last under their first load. It stands from the start of
its stage to the end, or behind a ramp no longer than the least of these shares of its time."""

COLOURS = (BLUE, GREEN, ORANGE, VERMILION)
"""Of these times."""

NEAR = 0.1
"""Share of its time by which a reading may be earlier or later and still be drawn."""

CAPTION = (
    "The isochronous view of the creep tests: the stress of each (its mean, where it varies a "
    "little) against its strain after the same times under its first load. Bars are medians and "
    "central 90 % of the solutions, noise not included, joined by a line for each time; circles "
    "are readings at that time. Straight lines through the origin would be a linear material; they "
    "bend as flow of a power law sets in."
)


def isochronous_figure(fits: Sequence[FittedTest]) -> tuple[PageFigure, ...]:
    """Return the figure of tests that begin with creep, if there are at least two loads."""
    stresses = [load.stress for _, load in _first_loads(fits)]
    if not stresses or stresses[-1] <= (1 + NEARLY_CONSTANT) * stresses[0]:
        return ()
    draw = partial(isochronous, fits)
    return (PageFigure("isochronous", "Isochronous view", CAPTION, draw),)


def isochronous(fits: Sequence[FittedTest]) -> Figure:
    """Draw stress against strain at a few times; at least one of the fits begins with creep."""
    loaded = _first_loads(fits)
    stress = np.array([load.stress for _, load in loaded])
    shortest = min(load.duration for _, load in loaded)
    unit, seconds = time_unit(shortest)
    times = shortest * np.array(SHARES)
    after = np.stack([_strain_after(fit, load.start_time + times) for fit, load in loaded], axis=-1)
    with figure_of(6.4, 4.4) as figure:
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
            for fit, load in loaded:
                read = _reading_after(of_kind(fit.experiment, HistoryExperiment), load, time)
                axes.plot(
                    STRAIN_FACTOR * read,
                    np.full(read.shape, STRESS_FACTOR * load.stress),
                    "o",
                    markerfacecolor="none",
                    color=colour,
                )
        axes.set(xlabel=STRAIN_LABEL, ylabel=STRESS_LABEL)
        axes.set_xlim(left=0.0)
        axes.set_ylim(0.0, 1.1 * STRESS_FACTOR * float(stress.max()))
        axes.locator_params(nbins=6)
        axes.legend(title="after")
    return figure


def _first_loads(fits: Sequence[FittedTest]) -> list[tuple[FittedTest, CreepInterval]]:
    """Return the tests whose first stage is creep with their loads, the smallest first."""
    found = []
    for fit in fits:
        experiment = of_kind(fit.experiment, HistoryExperiment)
        for load in creep_intervals(experiment)[:1]:
            # Solutions are too coarse in time to tell the strain at a corner inside a stage.
            lasts = load.end_time == experiment.stages[0].end_time
            if lasts and load.start_time <= SHARES[0] * load.duration:
                found.append((fit, load))
    return sorted(found, key=lambda one: one[1].stress)


def _strain_after(fit: FittedTest, times: FloatArray) -> FloatArray:
    """Quantiles (low, median, high) of the strain at each of some times (s), shape (times, 3)."""
    # The end of a stage comes twice, the first of the two is before the jump.
    at, first = np.unique(positions(fit), return_index=True)
    strain = predicted(fit, "strain")[:, first]
    drawn = np.array([np.interp(times, at, one) for one in strain])
    return np.transpose(central_band(drawn))


def _reading_after(experiment: HistoryExperiment, load: CreepInterval, time: float) -> FloatArray:
    """Strain read nearest to a time (s) under a load; empty where none is near it."""
    since = experiment.time - load.start_time
    here = (experiment.reading_stage == load.stage) & (since >= 0)
    if not here.any():
        return np.empty(0)
    away = np.abs(since[here] - time)
    nearest = int(np.argmin(away))
    is_near = bool(away[nearest] <= NEAR * time)
    read: FloatArray = experiment.reading[here][nearest : nearest + is_near]
    return read
