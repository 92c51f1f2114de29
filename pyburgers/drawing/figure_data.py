"""The numbers that a figure shows, read off its panels."""

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import Collection, PathCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

FloatArray = npt.NDArray[np.float64]

COLUMNS = ("panel", "x label", "y label", "series", "x", "y")


def figure_data(figure: Figure) -> pd.DataFrame:
    """Return a row for each point of lines, dots and outlines of areas, in the units of the axes.

    A series has its name in the legend, or else its kind and number. Thin lines of single draws
    are left out, and a figure whose dots are single draws has no rows: the run directory has them.
    """
    dots = [one for axes in figure.axes for one in (*axes.lines, *axes.collections)]
    if any(isinstance(one, Line2D | PathCollection) and one.get_rasterized() for one in dots):
        return pd.DataFrame(columns=list(COLUMNS))
    parts = [
        pd.DataFrame(dict(zip(COLUMNS, (*_about(axes, panel), name, *points.T), strict=True)))
        for panel, axes in enumerate(figure.axes, start=1)
        for name, points in _series(axes)
    ]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=list(COLUMNS))


def _about(axes: Axes, panel: int) -> tuple[str, str, str]:
    """Return number and title of a panel, and the labels of its axes."""
    title = axes.get_title("left") or axes.get_title()
    below = [other.get_xlabel() for other in axes.get_shared_x_axes().get_siblings(axes)]
    x_label = axes.get_xlabel() or next(filter(None, below), "")
    return f"{panel}: {title}" if title else str(panel), x_label, axes.get_ylabel()


def _series(axes: Axes) -> Iterator[tuple[str, FloatArray]]:
    """Yield name and points, shape (n, 2), of everything that lies at data of a panel."""
    names: dict[Artist, object] = {
        part: whole.get_label() for whole in axes.containers for part in whole.get_children()
    }
    number = 0
    for artist in (*axes.lines, *axes.collections, *axes.patches):
        kind, points = _points(artist, axes)
        if len(points):
            number += 1
            name = str(names.get(artist, artist.get_label()))
            yield (f"{kind} {number}" if not name or name.startswith("_") else name), points


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
