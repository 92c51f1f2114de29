"""Minimum creep rates of a fit of a loading history, and the strains at them."""

import numpy as np
import pandas as pd
from markupsafe import Markup
from scipy.stats import linregress

from pyburgers.common.array_types import IntArray
from pyburgers.common.draws import FloatArray
from pyburgers.common.units import rounded, span_text
from pyburgers.drawing.fitted import positions, predicted
from pyburgers.drawing.page_parts import PageTable, text_table
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

WINDOW, LEAST_READINGS = 0.2, 5
"""Share of an interval over which a measured rate is the slope of the strain readings, and how many
readings that takes at least: over fewer a slope is mostly their error."""

LEAST_SHARE = 0.5
"""Of the draws. Numbers of a minority would be taken for those of the fit."""


def minimum_rates(fit: FittedTest) -> pd.DataFrame:
    """Return the minimum strain rate wherever a sample creeps forward under a constant stress.

    A row is one of the `creep_intervals` in which at least half of the draws creep forward
    throughout; all numbers are those of such draws. Columns: stage (from 1), start_time_s,
    end_time_s, stress_Pa; measured_rate_per_s, measured_rate_sd_per_s (of the readings; NaN where
    they are few); rate_per_s, rate_q5_per_s, rate_q95_per_s (median and quantiles over the draws);
    strain, strain_q5, strain_q95 (of draws with a minimum inside; NaN where these are fewer than
    half); minimum_inside (share of draws whose rate is slower than at both ends in between) and
    least_at_end (share of those whose rate is least, or as good as that, at the end).
    """
    experiment = of_kind(fit.experiment, HistoryExperiment)
    time = positions(fit)
    rate, strain = predicted(fit, "strain_rate"), predicted(fit, "strain")
    rows = []
    for interval in creep_intervals(experiment):
        here = _times_inside(experiment, interval, time)
        forward = (rate[:, here] > 0).all(axis=1)
        if here.size >= LEAST_TIMES and forward.mean() >= LEAST_SHARE:
            rows.append(
                {
                    "stage": interval.stage + 1,
                    "start_time_s": interval.start_time,
                    "end_time_s": interval.end_time,
                    "stress_Pa": interval.stress,
                    **_measured(experiment, interval),
                    **_minimum(rate[np.ix_(forward, here)], strain[np.ix_(forward, here)]),
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


def _measured(experiment: HistoryExperiment, interval: CreepInterval) -> dict[str, float]:
    """Return the least slope (1/s) of strain readings over `WINDOW`, with its standard error."""
    here = (experiment.reading_stage == interval.stage) & experiment.response_is_strain
    here &= (experiment.time >= interval.start_time) & (experiment.time <= interval.end_time)
    time, strain = experiment.time[here], experiment.reading[here]
    if time.size < LEAST_READINGS:
        return {"measured_rate_per_s": np.nan, "measured_rate_sd_per_s": np.nan}
    ends = time + WINDOW * interval.duration
    starts = np.flatnonzero(ends[: time.size - LEAST_READINGS + 1] <= time[-1])
    lines = []
    for first in starts if starts.size else (0,):
        end = max(first + LEAST_READINGS, int(np.searchsorted(time, ends[first], side="right")))
        line = linregress(time[first:end], strain[first:end])
        lines.append((float(line.slope), float(line.stderr)))
    slope, error = min(lines)
    return {"measured_rate_per_s": slope, "measured_rate_sd_per_s": error}


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
    spans = found[["start_time_s", "end_time_s"]].to_numpy() / seconds
    strain = STRAIN_FACTOR * found[["strain", "strain_q5", "strain_q95"]].to_numpy()
    known = found.assign(
        time=[span_text(ends, digits=3) for ends in spans],
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
        "measured rate (1/s)": "{measured_rate_per_s:.3g} ± {measured_rate_sd_per_s:.1g}",
        f"strain there ({STRAIN_UNIT})": "{median}",
        "strain, 5 to 95 %": "{low:.3g} to {high:.3g}",
        "minimum inside": "{minimum_inside:.0%} of draws",
        "least at the end": "{least_at_end:.0%} of draws",
    }
    shown = text_table(known, columns)
    text = (
        "Of the solutions, for draws from the posterior; noise takes no part. A row is a time over "
        f"which the stress stays within {100 * NEARLY_CONSTANT:g} % of its mean. The measured rate "
        f"is the least slope of the strain readings over {100 * WINDOW:g} % of that time, with its "
        f"standard error. It is left empty where fewer than {LEAST_READINGS} strains were read. "
        "The rate is least at the end where it is then "
        f"within {100 * SAME_RATE:g} % of the least one: it is still falling, or has come to a "
        "plateau, and no strain belongs to the minimum. The strain is that of draws whose minimum "
        "lies inside, and is left empty where these are fewer than half; in all others the rate is "
        "least at the start."
    )
    return (PageTable("minimum_rates", "Minimum creep rates", shown, found, text=Markup(text)),)
