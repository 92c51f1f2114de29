"""What all figures share: colours, letters, rendering; no state of matplotlib is changed."""

import html
import io
import json
import math
import re
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Literal

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from pyburgers.common.atomic_files import write_bytes, write_text
from pyburgers.common.csv_tables import csv_text
from pyburgers.drawing.figure_data import SERIES_ID, figure_data, name_series, panel_scales

# The palette of Okabe and Ito (2008), which readers with any colour vision can tell apart.
BLACK, GREY = "#000000", "#b8b8b8"
ORANGE, SKY_BLUE, GREEN = "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"

MARKERS = ("o", "s", "^", "D", "v")
"""Of what stands beside each other in a figure, for readers without its colours."""

PNG_DOTS_PER_INCH = 100

SVG_DOTS_PER_INCH = 72
"""Of what lies as one picture in vector files: thousands of curves or dots."""

ROUNDING = 1e-6
"""Part of a dot that is none."""

_TAG, _DECIMALS = re.compile(rb"<[^>]*>"), re.compile(rb"(\.\d\d)\d+")
"""Tags of a vector file, and decimals beyond a hundredth of a point in their coordinates."""

_SERIES = re.compile(rf' id="{SERIES_ID}:(\d+):([^"]*)"'.encode())
"""What `name_series` makes of the id of an element."""


def style() -> AbstractContextManager[None]:
    """Set what all figures share; undone when the context ends.

    Examples
    --------
    >>> with pyburgers.style():
    ...     figure, axes = plt.subplots()
    """
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
    """Render a figure; the same figure gives the same bytes."""
    # Tick labels are made when a figure is drawn, so the style has to hold here as well.
    with style():
        engine = figure.get_layout_engine()
        if isinstance(engine, ConstrainedLayoutEngine):
            engine.execute(figure)
            figure.set_layout_engine(None)
        buffer = io.BytesIO()
        if kind == "svg":
            name_series(figure)
            with _whole_dots(figure, SVG_DOTS_PER_INCH):
                figure.savefig(buffer, format="svg", dpi=SVG_DOTS_PER_INCH, metadata={"Date": None})
            picture = _TAG.sub(lambda tag: _DECIMALS.sub(rb"\1", tag[0]), buffer.getvalue())
            panels = html.escape(json.dumps(panel_scales(figure)))
            picture = picture.replace(b"<svg ", f'<svg data-panels="{panels}" '.encode(), 1)
            return _SERIES.sub(rb' data-panel="\1" data-series="\2"', picture)
        figure.savefig(buffer, format="png", dpi=PNG_DOTS_PER_INCH)
    return buffer.getvalue()


@contextmanager
def _whole_dots(figure: Figure, dots_per_inch: int) -> Iterator[None]:
    """Give a figure whole dots: of others matplotlib cuts its pictures, which lie too high then."""
    width, height = figure.get_size_inches().tolist()
    dots = (math.ceil(side * dots_per_inch - ROUNDING) for side in (width, height))
    figure.set_size_inches(*(side / dots_per_inch for side in dots))
    yield
    figure.set_size_inches(width, height)


def write_images(figure: Figure, path: Path) -> str:
    """Write a figure as PNG and, beside it, as SVG, which is returned."""
    vector = image(figure, "svg")
    write_bytes(path.with_suffix(".png"), image(figure, "png"))
    write_bytes(path.with_suffix(".svg"), vector)
    return vector.decode("utf-8")


def write_page_images(figure: Figure, path: Path) -> str:
    """Write a figure as PNG, SVG and, with `figure_data`, CSV; return the SVG."""
    vector = write_images(figure, path)
    data = figure_data(figure)
    if len(data):
        write_text(path.with_suffix(".csv"), csv_text(data, float_format="%.7g"))
    return vector


def few_ticks(intervals: int) -> MaxNLocator:
    """Return ticks at round numbers, few enough for small panels."""
    return MaxNLocator(intervals, steps=[1, 2, 5, 10])


def few_ticks_of_decades(axes: Axes) -> None:
    """Label decades of a logarithmic x axis, and threes of them where these are few."""
    low, high = axes.get_xlim()
    subs = (1.0, 3.0) if high < 10**2.5 * low else (1.0,)
    axes.xaxis.set_major_locator(LogLocator(subs=subs, numticks=4))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
