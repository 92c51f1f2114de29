"""Figures of a fit: what is drawn, and beside each how to read it.

Every function takes a fit and returns a figure of its own; no state of matplotlib is changed.
Values are converted to display units here and nowhere earlier.
"""

import io
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from scipy import ndimage, stats

from pyburgers.constant_rate import ConstantRateExperiment
from pyburgers.diagnostics import BAND
from pyburgers.display import (
    LENGTH_FACTOR,
    LENGTH_UNIT,
    STRAIN_FACTOR,
    STRAIN_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
    axis_label,
    number,
    shown_quantity,
    unit_text,
)
from pyburgers.fitting import Fit
from pyburgers.parameters import Parameter
from pyburgers.posterior import free_parameters
from pyburgers.priors import Prior
from pyburgers.stan_data import REFERENCE_STRESS

FloatArray = npt.NDArray[np.float64]

# The palette of Okabe and Ito (2008), which readers with any colour vision can tell apart.
BLACK, GREY = "#000000", "#b8b8b8"
ORANGE, SKY_BLUE, GREEN = "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"
CHAIN_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY_BLUE, VERMILION)
CHAIN_DASHES = ("-", "-.", ":")

PNG_DOTS_PER_INCH = 150
TRUE_VALUE: dict[str, Any] = {
    "marker": "X",
    "markersize": 7,
    "color": BLACK,
    "markeredgecolor": "white",
    "markeredgewidth": 0.8,
}

RETRODICTIONS = 1000
PAIRED_DRAWS = 1000
TAIL = 0.5 * (1.0 - BAND)
QUANTILES = (TAIL, 0.5, 1.0 - TAIL)

PAIRED_QUANTITIES = (
    "stress_exponent",
    "grain_size_exponent",
    REFERENCE_STRESS,
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

STUCK_BANDWIDTH = 0.02
"""Kernel, in standard deviations of all draws, that shows a chain that did not move as a spike."""

NARROW = 0.12
"""Share of the prior's range below which a posterior gets limits of its own."""


@dataclass(frozen=True)
class FigureRecipe:
    """A figure that every report holds.

    Attributes
    ----------
    name : str
        Part of file names.
    title : str
        Heading.
    caption : str
        What is shown and how to read it, one paragraph.
    draw : callable
        Draws it for a fit.
    """

    name: str
    title: str
    caption: str
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
        }
    )


def image(figure: Figure, kind: Literal["png", "svg"]) -> bytes:
    """Render a figure; the same figure gives the same bytes.

    The first rendering settles where panels lie: the layout engine moves them a little each time.
    """
    buffer = io.BytesIO()
    metadata: dict[str, Any] = {"Software": None} if kind == "png" else {"Date": None}
    # Tick labels are made when a figure is drawn, so the style has to hold here as well.
    with style():
        if isinstance(figure.get_layout_engine(), ConstrainedLayoutEngine):
            figure.draw_without_rendering()
            figure.set_layout_engine("none")
        figure.savefig(buffer, format=kind, dpi=PNG_DOTS_PER_INCH, metadata=metadata)
    return buffer.getvalue()


STRESS_STRAIN_CAPTION = (
    "Top: the stress-strain curve (circles) with the solution at the posterior mean of the "
    "parameters (solid line), up to 1000 retrodictions, that is solutions for single draws from "
    "the posterior (thin lines), and the band that should hold 90 % of new measurements, noise "
    "included. The means of all parameters need not be a good combination: where parameters trade "
    "off along a bent ridge, the solid line leaves the band although the fit is good, so judge the "
    "fit by the band and the residuals. Dotted vertical lines mark where the imposed strain rate "
    "changes. Bottom: data minus the mean prediction, with the band that should hold 90 % of "
    "residuals if they were noise alone; a run of points on one side of zero means that the model "
    "misses something there."
)


def stress_strain(fit: Fit) -> Figure:
    """Draw data, retrodictions, predictive band and residuals along strain."""
    with style():
        figure = Figure(figsize=(8.0, 6.4), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
        _draw_curve(upper, fit)
        _draw_residuals(lower, fit)
        _mark_rate_steps((upper, lower), fit.experiment)
        upper.set_xlim(0.0, 1.02 * fit.experiment.final_strain * STRAIN_FACTOR)
        upper.set_title(_title(fit.experiment), loc="left")
        upper.set_ylabel(f"differential stress ({STRESS_UNIT})")
        lower.set_ylabel(f"residual ({STRESS_UNIT})")
        lower.set_xlabel(f"axial strain ({STRAIN_UNIT})")
        handles, labels = upper.get_legend_handles_labels()
        more, more_labels = lower.get_legend_handles_labels()
        figure.legend(
            [*handles, *more], [*labels, *more_labels], loc="outside upper center", ncols=3
        )
    return figure


def _draw_curve(axes: Axes, fit: Fit) -> None:
    """Draw data, mean solution, retrodictions and predictive band."""
    predictions = fit.posterior["predictions"].to_dataset()
    strain = predictions["strain"].to_numpy() * STRAIN_FACTOR
    low, _, high = _quantiles(predictions["stress_replicated"]) * STRESS_FACTOR
    axes.fill_between(
        strain, low, high, color=ORANGE, alpha=0.35, linewidth=0, label="90 % predictive band"
    )
    curves = evenly_spaced(_flat(predictions["stress"]), RETRODICTIONS) * STRESS_FACTOR
    points = np.stack([np.broadcast_to(strain, curves.shape), curves], axis=-1)
    # One picture instead of a thousand paths keeps vector files small.
    axes.add_collection(
        LineCollection(list(points), colors=BLUE, linewidths=0.5, alpha=0.04, rasterized=True)
    )
    axes.plot([], [], color=BLUE, linewidth=0.8, alpha=0.6, label=f"{len(curves)} retrodictions")
    mean = fit.posterior["posterior_mean_solution"].to_dataset()
    axes.plot(
        mean["strain"].to_numpy() * STRAIN_FACTOR,
        mean["stress"].to_numpy() * STRESS_FACTOR,
        color=VERMILION,
        linewidth=1.6,
        label="solution at the posterior mean",
    )
    axes.plot(
        fit.experiment.strain * STRAIN_FACTOR,
        fit.experiment.stress * STRESS_FACTOR,
        linestyle="none",
        marker="o",
        markersize=4,
        markerfacecolor="white",
        markeredgecolor=BLACK,
        markeredgewidth=0.8,
        label=f"{fit.experiment.provenance.kind} data",
    )


def _draw_residuals(axes: Axes, fit: Fit) -> None:
    """Draw data minus mean prediction, and the band of the noise."""
    predicted = fit.posterior["posterior_predictive"]["stress"].mean(("chain", "draw")).to_numpy()
    noise = float(fit.posterior["posterior"]["stress_noise"].mean()) * STRESS_FACTOR
    half_width = float(stats.norm.ppf(1.0 - TAIL)) * noise
    axes.axhspan(
        -half_width, half_width, color=GREY, alpha=0.5, linewidth=0, label="90 % band of the noise"
    )
    axes.axhline(0.0, color=BLUE, linewidth=1.0)
    axes.plot(
        fit.experiment.strain * STRAIN_FACTOR,
        (fit.experiment.stress - predicted) * STRESS_FACTOR,
        linestyle="none",
        marker="o",
        markersize=3.5,
        color=BLACK,
        label="data minus mean prediction",
    )
    axes.yaxis.set_major_locator(_few_ticks(5))


def _mark_rate_steps(panels: Sequence[Axes], experiment: ConstantRateExperiment) -> None:
    """Mark where the imposed rate changes, and to what; the first rate is in the title."""
    for segment in experiment.segments[1:]:
        position = segment.start_strain * STRAIN_FACTOR
        for axes in panels:
            axes.axvline(position, color=BLACK, linestyle=":", linewidth=0.9)
        panels[0].annotate(
            _rate_text(segment.strain_rate),
            (position, 0.02),
            xycoords=("data", "axes fraction"),
            xytext=(3, 0),
            textcoords="offset points",
            rotation=90,
            va="bottom",
            fontsize=9,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.5},
        )


PRIOR_POSTERIOR_CAPTION = (
    "Each panel shows one quantity: its prior density (grey area) and the posterior density of "
    "every chain (coloured lines, which should lie on top of each other). The percentage gives the "
    "posterior standard deviation as a share of the prior's: near 100 % the data say nothing about "
    "the parameter, and its posterior is what the prior put in. Where the posterior is much "
    "narrower than the prior, the panel shows only the part around it and states the range of the "
    "prior (its bounds, or what holds 98 % of it). The reference stress has no prior of its own; "
    "it is the stress at which the undeformed material flows at the first imposed rate, which the "
    "other priors imply. Dashed vertical lines are the true values, where data are synthetic and "
    "they are known."
)


def prior_posterior(fit: Fit) -> Figure:
    """Draw prior and posterior densities, chain by chain, a panel for each sampled quantity."""
    names = free_parameters(fit.posterior)
    truths = fit.experiment.true_parameters or {}
    with style():
        figure, panels = _panel_grid(len(names))
        for axes, name in zip(panels, names, strict=True):
            prior = fit.priors.priors.get(name)
            _draw_densities(axes, shown_quantity(name), _draws(fit, name), prior, truths.get(name))
        handles: list[Patch | Line2D] = [Patch(color=GREY, label="prior"), *_chain_handles(fit)]
        if truths:
            handles.append(Line2D([], [], color=BLACK, linestyle="--", label="true value"))
        _legend_above(figure, handles, fit.experiment, panels)
    return figure


def _draw_densities(
    axes: Axes,
    quantity: Parameter,
    draws: xr.DataArray,
    prior: Prior | None,
    truth: float | None,
) -> None:
    """Draw one panel of `prior_posterior`."""
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
    title = quantity.label
    if prior is not None:
        law = prior.distribution()
        title += f"\nsd {float(100.0 * draws.std(ddof=1) / law.std()):.0f} % of the prior's"
        low, high, cut = _density_limits(draws, prior, truth)
        x = np.linspace(low, high, 400)
        # Sampling the bounds themselves draws the vertical sides of a uniform prior.
        x = np.union1d(x, [end for end in bounds if low <= end <= high])
        height = law.pdf(x) / factor
        top = max(top, height.max())
        axes.fill_between(x * factor, height, color=GREY, alpha=0.6, linewidth=0, zorder=0)
        axes.plot(x * factor, height, color="#777777", linewidth=0.8, zorder=1)
        axes.set_xlim(low * factor, high * factor)
        if cut:
            span = " to ".join(number(float(f"{end * factor:.3g}")) for end in _prior_range(prior))
            title += f"\nprior spans {span}"
    axes.set_title(title, loc="left", fontsize=9.5)
    axes.set_ylim(0.0, 1.06 * top)
    axes.set_xlabel(axis_label(quantity))
    axes.set_ylabel(_density_label(quantity))
    axes.xaxis.set_major_locator(_few_ticks(4))
    axes.yaxis.set_major_locator(_few_ticks(3))


def _density_label(quantity: Parameter) -> str:
    """Axis label of a density, whose unit is the inverse of the quantity's."""
    unit = unit_text(quantity)
    if quantity.display_unit in {"1", "fraction"}:
        return "density (–)"
    if "/" in unit:
        return f"density ({'/'.join(reversed(unit.split('/')))})"
    return f"density (1/({unit}))" if " " in unit else f"density (1/{unit})"


def _prior_range(prior: Prior) -> tuple[float, float]:
    """Bounds of a uniform prior, or the central 98 % of another (SI)."""
    if prior.family == "uniform":
        return prior.lower, prior.upper
    low, high = prior.distribution().ppf([0.01, 0.99])
    return (prior.lower if prior.lower == 0 else float(low)), float(high)


def _density_limits(
    draws: xr.DataArray, prior: Prior, truth: float | None
) -> tuple[float, float, bool]:
    """Limits of a panel (SI), and whether they cut the prior's range."""
    ends = _prior_range(prior)
    low, high = (float(end) for end in np.quantile(draws, [0.005, 0.995]))
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
    """Kernel density estimate that loses no mass at hard bounds.

    A fine histogram is smoothed with a Gaussian kernel and reflected at the ends, which are the
    bounds where draws come near them. Draws that are all equal give a narrow spike.

    Parameters
    ----------
    draws : array, shape (n,)
        Values within the bounds.
    lower, upper : float
        Support; may be infinite.
    least_bandwidth : float
        Floor under the kernel's standard deviation.

    Returns
    -------
    x, height : array, shape (512,)
        Positions, and density in the inverse of their unit.
    """
    spreads = [float(np.std(draws)), float(stats.iqr(draws)) / 1.349]
    spread = min((s for s in spreads if s > 0), default=0.0)
    # Silverman's rule; the last floor is for draws that are all equal.
    bandwidth = max(
        0.9 * spread * draws.size**-0.2, least_bandwidth, 1e-5 * float(np.max(np.abs(draws)))
    )
    low = max(lower, float(draws.min()) - 4 * bandwidth)
    high = min(upper, float(draws.max()) + 4 * bandwidth)
    counts, edges = np.histogram(draws, bins=512, range=(low, high), density=True)
    cell = edges[1] - edges[0]
    height: FloatArray = ndimage.gaussian_filter1d(counts, bandwidth / cell, mode="reflect")
    return 0.5 * (edges[:-1] + edges[1:]), height


RANK_CAPTION = (
    "All draws of a quantity are ranked together, then each chain's ranks are counted in equal "
    "bins. Chains that explore the same distribution have flat histograms that stay mostly inside "
    "the grey band (95 % of bins would, were the draws independent; autocorrelated draws wander "
    "somewhat further). A slope or a step means that a chain sits higher or lower than the others, "
    "a hump or a trough that it is narrower or wider. One chain alone has nothing to compare with "
    "and is flat by construction."
)


def rank(fit: Fit) -> Figure:
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
            values = _draws(fit, name).to_numpy()
            ranks = (stats.rankdata(values).reshape(values.shape) - 0.5) / total
            axes.axhspan(
                expected.ppf(0.025), expected.ppf(0.975), color=GREY, alpha=0.5, linewidth=0
            )
            for k, of_chain in enumerate(ranks):
                counts, _ = np.histogram(of_chain, bins=edges)
                axes.stairs(counts, 100 * edges, baseline=None, linewidth=1.1, **_chain_style(k))
            quantity = shown_quantity(name)
            axes.set_title(f"{quantity.label}, ${quantity.symbol}$", loc="left", fontsize=9.5)
            axes.set_ylim(bottom=0.0)
            axes.set_xlim(0.0, 100.0)
            axes.xaxis.set_major_locator(_few_ticks(4))
            axes.yaxis.set_major_locator(_few_ticks(4))
        figure.supxlabel("rank among the draws of all chains (%)", fontsize=10)
        figure.supylabel("draws in bin (count)", fontsize=10)
        band = Patch(color=GREY, alpha=0.5, label="expected of independent draws")
        _legend_above(figure, [band, *_chain_handles(fit)], fit.experiment, panels)
    return figure


PAIRS_CAPTION = (
    "Joint posterior of pairs of quantities, at most 1000 draws. A round cloud means that the data "
    "fix two quantities independently, a narrow oblique or bent one that they fix a combination "
    "only: moving one can be made up for by the other. Divergent draws, where the sampler lost its "
    "way in a strongly curved region, lie on top; if they gather in one place, the posterior "
    "reaches further there than the draws show. Crosses are the true values, where data are "
    "synthetic and they are known."
)


def pairs(fit: Fit) -> Figure:
    """Draw scatter plots of the most telling quantities, divergent draws on top."""
    sampled = free_parameters(fit.posterior)
    telling = [name for name in PAIRED_QUANTITIES if name in sampled]
    names = telling if len(telling) > 1 else sampled
    values = np.stack([_flat(_draws(fit, name)) for name in names], axis=1)
    values *= [shown_quantity(name).display_factor for name in names]
    diverging = _flat(fit.posterior["sample_stats"].to_dataset()["diverging"]).astype(bool)
    shown, divergent = (
        evenly_spaced(part, PAIRED_DRAWS) for part in (values[~diverging], values[diverging])
    )
    truths = {
        name: value * shown_quantity(name).display_factor
        for name, value in (fit.experiment.true_parameters or {}).items()
    }
    size = len(names) - 1
    width = 2.0 + 0.95 * size
    with style():
        figure = Figure(figsize=(max(width, 5.0), max(width, 4.0)), layout="constrained")
        grid = figure.add_gridspec(size, size)
        for row in range(size):
            for column in range(row + 1):
                axes = figure.add_subplot(grid[row, column])
                for part, colour, area in ((shown, BLUE, 2.0), (divergent, VERMILION, 9.0)):
                    axes.scatter(
                        part[:, column],
                        part[:, row + 1],
                        s=area,
                        color=colour,
                        alpha=0.35 if part is shown else 0.9,
                        linewidths=0,
                        rasterized=True,
                    )
                if names[column] in truths and names[row + 1] in truths:
                    position = (truths[names[column]], truths[names[row + 1]])
                    axes.plot(*position, linestyle="none", **TRUE_VALUE)
                _label_pair(axes, names[column], names[row + 1], row == size - 1, column == 0)
        figure.align_labels()
        handles = [
            _dot(BLUE, f"draw ({len(shown)} of {len(values)} shown)"),
            _dot(VERMILION, f"divergent draw ({int(diverging.sum()) or 'none'})"),
        ]
        if truths:
            handles.append(Line2D([], [], linestyle="none", label="true value", **TRUE_VALUE))
        figure.legend(handles=handles, loc="outside upper right", title=_title(fit.experiment))
    return figure


def _label_pair(axes: Axes, x_name: str, y_name: str, at_bottom: bool, at_left: bool) -> None:
    """Label the outer panels and keep the ticks of all of them few."""
    for axis, name, outer in (
        (axes.xaxis, x_name, at_bottom),
        (axes.yaxis, y_name, at_left),
    ):
        axis.set_major_locator(_few_ticks(2))
        if outer:
            quantity = shown_quantity(name)
            axis.set_label_text(f"${quantity.symbol}$\n({unit_text(quantity)})")
        else:
            axis.set_tick_params(labelbottom=False, labelleft=False)
    axes.tick_params(axis="x", labelrotation=90)


def _dot(colour: str, label: str) -> Line2D:
    return Line2D([], [], linestyle="none", marker="o", markersize=5, color=colour, label=label)


SOFTENING_CAPTION = (
    "Why the material weakens, as far as the curve can tell: (a) mean grain size, (b) fabric "
    "factor (1 = isotropic), (c) the factors by which smaller grains and stronger fabric lower the "
    "flow stress, and their product; lines are posterior medians, areas hold 90 % of draws. (d) "
    "Share of the total softening, on a logarithmic scale, that grain size accounts for at the "
    "final strain; below 0 or above 1 one of the two hardens, and the outermost 1 % of draws may "
    "be cut off. The data fix the product well; where the histogram is broad, they do not tell "
    "which of the two mechanisms did it."
)


def softening(fit: Fit) -> Figure:
    """Draw how grain size and fabric soften the material along strain."""
    predictions = fit.posterior["predictions"].to_dataset()
    by_grains, by_fabric = predictions["grain_size_softening"], predictions["fabric_softening"]
    with style():
        figure = Figure(figsize=(8.6, 6.8), layout="constrained")
        panels = figure.subplots(2, 2)
        of_grains, of_fabric, of_strength, of_share = panels.flat
        _draw_band(of_grains, predictions["grain_size"] * LENGTH_FACTOR, BLUE, "mean grain size")
        of_grains.axhline(
            fit.experiment.initial_grain_size * LENGTH_FACTOR,
            color=BLACK,
            linestyle=":",
            linewidth=1.0,
            label="initial grain size",
        )
        of_grains.set_title("(a) grain size", loc="left")
        of_grains.set_ylabel(f"grain size ({LENGTH_UNIT})")
        of_grains.set_ylim(bottom=0.0)
        _draw_band(of_fabric, predictions["fabric_factor"], GREEN, "fabric factor")
        of_fabric.set_title("(b) fabric", loc="left")
        of_fabric.set_ylabel("fabric factor $F$ (–)")
        of_fabric.set_ylim(0.0, 1.05)
        _draw_band(of_strength, by_grains, BLUE, "grain size alone")
        _draw_band(of_strength, by_fabric, GREEN, "fabric alone")
        _draw_band(of_strength, by_grains * by_fabric, VERMILION, "both together")
        of_strength.set_title("(c) strength factors", loc="left")
        of_strength.set_ylabel("flow stress / undeformed (–)")
        of_strength.set_ylim(bottom=0.0)
        for axes in (of_grains, of_fabric, of_strength):
            axes.set_xlabel(f"axial strain ({STRAIN_UNIT})")
            axes.set_xlim(0.0, fit.experiment.final_strain * STRAIN_FACTOR)
            axes.legend(loc="best")
        _draw_share(of_share, by_grains, by_fabric)
        lines_and_areas = "lines: posterior median, areas: 90 % of draws"
        figure.suptitle(f"{_title(fit.experiment)}\n{lines_and_areas}", fontsize=10)
    return figure


def _draw_band(axes: Axes, values: xr.DataArray, colour: str, label: str) -> None:
    """Draw the median and the 90 % band along strain."""
    strain = values["strain"].to_numpy() * STRAIN_FACTOR
    low, median, high = _quantiles(values)
    axes.fill_between(strain, low, high, color=colour, alpha=0.22, linewidth=0)
    axes.plot(strain, median, color=colour, linewidth=1.6, label=label)


def _draw_share(axes: Axes, by_grains: xr.DataArray, by_fabric: xr.DataArray) -> None:
    """Draw the share of the logarithmic softening at the final strain that grain size has."""
    of_grains, of_fabric = (
        np.log(_flat(factor.isel(strain=-1)).astype(np.float64))
        for factor in (by_grains, by_fabric)
    )
    total = of_grains + of_fabric
    share = of_grains[total != 0] / total[total != 0]
    low, high = np.quantile(share, [0.005, 0.995]) if share.size else (0.0, 1.0)
    ends = (min(0.0, float(low)), max(1.0, float(high)))
    weights = np.full(share.size, 100.0 / max(share.size, 1))
    axes.hist(share, bins=30, range=ends, weights=weights, color=SKY_BLUE, label="posterior draws")
    if share.size:
        axes.axvline(
            float(np.median(share)),
            color=BLACK,
            linewidth=1.4,
            label=f"median {np.median(share):.2f}",
        )
    axes.set_title("(d) share of grain size", loc="left")
    axes.set_xlabel("share of ln-softening due to grain size (–)")
    axes.set_ylabel("share of draws (%)")
    axes.set_xlim(*ends)
    axes.legend(loc="best")


FIGURES: tuple[FigureRecipe, ...] = (
    FigureRecipe("stress_strain", "Stress-strain curve", STRESS_STRAIN_CAPTION, stress_strain),
    FigureRecipe(
        "prior_posterior", "Prior and posterior", PRIOR_POSTERIOR_CAPTION, prior_posterior
    ),
    FigureRecipe("softening", "What softens the material", SOFTENING_CAPTION, softening),
    FigureRecipe("pairs", "Trade-offs between quantities", PAIRS_CAPTION, pairs),
    FigureRecipe("rank", "Agreement of the chains", RANK_CAPTION, rank),
)
"""Figures of every report, in their order on the page."""


def _few_ticks(intervals: int) -> MaxNLocator:
    """Return ticks at round numbers, few enough for small panels."""
    return MaxNLocator(intervals, steps=[1, 2, 5, 10])


def _title(experiment: ConstantRateExperiment) -> str:
    """Sample, material, conditions and kind of data."""
    rate = _rate_text(experiment.segments[0].strain_rate)
    if len(experiment.segments) > 1:
        rate = f"first {rate}"
    conditions = f"{experiment.material}, {experiment.temperature:g} K, {rate}"
    return f"{experiment.id}: {conditions}, {experiment.provenance.kind} data"


def _rate_text(rate: float) -> str:
    """Strain rate as matplotlib text."""
    mantissa, exponent = f"{rate:.2e}".split("e")
    return rf"${mantissa}\times10^{{{int(exponent)}}}$ s$^{{-1}}$"


def _draws(fit: Fit, name: str) -> xr.DataArray:
    """Draws of a quantity (SI), dimensions chain, draw."""
    draws: xr.DataArray = fit.posterior["posterior"].to_dataset()[name].transpose("chain", "draw")
    return draws


def _flat(values: xr.DataArray) -> FloatArray:
    """All draws of all chains along the first axis."""
    ordered = values.transpose("chain", "draw", ...).to_numpy()
    flat: FloatArray = ordered.reshape(-1, *ordered.shape[2:])
    return flat


def evenly_spaced(rows: FloatArray, at_most: int) -> FloatArray:
    """Thin rows at a fixed stride to a number that can be drawn.

    Parameters
    ----------
    rows : array, shape (n, ...)
        What is thinned along its first axis.
    at_most : int
        Rows to keep, at most.
    """
    kept = min(len(rows), at_most)
    thinned: FloatArray = rows[np.arange(kept) * len(rows) // max(kept, 1)]
    return thinned


def _quantiles(values: xr.DataArray) -> FloatArray:
    """Lower end, median and upper end of the 90 % band, shape (3, n_strains)."""
    band: FloatArray = values.quantile(list(QUANTILES), ("chain", "draw")).to_numpy()
    return band


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
    experiment: ConstantRateExperiment,
    panels: Sequence[Axes],
) -> None:
    """Put title and legend above a panel grid, as wide as the grid allows."""
    columns = max(2, 2 * min(4, len(panels)) - 2)
    figure.legend(
        handles=list(handles), loc="outside upper center", ncols=columns, title=_title(experiment)
    )


def _chain_style(index: int) -> dict[str, Any]:
    """Colour of a chain, and dashes from the seventh on."""
    dashes, colour = divmod(index, len(CHAIN_COLOURS))
    return {
        "color": CHAIN_COLOURS[colour],
        "linestyle": CHAIN_DASHES[dashes % len(CHAIN_DASHES)],
    }


def _chain_handles(fit: Fit) -> list[Line2D]:
    """Legend entries of the chains."""
    return [
        Line2D([], [], label=f"chain {int(chain)}", **_chain_style(k))
        for k, chain in enumerate(fit.posterior["posterior"]["chain"])
    ]
