"""The league of laws on measured tests: what each describes, misses and predicts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from common import (
    GREEN,
    GREY,
    ORANGE,
    VERDICT_COLUMNS,
    VERMILION,
    against_best,
    bad_verdicts,
    shown_differences,
    shown_verdicts,
)
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import pyburgers
from pyburgers import Comparison, Experiment, Fit, Outcome, PageFigure, PageSection, PageTable

COLOURS: Mapping[str, tuple[str, str]] = {
    "yes": (GREEN, "describes the data"),
    "cannot tell": (ORANGE, "cannot tell"),
    "no": (VERMILION, "does not describe the data"),
}
"""Colour of a dot and its words in the legend, by the second verdict."""

PREDICTED_DRAWS = 1000
"""Draws that predict the last part of a test."""

BAND, DENSITY = "coverage of the 90 % band", "log predictive density a reading"
"""Scores of a last part that the league shows, as `pyburgers.score_table` names them."""


NOT_PREDICTED: Mapping[str, Any] = {
    "last_sampled_well": "",
    "last_in_band": np.nan,
    "last_density": np.nan,
    "last_as_expected": "",
}
"""Row of a law without a fit of the readings before the last part."""


@dataclass(frozen=True, eq=False)
class Contest:
    """Fits of one test by law, and how they predict.

    `comparison`: by leave-one-out, of two fits or more.
    `last_part`: by law how it predicts the last part from the readings before it, as a row has it.
    """

    name: str
    fits: Mapping[str, Fit]
    comparison: Comparison | None
    last_part: Mapping[str, Mapping[str, Any]]

    @classmethod
    def of(
        cls, name: str, fits: Mapping[str, Fit], before: Mapping[str, Fit], last: Experiment | None
    ) -> "Contest":
        """Compare fits, and let those of the readings `before` predict the `last` ones."""
        last_part = {
            law: predicted_part(fit, last) for law, fit in before.items() if last is not None
        }
        return cls(name, fits, pyburgers.compare(fits) if len(fits) > 1 else None, last_part)

    @property
    def best_first(self) -> list[str]:
        """Laws in the order of leave-one-out."""
        return list(self.comparison.results if self.comparison else self.fits)

    @property
    def describing(self) -> list[str]:
        """Laws that describe the data, of those that were sampled well; the best first."""
        return [law for law in self._sampled if self.fits[law].describes_data is Outcome.YES]

    @property
    def _sampled(self) -> list[str]:
        return [law for law in self.best_first if self.fits[law].sampled_well is Outcome.YES]

    @property
    def chosen(self) -> str:
        """The best law of those that describe the data; else of those sampled well; else of all."""
        return [*self.describing, *self._sampled, *self.best_first][0]

    @property
    def is_undecided(self) -> bool:
        """Whether no law describes the data, and it cannot be told of one of them, or of any."""
        answers = [self.fits[law].describes_data for law in self._sampled]
        return not self.describing and (not answers or Outcome.CANNOT_TELL in answers)

    def rows(self) -> list[dict[str, Any]]:
        """Return a row for each law, the best first: see `league_table`."""
        differences = against_best(self.fits, self.comparison)
        return [self._row(law, *differences[law]) for law in self.best_first]

    def _row(self, law: str, difference: float, error: float, outcome: str) -> dict[str, Any]:
        fit = self.fits[law]
        chains = fit.manifest["chains"].values()
        return {
            "test": self.name,
            "law": law,
            "model": fit.variant.short_text,
            "sampled_well": fit.sampled_well.value,
            "describes_data": fit.describes_data.value,
            "elpd_difference": difference,
            "standard_error": error,
            "outcome": outcome,
            **largest_misfit(fit),
            "chain_minutes": sum(chain["wall_seconds"] for chain in chains) / 60,
            **self.last_part.get(law, NOT_PREDICTED),
        }


def largest_misfit(fit: Fit) -> dict[str, Any]:
    """Return the discrepancy that is furthest beyond its limit, or nearest to it.

    Keys misfit, where, found and at_most: the largest number of a correct model.
    """
    tables = [
        # A check of one number alone does not name it again in its table.
        pd.DataFrame({"discrepancy": check.name, "where": ""}, index=check.table.index).assign(
            **{str(name): column for name, column in check.table.items()}
        )
        for check in fit.checks()
        if "at_most" in check.table
    ]
    every = pd.concat(tables).reset_index(drop=True)
    worst = every.iloc[int((every["found"] / every["at_most"]).argmax())]
    return {
        "misfit": worst["discrepancy"],
        "where": worst["where"],
        "found": float(worst["found"]),
        "at_most": float(worst["at_most"]),
    }


def predicted_part(fit: Fit, last: Experiment) -> dict[str, Any]:
    """Return how a fit predicts readings that it has not seen, as a row of the league has it."""
    scores = pyburgers.score_table(fit.predict(last, draws=PREDICTED_DRAWS))
    expected = scores["found"].between(scores["expected_q5"], scores["expected_q95"])
    return {
        "last_sampled_well": fit.sampled_well.value,
        "last_in_band": scores["found"][BAND],
        "last_density": scores["found"][DENSITY],
        "last_as_expected": "yes" if expected.all() else "no",
    }


def league_table(contests: Sequence[Contest]) -> pd.DataFrame:
    """Return the league, a row for each test and law, the best law of a test first.

    Columns test, law, model, both verdicts, elpd_difference to the best, its standard_error and
    outcome, misfit with where, found and at_most, chain_minutes. Of the last part last_sampled_well
    (the fit of the readings before), last_in_band (share of readings in the 90 % band),
    last_density (ln, a reading, SI) and last_as_expected.
    """
    return pd.DataFrame([row for contest in contests for row in contest.rows()])


def league_sentence(contests: Sequence[Contest]) -> str:
    """Say how many tests some law describes, and which ones none does.

    Fits that were not sampled well count neither for nor against a law.
    """
    described = [one for one in contests if one.describing]
    correlated = [
        one
        for one in described
        if all(one.fits[law].variant.residuals_correlate for law in one.describing)
    ]
    unsure = [one for one in contests if one.is_undecided]
    missed = [one for one in contests if not one.describing and not one.is_undecided]
    said = [
        f"Of {len(contests)} measured tests, some law describes {_listed(described)}",
        f"Only with correlated residuals {_listed(correlated)}",
        f"No law that was sampled well describes {_listed(missed)}",
        f"It cannot be told whether any law describes {_listed(unsure)}",
    ]
    fits = [fit for one in contests for fit in one.fits.values()]
    bad = sum(fit.sampled_well is not Outcome.YES for fit in fits)
    said.append(f"Not sampled well, and counted for nothing: {bad} of {len(fits)} fits")
    counted = (True, correlated, missed, unsure, bad)
    return " ".join(f"{text}." for text, there in zip(said, counted, strict=True) if there)


def _listed(contests: Sequence[Contest]) -> str:
    """Return how many tests there are, and their names."""
    names = ", ".join(one.name for one in contests)
    return f"{len(contests)} ({names})" if contests else "none"


def last_part_sentence(table: pd.DataFrame) -> str:
    """Say how many predictions of a last segment or hottest spectrum are as good as expected."""
    predicted = table[table["last_sampled_well"] == "yes"]
    if predicted.empty:
        return "No fit without the last part of its test is finished and was sampled well."
    good = predicted[predicted["last_as_expected"] == "yes"]
    best = predicted.loc[predicted.groupby("test")["last_density"].idxmax()]
    winners = ", ".join(f"{row['law']} ({row['test']})" for row in best.to_dict("records"))
    return (
        "The last segment of a stepped test, or the hottest spectrum of a table, is predicted from "
        f"the other readings. Of {len(predicted)} such predictions, by fits that were sampled "
        f"well, {len(good)} are as good as their draws expect. Best by density: {winners}."
    )


def league_section(contests: Sequence[Contest], missing: Mapping[str, str]) -> PageSection:
    """Return the part of the page about all laws and tests.

    `missing`: fits that are not there, and why.
    """
    table = league_table(contests)
    sentence = league_sentence(contests)
    gaps = (text for one in contests if one.comparison for text in one.comparison.gap_sentences())
    return PageSection(
        key="league",
        title="Laws on measured tests",
        paragraphs=(
            sentence,
            last_part_sentence(table),
            *([f"{len(missing)} fits are missing; they are named below."] if missing else []),
        ),
        details=(
            *dict.fromkeys(gaps),
            *(f"{run} is missing: {reason}" for run, reason in missing.items()),
        ),
        tables=(
            PageTable(
                "laws",
                "The league: the best law of a test first",
                _shown(table),
                table,
                words=("test", "law", *VERDICT_COLUMNS.values(), "against the best"),
                sentences=("largest misfit",),
                bad=bad_verdicts(table),
            ),
        ),
        figures=(
            PageFigure(
                "laws",
                "Which law describes which test",
                "A dot for each fit. Its colour says whether the law describes the data; an open "
                "dot was not sampled well. Numbers are elpd below the best law of the test.",
                partial(draw_league, table),
                sentence,
            ),
        ),
    )


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    """Return the league as text."""
    rows = table.to_dict("records")
    return pd.DataFrame(
        {
            "test": table["test"].tolist(),
            "law": table["law"].tolist(),
            **shown_verdicts(table),
            "elpd below the best": shown_differences(table),
            "against the best": table["outcome"].tolist(),
            "largest misfit": [
                f"{row['misfit']} {row['found']:.2g} (at most {row['at_most']:.2g}) {row['where']}"
                for row in rows
            ],
            "last part in the 90 % band": [
                text + ("" if sampled in ("", "yes") else ", not sampled well")
                for text, sampled in zip(
                    _text(table["last_in_band"], "{:.0%}"), table["last_sampled_well"], strict=True
                )
            ],
            "its ln density a reading": _text(table["last_density"], "{:.2f}"),
            "chains took (min)": _text(table["chain_minutes"], "{:.1f}"),
        }
    )


def _text(values: "pd.Series[float]", form: str) -> list[str]:
    """Return numbers as text, empty where there is none."""
    return ["" if np.isnan(value) else form.format(value) for value in values]


def draw_league(table: pd.DataFrame) -> Figure:
    """Draw a dot for each test and law, coloured by the second verdict.

    Tests with the same laws share a panel.
    """
    panels: dict[frozenset[str], list[str]] = {}
    for test, rows in table.groupby("test", sort=False):
        panels.setdefault(frozenset(rows["law"]), []).append(str(test))
    sizes = [len(tests) for tests in panels.values()]
    with pyburgers.style():
        figure = Figure(figsize=(7.5, 0.6 * sum(sizes) + 0.7 * len(sizes) + 0.6))
        figure.set_layout_engine("constrained")
        grid = figure.subplots(
            len(sizes), squeeze=False, height_ratios=[size + 0.6 for size in sizes]
        )
        for axes, tests in zip(grid.flat, panels.values(), strict=True):
            _draw_panel(axes, table[table["test"].isin(tests)])
        dots = [
            Line2D([], [], ls="", marker="o", color=colour, label=words)
            for colour, words in COLOURS.values()
        ]
        figure.legend(handles=dots, ncols=len(dots), loc="outside upper center")
    return figure


def _draw_panel(axes: Axes, table: pd.DataFrame) -> None:
    """Draw tests that were fitted with the same laws, and elpd below the best law of each test."""
    tests, laws = (list(dict.fromkeys(table[name])) for name in ("test", "law"))
    for row in table.to_dict("records"):
        place = laws.index(row["law"]), tests.index(row["test"])
        colour, _ = COLOURS[row["describes_data"]]
        filled = row["sampled_well"] == "yes"
        axes.plot(*place, "o", ms=11, mec=colour, mfc=colour if filled else "none", mew=1.6)
        if row["elpd_difference"] > 0:
            axes.annotate(
                f"{row['elpd_difference']:.0f}",
                place,
                (10, 0),
                textcoords="offset points",
                va="center",
                fontsize=9,
            )
    axes.set_xticks(range(len(laws)), [law.replace("_", "\n") for law in laws])
    axes.set_yticks(range(len(tests)), tests)
    axes.set_xlim(-0.6, len(laws) - 0.4)
    axes.set_ylim(len(tests) - 0.4, -0.6)
    axes.grid(color=GREY, linewidth=0.4)
    axes.set_axisbelow(True)
