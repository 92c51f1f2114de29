"""Figures of a joint fit: all curves, and its posterior beside those of fits of single tests."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pyburgers.common.draws import BAND, TAIL, all_draws
from pyburgers.comparison.same_data import fits_alone
from pyburgers.drawing.panels import draw_curve, legend_above
from pyburgers.drawing.style import BLUE, VERMILION, few_ticks, style
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.joint_fit import JointFit
from pyburgers.model.display import axis_label, shown_quantity
from pyburgers.model.parameters import REFERENCE_STRESS_QUANTITY
from pyburgers.protocols.registry import protocol_of

CURVES_CAPTION = (
    "Every test of the joint fit with all its segments: data (circles), solution at the posterior "
    "mean (solid line), retrodictions (thin lines) and the band that should hold 90 % of new "
    "measurements. Dotted vertical lines mark where the imposed strain rate changes."
)
INTERVALS_CAPTION = (
    f"Median, central 50 % (thick) and {BAND:.0%} (thin) of every parameter in every test: in the "
    "joint fit (blue) and, where there is one, in the fit of the test alone (red). A shared "
    "parameter has one joint posterior, shown as a band across all tests."
)
COLUMNS = 3
QUANTILES = (TAIL, 0.25, 0.5, 0.75, 1.0 - TAIL)
SHIFT = 0.14
"""Distance of the two fits of a test from its line; tests are 1 apart."""


def all_curves(joint: JointFit) -> Figure:
    """Draw data, solutions and predictive bands of every test."""
    curves = [protocol_of(fit.experiment).curve(fit) for fit in joint.tests().values()]
    with style():
        figure = Figure(figsize=(8.0, 3.2 * len(curves) + 0.6), layout="constrained")
        panels = list(figure.subplots(len(curves), 1, squeeze=False)[:, 0])
        for axes, curve in zip(panels, curves, strict=True):
            draw_curve(axes, curve)
        panels[-1].set_xlabel(curves[-1].position_label)
        legend_above(figure, panels[:1])
    return figure


def intervals(joint: JointFit, separate: Sequence[Fit]) -> Figure:
    """Draw intervals of every parameter in every test, joint and alone.

    Parameters
    ----------
    joint : JointFit
        The joint fit.
    separate : sequence of Fit
        Fits of single tests; those of the same data as a test are drawn beside it.
    """
    tests = joint.tests()
    alone = fits_alone(joint, separate)
    quantities = (*joint.problem.free, REFERENCE_STRESS_QUANTITY.name)
    n_rows = -(-len(quantities) // COLUMNS)
    with style():
        figure = Figure(
            figsize=(9.0, n_rows * (0.9 + 0.28 * len(tests)) + 0.5), layout="constrained"
        )
        panels = figure.subplots(n_rows, COLUMNS, sharey=True, squeeze=False)
        for axes, quantity in zip(panels.flat, quantities, strict=False):
            shared = quantity in joint.problem.shared
            for line, (name, fit) in enumerate(tests.items()):
                if not shared:
                    _bar(axes, line - SHIFT, fit, quantity, BLUE)
                elif line == 0:
                    _across(axes, fit, quantity)
                other = alone[name]
                if other is not None:
                    _bar(axes, line + SHIFT, other, quantity, VERMILION)
            axes.xaxis.set_major_locator(few_ticks(4))
            axes.set_xlabel(axis_label(shown_quantity(quantity)))
            axes.set_yticks(range(len(tests)), list(tests))
            axes.set_ylim(len(tests) - 0.5, -0.5)
        for axes in panels.flat[len(quantities) :]:
            axes.set_axis_off()
        shown = {"joint fit": BLUE}
        if any(alone.values()):
            shown["test alone"] = VERMILION
        lines = [Line2D([], [], color=colour, linewidth=3.5) for colour in shown.values()]
        figure.legend(lines, list(shown), loc="outside upper center", ncols=2)
    return figure


def _quantiles(fit: Fit, quantity: str) -> list[float]:
    """Quantiles of `QUANTILES` in display units."""
    draws = all_draws(fit.posterior["posterior"].to_dataset()[quantity])
    factor = shown_quantity(quantity).display_factor
    return [float(value) for value in np.quantile(draws, QUANTILES) * factor]


def _bar(axes: Axes, line: float, fit: Fit, quantity: str, colour: str) -> None:
    low, lower, median, upper, high = _quantiles(fit, quantity)
    axes.hlines(line, low, high, colors=colour, linewidth=1.2)
    axes.hlines(line, lower, upper, colors=colour, linewidth=3.5)
    axes.plot([median], [line], "o", color="white", markeredgecolor=colour, markersize=4)


def _across(axes: Axes, fit: Fit, quantity: str) -> None:
    low, lower, median, upper, high = _quantiles(fit, quantity)
    axes.axvspan(low, high, color=BLUE, alpha=0.16, linewidth=0)
    axes.axvspan(lower, upper, color=BLUE, alpha=0.25, linewidth=0)
    axes.axvline(median, color=BLUE, linewidth=1.2)
