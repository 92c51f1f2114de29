"""The numbers that a figure shows, read off its panels, and where a page finds them."""

import re
from collections.abc import Iterator

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import Collection, PathCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pyburgers.common.array_types import FloatArray

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
