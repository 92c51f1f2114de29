"""Figures of what comparisons found."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pyburgers.checks.fit_checks import PARETO_K_LIMIT
from pyburgers.common.array_types import BoolArray
from pyburgers.comparison.results import Comparison, ComparisonByTest, has_several_tests
from pyburgers.drawing.panels import draw_dots, figure_of
from pyburgers.drawing.style import (
    BLACK,
    BLUE,
    GREEN,
    MARKERS,
    ORANGE,
    PURPLE,
    VERMILION,
    few_ticks,
)

FIT_COLOURS = (VERMILION, BLUE, GREEN, PURPLE, ORANGE)
RING: dict[str, Any] = {"marker": "o", "color": BLACK, "markersize": 9, "fillstyle": "none"}
CROSS: dict[str, Any] = {"marker": "x", "color": BLACK, "markersize": 8}
MARKS = {"exact": ("left out by fitting again", RING), "unreliable": ("doubtful", CROSS)}
"""Names and marks of points by what a `LeaveOneOut` says of them."""

TEST_SHIFT = 0.12
"""Distance of the fits of a test from each other; tests are 1 apart."""

COMPARISON_CAPTION = (
    "Above: log predictive density of each left-out point under a fit less that under the best "
    "one; below zero the best fit predicts the point better. Below: the same added up along the "
    "test, so that its steps show which part of the curve decides and its end is the difference of "
    "elpd. The importance weights of a doubtful point are too uneven to be trusted (Pareto k above "
    f"{PARETO_K_LIMIT})."
)

LEFT_OUT_CAPTION = (
    "Log density of each test given the others, under a fit less that under the best one; below "
    "zero the best fit predicts the test better. Of a fit alone: per reading. Bars are Monte Carlo "
    "errors."
)

LETTER_WIDTH, HANDLE_WIDTH = 0.08, 0.6
"""Room in a legend of a letter and of what stands beside a name, in inches."""


def pointwise_differences(comparison: Comparison) -> Figure:
    """Draw differences of the elpd to the best fit along each test, by point and added up."""
    (best_name, best), *others = comparison.results.items()
    tests = _tests(comparison)
    along = comparison.position.to_numpy() * comparison.clock.display_factor
    with figure_of(3.4 + 3.4 * len(tests), 5.4) as figure:
        panels = figure.subplots(2, len(tests), sharex="col", sharey="row", squeeze=False)
        for column, (test, here) in enumerate(tests.items()):
            points, sums = panels[:, column]
            for k, (name, result) in enumerate(others):
                difference = result.elpd - best.elpd
                colour = FIT_COLOURS[k % len(FIT_COLOURS)]
                draw_dots(
                    points,
                    along[here],
                    difference[here],
                    colour=colour,
                    face=colour,
                    size=3.5,
                    marker=MARKERS[k % len(MARKERS)],
                    label=f"{name} less {best_name}",
                )
                for said, (_, mark) in MARKS.items():
                    some = here & (getattr(result, said) | getattr(best, said))
                    points.plot(along[some], difference[some], linestyle="none", **mark)
                summed = np.cumsum(difference[here])
                sums.step(along[here], summed, where="post", color=colour, linewidth=1.4)
            for axes in (points, sums):
                axes.axhline(0.0, color=BLACK, linewidth=0.8)
                axes.yaxis.set_major_locator(few_ticks(5))
            points.set_title(test, loc="left")
            sums.set_xlabel(comparison.clock.label)
        panels[0, 0].set_ylabel("difference of a point's\nlog density (–)")
        panels[1, 0].set_ylabel("added up (–)")
        marks = [
            Line2D([], [], linestyle="none", label=label, **mark)
            for said, (label, mark) in MARKS.items()
            if any(getattr(one, said).any() for one in comparison.results.values())
        ]
        _legend_above(figure, panels[0, 0], marks)
    return figure


def _legend_above(figure: Figure, axes: Axes, marks: Sequence[Line2D] = ()) -> None:
    """Name what the axes show, in two columns where the longest names fit side by side."""
    handles = [*axes.get_legend_handles_labels()[0], *marks]
    labels = [str(handle.get_label()) for handle in handles]
    widest = LETTER_WIDTH * max(map(len, labels), default=0) + HANDLE_WIDTH
    columns = 2 if len(labels) > 1 and 2 * widest <= figure.get_figwidth() else 1
    figure.legend(handles, labels, loc="outside upper left", ncols=columns)


def _tests(comparison: Comparison) -> dict[str, BoolArray]:
    """Return the points of each test, by its name where there are several."""
    if not has_several_tests(comparison):
        return {"": np.ones(comparison.position.size, dtype=bool)}
    of_point = comparison.position["test"].to_numpy()
    return {str(name): of_point == name for name in dict.fromkeys(of_point)}


def left_out_tests(comparison: ComparisonByTest) -> Figure:
    """Draw the log density of each left-out test: less that of the best fit, or of a fit alone."""
    (best_name, best), *others = comparison.results.items()
    if others:
        shown = {
            f"{name} less {best_name}": (one.elpd - best.elpd, np.hypot(one.error, best.error))
            for name, one in others
        }
    else:
        shown = {best_name: (best.elpd / best.n_points, best.error / best.n_points)}
    lines = np.arange(len(best.tests), dtype=np.float64)
    with figure_of(6.8, 1.8 + 0.45 * lines.size) as figure:
        axes = figure.subplots()
        for k, (label, (value, error)) in enumerate(shown.items()):
            colour = FIT_COLOURS[k % len(FIT_COLOURS)]
            draw_dots(
                axes,
                value,
                lines + TEST_SHIFT * (k - (len(shown) - 1) / 2),
                xerr=error,
                colour=colour,
                face=colour,
                size=5.0,
                marker=MARKERS[k % len(MARKERS)],
                label=label,
            )
        if others:
            axes.axvline(0.0, color=BLACK, linewidth=0.8)
        axes.set_xlabel(
            f"difference of the log density of the left-out {best.kind} (–)"
            if others
            else f"log density of the left-out {best.kind} per reading (readings in SI units)"
        )
        axes.set_yticks(lines, list(best.tests))
        axes.set_ylim(lines.size - 0.5, -0.5)
        _legend_above(figure, axes)
    return figure
