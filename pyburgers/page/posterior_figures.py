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

from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError, nearest
from pyburgers.common.units import number
from pyburgers.drawing.page_parts import PageFigure, recipe
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
from pyburgers.kinds.kind import FittedTest
from pyburgers.model.display import axis_label, shown_quantity, unit_text
from pyburgers.model.parameters import Parameter
from pyburgers.model.prior_families import Prior
from pyburgers.page.decades import Panels, PriorOfLogarithm, ShownDraws, panels_of, shown_draws
from pyburgers.page.trade_offs import paired, pairs
from pyburgers.posterior.labelled_draws import convergence_table

CHAIN_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY_BLUE, VERMILION)
CHAIN_DASHES = ("-", "-.", ":")

PANEL_TITLE_WIDTH = 30
"""Characters of a title that fit above one panel of a grid."""

DENSITY_POINTS, PRIOR_POINTS = 128, 100
"""Positions at which the densities of posterior and prior are drawn."""

STUCK_BANDWIDTH = 0.02
"""Kernel, in standard deviations of all draws, that shows a chain that did not move as a spike."""

NARROW = 0.12
"""Share of the prior's range below which a posterior gets limits of its own."""


def narrowed(fit: FittedTest, shown: Panels | None = None) -> str:
    """Say which quantity is narrowest beside its prior, and which is widest."""
    names = [name for name in fit.priors.free if name in (shown or panels_of(fit)).names]
    if not names:
        return ""
    share = {name: shown_draws(fit, name).width_beside_prior for name in names}
    least, most = min(share, key=share.__getitem__), max(share, key=share.__getitem__)
    return (
        f"{shown_quantity(least).label} is narrowest beside its prior ({share[least]:.0%} of its "
        f"standard deviation), {shown_quantity(most).label} widest ({share[most]:.0%})."
    )


def agreement(fit: FittedTest, shown: Panels | None = None) -> str:
    """Say how far chains agree."""
    if fit.posterior["posterior"].sizes["chain"] == 1:
        return "one chain, with none to compare it with."
    rhat = convergence_table(fit.posterior)["rhat"].fillna(np.inf)
    if shown is not None:
        rhat = rhat[list(shown.names)]
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
def prior_posterior(fit: FittedTest, shown: Panels | None = None) -> Figure:
    """Draw prior and posterior densities, chain by chain, a panel for each sampled quantity."""
    shown = shown or panels_of(fit)
    with style():
        figure, panels = _panel_grid(len(shown.names))
        for axes, name in zip(panels, shown.names, strict=True):
            _draw_densities(axes, shown_draws(fit, name))
        handles: list[Patch | Line2D] = [Patch(color=GREY, label="prior"), *_chain_handles(fit)]
        if fit.experiment.true_parameters:
            handles.append(Line2D([], [], color=BLACK, linestyle="--", label="true value"))
        _legend_above(figure, handles, shown.title, panels)
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
def rank(fit: FittedTest, shown: Panels | None = None) -> Figure:
    """Draw rank histograms of every sampled quantity, chain by chain (Vehtari et al. 2021)."""
    shown = shown or panels_of(fit)
    draws = fit.posterior["posterior"]
    n_chains, n_draws = draws.sizes["chain"], draws.sizes["draw"]
    edges = np.linspace(0.0, 1.0, min(20, max(4, n_draws // 25)) + 1)
    total = n_chains * n_draws
    in_bin = round(total / (edges.size - 1))
    expected = stats.hypergeom(total, in_bin, n_draws)
    with style():
        figure, panels = _panel_grid(len(shown.names), height=1.75)
        for axes, name in zip(panels, shown.names, strict=True):
            one = shown_draws(fit, name)
            quantity, values = one.quantity, one.draws.to_numpy()
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
        _legend_above(figure, [band, *_chain_handles(fit)], shown.title, panels)
    return figure


def _panel_grid(count: int, height: float = 2.35) -> tuple[Figure, list[Axes]]:
    """Figure with `count` panels, at most four in a row."""
    columns = min(4, count)
    rows = -(-count // columns)
    size = (2.6 * columns + 0.4, height * rows + 1.0)
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.add_gridspec(rows, columns)
    return figure, [figure.add_subplot(grid[divmod(k, columns)]) for k in range(count)]


def _legend_above(
    figure: Figure, handles: Sequence[Patch | Line2D], title: str, panels: Sequence[Axes]
) -> None:
    """Put title and legend above a panel grid, as wide as the grid allows."""
    columns = max(2, 2 * min(4, len(panels)) - 1)
    figure.legend(handles=list(handles), loc="outside upper center", ncols=columns, title=title)


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


def figures_for(fit: FittedTest, elsewhere: Sequence[str] = ()) -> tuple[PageFigure, ...]:
    """Return the figures of a fit, in their order on the page, but panels that are `elsewhere`."""
    first, *others = (one.of(fit) for one in view_of(fit.experiment).figures if one.suits(fit))
    found = posterior_figures(fit, panels_of(fit, elsewhere))
    return (first, *found[:1], *others, *found[1:])


def posterior_figures(fit: FittedTest, shown: Panels) -> tuple[PageFigure, ...]:
    """Return those of `POSTERIOR_FIGURES` that have something to show."""
    names, beside = paired(shown)
    has_pairs = len(names) > max(beside, 1)
    suiting = (one for one in POSTERIOR_FIGURES if has_pairs or one is not pairs)
    return tuple(one.of(fit, shown) for one in suiting) if shown.names else ()


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
