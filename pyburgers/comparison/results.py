"""What comparisons found: tables, sentences, figures and files."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pyburgers.checks.fit_checks import PARETO_K_LIMIT
from pyburgers.common.atomic_files import write_json, write_text
from pyburgers.common.units import count_points
from pyburgers.comparison.by_points import (
    BoolArray,
    Comparison,
    LeaveOneOut,
    elpd_difference,
    has_several_tests,
)
from pyburgers.comparison.by_tests import LARGEST_ERROR, ComparisonByTest, difference_by_test
from pyburgers.comparison.marginal_likelihood import LogIntegral
from pyburgers.comparison.pairs import CLEAR, NO_DIFFERENCE, Pair, weight_sentence
from pyburgers.comparison.same_data import origins, standard_error
from pyburgers.drawing.style import (
    BLACK,
    BLUE,
    GREEN,
    ORANGE,
    PURPLE,
    VERMILION,
    few_ticks,
    style,
)
from pyburgers.fitting.fit import Fit

FloatArray = npt.NDArray[np.float64]

COMPARISON_TEXT = (
    "Measure: expected log predictive density of each point given all others (elpd), by importance "
    "sampling from the fit of all points; higher is better. A fit is better by a difference of "
    f"{NO_DIFFERENCE:g} or more that is also {CLEAR:g} or more of its standard errors; fits are "
    f"alike where even {CLEAR:g} standard errors further apart they would differ by less than "
    f"{NO_DIFFERENCE:g}; else the data cannot tell. Points with a Pareto k above {PARETO_K_LIMIT} "
    "are not reliable; pyburgers compare leaves them out by fitting again. Weights are those of "
    "the best mixture of the fits, and arbitrary between fits that predict alike."
)

BY_TEST_TEXT = (
    "Measure: log density of each whole test given the others, stresses in Pa; higher is better. "
    "The fits were repeated without each test, and the density is a ratio of marginal likelihoods, "
    "by bridge sampling. A test's own parameters are averaged under their priors, which costs as "
    "much as the test narrows them."
)


def comparison_table(comparison: Comparison) -> pd.DataFrame:
    """Numbers of a comparison, a row for each fit, the best first.

    Returns
    -------
    DataFrame
        Index name; columns variant (what differs from the standard model), elpd, se (its standard
        error), difference (to the best), difference_se, weight, n_effective, high_k (points with a
        Pareto k above 0.7), left_out (of these, left out in earnest).
    """
    best = next(iter(comparison.results.values()))
    rows = {}
    for (name, result), weight in zip(comparison.results.items(), comparison.weights, strict=True):
        difference, difference_se = elpd_difference(result, best)
        rows[name] = {
            "variant": comparison.variants[name],
            "elpd": result.total,
            "se": standard_error(result.elpd),
            "difference": difference,
            "difference_se": difference_se,
            "weight": float(weight),
            "n_effective": result.n_effective,
            "high_k": int(np.sum(result.pareto_k > PARETO_K_LIMIT)),
            "left_out": int(result.exact.sum()),
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("fit")


def pointwise_table(comparison: Comparison) -> pd.DataFrame:
    """Return every point's numbers, a row for each point.

    Returns
    -------
    DataFrame
        Index point (from 1); columns test (of joint fits only), strain or time_s, and for each fit
        ``NAME elpd``, ``NAME pareto_k`` and ``NAME left_out``.
    """
    columns: dict[str, npt.NDArray[Any]] = {}
    if has_several_tests(comparison):
        columns["test"] = comparison.position["test"].to_numpy()
    columns[comparison.clock.column] = comparison.position.to_numpy()
    for name, result in comparison.results.items():
        columns |= {
            f"{name} elpd": result.elpd,
            f"{name} pareto_k": result.pareto_k,
            f"{name} left_out": result.exact,
        }
    table = pd.DataFrame(columns)
    table.index = pd.RangeIndex(1, len(table) + 1, name="point")
    return table


def save_comparison(
    comparison: Comparison, fits: Mapping[str, Fit], folder: Path, *, command: str
) -> None:
    """Write ``comparison.csv``, ``pointwise.csv`` and ``comparison.json``.

    Parameters
    ----------
    comparison : Comparison
        What to write.
    fits : mapping of str to Fit
        The fits that were compared.
    folder : Path
        An existing folder.
    command : str
        What regenerates the comparison.
    """
    write_text(folder / "comparison.csv", comparison_table(comparison).to_csv())
    write_text(folder / "pointwise.csv", pointwise_table(comparison).to_csv())
    write_json(
        folder / "comparison.json",
        {
            **origins(fits, command=command),
            "reliable": comparison.reliable,
            "pairs": _pair_records(pairs(comparison)),
            "sentences": list(sentences(comparison)),
        },
    )


def pairs(comparison: Comparison) -> tuple[Pair, ...]:
    """Return every two fits of a comparison, the better first."""
    return tuple(
        Pair(better, worse, *elpd_difference(one, other))
        for (better, one), (worse, other) in itertools.combinations(comparison.results.items(), 2)
    )


def pairs_by_test(comparison: ComparisonByTest) -> tuple[Pair, ...]:
    """Return the same by whole tests; errors hold those of Monte Carlo."""
    found = []
    for (better, one), (worse, other) in itertools.combinations(comparison.results.items(), 2):
        difference, over_tests, monte_carlo = difference_by_test(one, other)
        found.append(Pair(better, worse, difference, float(np.hypot(over_tests, monte_carlo))))
    return tuple(found)


def _about_weights(elpd: Mapping[str, FloatArray], weights: FloatArray, unit: str) -> list[str]:
    """Sentences about fits that weigh more than the best one, which comes first."""
    (best, first), *others = elpd.items()
    said = [
        weight_sentence(best, name, (float(weights[0]), float(own)), of_one - first, unit=unit)
        for (name, of_one), own in zip(others, weights[1:], strict=True)
    ]
    return [sentence for sentence in said if sentence is not None]


def _pair_records(compared: Sequence[Pair]) -> list[dict[str, Any]]:
    return [{**asdict(pair), "outcome": pair.outcome} for pair in compared]


def sentences(comparison: Comparison) -> tuple[str, ...]:
    """One sentence for each pair of fits, then those about weights and doubtful points."""
    doubts = [
        f"{name}: its elpd may be far off, because of {_numbered(result.unreliable)} with a Pareto "
        f"k above {PARETO_K_LIMIT}, not left out by fitting again."
        for name, result in comparison.results.items()
        if result.unreliable.any()
    ]
    said = [pair.sentence() for pair in pairs(comparison)]
    elpd = {name: one.elpd for name, one in comparison.results.items()}
    return (*said, *_about_weights(elpd, comparison.weights, "points"), *doubts)


def table_of_fits(comparison: ComparisonByTest) -> pd.DataFrame:
    """Numbers of a comparison, a row for each fit, the best first.

    Returns
    -------
    DataFrame
        Index fit; columns variant (what differs from the standard model), elpd (sum over the tests
        left out), monte_carlo_error (its own), per_point, difference (to the best), difference_se
        (over the tests), difference_monte_carlo_error, weight.
    """
    best = next(iter(comparison.results.values()))
    rows = {}
    for (name, result), weight in zip(comparison.results.items(), comparison.weights, strict=True):
        difference, over_tests, monte_carlo = difference_by_test(result, best)
        rows[name] = {
            "variant": comparison.variants[name],
            "elpd": result.total,
            "monte_carlo_error": result.total_error,
            "per_point": result.total / int(result.n_points.sum()),
            "difference": difference,
            "difference_se": over_tests,
            "difference_monte_carlo_error": monte_carlo,
            "weight": float(weight),
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("fit")


def table_of_tests(comparison: ComparisonByTest) -> pd.DataFrame:
    """Log density of every left-out test under every fit.

    Returns
    -------
    DataFrame
        Index test; columns points, and for each fit ``NAME elpd``, ``NAME monte_carlo_error`` and
        ``NAME per_point``.
    """
    first = next(iter(comparison.results.values()))
    columns: dict[str, npt.NDArray[Any]] = {"points": first.n_points}
    for name, result in comparison.results.items():
        columns |= {
            f"{name} elpd": result.elpd,
            f"{name} monte_carlo_error": result.error,
            f"{name} per_point": result.elpd / result.n_points,
        }
    return pd.DataFrame(columns, index=pd.Index(first.tests, name="test"))


def sentences_by_test(comparison: ComparisonByTest) -> tuple[str, ...]:
    """One sentence for each pair of fits, or for a single one, then those of what is doubtful."""
    results = list(comparison.results.items())
    if len(results) == 1:
        ((name, only),) = results
        said = [
            f"{name}: the tests have, each given the others, a log density of {only.total:.1f} "
            f"together, Monte Carlo error {only.total_error:.1f}; it means something only beside "
            "that of another fit of the same tests."
        ]
    else:
        said = [pair.sentence("left-out tests") for pair in pairs_by_test(comparison)]
        elpd = {name: one.elpd for name, one in results}
        said += _about_weights(elpd, comparison.weights, "tests")
        if len(results[0][1].tests) == 2:
            said.append(
                "Of two tests the standard error says little: what the one tells about the other "
                "is as much as the other tells about it."
            )
    for name, result in results:
        said += [f"{name}: {doubt}" for doubt in result.doubts]
        said += [
            f"{name}: the log density of {test} has a Monte Carlo error of {error:.1f}, more than "
            f"{LARGEST_ERROR:g}; run the fit and those without single tests for longer."
            for test, error in zip(result.tests, result.error, strict=True)
            if error > LARGEST_ERROR
        ]
    return tuple(said)


def save_comparison_by_test(
    comparison: ComparisonByTest, joints: Mapping[str, Fit], folder: Path, *, command: str
) -> None:
    """Write ``comparison.csv``, ``left_out_tests.csv`` and ``comparison.json``.

    Parameters
    ----------
    comparison : ComparisonByTest
        What to write.
    joints : mapping of str to Fit
        The fits that were compared.
    folder : Path
        An existing folder.
    command : str
        What regenerates the comparison.
    """
    write_text(folder / "comparison.csv", table_of_fits(comparison).to_csv())
    write_text(folder / "left_out_tests.csv", table_of_tests(comparison).to_csv())
    write_json(
        folder / "comparison.json",
        {
            **origins(joints, command=command),
            "marginal_likelihoods": {
                name: {
                    "all": _record(result.all_tests),
                    "without": dict(zip(result.tests, map(_record, result.without), strict=True)),
                }
                for name, result in comparison.results.items()
            },
            "reliable": comparison.reliable,
            "pairs": _pair_records(pairs_by_test(comparison)),
            "sentences": list(sentences_by_test(comparison)),
        },
    )


def _numbered(flags: BoolArray) -> str:
    """Say how many points, and which, numbered from 1."""
    numbers = ", ".join(str(k + 1) for k in np.flatnonzero(flags))
    return f"{count_points(int(flags.sum()))} (number {numbers})"


def _record(integral: LogIntegral) -> dict[str, float]:
    return {"log": integral.value, "error": integral.error}


FIT_COLOURS = (VERMILION, BLUE, GREEN, PURPLE, ORANGE)
FIT_MARKERS = ("o", "s", "^", "D", "v")
TEST_SHIFT = 0.12
"""Distance of the fits of a test from each other; tests are 1 apart."""

COMPARISON_CAPTION = (
    "Above: log predictive density of each left-out point under a fit less that under the best "
    "one; below zero the best fit predicts the point better. Below: the same added up along the "
    "test, so that its steps show which part of the curve decides and its end is the difference of "
    "elpd. A black ring marks a point that was left out by fitting again, a cross one whose "
    "importance weights are too uneven to be trusted (Pareto k above 0.7)."
)

LEFT_OUT_CAPTION = (
    "Log density of each test given the others, under a fit less that under the best one; below "
    "zero the best fit predicts the test better. Of a fit alone: per reading. Bars are Monte Carlo "
    "errors."
)


def pointwise_differences(comparison: Comparison) -> Figure:
    """Draw differences of the elpd to the best fit along each test, by point and added up."""
    (best_name, best), *others = comparison.results.items()
    tests = _tests(comparison)
    along = comparison.position.to_numpy() * comparison.clock.display_factor
    with style():
        figure = Figure(figsize=(3.4 + 3.4 * len(tests), 5.4), layout="constrained")
        panels = figure.subplots(2, len(tests), sharex="col", sharey="row", squeeze=False)
        for column, (test, here) in enumerate(tests.items()):
            points, sums = panels[:, column]
            for k, (name, result) in enumerate(others):
                _draw_differences(points, along, here, k, f"{name} less {best_name}", result, best)
                sums.step(
                    along[here],
                    np.cumsum((result.elpd - best.elpd)[here]),
                    where="post",
                    color=FIT_COLOURS[k % len(FIT_COLOURS)],
                    linewidth=1.4,
                )
            for axes in (points, sums):
                axes.axhline(0.0, color=BLACK, linewidth=0.8)
                axes.yaxis.set_major_locator(few_ticks(5))
            points.set_title(test, loc="left")
            sums.set_xlabel(comparison.clock.label)
        panels[0, 0].set_ylabel("difference of a point's\nlog density (–)")
        panels[1, 0].set_ylabel("added up (–)")
        figure.legend(
            *panels[0, 0].get_legend_handles_labels(),
            loc="outside upper left",
            ncols=min(2, len(others)),
        )
    return figure


def _tests(comparison: Comparison) -> dict[str, BoolArray]:
    """Return the points of each test, by its name where there are several."""
    if not has_several_tests(comparison):
        return {"": np.ones(comparison.position.size, dtype=bool)}
    of_point = comparison.position["test"].to_numpy()
    return {str(name): of_point == name for name in dict.fromkeys(of_point)}


def _draw_differences(
    axes: Axes,
    along: FloatArray,
    here: BoolArray,
    number: int,
    label: str,
    result: LeaveOneOut,
    best: LeaveOneOut,
) -> None:
    """Draw what one fit loses to the best at the points of a test, and mark doubtful points."""
    difference = result.elpd - best.elpd
    axes.plot(
        along[here],
        difference[here],
        linestyle="none",
        marker=FIT_MARKERS[number % len(FIT_MARKERS)],
        markersize=4,
        markeredgewidth=0,
        alpha=0.8,
        color=FIT_COLOURS[number % len(FIT_COLOURS)],
        label=label,
    )
    exact = here & (result.exact | best.exact)
    axes.plot(along[exact], difference[exact], "o", color=BLACK, markersize=9, fillstyle="none")
    doubtful = here & (result.unreliable | best.unreliable)
    axes.plot(along[doubtful], difference[doubtful], "x", color=BLACK, markersize=8)


def left_out_tests(comparison: ComparisonByTest) -> Figure:
    """Draw the log density of each left-out test: less that of the best fit, or of a fit alone."""
    (best_name, best), *others = comparison.results.items()
    if others:
        shown = {
            f"{name} less {best_name}": (one.elpd - best.elpd, np.hypot(one.error, best.error))
            for name, one in others
        }
    else:
        shown = {best_name: (best.elpd / best.n_points, best.error / best.n_points)}
    lines = np.arange(len(best.tests), dtype=np.float64)
    with style():
        figure = Figure(figsize=(6.8, 1.8 + 0.45 * lines.size), layout="constrained")
        axes = figure.subplots()
        for k, (label, (value, error)) in enumerate(shown.items()):
            axes.errorbar(
                value,
                lines + TEST_SHIFT * (k - (len(shown) - 1) / 2),
                xerr=error,
                linestyle="none",
                marker=FIT_MARKERS[k % len(FIT_MARKERS)],
                markersize=5,
                color=FIT_COLOURS[k % len(FIT_COLOURS)],
                label=label,
            )
        if others:
            axes.axvline(0.0, color=BLACK, linewidth=0.8)
        axes.set_xlabel(
            "difference of the log density of the left-out test (–)"
            if others
            else "log density of the left-out test per reading (stress in Pa)"
        )
        axes.set_yticks(lines, list(best.tests))
        axes.set_ylim(lines.size - 0.5, -0.5)
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure
