"""Figure of which mechanism of a composite flow law leads where."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from pyburgers.common.array_types import FloatArray
from pyburgers.drawing.panels import figure_of
from pyburgers.drawing.style import BLUE, GREEN, ORANGE, PURPLE, VERMILION
from pyburgers.flow_law_tables.mechanism_maps import (
    NATURAL_CONDITIONS,
    NEAR_FACTOR,
    NEAR_KELVIN,
    MechanismMap,
    NaturalConditions,
)
from pyburgers.flow_law_tables.tables import RateTable
from pyburgers.model.display import LENGTH_FACTOR, LENGTH_UNIT, STRESS_FACTOR, STRESS_UNIT

MECHANISM_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE)

MOST_LINES = 12
"""Of equal strain rate on a map."""

MAP_CAPTION = (
    "The mechanism that leads, by colour. The colour is full if the mechanism leads in all draws, "
    "and white if every mechanism leads equally often. Lines are log10 of the strain rate (1/s). "
    "Dots are the tests within a factor of 3 of the grain size, or within 10 K. Hatched: no test "
    "lies within 10 K and within a factor of 3 of stress and grain size, so that the law alone "
    "speaks. A box stands where a map passes through conditions in nature: {natural}."
)


def map_caption(material: str) -> str:
    """Return the caption, with the sources of the conditions in nature."""
    found = NATURAL_CONDITIONS.get(material, ())
    return MAP_CAPTION.format(
        natural="; ".join(f"{one.name} ({one.source})" for one in found) or "none are stated"
    )


def mechanism_figure(used: RateTable, maps: Sequence[MechanismMap]) -> Figure:
    """Draw maps side by side."""
    with figure_of(5.6 * len(maps), 4.9) as figure:
        panels = figure.subplots(1, len(maps), squeeze=False)[0]
        for axes, found in zip(panels, maps, strict=True):
            _draw_map(axes, used, found)
        names = maps[0].mechanisms
        figure.legend(
            handles=[
                Patch(color=colour, label=name.replace("_", " "))
                for name, colour in zip(names, MECHANISM_COLOURS, strict=False)
            ],
            loc="outside upper center",
            ncols=len(names),
        )
    return figure


def _draw_map(axes: Axes, used: RateTable, found: MechanismMap) -> None:
    """Draw one map: stress against temperature (K) or against grain size."""
    across = found.grain_size * LENGTH_FACTOR if found.over_grain_size else found.temperature
    up = found.stress * STRESS_FACTOR
    axes.pcolormesh(across, up, _colours(found.probability), shading="nearest", rasterized=True)
    axes.set_yscale("log")
    powers = found.log_rate / np.log(10.0)
    whole = np.arange(np.ceil(powers.min()), np.floor(powers.max()) + 1)
    levels = whole[:: 1 + whole.size // MOST_LINES]
    lines = axes.contour(across, up, powers, levels=levels, colors="black", linewidths=0.7)
    axes.clabel(lines, fontsize="x-small", fmt="%.0f")
    if not found.is_supported.all():
        unseen = ~found.is_supported
        axes.contourf(across, up, unseen, levels=[0.5, 1.5], colors="none", hatches=["///"])
    if found.over_grain_size:
        axes.set_xscale("log")
        axes.set_xlabel(f"grain size ({LENGTH_UNIT})")
        axes.set_title(f"{found.temperature[0]:.0f} K", loc="left")
        shown, at = np.abs(used.temperature - found.temperature[0]) <= NEAR_KELVIN, used.grain_size
        places = at * LENGTH_FACTOR
    else:
        axes.set_xlabel("temperature (K)")
        axes.set_title(f"{found.grain_size[0] * LENGTH_FACTOR:.3g} {LENGTH_UNIT}", loc="left")
        shown = np.abs(np.log(used.grain_size / found.grain_size[0])) <= np.log(NEAR_FACTOR)
        places = used.temperature
    axes.plot(places[shown], used.stress[shown] * STRESS_FACTOR, ".", color="black", markersize=3)
    axes.set_ylabel(f"stress ({STRESS_UNIT})")
    axes.set_xlim(across[0], across[-1])
    axes.set_ylim(up[0], up[-1])
    for one in NATURAL_CONDITIONS.get(used.material, ()):
        _draw_box(axes, found, one)


def _draw_box(axes: Axes, found: MechanismMap, conditions: NaturalConditions) -> None:
    """Draw the part of natural conditions that the map passes through, if it does."""
    at, (least, most) = found.grain_size[0], conditions.grain_size
    left, right = conditions.temperature
    if found.over_grain_size:
        at, (least, most) = found.temperature[0], conditions.temperature
        left, right = np.array(conditions.grain_size) * LENGTH_FACTOR
    if not least <= at <= most:
        return
    low, high = np.array(conditions.stress) * STRESS_FACTOR
    axes.add_patch(
        Rectangle((left, low), right - left, high - low, fill=False, linewidth=1.2, clip_on=True)
    )
    axes.annotate(
        conditions.name,
        (min(right, axes.get_xlim()[1]), high),
        xytext=(-3, -3),
        textcoords="offset points",
        ha="right",
        va="top",
        fontsize="x-small",
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 1.0},
    )


def _colours(probability: FloatArray) -> FloatArray:
    """Return colours (m, n, 3) of the leading mechanism by `probability` (m, n, n_mechanisms)."""
    base = np.array([to_rgb(one) for one in MECHANISM_COLOURS])[: probability.shape[-1]]
    least = 1.0 / probability.shape[-1]
    surety = (probability.max(axis=-1) - least) / (1.0 - least)
    return np.asarray(1.0 - surety[..., np.newaxis] * (1.0 - base[probability.argmax(axis=-1)]))
