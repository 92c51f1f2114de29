"""What a page shows of the microstructure of a test: measured, and how it softens the material."""

from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pyburgers.common.draws import FloatArray, all_draws
from pyburgers.common.units import with_error
from pyburgers.drawing.panels import (
    LINES_AND_AREAS,
    band_text,
    draw_band_panel,
    draw_dots,
    figure_of,
)
from pyburgers.drawing.style import BLACK, BLUE, GREEN, SKY_BLUE, VERMILION
from pyburgers.drawing.view import positions, predicted, shown_clock
from pyburgers.kinds.experiment import Experiment, MeasuredMicrostructure
from pyburgers.kinds.kind import FittedTest
from pyburgers.model.display import LENGTH_FACTOR, LENGTH_UNIT
from pyburgers.model.laws import DASHPOT_LAWS
from pyburgers.model.variants import variant_of

SHARES = (-1.0, 2.0)
"""Shares of grain size in the softening, the least and the largest, up to which an axis may go."""


def microstructure_facts(
    measured: Sequence[MeasuredMicrostructure], place: Callable[[MeasuredMicrostructure], str]
) -> list[tuple[str, str]]:
    """Say what was measured of the microstructure, if anything, and where: ``15 % strain``."""
    if not measured:
        return []
    said = []
    for one in measured:
        size, error = (LENGTH_FACTOR * value for value in (one.grain_size, one.grain_size_sd))
        fabric = ""
        if one.fabric_factor is not None and one.fabric_factor_sd is not None:
            fabric = f", fabric factor {with_error(one.fabric_factor, one.fabric_factor_sd)}"
        said.append(f"grain size {with_error(size, error)} {LENGTH_UNIT}{fabric} at {place(one)}")
    return [("Measured microstructure", "; ".join(said))]


def evolves(fit: FittedTest) -> bool:
    """Whether grain size or fabric change in a fit, or were measured."""
    variant = variant_of(fit.priors, fit.experiment)
    constant = variant.grain_size == variant.fabric == "constant"
    return not constant or bool(fit.experiment.microstructure)


def softening_caption(end: str) -> str:
    """Return the caption of the figure; the end is that of the test, such as ``final strain``."""
    return (
        "Why the material weakens or hardens: (a) mean grain size, (b) fabric factor (1 = "
        "isotropic), (c) the factors by which grain size and fabric change the flow stress of "
        "the power law, and their product; lines are posterior medians, areas hold 90 % of draws. "
        "(d) Share of grain size in the total softening (logarithms) at the "
        f"{end}; below 0 or above 1 one of the two "
        "hardens. The legend counts draws beyond the axis, if they are more than 1 %. If this "
        "histogram is broad, the data do not tell which mechanism softened the material. Circles "
        "with bars: measured, with standard deviation."
    )


def softening_along(fit: FittedTest, measured: FloatArray, label: str = "") -> Figure:
    """Draw how grain size and fabric soften a material that was `measured` at positions (SI)."""
    experiment, clock = fit.experiment, shown_clock(fit.experiment)
    position = positions(fit) * clock.display_factor
    by_grains, by_fabric = (
        predicted(fit, name) for name in ("grain_size_softening", "fabric_softening")
    )
    with figure_of(8.6, 6.8, f"{experiment.title}\n{LINES_AND_AREAS}") as figure:
        grains, fabric, strength, share = figure.subplots(2, 2).flat
        draw_band_panel(
            grains,
            position,
            [(predicted(fit, "grain_size") * LENGTH_FACTOR, BLUE, "mean grain size")],
            heading="(a) grain size",
            label=f"grain size ({LENGTH_UNIT})",
            level=(experiment.initial_grain_size * LENGTH_FACTOR, "initial grain size"),
        )
        draw_band_panel(
            fabric,
            position,
            [(predicted(fit, "fabric_factor"), GREEN, "fabric factor")],
            heading="(b) fabric",
            label="fabric factor $F$ (–)",
        )
        draw_band_panel(
            strength,
            position,
            [
                (by_grains, BLUE, "grain size alone"),
                (by_fabric, GREEN, "fabric alone"),
                (by_grains * by_fabric, VERMILION, "both together"),
            ],
            heading="(c) strength factors",
            label="flow stress / undeformed (–)",
        )
        _draw_measured(grains, fabric, experiment, measured * clock.display_factor)
        for axes, least_top in ((grains, 0.0), (fabric, 1.05), (strength, 1.05)):
            axes.set_ylim(0.0, max(axes.get_ylim()[1], least_top))
            axes.set(xlabel=label or clock.label)
            axes.set_xlim(0.0, experiment.span[1] * clock.display_factor)
        _draw_share(share, softening_shares(fit.posterior["predictions"].to_dataset()))
    return figure


def softening_shares(predictions: xr.Dataset) -> FloatArray:
    """Return the share of grain size in ln(softening) at the end, of draws with any softening."""
    log_grains, log_fabric = (
        np.log(all_draws(predictions[name])[:, -1].astype(np.float64))
        for name in ("grain_size_softening", "fabric_softening")
    )
    total = log_grains + log_fabric
    return np.asarray(log_grains[total != 0] / total[total != 0])


def softened_text(fit: FittedTest) -> str:
    """Say how far the material has softened at the end of a test, and by what."""
    size, fabric, by_grains, by_fabric = (
        predicted(fit, name)[:, -1]
        for name in ("grain_size", "fabric_factor", "grain_size_softening", "fabric_softening")
    )
    variant = variant_of(fit.priors, fit.experiment)
    alone = variant.second_mechanism == variant.hardening == "none"
    alone &= not DASHPOT_LAWS[variant.maxwell].own_stress
    return (
        f"grains have {band_text(size * LENGTH_FACTOR, LENGTH_UNIT)}, the "
        f"fabric factor is {band_text(fabric, '')}, and the flow stress "
        f"{'' if alone else 'of its power law by itself is '}"
        f"{band_text(by_grains * by_fabric, '')} of the undeformed material's."
    )


def _draw_measured(
    grains: Axes, fabric: Axes, experiment: Experiment, position: FloatArray
) -> None:
    """Draw measured grain sizes and fabric factors with their standard deviations."""
    if not experiment.microstructure:
        return
    size, log_error, factor, error = np.transpose(
        [one.numbers for one in experiment.microstructure]
    )
    some = error > 0
    for axes, at, value, spread in (
        (grains, position, size * LENGTH_FACTOR, size * log_error * LENGTH_FACTOR),
        (fabric, position[some], factor[some], error[some]),
    ):
        if at.size:
            # The last one is at the end of the axis.
            draw_dots(axes, at, value, yerr=spread, size=6.0, label="measured", clip_on=False)
            axes.legend(loc="best")


def _draw_share(axes: Axes, share: FloatArray) -> None:
    """Draw a histogram of the shares of grain size."""
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
    axes.set(xlabel="share of ln-softening due to grain size (–)", ylabel="share of draws (%)")
    axes.set_xlim(*ends)
    axes.legend(loc="best")
