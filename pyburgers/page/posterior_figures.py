"""Figures of the posterior of any fit: what is drawn, and beside each how to read it."""

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from scipy import ndimage, stats

from pyburgers.common.draws import FloatArray, all_draws, evenly_spaced
from pyburgers.common.errors import InputError, nearest
from pyburgers.common.units import number
from pyburgers.drawing.page_parts import PageFigure, recipe
from pyburgers.drawing.panels import figure_of
from pyburgers.drawing.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    VERMILION,
    few_ticks,
    style,
)
from pyburgers.drawing.view import view_of
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.stan_data import REFERENCE_FLOW_RATE, REFERENCE_STRESS
from pyburgers.model.display import axis_label, shown_quantity, unit_text
from pyburgers.model.parameters import Parameter
from pyburgers.model.prior_families import Prior
from pyburgers.page.decades import PriorOfLogarithm, ShownDraws, shown_draws
from pyburgers.posterior.labelled_draws import convergence_table, free_parameters

CHAIN_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY_BLUE, VERMILION)
CHAIN_DASHES = ("-", "-.", ":")

TRUE_VALUE: dict[str, Any] = {
    "marker": "X",
    "markersize": 7,
    "color": BLACK,
    "markeredgecolor": "white",
    "markeredgewidth": 0.8,
}

PANEL_TITLE_WIDTH = 30
"""Characters of a title that fit above one panel of a grid."""

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

DENSITY_POINTS, PRIOR_POINTS = 128, 100
"""Positions at which the densities of posterior and prior are drawn."""

STUCK_BANDWIDTH = 0.02
"""Kernel, in standard deviations of all draws, that shows a chain that did not move as a spike."""

NARROW = 0.12
"""Share of the prior's range below which a posterior gets limits of its own."""


def narrowed(fit: FittedTest) -> str:
    """Say which quantity is narrowest beside its prior, and which is widest."""
    share = {name: shown_draws(fit, name).width_beside_prior for name in fit.priors.free}
    least, most = min(share, key=share.__getitem__), max(share, key=share.__getitem__)
    return (
        f"{shown_quantity(least).label} is narrowest beside its prior ({share[least]:.0%} of its "
        f"standard deviation), {shown_quantity(most).label} widest ({share[most]:.0%})."
    )


def strongest_trade_off(fit: FittedTest) -> str:
    """Name the two quantities that go together most closely."""
    draws = fit.posterior["posterior"].to_dataset()
    names = free_parameters(fit.posterior)
    ranks = np.array([stats.rankdata(all_draws(draws[name])) for name in names])
    divergent = int(fit.posterior["sample_stats"].to_dataset()["diverging"].sum())
    said = f"{divergent} divergent draws."
    if len(names) < 2:
        return said
    correlation = np.triu(np.corrcoef(ranks), 1)
    one, other = divmod(int(np.abs(correlation).argmax()), len(names))
    labels = " and ".join(shown_quantity(names[k]).label for k in (one, other))
    return f"{labels} go together most, rank correlation {correlation[one, other]:+.2f}; {said}"


def agreement(fit: FittedTest) -> str:
    """Say how far chains agree."""
    if fit.posterior["posterior"].sizes["chain"] == 1:
        return "one chain, with none to compare it with."
    rhat = convergence_table(fit.posterior)["rhat"].fillna(np.inf)
    return f"largest R-hat {rhat.max():.3f}, of {rhat.idxmax()}."


@recipe(
    "prior_posterior",
    "Prior and posterior",
    "Prior density (grey area) and the posterior density of every chain (coloured lines, which "
    "should lie on top of each other). The percentage is the posterior standard deviation as a "
    "share of the prior's: near 100 % the data say nothing; a small one may come from the prior "
    "of another quantity. A joint prior of the flow law is shown by its marginals: given the other "
    "parameters it can be wider, and the share above 100 %. Where the posterior is much "
    "narrower, a panel shows only the part around it and states the range of the prior. A "
    "reference stress or flow rate has no prior of its own: the others imply it. A "
    "quantity that spans decades is shown by its logarithm.",
    narrowed,
)
def prior_posterior(fit: FittedTest) -> Figure:
    """Draw prior and posterior densities, chain by chain, a panel for each sampled quantity."""
    names = free_parameters(fit.posterior)
    with style():
        figure, panels = _panel_grid(len(names))
        for axes, name in zip(panels, names, strict=True):
            _draw_densities(axes, shown_draws(fit, name))
        handles: list[Patch | Line2D] = [Patch(color=GREY, label="prior"), *_chain_handles(fit)]
        if fit.experiment.true_parameters:
            handles.append(Line2D([], [], color=BLACK, linestyle="--", label="true value"))
        _legend_above(figure, handles, fit.experiment, panels)
    return figure


def _draw_densities(axes: Axes, shown: ShownDraws) -> None:
    """Draw one panel of `prior_posterior`."""
    quantity, draws, prior, truth = shown.quantity, shown.draws, shown.prior, shown.truth
    factor = quantity.display_factor
    bounds = (-np.inf, np.inf) if prior is None else (prior.lower, prior.upper)
    least_bandwidth = STUCK_BANDWIDTH * float(draws.std())
    peaks = []
    for k, values in enumerate(draws.to_numpy()):
        x, height = density(values, *bounds, least_bandwidth=least_bandwidth)
        axes.plot(x * factor, height / factor, linewidth=1.1, **_chain_style(k))
        peaks.append(height.max() / factor)
    # A chain that hardly moved has a spike that would flatten everything else.
    top = min(max(peaks), 3.0 * sorted(peaks)[(len(peaks) - 1) // 2])
    if truth is not None:
        axes.axvline(truth * factor, color=BLACK, linestyle="--", linewidth=1.1)
    text = textwrap.fill(quantity.label, PANEL_TITLE_WIDTH)
    if prior is not None:
        law = prior.distribution()
        text += f"\nsd {100.0 * shown.width_beside_prior:.0f} % of the prior's"
        low, high, cut = _density_limits(draws, prior, truth)
        x = np.linspace(low, high, PRIOR_POINTS)
        # Points on either side of the bounds draw the vertical sides of a uniform prior.
        sides = np.nextafter(bounds, (-np.inf, np.inf))
        x = np.union1d(x, [end for end in (*bounds, *sides) if low <= end <= high])
        height = law.pdf(x) / factor
        top = max(top, height.max())
        axes.fill_between(x * factor, height, color=GREY, alpha=0.6, linewidth=0, zorder=0)
        axes.plot(x * factor, height, color="#777777", linewidth=0.8, zorder=1)
        axes.set_xlim(low * factor, high * factor)
        if cut:
            span = " to ".join(number(float(f"{end * factor:.3g}")) for end in _prior_range(prior))
            text += f"\nprior spans {span}"
    axes.set_title(text, loc="left", fontsize=9.5)
    axes.set_ylim(0.0, 1.06 * top)
    axes.set_xlabel(axis_label(quantity))
    axes.set_ylabel(_density_label(quantity))
    axes.xaxis.set_major_locator(few_ticks(4))
    axes.yaxis.set_major_locator(few_ticks(3))


def _density_label(quantity: Parameter) -> str:
    """Axis label of a density, whose unit is the inverse of the quantity's."""
    unit = unit_text(quantity)
    if quantity.display_unit in {"1", "fraction"}:
        return "density (–)"
    if "/" in unit:
        return f"density ({'/'.join(reversed(unit.split('/')))})"
    return f"density (1/({unit}))" if " " in unit else f"density (1/{unit})"


def _prior_range(prior: Prior | PriorOfLogarithm) -> tuple[float, float]:
    """Bounds of a uniform prior, or the central 98 % of another (SI)."""
    if prior.family == "uniform":
        return prior.lower, prior.upper
    low, high = prior.distribution().ppf([0.01, 0.99])
    near_zero = prior.lower == 0 and low < high - low
    return (0.0 if near_zero else float(low)), float(high)


def _density_limits(
    draws: xr.DataArray, prior: Prior | PriorOfLogarithm, truth: float | None
) -> tuple[float, float, bool]:
    """Limits of a panel (SI), and whether they cut the prior's range."""
    ends = _prior_range(prior)
    low, high = (float(end) for end in np.quantile(draws, [0.01, 0.99]))
    cut = high - low < NARROW * (ends[1] - ends[0])
    if cut:
        width = max(high - low, 1e-3 * abs(high))
        low, high = max(prior.lower, low - width), min(prior.upper, high + width)
    else:
        low, high = min(ends[0], low), max(ends[1], high)
    if truth is not None:
        low, high = min(low, truth), max(high, truth)
    margin = 0.03 * (high - low)
    return low - margin, high + margin, cut


def density(
    draws: FloatArray, lower: float, upper: float, *, least_bandwidth: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return positions and a kernel density, (DENSITY_POINTS,), that loses no mass at hard bounds.

    A fine histogram of the draws (n,) is smoothed with a Gaussian kernel of at least
    `least_bandwidth`, and reflected at the ends. ArviZ has none for draws that are all equal.
    """
    spreads = [float(np.std(draws)), float(stats.iqr(draws)) / 1.349]
    spread = min((s for s in spreads if s > 0), default=0.0)
    # Silverman's rule; the last floor is for draws that are all equal.
    bandwidth = max(
        0.9 * spread * draws.size**-0.2, least_bandwidth, 1e-5 * float(np.max(np.abs(draws)))
    )
    low = max(lower, float(draws.min()) - 4 * bandwidth)
    high = min(upper, float(draws.max()) + 4 * bandwidth)
    counts, edges = np.histogram(draws, bins=DENSITY_POINTS, range=(low, high), density=True)
    cell = edges[1] - edges[0]
    height: FloatArray = ndimage.gaussian_filter1d(counts, bandwidth / cell, mode="reflect")
    return 0.5 * (edges[:-1] + edges[1:]), height


@recipe(
    "rank",
    "Agreement of the chains",
    "All draws of a quantity are ranked together, then each chain's ranks are counted in equal "
    "bins. Chains that explore the same distribution have flat histograms, mostly inside the "
    "grey band (95 % of bins, were the draws independent). A slope or a step: a chain sits "
    "higher or lower than the others; a hump or a trough: it is narrower or wider. One chain "
    "alone is flat by construction.",
    agreement,
)
def rank(fit: FittedTest) -> Figure:
    """Draw rank histograms of every sampled quantity, chain by chain (Vehtari et al. 2021)."""
    names = free_parameters(fit.posterior)
    draws = fit.posterior["posterior"]
    n_chains, n_draws = draws.sizes["chain"], draws.sizes["draw"]
    edges = np.linspace(0.0, 1.0, min(20, max(4, n_draws // 25)) + 1)
    total = n_chains * n_draws
    in_bin = round(total / (edges.size - 1))
    expected = stats.hypergeom(total, in_bin, n_draws)
    with style():
        figure, panels = _panel_grid(len(names), height=1.75)
        for axes, name in zip(panels, names, strict=True):
            shown = shown_draws(fit, name)
            quantity, values = shown.quantity, shown.draws.to_numpy()
            ranks = (stats.rankdata(values).reshape(values.shape) - 0.5) / total
            axes.axhspan(
                expected.ppf(0.025), expected.ppf(0.975), color=GREY, alpha=0.5, linewidth=0
            )
            for k, chain_ranks in enumerate(ranks):
                counts, _ = np.histogram(chain_ranks, bins=edges)
                axes.stairs(counts, 100 * edges, baseline=None, linewidth=1.1, **_chain_style(k))
            label = textwrap.fill(quantity.label, PANEL_TITLE_WIDTH)
            gap = "\n" if quantity.symbol.startswith(r"\log") else " "
            axes.set_title(f"{label},{gap}${quantity.symbol}$", loc="left", fontsize=9.5)
            axes.set_ylim(bottom=0.0)
            axes.set_xlim(0.0, 100.0)
            axes.xaxis.set_major_locator(few_ticks(4))
            axes.yaxis.set_major_locator(few_ticks(4))
        figure.supxlabel("rank among the draws of all chains (%)", fontsize=10)
        figure.supylabel("draws in bin (count)", fontsize=10)
        band = Patch(color=GREY, alpha=0.5, label="expected of independent draws")
        _legend_above(figure, [band, *_chain_handles(fit)], fit.experiment, panels)
    return figure


@recipe(
    "pairs",
    "Trade-offs between quantities",
    "Joint posterior of pairs of quantities, at most 1000 draws. A round cloud: the data fix "
    "both independently; a narrow oblique or bent one: they fix a combination only. Divergent "
    "draws lie on top; where they gather, the posterior reaches further than the draws show.",
    strongest_trade_off,
)
def pairs(fit: FittedTest) -> Figure:
    """Draw scatter plots of the most telling quantities, divergent draws on top."""
    sampled = free_parameters(fit.posterior)
    telling = [name for name in PAIRED_QUANTITIES if name in sampled]
    names = telling if len(telling) > 1 else sampled
    shown = [shown_draws(fit, name) for name in names]
    factors = [one.quantity.display_factor for one in shown]
    values = np.stack([all_draws(one.draws) for one in shown], axis=1) * factors
    diverging = all_draws(fit.posterior["sample_stats"].to_dataset()["diverging"]).astype(bool)
    plain, divergent = (
        evenly_spaced(part, PAIRED_DRAWS) for part in (values[~diverging], values[diverging])
    )
    # NaN is not drawn.
    truths = [
        (np.nan if one.truth is None else one.truth) * factor
        for one, factor in zip(shown, factors, strict=True)
    ]
    size = len(names) - 1
    width = 2.0 + 0.95 * size
    with figure_of(max(width, 5.0), max(width, 4.0)) as figure:
        grid = figure.add_gridspec(size, size)
        panels = {}
        for row in range(size):
            for column in range(row + 1):
                axes = panels[row, column] = figure.add_subplot(grid[row, column])
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
                both = shown[column].quantity, shown[row + 1].quantity
                _label_pair(axes, *both, row == size - 1, column == 0)
        # Only these have labels, and each aligned axis costs a look at all of its group.
        figure.align_xlabels([panels[size - 1, column] for column in range(size)])
        figure.align_ylabels([panels[row, 0] for row in range(size)])
        handles = [
            _dot(BLUE, f"draw ({len(plain)} of {len(values)} shown)"),
            _dot(VERMILION, f"divergent draw ({int(diverging.sum()) or 'none'})"),
        ]
        if not np.all(np.isnan(truths)):
            handles.append(Line2D([], [], linestyle="none", label="true value", **TRUE_VALUE))
        figure.legend(handles=handles, loc="outside upper right", title=fit.experiment.title)
    return figure


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


def _panel_grid(count: int, height: float = 2.35) -> tuple[Figure, list[Axes]]:
    """Figure with `count` panels, at most four in a row."""
    columns = min(4, count)
    rows = -(-count // columns)
    size = (2.6 * columns + 0.4, height * rows + 1.0)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.add_gridspec(rows, columns)
    return figure, [figure.add_subplot(grid[divmod(k, columns)]) for k in range(count)]


def _legend_above(
    figure: Figure,
    handles: Sequence[Patch | Line2D],
    experiment: Experiment,
    panels: Sequence[Axes],
) -> None:
    """Put title and legend above a panel grid, as wide as the grid allows."""
    columns = max(2, 2 * min(4, len(panels)) - 1)
    figure.legend(
        handles=list(handles), loc="outside upper center", ncols=columns, title=experiment.title
    )


def _chain_style(index: int) -> dict[str, Any]:
    """Colour of a chain, and dashes from the seventh on."""
    dashes, colour = divmod(index, len(CHAIN_COLOURS))
    return {"color": CHAIN_COLOURS[colour], "linestyle": CHAIN_DASHES[dashes % len(CHAIN_DASHES)]}


def _chain_handles(fit: FittedTest) -> list[Line2D]:
    """Legend entries of the chains."""
    return [
        Line2D([], [], label=f"chain {int(chain)}", **_chain_style(k))
        for k, chain in enumerate(fit.posterior["posterior"]["chain"])
    ]


def figures_for(fit: FittedTest) -> tuple[PageFigure, ...]:
    """Return the figures of a fit, in their order on the page."""
    first, *others = (one for one in view_of(fit.experiment).figures if one.suits(fit))
    return tuple(
        one.of(fit) for one in (first, *POSTERIOR_FIGURES[:1], *others, *POSTERIOR_FIGURES[1:])
    )


POSTERIOR_FIGURES = (prior_posterior, pairs, rank)
"""Figures that every fit has."""


def page_figure(fit: FittedTest, name: str) -> PageFigure:
    """Return a figure of a fit of one test, to be put into a part of a page.

    Parameters
    ----------
    fit : Fit
        The fit.
    name : str
        As in the names of the figure's files on the page of a fit, such as ``"stress_strain"``, or
        ``"preparation"`` of a forced oscillation test.

    Raises
    ------
    InputError
        If fits of such a test have no such figure.

    Examples
    --------
    >>> pyburgers.page_figure(fit, "stress_strain").title
    'Stress-strain curve'
    """
    recipes = {one.name: one for one in (*view_of(fit.experiment).figures, *POSTERIOR_FIGURES)}
    if name not in recipes:
        raise InputError(f"{fit.experiment.id}: has no figure {name!r}, {nearest(name, recipes)}")
    return recipes[name].of(fit)
