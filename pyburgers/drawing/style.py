"""What all figures share: colours, letters, rendering, headings, and how draws become bands.

Values are converted to display units in figures and nowhere earlier; no state of matplotlib is
changed.
"""

import io
import re
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import MaxNLocator
from PIL import Image

from pyburgers.checks.sampling_checks import BAND
from pyburgers.common.atomic_files import write_bytes
from pyburgers.fitting.fit import Fit
from pyburgers.model.display import STRAIN_FACTOR, STRAIN_UNIT, STRESS_FACTOR
from pyburgers.common.draws import all_draws, evenly_spaced
from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.forced_oscillation.experiment import OscillationExperiment

FloatArray = npt.NDArray[np.float64]

# The palette of Okabe and Ito (2008), which readers with any colour vision can tell apart.
BLACK, GREY = "#000000", "#b8b8b8"
ORANGE, SKY_BLUE, GREEN = "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"
PNG_DOTS_PER_INCH, PNG_COLOURS = 100, 128
"""Pictures are on pages and beside them, so they are small; the palette is chosen for each."""

PALETTE_ROUNDS = 4
"""Of k-means, with which the palette has the colours of thin lines to two of 255 steps."""

SVG_DOTS_PER_INCH = 50
"""Of what lies as one picture in vector files: thousands of curves or dots."""

_TAG, _DECIMALS = re.compile(rb"<[^>]*>"), re.compile(rb"(\.\d\d)\d+")
"""Tags of a vector file, and decimals beyond a hundredth of a point in their coordinates."""

RETRODICTIONS = 1000
"""Solutions for single draws that a figure shows at most."""

TAIL = 0.5 * (1.0 - BAND)
"""Share of draws on either side of a band."""


@dataclass(frozen=True)
class FigureText:
    """What a page says about a figure.

    Attributes
    ----------
    name : str
        Part of file names.
    title : str
        Heading.
    caption : str
        What is shown and how to read it, one paragraph.
    """

    name: str
    title: str
    caption: str


@dataclass(frozen=True)
class FigureRecipe(FigureText):
    """A figure that every report holds.

    Attributes
    ----------
    draw : callable
        Draws it for a fit.
    """

    draw: Callable[[Fit], Figure]


def style() -> AbstractContextManager[None]:
    """Set what all figures share; undone when the context ends."""
    return rc_context(
        {
            "font.size": 10.0,
            "axes.titlesize": 10.0,
            "axes.labelsize": 10.0,
            "xtick.labelsize": 9.0,
            "ytick.labelsize": 9.0,
            "legend.fontsize": 9.5,
            "legend.frameon": False,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.formatter.useoffset": False,
            "svg.hashsalt": "pyburgers",
            # Vector files keep text as text, and lines to a part of their width.
            "font.sans-serif": ["DejaVu Sans"],
            "svg.fonttype": "none",
            "path.simplify_threshold": 0.5,
        }
    )


def image(figure: Figure, kind: Literal["png", "svg"]) -> bytes:
    """Render a figure; the same figure gives the same bytes.

    The layout is made once: its engine moves panels a little each time, and takes as long as the
    drawing.
    """
    # Tick labels are made when a figure is drawn, so the style has to hold here as well.
    with style():
        engine = figure.get_layout_engine()
        if isinstance(engine, ConstrainedLayoutEngine):
            engine.execute(figure)
            figure.set_layout_engine(None)
        buffer = io.BytesIO()
        if kind == "svg":
            figure.savefig(buffer, format="svg", dpi=SVG_DOTS_PER_INCH, metadata={"Date": None})
            return _TAG.sub(lambda tag: _DECIMALS.sub(rb"\1", tag[0]), buffer.getvalue())
        figure.savefig(buffer, format="png", dpi=PNG_DOTS_PER_INCH)
    coloured = Image.open(buffer).convert("RGB")
    few = coloured.quantize(
        PNG_COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=PALETTE_ROUNDS, dither=Image.Dither.NONE
    )
    picture = io.BytesIO()
    few.save(picture, "png", optimize=True, dpi=(PNG_DOTS_PER_INCH, PNG_DOTS_PER_INCH))
    return picture.getvalue()


def write_images(figure: Figure, path: Path) -> None:
    """Write a figure as PNG and, beside it, as SVG."""
    kinds: tuple[Literal["png", "svg"], ...] = ("png", "svg")
    for kind in kinds:
        write_bytes(path.with_suffix(f".{kind}"), image(figure, kind))


def few_ticks(intervals: int) -> MaxNLocator:
    """Return ticks at round numbers, few enough for small panels."""
    return MaxNLocator(intervals, steps=[1, 2, 5, 10])


def title(experiment: Experiment) -> str:
    """Sample, material, conditions and kind of data; two lines for an oscillation."""
    kind = f"{experiment.provenance.kind} data"
    sample = f"{experiment.id}: {experiment.material}, {experiment.temperature:g} K"
    if isinstance(experiment, OscillationExperiment):
        prepared = experiment.prepared
        amplitude, _ = prepared.strain_fit.amplitude()
        return (
            f"{sample}, {kind}\nperiod {prepared.period:g} s, strain amplitude "
            f"{amplitude * STRAIN_FACTOR:.2g} {STRAIN_UNIT}, background {prepared.background}"
        )
    assert isinstance(experiment, ConstantRateExperiment)  # the only other protocol
    rate = rate_text(experiment.segments[0].strain_rate)
    return f"{sample}, {'first ' if len(experiment.segments) > 1 else ''}{rate}, {kind}"


def rate_text(rate: float) -> str:
    """Strain rate as matplotlib text."""
    mantissa, exponent = f"{rate:.2e}".split("e")
    return rf"${mantissa}\times10^{{{int(exponent)}}}$ s$^{{-1}}$"


def draw_band(
    axes: Axes, positions: FloatArray, values: xr.DataArray, colour: str, label: str
) -> None:
    """Draw the median and the 90 % band of draws.

    Parameters
    ----------
    axes : Axes
        Where.
    positions : array, shape (n,)
        Along the horizontal axis, in display units.
    values : DataArray, dimensions chain, draw and one more
        What is drawn, in display units.
    colour, label : str
        Of both, and of the line.
    """
    low, median, high = band(values)
    axes.fill_between(positions, low, high, color=colour, alpha=0.22, linewidth=0)
    axes.plot(positions, median, color=colour, linewidth=1.6, label=label)


def draw_predictive_band(axes: Axes, positions: FloatArray, replicated: xr.DataArray) -> None:
    """Draw the band that should hold 90 % of new stresses.

    Parameters
    ----------
    axes : Axes
        Where.
    positions : array, shape (n,)
        Along the horizontal axis, in display units.
    replicated : DataArray, dimensions chain, draw and one more
        Stresses with noise (Pa).
    """
    low, _, high = band(replicated) * STRESS_FACTOR
    axes.fill_between(
        positions, low, high, color=ORANGE, alpha=0.35, linewidth=0, label="90 % predictive band"
    )


def draw_residuals(
    axes: Axes, positions: FloatArray, residuals: FloatArray, half_width: float
) -> None:
    """Draw data minus mean prediction, and the 90 % band of the noise.

    Parameters
    ----------
    axes : Axes
        Where.
    positions, residuals : array, shape (n,)
        In display units.
    half_width : float
        Of the band, in the unit of the residuals.
    """
    axes.axhspan(
        -half_width, half_width, color=GREY, alpha=0.5, linewidth=0, label="90 % band of the noise"
    )
    axes.axhline(0.0, color=BLUE, linewidth=1.0)
    axes.plot(
        positions,
        residuals,
        linestyle="none",
        marker="o",
        markersize=3.5,
        color=BLACK,
        label="data minus mean prediction",
    )
    axes.yaxis.set_major_locator(few_ticks(5))


def legend_of_panels(figure: Figure, panels: Sequence[Axes]) -> None:
    """Put the legends of several panels together above them."""
    handles: list[Artist] = []
    labels: list[str] = []
    for axes in panels:
        more, more_labels = axes.get_legend_handles_labels()
        handles += more
        labels += more_labels
    figure.legend(handles, labels, loc="outside upper center", ncols=3)


def band(values: xr.DataArray) -> FloatArray:
    """Lower end, median and upper end of the central 90 % of draws, shape (3, n)."""
    ends: FloatArray = values.quantile([TAIL, 0.5, 1.0 - TAIL], ("chain", "draw")).to_numpy()
    return ends


def draw_retrodictions(
    axes: Axes, positions: FloatArray, values: xr.DataArray, factor: float
) -> None:
    """Draw solutions for single draws as thin lines, at most `RETRODICTIONS` of them.

    Parameters
    ----------
    axes : Axes
        Where.
    positions : array, shape (n,)
        Along the horizontal axis, in display units.
    values : DataArray, dimensions chain, draw and one more
        Solutions (SI).
    factor : float
        From SI to display units.
    """
    curves = evenly_spaced(all_draws(values), RETRODICTIONS) * factor
    points = np.stack([np.broadcast_to(positions, curves.shape), curves], axis=-1)
    # One picture instead of a thousand paths keeps vector files small.
    axes.add_collection(
        LineCollection(list(points), colors=BLUE, linewidths=0.5, alpha=0.04, rasterized=True)
    )
    axes.plot([], [], color=BLUE, linewidth=0.8, alpha=0.6, label=f"{len(curves)} retrodictions")
