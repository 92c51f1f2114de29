"""Figure of a calibration: how far the ranks of each quantity are from uniform ones."""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pyburgers.drawing.style import BLACK, BLUE, GREY, SKY_BLUE, VERMILION, few_ticks, style
from pyburgers.model.display import shown_quantity
from pyburgers.sbc.data_sets import LOG_LIKELIHOOD
from pyburgers.sbc.rank_uniformity import RankBands, RankVerdict, counts_at_most
from pyburgers.sbc.run import Calibration

COLUMNS = 4

RANKS_CAPTION = (
    "Share of data sets in which the true value ranks at most this high among the draws, less the "
    "share expected of a right posterior. Dark band: holds the whole line in 95 % of calibrations "
    "of a right program; light band: holds the lines of all quantities together in 95 %. A line "
    "like an arch above zero means that the posterior is too high, below zero too low; one that "
    "is above zero at first and below it at the end, that it is too narrow, the reverse too wide."
)


def rank_differences(calibration: Calibration) -> Figure:
    """Draw the empirical distribution of the ranks less the uniform one, with its bands."""
    names = list(calibration.ranks)
    n_rows = math.ceil(len(names) / COLUMNS)
    with style():
        figure = Figure(figsize=(9.0, 0.9 + 1.7 * n_rows), layout="constrained")
        panels = figure.subplots(n_rows, COLUMNS, sharex=True, sharey=True, squeeze=False).ravel()
        for axes, name in zip(panels, names, strict=False):
            _draw(axes, calibration.ranks[name], calibration.verdicts[name], calibration.bands)
            axes.set_title(_heading(name), loc="left")
        for axes in panels[len(names) :]:
            axes.set_axis_off()
        for axes in panels[max(0, len(names) - COLUMNS) : len(names)]:
            axes.tick_params(labelbottom=True)
        figure.supxlabel("rank of the true value as a share of the draws", fontsize=10.0)
        figure.supylabel("difference from uniform", fontsize=10.0)
        n_unsolvable = sum(one.n_unsolvable for one in calibration.replications)
        figure.suptitle(
            f"{calibration.template.id}: {len(calibration.ranked)} data sets from the prior, "
            f"{n_unsolvable} draws without solution",
            x=0.01,
            horizontalalignment="left",
            fontsize=10.0,
        )
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper right", ncols=2)
    return figure


def _draw(axes: Axes, ranks: list[int], verdict: RankVerdict, bands: RankBands) -> None:
    """Draw one quantity."""
    place = np.arange(1, bands.n_draws + 1) / (bands.n_draws + 1)
    for band, colour, label in (
        (bands.joint, GREY, "95 % band, all quantities"),
        (bands.own, SKY_BLUE, "95 % band"),
    ):
        low, high = (limit / bands.n_ranks - place for limit in band)
        axes.fill_between(
            place, low, high, color=colour, alpha=0.5, linewidth=0, step="post", label=label
        )
    wrong = verdict.verdict == "not calibrated"
    difference = counts_at_most(ranks, bands.n_draws) / bands.n_ranks - place
    axes.step(place, difference, where="post", color=VERMILION if wrong else BLUE, linewidth=1.4)
    axes.axhline(0.0, color=BLACK, linewidth=0.6)
    axes.set_xlim(0.0, 1.0)
    axes.set_xticks([0.0, 0.5, 1.0])
    axes.yaxis.set_major_locator(few_ticks(4))
    if verdict.verdict != "calibrated":
        axes.text(
            0.97,
            0.95,
            verdict.verdict,
            transform=axes.transAxes,
            horizontalalignment="right",
            verticalalignment="top",
            fontsize=9.0,
            color=VERMILION if wrong else BLACK,
        )


def _heading(name: str) -> str:
    return "log likelihood" if name == LOG_LIKELIHOOD else f"${shown_quantity(name).symbol}$"
