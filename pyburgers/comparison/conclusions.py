"""What comparisons come to: every two fits, sentences about them, and tables."""

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.checks.fit_checks import PARETO_K_LIMIT
from pyburgers.common.array_types import BoolArray
from pyburgers.common.draws import FloatArray
from pyburgers.common.units import count_points
from pyburgers.comparison.results import (
    LARGEST_ERROR,
    LEAST_UNITS,
    Comparison,
    ComparisonByTest,
    Pair,
    difference_by_test,
    doubt_about,
    has_several_tests,
    standard_error,
    weight_sentence,
)


def pairs_by_test(comparison: ComparisonByTest) -> tuple[Pair, ...]:
    """Return the same by whole tests; errors hold those of Monte Carlo."""
    found = []
    for (better, one), (worse, other) in itertools.combinations(comparison.results.items(), 2):
        difference, over_tests, monte_carlo = difference_by_test(one, other)
        n_tests = len(one.tests)
        doubt = doubt_about(
            f"{n_tests} {one.kind}",
            n_tests,
            [name for name, result in ((better, one), (worse, other)) if result.doubts],
        )
        error = float(np.hypot(over_tests, monte_carlo))
        found.append(Pair(better, worse, difference, error, doubt))
    return tuple(found)


def sentences(comparison: Comparison) -> tuple[str, ...]:
    """One sentence for each pair of fits, then those about weights and doubtful points."""
    doubts = []
    for name, result in comparison.results.items():
        doubts += [f"{name}: {doubt}" for doubt in (*result.doubts, *result.notes)]
        if result.unreliable.any():
            doubts.append(
                f"{name}: its elpd may be far off, because of {_numbered(result.unreliable)} with "
                f"a Pareto k above {PARETO_K_LIMIT}, not left out by fitting again; a fit is "
                "called better, or two alike, only where all other points say so by themselves."
            )
    said = [pair.sentence() for pair in comparison.pairs()]
    elpd = {name: one.elpd for name, one in comparison.results.items()}
    return (
        *said,
        *comparison.gap_sentences(),
        *_about_weights(elpd, comparison.weights, "points"),
        *doubts,
    )


def sentences_by_test(comparison: ComparisonByTest) -> tuple[str, ...]:
    """One sentence for each pair of fits, or for a single one, then those of what is doubtful."""
    results = list(comparison.results.items())
    kind = results[0][1].kind
    if len(results) == 1:
        ((name, only),) = results
        said = [
            f"{name}: the {kind} have, each given the others, a log density of {only.total:.1f} "
            f"together, Monte Carlo error {only.total_error:.1f}; it means something only beside "
            "that of another fit of the same tests."
        ]
    else:
        said = [pair.sentence(f"left-out {kind}") for pair in pairs_by_test(comparison)]
        elpd = {name: one.elpd for name, one in results}
        said += _about_weights(elpd, comparison.weights, kind)
        if len(results[0][1].tests) < LEAST_UNITS:
            said.append(
                f"Of two {kind} the standard error says nothing: what the one tells about the "
                "other is as much as the other tells about it."
            )
    for name, result in results:
        said += [f"{name}: {doubt}" for doubt in (*result.doubts, *result.notes)]
        said += [
            f"{name}: the log density of {test} has a Monte Carlo error of {error:.1f}, more than "
            f"{LARGEST_ERROR:g}; run the fit and those without single {kind} for longer."
            for test, error in zip(result.tests, result.error, strict=True)
            if error > LARGEST_ERROR
        ]
    return tuple(said)


def _about_weights(elpd: Mapping[str, FloatArray], weights: FloatArray, unit: str) -> list[str]:
    """Sentences about fits that weigh more than the best one, which comes first."""
    (best, first), *others = elpd.items()
    said = [
        weight_sentence(best, name, (float(weights[0]), float(own)), of_one - first, unit=unit)
        for (name, of_one), own in zip(others, weights[1:], strict=True)
    ]
    return [sentence for sentence in said if sentence is not None]


def _numbered(flags: BoolArray) -> str:
    """Say how many points, and which, numbered from 1."""
    numbers = ", ".join(str(k + 1) for k in np.flatnonzero(flags))
    return f"{count_points(int(flags.sum()))} (number {numbers})"


def comparison_table(comparison: Comparison) -> pd.DataFrame:
    """Return the numbers of a comparison, a row for each fit, the best first.

    Columns are variant, elpd, se, difference (to the best), difference_se, weight, n_effective,
    high_k (points with a Pareto k above 0.7), left_out (of these, left out in earnest).
    """
    best = next(iter(comparison.results.values()))
    rows = {}
    for (name, result), weight in zip(comparison.results.items(), comparison.weights, strict=True):
        pointwise = result.elpd - best.elpd
        rows[name] = {
            "variant": comparison.variants[name],
            "elpd": result.total,
            "se": standard_error(result.elpd),
            "difference": float(pointwise.sum()),
            "difference_se": standard_error(pointwise),
            "weight": float(weight),
            "n_effective": result.n_effective,
            "high_k": int(np.sum(result.pareto_k > PARETO_K_LIMIT)),
            "left_out": int(result.exact.sum()),
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("fit")


def pointwise_table(comparison: Comparison) -> pd.DataFrame:
    """Return every point's numbers, a row for each point, numbered from 1.

    Columns are test (of joint fits only), strain or time_s, and for each fit ``NAME elpd``,
    ``NAME pareto_k`` and ``NAME left_out``.
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


def table_of_fits(comparison: ComparisonByTest) -> pd.DataFrame:
    """Return the numbers of a comparison by test, a row for each fit, the best first.

    Columns are variant, elpd (sum over the tests left out), monte_carlo_error, per_point,
    difference (to the best), difference_se (over the tests), difference_monte_carlo_error,
    weight.
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
    """Return the log density of every left-out test under every fit, a row for each test.

    Columns are points, and for each fit ``NAME elpd``, ``NAME monte_carlo_error``, ``NAME
    per_point``.
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
