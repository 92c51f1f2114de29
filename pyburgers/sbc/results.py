"""Results of a calibration: counts, table of verdicts, figure of the ranks, and their files."""

import math
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pyburgers.common.atomic_files import write_text
from pyburgers.common.csv_tables import csv_text
from pyburgers.drawing.panels import figure_of
from pyburgers.drawing.style import BLACK, BLUE, GREY, SKY_BLUE, VERMILION, few_ticks
from pyburgers.model.display import (
    STRAIN_FACTOR,
    STRAIN_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
    shown_quantity,
)
from pyburgers.model.parameters import Parameter
from pyburgers.sbc.data_sets import LOG_LIKELIHOOD, LONGER, RHAT_LIMIT
from pyburgers.sbc.rank_uniformity import VERDICTS_TEXT, RankBands, RankVerdict, counts_at_most
from pyburgers.sbc.replication import RANKS, replication_table
from pyburgers.sbc.run import Calibration


def _called(name: str, quantity_text: Callable[[Parameter], str]) -> str:
    """Return what tables or figures call a ranked quantity, given what they call its parameter."""
    if name == LOG_LIKELIHOOD:
        return "log likelihood"
    quantity, _, test = name.partition("[")
    return quantity_text(shown_quantity(quantity)) + (f" [{test}" if test else "")


def verdict_table(calibration: Calibration) -> pd.DataFrame:
    """Verdicts, a row for each ranked quantity."""
    rows = [
        {
            "quantity": name,
            "data_sets": len(calibration.ranked),
            "mean_rank": verdict.mean,
            "rank_spread": verdict.spread,
            "verdict": verdict.verdict,
            "in_words": verdict.sentence,
        }
        for name, verdict in calibration.verdicts.items()
    ]
    columns = ["quantity", "data_sets", "mean_rank", "rank_spread", "verdict", "in_words"]
    return pd.DataFrame(rows, columns=columns)


def shown_verdict_table(calibration: Calibration) -> pd.DataFrame:
    """Return `verdict_table` as text for people."""
    table = verdict_table(calibration)
    return pd.DataFrame(
        {
            "quantity": [_called(name, lambda one: one.label) for name in table["quantity"]],
            "mean rank": table["mean_rank"].map("{:.3f}".format),
            "spread": table["rank_spread"].map("{:.3f}".format),
            "verdict": table["verdict"],
            "in words": table["in_words"],
        }
    )


def count_sentences(calibration: Calibration) -> tuple[str, ...]:
    """Say how many data sets, unphysical draws, lost fits and failed checks there were."""
    done, ranked, plan = calibration.replications, calibration.ranked, calibration.plan
    n_unsolvable = sum(one.n_unsolvable for one in done)
    n_outside = sum(one.n_outside for one in done)
    n_drawn = n_unsolvable + n_outside + len(done)
    unconverged = [one for one in done if one.failure is None and not one.ranks]
    failed = Counter(name for one in unconverged for name in one.failed_checks)
    by_name = ", ".join(f"{name} {count}" for name, count in sorted(failed.items()))
    sentences = [
        "All data are synthetic: they were made with known parameters and say nothing of nature.",
        f"{len(done)} of {plan.simulations} data sets like {calibration.template.name} are done "
        f"(the number was fixed before the first), {len(ranked)} of them ranked: the truth among "
        f"{plan.n_ranked} draws of each fit.",
        f"Unphysical draws: {n_unsolvable} of {n_drawn} draws from the prior had no finite "
        "solution within the solver's step limit and were replaced by the next ones.",
        f"Fits without any chain: {sum(one.failure is not None for one in done)}; they have no "
        "ranks.",
        "Fits that went on with shorter steps because a few trajectories diverged: "
        f"{sum(one.n_shortened > 0 for one in done)}.",
        f"Fits that had not converged and were repeated {LONGER} times as long: "
        f"{sum(one.n_refits > 0 for one in done)}; still not converged and not ranked: "
        f"{len(unconverged)}{f' ({by_name})' if by_name else ''}. The limit of R-hat is "
        f"{RHAT_LIMIT} for these short chains, and as many effective draws are wanted as are "
        "ranked.",
    ]
    ranges = [
        f"{what} lay outside {factor * limits[0]:g} to {factor * limits[1]:g} {unit}"
        for what, limits, factor, unit in (
            ("stress", plan.stress_range, STRESS_FACTOR, STRESS_UNIT),
            ("strain", plan.strain_range, STRAIN_FACTOR, STRAIN_UNIT),
        )
        if limits is not None
    ]
    if ranges:
        sentences.append(
            f"Data sets whose largest {' or '.join(ranges)}: {n_outside}; they were replaced. That "
            "looks at the data alone, so that the ranks of the others stay uniform."
        )
    return tuple(sentences)


def calibration_text(calibration: Calibration) -> str:
    """Return counts, verdicts and how to repeat them as Markdown."""
    table = shown_verdict_table(calibration)
    rows = [list(table.columns), ["---"] * len(table.columns), *table.to_numpy().tolist()]
    return "\n".join(
        [
            f"# Calibration of the fit of {calibration.template.name}",
            "",
            *(f"- {sentence}" for sentence in count_sentences(calibration)),
            f"- Priors: {calibration.template.priors[0].title}.",
            f"- Command: `{calibration.command}`",
            "",
            *(f"| {' | '.join(row)} |" for row in rows),
            "",
            VERDICTS_TEXT,
            "",
        ]
    )


def save_calibration(calibration: Calibration, folder: Path) -> None:
    """Write ``verdicts.csv``, ``ranks.csv`` and ``calibration.md``."""
    write_text(folder / "verdicts.csv", csv_text(verdict_table(calibration)))
    table = replication_table(calibration.replications, list(calibration.ranks))
    write_text(folder / RANKS, csv_text(table))
    write_text(folder / "calibration.md", calibration_text(calibration))


COLUMNS = 4


def rank_differences(calibration: Calibration) -> Figure:
    """Draw the empirical distribution of the ranks less the uniform one, with its bands."""
    names = list(calibration.ranks)
    n_rows = math.ceil(len(names) / COLUMNS)
    with figure_of(9.0, 0.9 + 1.7 * n_rows) as figure:
        panels = figure.subplots(n_rows, COLUMNS, sharex=True, sharey=True, squeeze=False).ravel()
        for axes, name in zip(panels, names, strict=False):
            _draw(axes, calibration.ranks[name], calibration.verdicts[name], calibration.bands)
            axes.set_title(_called(name, lambda one: f"${one.symbol}$"), loc="left")
        for axes in panels[len(names) :]:
            axes.set_axis_off()
        for axes in panels[max(0, len(names) - COLUMNS) : len(names)]:
            axes.tick_params(labelbottom=True)
        figure.supxlabel("rank of the true value as a share of the draws", fontsize=10.0)
        figure.supylabel("difference from uniform", fontsize=10.0)
        n_unsolvable = sum(one.n_unsolvable for one in calibration.replications)
        figure.suptitle(
            f"{calibration.template.name}: {len(calibration.ranked)} data sets from the prior, "
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
        # Beside the heading: in the panel it would lie on the line.
        axes.set_title(
            verdict.verdict, loc="right", fontsize=9.0, color=VERMILION if wrong else BLACK
        )
