"""Figure of the trade-offs between quantities of a posterior."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy import stats

from pyburgers.common.draws import all_draws, evenly_spaced
from pyburgers.drawing.page_parts import recipe
from pyburgers.drawing.panels import figure_of
from pyburgers.drawing.style import BLACK, BLUE, VERMILION, few_ticks
from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.stan_data import REFERENCE_FLOW_RATE, REFERENCE_STRESS
from pyburgers.model.display import shown_quantity, unit_text
from pyburgers.model.parameters import Parameter
from pyburgers.page.decades import Panels, panels_of, shown_draws

TRUE_VALUE: dict[str, Any] = {
    "marker": "X",
    "markersize": 7,
    "color": BLACK,
    "markeredgecolor": "white",
    "markeredgewidth": 0.8,
}

PAIRED_DRAWS = 1000
PAIRED_QUANTITIES = (
    "stress_exponent",
    "grain_size_exponent",
    REFERENCE_STRESS,
    REFERENCE_FLOW_RATE,
    "activation_enthalpy",
    "maxwell_modulus",
    "kelvin_modulus",
    "kelvin_viscosity",
    "steady_state_grain_size",
    "steady_state_fabric_factor",
    "critical_strain_grain_size",
    "critical_strain_fabric",
)
"""Quantities whose trade-offs are worth a panel."""


def strongest_trade_off(fit: FittedTest, shown: Panels | None = None) -> str:
    """Name the two quantities that go together most closely."""
    draws, shown = fit.posterior["posterior"].to_dataset(), shown or panels_of(fit)
    names = [*shown.beside, *shown.names]
    ranks = np.array([stats.rankdata(all_draws(draws[name])) for name in names])
    divergent = int(fit.posterior["sample_stats"].to_dataset()["diverging"].sum())
    said = f"{divergent} divergent draws."
    if len(names) < 2:
        return said
    correlation = np.triu(np.corrcoef(ranks), 1)
    correlation[:, : len(shown.beside)] = 0.0
    one, other = divmod(int(np.abs(correlation).argmax()), len(names))
    labels = " and ".join(shown_quantity(names[k]).label for k in (one, other))
    return f"{labels} go together most, rank correlation {correlation[one, other]:+.2f}; {said}"


@recipe(
    "pairs",
    "Trade-offs between quantities",
    "Joint posterior of pairs of quantities, at most 1000 draws. A round cloud: no trade-off "
    "between the two, whoever decides them; a narrow oblique or bent one: a combination of them is "
    "known better than each. Divergent draws lie on top; where they gather, the posterior reaches "
    "further than the draws show.",
    strongest_trade_off,
)
def pairs(fit: FittedTest, shown: Panels | None = None) -> Figure:
    """Draw scatter plots of the most telling quantities, divergent draws on top."""
    shown = shown or panels_of(fit)
    names, beside = paired(shown)
    quantities = [shown_draws(fit, name) for name in names]
    factors = [one.quantity.display_factor for one in quantities]
    values = np.stack([all_draws(one.draws) for one in quantities], axis=1) * factors
    diverging = all_draws(fit.posterior["sample_stats"].to_dataset()["diverging"]).astype(bool)
    plain, divergent = (
        evenly_spaced(part, PAIRED_DRAWS) for part in (values[~diverging], values[diverging])
    )
    # NaN is not drawn.
    truths = [
        (np.nan if one.truth is None else one.truth) * factor
        for one, factor in zip(quantities, factors, strict=True)
    ]
    size, first = len(names) - 1, max(beside - 1, 0)
    width, height = (2.0 + 0.95 * count for count in (size, size - first))
    with figure_of(max(width, 5.0), max(height, 4.0)) as figure:
        grid = figure.add_gridspec(size - first, size)
        panels = {}
        for row in range(first, size):
            for column in range(row + 1):
                axes = panels[row, column] = figure.add_subplot(grid[row - first, column])
                for part, colour, area in ((plain, BLUE, 2.0), (divergent, VERMILION, 9.0)):
                    axes.scatter(
                        part[:, column],
                        part[:, row + 1],
                        s=area,
                        color=colour,
                        alpha=0.35 if part is plain else 0.9,
                        linewidths=0,
                        rasterized=True,
                    )
                axes.plot(truths[column], truths[row + 1], linestyle="none", **TRUE_VALUE)
                both = quantities[column].quantity, quantities[row + 1].quantity
                _label_pair(axes, *both, row == size - 1, column == 0)
        # Only these have labels, and each aligned axis costs a look at all of its group.
        figure.align_xlabels([panels[size - 1, column] for column in range(size)])
        figure.align_ylabels([panels[row, 0] for row in range(first, size)])
        handles = [
            _dot(BLUE, f"draw ({len(plain)} of {len(values)} shown)"),
            _dot(VERMILION, f"divergent draw ({int(diverging.sum()) or 'none'})"),
        ]
        if not np.all(np.isnan(truths)):
            handles.append(Line2D([], [], linestyle="none", label="true value", **TRUE_VALUE))
        figure.legend(handles=handles, loc="outside upper right", title=shown.title)
    return figure


def paired(shown: Panels) -> tuple[list[str], int]:
    """Return the quantities that are paired, and how many of them come first for others alone."""
    sampled = [*shown.beside, *shown.names]
    telling = [name for name in PAIRED_QUANTITIES if name in sampled]
    names = telling if len(telling) > 1 else sampled
    beside = [name for name in names if name in shown.beside]
    return [*beside, *(name for name in names if name not in beside)], len(beside)


def _label_pair(axes: Axes, x: Parameter, y: Parameter, at_bottom: bool, at_left: bool) -> None:
    """Label the outer panels and keep the ticks of all of them few."""
    for axis, quantity, outer in ((axes.xaxis, x, at_bottom), (axes.yaxis, y, at_left)):
        axis.set_major_locator(few_ticks(2))
        if outer:
            axis.set_label_text(f"${quantity.symbol}$\n({unit_text(quantity)})")
        else:
            axis.set_tick_params(labelbottom=False, labelleft=False)
    axes.tick_params(axis="x", labelrotation=90)


def _dot(colour: str, label: str) -> Line2D:
    return Line2D([], [], linestyle="none", marker="o", markersize=5, color=colour, label=label)
