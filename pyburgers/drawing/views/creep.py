"""Minimum creep rates of a fit of a loading history, and the isochronous view of creep tests."""

from collections.abc import Sequence
from functools import partial

import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib.figure import Figure
from scipy.stats import linregress

from pyburgers.common.array_types import IntArray
from pyburgers.common.draws import FloatArray, central_band
from pyburgers.common.units import rounded, span_text
from pyburgers.drawing.page_parts import PageFigure, PageTable, text_table
from pyburgers.drawing.panels import STRAIN_LABEL, STRESS_LABEL, figure_of
from pyburgers.drawing.style import BLUE, GREEN, ORANGE, VERMILION
from pyburgers.drawing.view import positions, predicted
from pyburgers.kinds.experiment import of_kind
from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.loading_history.experiment import (
    NEARLY_CONSTANT,
    CreepInterval,
    HistoryExperiment,
    creep_intervals,
)
from pyburgers.kinds.loading_history.stan_data import stage_of_times
from pyburgers.model.display import (
    STRAIN_FACTOR,
    STRAIN_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
    time_unit,
)

SAME_RATE = 1e-3
"""How much faster, as a share, the end of an interval may creep than its slowest time and still be
as slow. On a plateau rates differ by the errors of solver and storage, 1e-6; a rise of 1e-3 no
strain reading shows, and where on so flat a curve the minimum lies says nothing."""

LEAST_TIMES = 3
"""Times of the solution in an interval: before, at and behind a minimum."""

WINDOW = 0.2
"""Share of an interval over which a measured rate is the slope of the strain readings."""

LEAST_TIMES_READ = 5
"""At how many times strains are read at least: over fewer a slope is mostly their error."""

MEASURED = (
    "measured_rate_per_s",
    "measured_rate_sd_per_s",
    "measured_start_time_s",
    "measured_end_time_s",
)
"""Columns of the rate of the readings, its standard error, and the first and last time of them."""

LEAST_SHARE = 0.5
"""Of the draws. Numbers of a minority would be taken for those of the fit."""


def minimum_rates(fit: FittedTest) -> pd.DataFrame:
    """Return the minimum strain rate wherever a sample creeps forward under a constant stress.

    A row is one of the `creep_intervals` in which at least half of the draws creep forward
    throughout; all numbers are those of such draws. Columns of `MEASURED` are NaN where readings
    are few, those of strain where fewer than half of the draws have a minimum inside.
    minimum_inside is the share of draws whose rate is slower than at both ends in between,
    least_at_end that of those whose rate is least, or as good as that, at the end.
    """
    experiment = of_kind(fit.experiment, HistoryExperiment)
    time = positions(fit)
    rate, strain = predicted(fit, "strain_rate"), predicted(fit, "strain")
    rows = []
    for interval in creep_intervals(experiment):
        here = _times_inside(experiment, interval, time)
        forward = (rate[:, here] > 0).all(axis=1)
        if here.size >= LEAST_TIMES and forward.mean() >= LEAST_SHARE:
            rates, strains = rate[np.ix_(forward, here)], strain[np.ix_(forward, here)]
            slowest = float(np.median(time[here][rates.argmin(axis=1)]))
            rows.append(
                {
                    "stage": interval.stage + 1,
                    "start_time_s": interval.start_time,
                    "end_time_s": interval.end_time,
                    "stress_Pa": interval.stress,
                    **_measured(experiment, interval, slowest),
                    **_minimum(rates, strains),
                }
            )
    return pd.DataFrame(rows)


def _times_inside(
    experiment: HistoryExperiment, interval: CreepInterval, time: FloatArray
) -> IntArray:
    """Return which times lie in an interval, without corners inside a stage: there rates jump."""
    stage = experiment.stages[interval.stage]
    begun = (time > interval.start_time) | (interval.start_time == stage.start_time)
    goes_on = (time < interval.end_time) | (interval.end_time == stage.end_time)
    return np.flatnonzero((stage_of_times(experiment, time) == interval.stage) & begun & goes_on)


def _measured(
    experiment: HistoryExperiment, interval: CreepInterval, slowest: float
) -> dict[str, float]:
    """Return the slope (1/s) of strain readings about a time (s), with its error and its ends."""
    here = (experiment.reading_stage == interval.stage) & experiment.response_is_strain
    here &= (experiment.time >= interval.start_time) & (experiment.time <= interval.end_time)
    time, strain = experiment.time[here], experiment.reading[here]
    half = 0.5 * WINDOW * interval.duration
    middle = np.clip(slowest, interval.start_time + half, interval.end_time - half)
    distances = np.sort(np.abs(np.unique(time) - middle))
    if distances.size < LEAST_TIMES_READ:
        return dict.fromkeys(MEASURED, np.nan)
    near = np.abs(time - middle) <= max(half, distances[LEAST_TIMES_READ - 1])
    line = linregress(time[near], strain[near])
    found = (line.slope, line.stderr, time[near][0], time[near][-1])
    return dict(zip(MEASURED, map(float, found), strict=True))


def _minimum(rate: FloatArray, strain: FloatArray) -> dict[str, float]:
    """Summarise rates (1/s) and strains of an interval, shape (draws, times), over the draws."""
    least = rate.min(axis=1)
    at_end = rate[:, -1] <= (1 + SAME_RATE) * least
    inside = ~at_end & (rate[:, 0] > (1 + SAME_RATE) * least)
    there = strain[inside, rate[inside].argmin(axis=1)]
    slow, slowest, fast = np.quantile(least, [0.05, 0.5, 0.95])
    is_told = inside.mean() >= LEAST_SHARE
    low, middle, high = np.quantile(there, [0.05, 0.5, 0.95]) if is_told else np.full(3, np.nan)
    return {
        "rate_per_s": float(slowest),
        "rate_q5_per_s": float(slow),
        "rate_q95_per_s": float(fast),
        "strain": float(middle),
        "strain_q5": float(low),
        "strain_q95": float(high),
        "minimum_inside": float(inside.mean()),
        "least_at_end": float(at_end.mean()),
    }


def minimum_rate_table(fit: FittedTest) -> tuple[PageTable, ...]:
    """Return the table of minimum creep rates, or none where nothing creeps at constant stress."""
    found = minimum_rates(fit)
    if found.empty:
        return ()
    unit, seconds = time_unit(of_kind(fit.experiment, HistoryExperiment).end_time)
    spans, read = (
        [span_text(ends, digits=3) for ends in found[[*names]].to_numpy() / seconds]
        for names in (("start_time_s", "end_time_s"), MEASURED[2:])
    )
    strain = STRAIN_FACTOR * found[["strain", "strain_q5", "strain_q95"]].to_numpy()
    known = found.assign(
        time=spans,
        read=read,
        stress=found["stress_Pa"] * STRESS_FACTOR,
        median=["" if np.isnan(mid) else rounded(mid, high - low) for mid, low, high in strain],
        low=strain[:, 1],
        high=strain[:, 2],
    )
    columns = {
        "stage": "{stage}",
        f"time ({unit})": "{time}",
        f"stress ({STRESS_UNIT})": "{stress:.4g}",
        "minimum rate (1/s)": "{rate_per_s:.3g}",
        "5 to 95 %": "{rate_q5_per_s:.3g} to {rate_q95_per_s:.3g}",
        "measured rate there (1/s)": "{measured_rate_per_s:.3g} ± {measured_rate_sd_per_s:.1g}",
        f"measured over ({unit})": "{read}",
        f"strain there ({STRAIN_UNIT})": "{median}",
        "strain, 5 to 95 %": "{low:.3g} to {high:.3g}",
        "minimum inside": "{minimum_inside:.0%} of draws",
        "least at the end": "{least_at_end:.0%} of draws",
    }
    shown = text_table(known, columns)
    text = (
        "Of the solutions, for draws from the posterior; noise takes no part. A row is a time over "
        f"which the stress stays within {100 * NEARLY_CONSTANT:g} % of its mean. The measured rate "
        "is the slope of the strain readings about the slowest time (median of the solutions), "
        "with its standard error. Readings that the fit uses over "
        f"{100 * WINDOW:g} % of the row's time count, or at the {LEAST_TIMES_READ} nearest times "
        "where these reach further. It is left empty where the strain was read at fewer times. "
        "The rate is least at the end where it is then "
        f"within {100 * SAME_RATE:g} % of the least one: it is still falling, or has come to a "
        "plateau, and no strain belongs to the minimum. The strain is that of draws whose minimum "
        "lies inside, and is left empty where these are fewer than half; in all others the rate is "
        "least at the start."
    )
    return (PageTable("minimum_rates", "Minimum creep rates", shown, found, text=Markup(text)),)


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
    return np.asarray(experiment.reading[here][nearest : nearest + is_near])
