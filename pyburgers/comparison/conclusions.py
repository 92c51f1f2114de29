"""What comparisons come to: every two fits, and sentences about them."""

import itertools
from collections.abc import Mapping

import numpy as np

from pyburgers.checks.fit_checks import PARETO_K_LIMIT
from pyburgers.common.array_types import BoolArray
from pyburgers.common.draws import FloatArray
from pyburgers.common.units import count_points
from pyburgers.comparison.pairs import (
    LEAST_UNITS,
    Pair,
    doubt_about,
    weight_sentence,
)
from pyburgers.comparison.results import (
    LARGEST_ERROR,
    Comparison,
    ComparisonByTest,
    difference_by_test,
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
