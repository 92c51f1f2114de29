"""Panels that figures share: bands and curves of draws, data with residuals, legends.

Everything is in display units already; draws are along the first axis.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from scipy import stats

from pyburgers.common.draws import TAIL, FloatArray, central_band, evenly_spaced
from pyburgers.drawing.style import BLACK, BLUE, GREY, ORANGE, VERMILION, few_ticks, style
from pyburgers.model.display import STRAIN_UNIT, STRESS_UNIT

RETRODICTIONS = 1000
"""Solutions for single draws that a figure shows at most."""

MEDIAN_LABEL = "predictive median"

LINES_AND_AREAS = "lines: posterior median, areas: 90 % of draws"

STRESS_LABEL = f"differential stress ({STRESS_UNIT})"
STRAIN_LABEL = f"axial strain ({STRAIN_UNIT})"

HALF_WIDTH = float(stats.norm.ppf(1.0 - TAIL))
"""Of the central 90 % of a normal distribution, in standard deviations."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ReadCurve:
    """Readings of a test along its clock in display units, shape (n_points,)."""

    position: FloatArray
    data: FloatArray
    position_label: str
    label: str
    heading: str
    error: FloatArray | None = None  # standard deviation of each reading where they differ
    marks: Sequence[tuple[float, str]] = ()  # where what is imposed changes, and to what
    limits: tuple[float, float] | None = None  # of the horizontal axis
    scale: Literal["linear", "log"] = "linear"


@dataclass(frozen=True, eq=False, kw_only=True)
class FittedCurve(ReadCurve):
    """The response of a test along its clock, measured and as a fit has it, in display units.

    Solutions of single draws, without and with noise, have shape (n_draws, n_grid); residuals of
    the readings about the predictive median have shape (n_points,).
    """

    grid: FloatArray
    solutions: FloatArray
    replicated: FloatArray
    residuals: FloatArray
    data_label: str
    noise_band: float  # half width of the band of the residuals
    residual_label: str

    @property
    def median(self) -> FloatArray:
        """Predictive median at the positions of the solutions; noise is symmetric about them."""
        return np.asarray(central_band(self.solutions)[1])


@contextmanager
def figure_of(width: float, height: float, heading: str = "") -> Iterator[Figure]:
    """Yield a figure (inches) to be drawn in the shared style, below a heading if there is one."""
    with style():
        figure = Figure(figsize=(width, height), layout="constrained")
        yield figure
        if heading:
            figure.suptitle(heading, fontsize=10)


def curve_with_residuals(curve: FittedCurve) -> Figure:
    """Draw data, retrodictions and predictive band above residuals."""
    with figure_of(8.0, 6.4) as figure:
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
        draw_curve(upper, curve)
        draw_residuals(lower, curve)
        for position, _ in curve.marks:
            _draw_mark(lower, position)
        figure.legend(loc="outside upper center", ncols=3)
    return figure


def draw_residuals(axes: Axes, curve: FittedCurve) -> None:
    """Draw readings minus the predictive median, with the 90 % band of the noise."""
    band = curve.noise_band
    axes.axhspan(-band, band, color=GREY, alpha=0.5, linewidth=0, label="90 % band of the noise")
    axes.axhline(0.0, color=BLUE, linewidth=1.0)
    label = f"data minus {MEDIAN_LABEL}"
    axes.plot(curve.position, curve.residuals, "o", markersize=3.5, color=BLACK, label=label)
    axes.yaxis.set_major_locator(few_ticks(5))
    axes.set(xlabel=curve.position_label, ylabel=curve.residual_label)


def curve_result(curve: FittedCurve) -> str:
    """Say how a fit meets the readings."""
    inside = np.mean(np.abs(curve.residuals) <= curve.noise_band)
    return (
        f"{inside:.0%} of {curve.residuals.size} readings lie within the band about the median "
        "that should hold 90 %."
    )


def band_text(draws: FloatArray, unit: str) -> str:
    """Return median and central 90 % of draws in display units."""
    low, median, high = (f"{float(value):.3g}" for value in central_band(draws))
    return f"{median} {unit}".rstrip() + f" ({low} to {high})"


def draw_curve(axes: Axes, curve: FittedCurve, *, is_read: bool = True) -> None:
    """Draw data and band, if the quantity is read, retrodictions, median and marks."""
    if is_read:
        low, _, high = central_band(curve.replicated)
        band = axes.fill_between(curve.grid, low, high, color=ORANGE, alpha=0.35, linewidth=0)
        band.set_label("90 % predictive band")
    draw_retrodictions(axes, curve.grid, curve.solutions)
    axes.plot(curve.grid, curve.median, color=VERMILION, linewidth=1.6, label=MEDIAN_LABEL)
    if is_read:
        draw_data(axes, curve.position, curve.data, curve.error, curve.data_label)
    draw_marks(axes, curve)


def draw_marks(axes: Axes, curve: ReadCurve) -> None:
    """Draw where what is imposed changes; set limits, title and label of the response."""
    for position, text in curve.marks:
        _draw_mark(axes, position)
        # Ahead of the mark, where stress is high: behind it may be low readings.
        axes.annotate(
            text,
            (position, 0.02),
            xycoords=("data", "axes fraction"),
            xytext=(-3, 0),
            textcoords="offset points",
            rotation=90,
            ha="right",
            va="bottom",
            fontsize=9,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.5},
        )
    if curve.limits is None:
        axes.margins(x=0.01)
    else:
        axes.set_xlim(*curve.limits)
    axes.set_title(curve.heading, loc="left")
    axes.set_ylabel(curve.label)


def _draw_mark(axes: Axes, position: float) -> None:
    axes.axvline(position, color=BLACK, linestyle=":", linewidth=0.9)


def draw_dots(
    axes: Axes,
    x: FloatArray,
    y: FloatArray,
    *,
    xerr: FloatArray | Sequence[FloatArray] | None = None,
    yerr: FloatArray | Sequence[FloatArray] | None = None,
    colour: str = BLACK,
    face: str = "white",
    size: float = 4.0,
    marker: str = "o",
    label: str = "",
    **style_of_bars: Any,
) -> None:
    """Draw dots with a coloured edge, and bars either way where they are given."""
    axes.errorbar(
        x,
        y,
        xerr=xerr,
        yerr=yerr,
        **{"elinewidth": 0.8, "ecolor": colour, **style_of_bars},
        linestyle="none",
        marker=marker,
        markersize=size,
        markerfacecolor=face,
        markeredgecolor=colour,
        markeredgewidth=0.8,
        label=label or None,
    )


def draw_data(
    axes: Axes, position: FloatArray, data: FloatArray, error: FloatArray | None, label: str
) -> None:
    """Draw readings as circles, with one standard deviation either way where it is given."""
    draw_dots(axes, position, data, yerr=error, ecolor="#777777", label=label)


def draw_retrodictions(axes: Axes, grid: FloatArray, solutions: FloatArray) -> None:
    """Draw solutions for single draws as thin lines, at most `RETRODICTIONS` of them."""
    curves = evenly_spaced(solutions, RETRODICTIONS)
    draw_thin_lines(axes, grid, curves, BLUE, alpha=0.04)
    axes.plot([], [], color=BLUE, linewidth=0.8, alpha=0.6, label=f"{len(curves)} retrodictions")


def draw_thin_lines(
    axes: Axes, position: FloatArray, curves: FloatArray, colour: str, *, alpha: float
) -> None:
    """Draw many curves, shape (n_curves, n), as one picture, which keeps vector files small."""
    points = np.stack([np.broadcast_to(position, curves.shape), curves], axis=-1)
    axes.add_collection(
        LineCollection(list(points), colors=colour, linewidths=0.5, alpha=alpha, rasterized=True)
    )


def draw_band(
    axes: Axes,
    position: FloatArray,
    values: FloatArray,
    colour: str,
    label: str,
    linestyle: str = "-",
) -> None:
    """Draw the median and the 90 % band of draws, shape (n_draws, n); the label is the line's."""
    low, median, high = central_band(values)
    axes.fill_between(position, low, high, color=colour, alpha=0.22, linewidth=0)
    axes.plot(position, median, color=colour, linewidth=1.6, linestyle=linestyle, label=label)


def draw_band_panel(
    axes: Axes,
    position: FloatArray,
    bands: Sequence[tuple[FloatArray, str, str]],
    *,
    heading: str,
    label: str,
    level: tuple[float, str] | None = None,
) -> None:
    """Draw medians and bands of draws, shape (n_draws, n), each with its colour and label."""
    for values, colour, name in bands:
        draw_band(axes, position, values, colour, name)
    if level is not None:
        axes.axhline(level[0], color=BLACK, linestyle=":", linewidth=1.0, label=level[1])
    axes.set_title(heading, loc="left")
    axes.set_ylabel(label)
    axes.legend(loc="best")
