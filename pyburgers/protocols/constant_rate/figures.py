"""Figures of a fit of a test at imposed strain rate: what is drawn, and how to read it.

Every function takes a fit and returns a figure of its own.
"""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment
from pyburgers.model.display import (
    LENGTH_FACTOR,
    LENGTH_UNIT,
    STRAIN_FACTOR,
    STRAIN_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
)
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError
from pyburgers.drawing.style import (
    BLACK,
    BLUE,
    GREEN,
    SKY_BLUE,
    TAIL,
    VERMILION,
    FigureRecipe,
    draw_band,
    draw_predictive_band,
    draw_residuals,
    draw_retrodictions,
    legend_of_panels,
    rate_text,
    style,
    title,
)
from pyburgers.fitting.fit import Fit

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
    """Draw data, retrodictions, predictive band and residuals along strain.

    Raises
    ------
    InputError
        If the fit is of another kind of test.
    """
    experiment = _experiment(fit)
    with style():
        figure = Figure(figsize=(8.0, 6.4), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1])
        draw_curve(upper, fit, experiment)
        _draw_residuals(lower, fit, experiment)
        mark_rate_steps((upper, lower), experiment)
        upper.set_xlim(0.0, 1.02 * experiment.final_strain * STRAIN_FACTOR)
        upper.set_title(title(experiment), loc="left")
        upper.set_ylabel(f"differential stress ({STRESS_UNIT})")
        lower.set_ylabel(f"residual ({STRESS_UNIT})")
        lower.set_xlabel(f"axial strain ({STRAIN_UNIT})")
        legend_of_panels(figure, (upper, lower))
    return figure


def draw_curve(axes: Axes, fit: Fit, experiment: ConstantRateExperiment) -> None:
    """Draw data, mean solution, retrodictions and predictive band."""
    predictions = fit.posterior["predictions"].to_dataset()
    strain = predictions["strain"].to_numpy() * STRAIN_FACTOR
    draw_predictive_band(axes, strain, predictions["stress_replicated"])
    draw_retrodictions(axes, strain, predictions["stress"], STRESS_FACTOR)
    mean = fit.posterior["posterior_mean_solution"].to_dataset()
    axes.plot(
        mean["strain"].to_numpy() * STRAIN_FACTOR,
        mean["stress"].to_numpy() * STRESS_FACTOR,
        color=VERMILION,
        linewidth=1.6,
        label="solution at the posterior mean",
    )
    axes.plot(
        experiment.strain * STRAIN_FACTOR,
        experiment.stress * STRESS_FACTOR,
        linestyle="none",
        marker="o",
        markersize=4,
        markerfacecolor="white",
        markeredgecolor=BLACK,
        markeredgewidth=0.8,
        label=f"{experiment.provenance.kind} data",
    )


def _draw_residuals(axes: Axes, fit: Fit, experiment: ConstantRateExperiment) -> None:
    """Draw data minus mean prediction, and the band of the noise."""
    predicted = fit.posterior["posterior_predictive"]["stress"].mean(("chain", "draw")).to_numpy()
    noise = float(fit.posterior["posterior"]["stress_noise"].mean()) * STRESS_FACTOR
    half_width = float(stats.norm.ppf(1.0 - TAIL)) * noise
    residuals = (experiment.stress - predicted) * STRESS_FACTOR
    draw_residuals(axes, experiment.strain * STRAIN_FACTOR, residuals, half_width)


def mark_rate_steps(panels: Sequence[Axes], experiment: ConstantRateExperiment) -> None:
    """Mark where the imposed rate changes, and to what; the first rate is in the title.

    Rates stand before their step, where the stress is high: behind it may be low readings.
    """
    for segment in experiment.segments[1:]:
        position = segment.start_strain * STRAIN_FACTOR
        for axes in panels:
            axes.axvline(position, color=BLACK, linestyle=":", linewidth=0.9)
        panels[0].annotate(
            f"then {rate_text(segment.strain_rate)}",
            (position, 0.02),
            xycoords=("data", "axes fraction"),
            xytext=(-3, 0),
            textcoords="offset points",
            rotation=90,
            ha="right",
            va="bottom",
            fontsize=9,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.5},
        )


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
    """Draw how grain size and fabric soften the material along strain.

    Raises
    ------
    InputError
        If the fit is of another kind of test.
    """
    experiment = _experiment(fit)
    predictions = fit.posterior["predictions"].to_dataset()
    strain = predictions["strain"].to_numpy() * STRAIN_FACTOR
    by_grains, by_fabric = predictions["grain_size_softening"], predictions["fabric_softening"]
    with style():
        figure = Figure(figsize=(8.6, 6.8), layout="constrained")
        panels = figure.subplots(2, 2)
        of_grains, of_fabric, of_strength, of_share = panels.flat
        grain_size = predictions["grain_size"] * LENGTH_FACTOR
        draw_band(of_grains, strain, grain_size, BLUE, "mean grain size")
        of_grains.axhline(
            experiment.initial_grain_size * LENGTH_FACTOR,
            color=BLACK,
            linestyle=":",
            linewidth=1.0,
            label="initial grain size",
        )
        of_grains.set_title("(a) grain size", loc="left")
        of_grains.set_ylabel(f"grain size ({LENGTH_UNIT})")
        of_grains.set_ylim(bottom=0.0)
        draw_band(of_fabric, strain, predictions["fabric_factor"], GREEN, "fabric factor")
        of_fabric.set_title("(b) fabric", loc="left")
        of_fabric.set_ylabel("fabric factor $F$ (–)")
        of_fabric.set_ylim(0.0, 1.05)
        draw_band(of_strength, strain, by_grains, BLUE, "grain size alone")
        draw_band(of_strength, strain, by_fabric, GREEN, "fabric alone")
        draw_band(of_strength, strain, by_grains * by_fabric, VERMILION, "both together")
        of_strength.set_title("(c) strength factors", loc="left")
        of_strength.set_ylabel("flow stress / undeformed (–)")
        of_strength.set_ylim(bottom=0.0)
        for axes in (of_grains, of_fabric, of_strength):
            axes.set_xlabel(f"axial strain ({STRAIN_UNIT})")
            axes.set_xlim(0.0, experiment.final_strain * STRAIN_FACTOR)
            axes.legend(loc="best")
        _draw_share(of_share, by_grains, by_fabric)
        lines_and_areas = "lines: posterior median, areas: 90 % of draws"
        figure.suptitle(f"{title(experiment)}\n{lines_and_areas}", fontsize=10)
    return figure


def _draw_share(axes: Axes, by_grains: xr.DataArray, by_fabric: xr.DataArray) -> None:
    """Draw the share of the logarithmic softening at the final strain that grain size has."""
    of_grains, of_fabric = (
        np.log(all_draws(factor.isel(strain=-1)).astype(np.float64))
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


def _experiment(fit: Fit) -> ConstantRateExperiment:
    """Return the experiment of a fit, which has to be of the kind that is drawn here."""
    if not isinstance(fit.experiment, ConstantRateExperiment):
        raise InputError(
            f"{fit.experiment.id}: found a test of protocol {fit.experiment.protocol!r}, expected "
            "the fit of a test at imposed strain rate."
        )
    return fit.experiment


CONSTANT_RATE_FIGURES = (
    FigureRecipe("stress_strain", "Stress-strain curve", STRESS_STRAIN_CAPTION, stress_strain),
    FigureRecipe("softening", "What softens the material", SOFTENING_CAPTION, softening),
)
"""What the report of such a fit shows beside the figures of its posterior."""
