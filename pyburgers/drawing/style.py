"""What all figures share: colours, letters, rendering, and the numbers that a figure shows.

No state of matplotlib is changed.
"""

import html
import io
import json
import math
import re
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
import pandas as pd
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import Collection, PathCollection
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter

from pyburgers.common.array_types import FloatArray
from pyburgers.common.atomic_files import write_bytes, write_text
from pyburgers.common.csv_tables import csv_text

COLUMNS = ("panel", "x label", "y label", "series", "x", "y")


def figure_data(figure: Figure) -> pd.DataFrame:
    """Return a row for each point of lines, dots and outlines, but for lines of single draws."""
    dots = [one for axes in figure.axes for one in (*axes.lines, *axes.collections)]
    if any(isinstance(one, Line2D | PathCollection) and one.get_rasterized() for one in dots):
        return pd.DataFrame(columns=list(COLUMNS))
    parts = [
        pd.DataFrame(dict(zip(COLUMNS, (*_about(axes, panel), name, *points.T), strict=True)))
        for panel, axes in enumerate(figure.axes, start=1)
        for _, name, points in _series(axes)
    ]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=list(COLUMNS))


SERIES_ID = "series"
"""First part of the ids that `name_series` gives."""

_UNIT = re.compile(r"\(([^()]*(?:\([^()]*\))?[^()]*)\)\s*$")
"""Unit in the brackets at the end of the label of an axis."""


def name_series(figure: Figure) -> None:
    """Give lines, dots and outlines an id of number of the panel and name: ``series:1:model``."""
    for panel, axes in enumerate(figure.axes):
        for artist, name, _ in _series(axes):
            if isinstance(artist, Line2D | PathCollection | Patch):
                text = name.replace('"', "'")
                artist.set_gid(f"{SERIES_ID}:{panel}:{text}")


def panel_scales(figure: Figure) -> list[list[object]]:
    """Return left, top, right and bottom (shares of the figure) and both axes of each panel."""
    found: list[list[object]] = []
    for panel, axes in enumerate(figure.axes):
        place = axes.get_position()
        _, *labels = _about(axes, panel)
        scales = [
            _scale(ends, axis.get_scale() == "log", label)
            for ends, axis, label in zip(
                (axes.get_xlim(), axes.get_ylim()), (axes.xaxis, axes.yaxis), labels, strict=True
            )
        ]
        found.append([place.x0, 1 - place.y1, place.x1, 1 - place.y0, *scales])
    return found


def _scale(ends: tuple[float, float], is_log: bool, label: str) -> list[object]:
    unit = _UNIT.search(label)
    text = re.sub(r"[${}\\]", "", unit[1]) if unit else ""
    low, high = np.log10(ends) if is_log else ends
    return [float(low), float(high), int(is_log), "" if text == "–" else text]


def _about(axes: Axes, panel: int) -> tuple[str, str, str]:
    """Return number and title of a panel, and the labels of its axes."""
    title = axes.get_title("left") or axes.get_title()
    below = [other.get_xlabel() for other in axes.get_shared_x_axes().get_siblings(axes)]
    whole = axes.get_figure(root=True)
    assert whole is not None
    x_label = axes.get_xlabel() or next(filter(None, below), "") or whole.get_supxlabel()
    y_label = axes.get_ylabel() or whole.get_supylabel()
    return f"{panel}: {title}" if title else str(panel), x_label, y_label


def _series(axes: Axes) -> Iterator[tuple[Artist, str, FloatArray]]:
    """Yield everything that lies at data of a panel, its name and its points, shape (n, 2)."""
    names: dict[Artist, object] = {
        part: whole.get_label() for whole in axes.containers for part in whole.get_children()
    }
    number = 0
    for artist in (*axes.lines, *axes.collections, *axes.patches):
        kind, points = _points(artist, axes)
        if len(points):
            number += 1
            name = str(names.get(artist, artist.get_label()))
            is_named = bool(name) and not name.startswith("_")
            yield artist, name if is_named else f"{kind} {number}", points


def _points(artist: Artist, axes: Axes) -> tuple[str, FloatArray]:
    """Return the kind of an artist, and its points at data, shape (n, 2): none of a picture."""
    place, points = artist.get_transform(), np.empty((0, 2))
    if isinstance(artist, Line2D):
        kind, points = "line", np.asarray(artist.get_xydata(), dtype=float)
    elif isinstance(artist, PathCollection):
        kind, points = "dots", np.ma.filled(np.ma.asarray(artist.get_offsets(), float), np.nan)
        place = artist.get_offset_transform()
    elif isinstance(artist, Patch):
        kind, inner = "area", artist.get_patch_transform()
        points = np.asarray(inner.transform_path(artist.get_path()).vertices)
    else:
        assert isinstance(artist, Collection)
        kind = "area"
        points = np.concatenate([points, *(path.vertices for path in artist.get_paths())])
    if artist.get_rasterized() or not all(place.contains_branch_seperately(axes.transData)):
        return kind, points[:0]
    return kind, points[np.isfinite(points).all(axis=1)]


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


ImageFormat: TypeAlias = Literal["png", "svg"]
"""What a figure becomes."""


def image(figure: Figure, kind: ImageFormat) -> bytes:
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
