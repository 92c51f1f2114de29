"""What comparisons come to: every two fits, and sentences about them."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pyburgers.checks.fit_checks import PARETO_K_LIMIT
from pyburgers.common.units import count_points
from pyburgers.comparison.pairs import (
    LEAST_UNITS,
    Pair,
    PairOutcome,
    doubt_about,
    weight_sentence,
)
from pyburgers.comparison.results import (
    LARGEST_ERROR,
    Comparison,
    ComparisonByTest,
    LeaveOneOut,
    difference_by_test,
    standard_error,
)

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


def pairs(comparison: Comparison) -> tuple[Pair, ...]:
    """Return every two fits of a comparison, the better first."""
    return tuple(
        pair_of({better: one, worse: other})
        for (better, one), (worse, other) in itertools.combinations(comparison.results.items(), 2)
    )


def pair_of(results: Mapping[str, LeaveOneOut]) -> Pair:
    """Relate two fits of the same points, by name and the better first.

    Where points may be far off, what the others say has to be the same.
    """
    (better, one), (worse, other) = results.items()
    failed = [name for name, result in results.items() if result.doubts]
    unreliable = one.unreliable | other.unreliable
    pair = _of_points(better, worse, one.elpd - other.elpd, failed)
    rest = _of_points(better, worse, (one.elpd - other.elpd)[~unreliable], failed)
    same = rest.outcome is pair.outcome and (
        rest.difference > 0 or pair.outcome is PairOutcome.ALIKE
    )
    if pair.outcome is PairOutcome.CANNOT_TELL or same:
        return pair
    number = count_points(int(unreliable.sum()))
    return replace(pair, doubt=f"it hangs on {number} with a Pareto k above {PARETO_K_LIMIT}")


def _of_points(better: str, worse: str, pointwise: FloatArray, failed: Sequence[str]) -> Pair:
    """Relate two fits by their difference at some points."""
    doubt = doubt_about(count_points(pointwise.size), pointwise.size, failed)
    return Pair(better, worse, float(pointwise.sum()), standard_error(pointwise), doubt)


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
    said = [pair.sentence() for pair in pairs(comparison)]
    elpd = {name: one.elpd for name, one in comparison.results.items()}
    return (
        *said,
        *about_gaps(comparison.correlated, len(elpd)),
        *_about_weights(elpd, comparison.weights, "points"),
        *doubts,
    )


def about_gaps(correlated: Sequence[str], n_fits: int) -> tuple[str, ...]:
    """Say what elpd compares if residuals correlate in some fits, the named, and not in all."""
    if not 0 < len(correlated) < n_fits:
        return ()
    return (
        "The expected log predictive density (elpd) is that of each reading given all others, "
        f"later ones as well: where residuals correlate ({', '.join(correlated)}), what its two "
        "neighbours missed is taken over into it, and a gap is filled whatever the law. So it is "
        "no measure of how close a law comes by itself, nor of how well it predicts another test.",
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
