"""Figure of a flow law that was fitted to a table of peak stresses."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from pyburgers.common.draws import all_draws
from pyburgers.common.numbers import number
from pyburgers.drawing.panels import draw_band
from pyburgers.drawing.style import BLUE, GREEN, ORANGE, PURPLE, VERMILION, style
from pyburgers.flow_law_tables.fit import PeakStressFit
from pyburgers.flow_law_tables.stan_data import GROUP_TEMPERATURES, groups
from pyburgers.model.display import (
    LENGTH_FACTOR,
    LENGTH_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
)

GROUP_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE)
GROUP_MARKERS = ("o", "s", "^", "D", "v")

FLOW_LAW_CAPTION = (
    "Strain rate against peak stress, both on logarithmic axes, one point for each test. Lines are "
    "the posterior median of the flow law at the grain size and mean temperature of each group of "
    f"tests (temperatures with no gap wider than {GROUP_TEMPERATURES:g} K), bands hold 90 % of its "
    "draws: they show how well the law is known, not how far single tests scatter about it, which "
    "is the scatter in the table. The slope is the stress exponent n, the distance between groups "
    "of different grain size the grain size exponent p."
)


def flow_law(fit: PeakStressFit) -> Figure:
    """Draw points, and the flow law with its 90 % band, by grain size and temperature."""
    data = fit.data
    rates = all_draws(fit.posterior["predictions"].to_dataset()["strain_rate"])
    with style():
        figure = Figure(figsize=(6.4, 4.8), layout="constrained")
        axes = figure.subplots()
        for k, group in enumerate(groups(data)):
            colour = GROUP_COLOURS[k % len(GROUP_COLOURS)]
            draw_band(
                axes,
                group.stress * STRESS_FACTOR,
                rates[:, k],
                colour,
                f"{number(round(group.grain_size * LENGTH_FACTOR, 3))} {LENGTH_UNIT}, "
                f"{group.temperature:.1f} K: flow law, 90 %",
            )
            spread = data.relative_stress_uncertainty[group.points]
            stress = data.stress[group.points] * STRESS_FACTOR
            axes.errorbar(
                stress,
                data.strain_rate[group.points],
                xerr=stress * spread if np.any(spread > 0) else None,
                linestyle="none",
                marker=GROUP_MARKERS[k % len(GROUP_MARKERS)],
                markersize=5,
                markeredgecolor="white",
                markeredgewidth=0.6,
                color=colour,
                label=f"tests ({group.points.size})",
            )
        axes.set_xscale("log")
        axes.set_yscale("log")
        low, high = axes.get_xlim()
        axes.set_xticks([tick for tick in _ROUND_STRESSES if low <= tick <= high])
        axes.xaxis.set_major_formatter(FuncFormatter(_plain))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel(f"peak stress ({STRESS_UNIT})")
        axes.set_ylabel("strain rate (1/s)")
        axes.set_title(
            f"{data.id}: {data.material}, {data.n_points} tests, {data.provenance.kind} data",
            loc="left",
        )
        axes.legend(loc="upper left")
    return figure


_ROUND_STRESSES = tuple(m * 10.0**e for e in range(-3, 5) for m in (1, 2, 3, 5, 7))
"""Ticks (MPa) that a decade of stresses or less can be read off at."""


def _plain(value: float, _: int) -> str:
    """Label a tick without an exponent; not a lambda, which could not travel between processes."""
    return number(value)
