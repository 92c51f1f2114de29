"""Figures of a fit of a test at imposed strain rate: what is drawn, and how to read it.

Every function takes a fit and returns a figure of its own, and refuses the fit of another kind of
test (`InputError`).
"""

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from pyburgers.common.draws import TAIL, all_draws
from pyburgers.drawing.page_parts import FigureRecipe
from pyburgers.drawing.panels import (
    LINES_AND_AREAS,
    FittedCurve,
    band_text,
    curve_with_residuals,
    draw_band_panel,
    result_of,
)
from pyburgers.drawing.style import BLACK, BLUE, GREEN, SKY_BLUE, VERMILION, style
from pyburgers.model.display import (
    LENGTH_FACTOR,
    LENGTH_UNIT,
    STRAIN_FACTOR,
    STRAIN_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
)
from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment, rate_text
from pyburgers.protocols.experiment import of_kind
from pyburgers.protocols.protocol import FittedTest

FloatArray = npt.NDArray[np.float64]

STRAIN_LABEL = f"axial strain ({STRAIN_UNIT})"

STRESS_STRAIN_CAPTION = (
    "Top: the stress-strain curve (circles), the predictive median (solid line), up to 1000 "
    "retrodictions, that is solutions for single draws from the posterior (thin lines), and the "
    "band that should hold 90 % of new measurements. Dotted vertical lines mark where the "
    "imposed strain rate changes. Bottom: data minus the predictive median, with the band that "
    "should hold 90 % of residuals if they were noise alone; a run of points on one side of "
    "zero is what the model misses."
)


def stress_strain(fit: FittedTest) -> Figure:
    """Draw data, retrodictions, predictive band and residuals along strain."""
    return curve_with_residuals(fitted_curve(fit))


def fitted_curve(fit: FittedTest) -> FittedCurve:
    """Gather the stress-strain curve as measured and as a fit has it."""
    experiment = constant_rate_test(fit)
    predictions = fit.posterior["predictions"].to_dataset()
    predicted = fit.posterior["model_response"]["stress"].median(("chain", "draw")).to_numpy()
    noise = float(fit.posterior["posterior"]["stress_noise"].mean()) * STRESS_FACTOR
    return FittedCurve(
        grid=predictions["strain"].to_numpy() * STRAIN_FACTOR,
        solutions=all_draws(predictions["stress"]) * STRESS_FACTOR,
        replicated=all_draws(predictions["stress_replicated"]) * STRESS_FACTOR,
        position=experiment.strain * STRAIN_FACTOR,
        data=experiment.stress * STRESS_FACTOR,
        residuals=(experiment.stress - predicted) * STRESS_FACTOR,
        error=None,
        data_label=f"{experiment.provenance.kind} data",
        noise_band=float(stats.norm.ppf(1.0 - TAIL)) * noise,
        position_label=STRAIN_LABEL,
        label=f"differential stress ({STRESS_UNIT})",
        residual_label=f"residual ({STRESS_UNIT})",
        heading=experiment.title,
        # The first rate is in the title.
        marks=[
            (segment.start_strain * STRAIN_FACTOR, f"then {rate_text(segment.strain_rate)}")
            for segment in experiment.segments[1:]
        ],
        limits=(0.0, 1.02 * experiment.final_strain * STRAIN_FACTOR),
    )


SHARES = (-1.0, 2.0)
"""Shares of grain size in the softening, the least and the largest, up to which an axis may go."""

SOFTENING_CAPTION = (
    "Why the material weakens: (a) mean grain size, (b) fabric factor (1 = isotropic), (c) the "
    "factors by which smaller grains and stronger fabric lower the flow stress, and their "
    "product; lines are posterior medians, areas hold 90 % of draws. (d) Share of grain size in "
    "the total softening (logarithms) at the final strain; below 0 or above 1 one of the two "
    "hardens, and the outermost 1 % of draws may be cut off. Where this histogram is broad, the "
    "data do not tell which mechanism did it. Circles with bars: measured, with standard "
    "deviation."
)


def softening(fit: FittedTest) -> Figure:
    """Draw how grain size and fabric soften the material along strain."""
    experiment = constant_rate_test(fit)
    predictions = fit.posterior["predictions"].to_dataset()
    strain = predictions["strain"].to_numpy() * STRAIN_FACTOR
    by_grains, by_fabric = (
        all_draws(predictions[name]) for name in ("grain_size_softening", "fabric_softening")
    )
    with style():
        figure = Figure(figsize=(8.6, 6.8), layout="constrained")
        grains, fabric, strength, share = figure.subplots(2, 2).flat
        draw_band_panel(
            grains,
            strain,
            [(all_draws(predictions["grain_size"]) * LENGTH_FACTOR, BLUE, "mean grain size")],
            heading="(a) grain size",
            label=f"grain size ({LENGTH_UNIT})",
            level=(experiment.initial_grain_size * LENGTH_FACTOR, "initial grain size"),
        )
        draw_band_panel(
            fabric,
            strain,
            [(all_draws(predictions["fabric_factor"]), GREEN, "fabric factor")],
            heading="(b) fabric",
            label="fabric factor $F$ (–)",
        )
        draw_band_panel(
            strength,
            strain,
            [
                (by_grains, BLUE, "grain size alone"),
                (by_fabric, GREEN, "fabric alone"),
                (by_grains * by_fabric, VERMILION, "both together"),
            ],
            heading="(c) strength factors",
            label="flow stress / undeformed (–)",
        )
        _draw_measured(grains, fabric, experiment)
        for axes, top in ((grains, None), (fabric, 1.05), (strength, None)):
            axes.set_ylim(0.0, top)
            axes.set_xlabel(STRAIN_LABEL)
            axes.set_xlim(0.0, experiment.final_strain * STRAIN_FACTOR)
        _draw_share(share, by_grains[:, -1], by_fabric[:, -1])
        figure.suptitle(f"{experiment.title}\n{LINES_AND_AREAS}", fontsize=10)
    return figure


def _draw_measured(grains: Axes, fabric: Axes, experiment: ConstantRateExperiment) -> None:
    """Draw measured grain sizes and fabric factors with their standard deviations."""
    measured = np.array([[one.strain, *one.numbers] for one in experiment.microstructure])
    if not measured.size:
        return
    strain, size, log_error, factor, error = measured.T
    strain = strain * STRAIN_FACTOR
    some = error > 0
    for axes, position, value, spread in (
        (grains, strain, size * LENGTH_FACTOR, size * log_error * LENGTH_FACTOR),
        (fabric, strain[some], factor[some], error[some]),
    ):
        if position.size:
            axes.errorbar(
                position,
                value,
                spread,
                fmt="o",
                color=BLACK,
                mfc="white",
                clip_on=False,  # the last strain is the end of the axis
                label="measured",
            )
            axes.legend(loc="best")


def _draw_share(axes: Axes, by_grains: FloatArray, by_fabric: FloatArray) -> None:
    """Draw the share that grain size has in the softening (its logarithm), of factors by draw."""
    log_grains, log_fabric = (
        np.log(factor.astype(np.float64)) for factor in (by_grains, by_fabric)
    )
    total = log_grains + log_fabric
    share = log_grains[total != 0] / total[total != 0]
    low, median, high = np.quantile(share, [0.005, 0.5, 0.995]) if share.size else (0.0, 0.5, 1.0)
    # Where grains grow and the fabric weakens, the two nearly cancel in some draws, and the share
    # of what is left has no limit.
    left, right = SHARES
    ends = (min(0.0, max(left, low), median), max(1.0, min(right, high), median))
    weights = np.full(share.size, 100.0 / max(share.size, 1))
    axes.hist(share, bins=30, range=ends, weights=weights, color=SKY_BLUE, label="posterior draws")
    if share.size:
        axes.axvline(median, color=BLACK, linewidth=1.4, label=f"median {median:.2f}")
        beyond = float(np.mean((share < ends[0]) | (share > ends[1])))
        if beyond > 0.01:  # more than the tails that any axis leaves out
            axes.plot([], [], " ", label=f"{100 * beyond:.0f} % of draws lie beyond")
    axes.set_title("(d) share of grain size", loc="left")
    axes.set_xlabel("share of ln-softening due to grain size (–)")
    axes.set_ylabel("share of draws (%)")
    axes.set_xlim(*ends)
    axes.legend(loc="best")


def constant_rate_test(fit: FittedTest) -> ConstantRateExperiment:
    """Return the experiment of a fit, which has to be a test at imposed strain rate.

    Raises
    ------
    InputError
        If it is not.
    """
    return of_kind(fit.experiment, ConstantRateExperiment, "a test at imposed strain rate")


def softening_result(fit: FittedTest) -> str:
    """Say how far the material has softened at the end, and by what."""
    predictions = fit.posterior["predictions"].to_dataset()
    size, fabric, by_grains, by_fabric = (
        all_draws(predictions[name])[:, -1]
        for name in ("grain_size", "fabric_factor", "grain_size_softening", "fabric_softening")
    )
    return (
        f"at the final strain grains have {band_text(size * LENGTH_FACTOR, LENGTH_UNIT)}, the "
        f"fabric factor is {band_text(fabric, '')}, and the flow stress "
        f"{band_text(by_grains * by_fabric, '')} of the undeformed material's."
    )


CONSTANT_RATE_FIGURES = (
    FigureRecipe(
        "stress_strain",
        "Stress-strain curve",
        STRESS_STRAIN_CAPTION,
        stress_strain,
        result_of(fitted_curve),
    ),
    FigureRecipe(
        "softening", "What softens the material", SOFTENING_CAPTION, softening, softening_result
    ),
)
"""What the report of such a fit shows beside the figures of its posterior."""
