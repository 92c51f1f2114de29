"""Figure of a comparison: where along a test one fit predicts better than another."""

import numpy as np
from matplotlib.figure import Figure

from pyburgers.comparison import Comparison
from pyburgers.display import STRAIN_FACTOR, STRAIN_UNIT
from pyburgers.figure_style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    VERMILION,
    few_ticks,
    style,
)

FIT_COLOURS = (VERMILION, BLUE, GREEN, PURPLE, ORANGE)
FIT_MARKERS = ("o", "s", "^", "D", "v")

COMPARISON_CAPTION = (
    "Above: log predictive density of each left-out point under a fit less that under the best "
    "one; below zero the best fit predicts the point better. Below: the same added up along the "
    "test, so that its steps show which part of the curve decides and its end is the difference of "
    "elpd. A black ring marks a point that was left out by fitting again, a cross one whose "
    "importance weights are too uneven to be trusted (Pareto k above 0.7)."
)


def pointwise_differences(comparison: Comparison) -> Figure:
    """Draw differences of the elpd to the best fit along the test, point by point and added up."""
    (best_name, best), *others = comparison.results.items()
    along = comparison.position.to_numpy()
    is_strain = comparison.position.name == "strain"
    along = along * STRAIN_FACTOR if is_strain else along
    with style():
        figure = Figure(figsize=(6.8, 5.4), layout="constrained")
        points, sums = figure.subplots(2, 1, sharex=True)
        for k, (name, result) in enumerate(others):
            colour = FIT_COLOURS[k % len(FIT_COLOURS)]
            difference = result.elpd - best.elpd
            points.plot(
                along,
                difference,
                linestyle="none",
                marker=FIT_MARKERS[k % len(FIT_MARKERS)],
                markersize=4,
                markeredgewidth=0,
                alpha=0.8,
                color=colour,
                label=f"{name} less {best_name}",
            )
            marks = (
                (result.exact | best.exact, {"marker": "o", "markersize": 9, "fillstyle": "none"}),
                (result.unreliable | best.unreliable, {"marker": "x", "markersize": 8}),
            )
            for chosen, look in marks:
                points.plot(
                    along[chosen], difference[chosen], linestyle="none", color=BLACK, **look
                )
            sums.step(along, np.cumsum(difference), where="post", color=colour, linewidth=1.4)
        for axes in (points, sums):
            axes.axhline(0.0, color=BLACK, linewidth=0.8)
            axes.yaxis.set_major_locator(few_ticks(5))
        points.set_ylabel("difference of a point's\nlog density (–)")
        sums.set_ylabel("added up (–)")
        sums.set_xlabel(f"strain ({STRAIN_UNIT})" if is_strain else "time (s)")
        figure.legend(
            *points.get_legend_handles_labels(), loc="outside upper left", ncols=min(2, len(others))
        )
    return figure
