"""What comparisons come to: every two fits, sentences, tables, and fits under neighbouring laws."""

import itertools
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.checks.fit_checks import PARETO_K_LIMIT, CheckKind, Outcome
from pyburgers.common.array_types import BoolArray
from pyburgers.common.draws import FloatArray
from pyburgers.common.units import count_points
from pyburgers.comparison.results import (
    CLEAR,
    LARGEST_ERROR,
    LEAST_UNITS,
    Comparison,
    ComparisonByTest,
    Pair,
    clear_errors,
    difference_by_test,
    doubt_about,
    has_several_tests,
    standard_error,
    weight_sentence,
)
from pyburgers.fitting.fit import Fit
from pyburgers.model.display import shown_quantity
from pyburgers.model.neighbouring_laws import neighbouring_laws, redefined


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
        # Errors of draws are known well, however few the tests.
        off = np.hypot(clear_errors(n_tests) * over_tests, CLEAR * monte_carlo)
        clear = float(off) / error if error > 0 else CLEAR
        found.append(Pair(better, worse, difference, error, doubt, clear))
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
    """Return the numbers of a comparison, as `pyburgers compare` prints them.

    Parameters
    ----------
    comparison : Comparison
        Of `pyburgers.compare`.

    Returns
    -------
    DataFrame
        A row for each fit, the best first: ``variant``, ``elpd`` and its standard error ``se``,
        ``difference`` from the best and ``difference_se``, ``weight``, ``n_effective``. ``high_k``
        counts points with a Pareto k above 0.7, ``left_out`` those of them that were fitted
        without.

    Examples
    --------
    >>> table = pyburgers.comparison_table(pyburgers.compare({"one": fit, "same": fit}))
    >>> float(table.loc["same", "difference"])
    0.0
    """
    best = next(iter(comparison.results.values()))
    rows = {}
    for (name, result), weight in zip(comparison.results.items(), comparison.weights, strict=True):
        pointwise = result.elpd - best.elpd
        rows[name] = {
            "variant": comparison.variants[name],
            "elpd": result.total,
            "se": standard_error(result.elpd, comparison.segment),
            "difference": float(pointwise.sum()),
            "difference_se": standard_error(pointwise, comparison.segment),
            "weight": float(weight),
            "n_effective": result.n_effective,
            "high_k": int(np.sum(result.pareto_k > PARETO_K_LIMIT)),
            "left_out": int(result.exact.sum()),
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("fit")


def pointwise_table(comparison: Comparison) -> pd.DataFrame:
    """Return every point's numbers, a row for each point, numbered from 1."""
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
    """Return the numbers of a comparison by test, a row for each fit, the best first."""
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
    """Return the log density of every left-out test under every fit, a row for each test."""
    first = next(iter(comparison.results.values()))
    columns: dict[str, npt.NDArray[Any]] = {"points": first.n_points}
    for name, result in comparison.results.items():
        columns |= {
            f"{name} elpd": result.elpd,
            f"{name} monte_carlo_error": result.error,
            f"{name} per_point": result.elpd / result.n_points,
        }
    return pd.DataFrame(columns, index=pd.Index(first.tests, name="test"))


MOVED = " moved"
"""What names of columns with differences end with."""


def what_a_yes_leaves_open(fit: Fit) -> tuple[str, ...]:
    """Return a sentence on laws that a yes does not exclude, then commands; none without a yes."""
    if fit.verdicts()[CheckKind.DESCRIPTION].outcome is not Outcome.YES:
        return ()
    problem = (fit.whole or fit).problem
    laws = neighbouring_laws(problem.variant, *problem.experiments)
    if not laws:
        return ()
    said = (
        f"This yes does not exclude {', '.join(laws)}: under another law parameters may lie "
        "outside of the intervals of this fit."
    )
    if fit.is_joint or fit.is_part:
        return (f"{said} Fit the same tests with --variant {laws[0]} and compare.",)
    run = fit.directory
    other = f"{run.path}_{laws[0].replace('=', '_')}"
    inputs: list[str | Path] = [run.test_file(problem.name), "--priors", run.priors_file]
    return (
        f"{said} To see how far each moves:",
        _command("fit", *inputs, "--variant", laws[0], "--out", Path(other)),
        _command("compare", run.path, Path(other)),
    )


def _command(*words: str | Path) -> str:
    """Return a command, paths as they are seen from the working directory."""
    here = Path.cwd()
    near = (
        word.relative_to(here) if isinstance(word, Path) and word.is_relative_to(here) else word
        for word in words
    )
    return shlex.join(["pyburgers", *map(str, near)])


def parameter_shifts(fits: Mapping[str, Fit]) -> pd.DataFrame:
    """Return mean and sd of the first fit, and means and moves of others, of what all share."""
    (_, first), *others = fits.items()
    table = first.si_summary()[["unit", "mean", "sd"]]
    for name, other in others:
        mean = other.si_summary()["mean"].rename(f"{name} mean")
        apart = redefined(first.variant, other.variant) | _of_other_units(first, other)
        is_apart = mean.index.str.partition("[").get_level_values(0).isin(apart)
        table = table.join(mean[~is_apart], how="inner")
        table[f"{name}{MOVED}"] = (table[f"{name} mean"] - table["mean"]) / table["sd"]
    return table.rename_axis("parameter")


def _of_other_units(one: Fit, other: Fit) -> frozenset[str]:
    """Return beta if A has the unit Pa^-n of an n that only one fit knows, or knows otherwise."""
    exponents = [fit.problem.priors[0]["stress_exponent"] for fit in (one, other)]
    known = {prior.location if prior.is_fixed else None for prior in exponents}
    return frozenset({"beta"} if len(known) > 1 else ())


def shift_sentences(fits: Mapping[str, Fit]) -> tuple[str, ...]:
    """Say how far each parameter moves from the first fit to each other one, the farthest first."""
    table = parameter_shifts(fits).filter(like=MOVED)
    sentences = []
    for name in table if len(table) else ():
        by = table[name].sort_values(key=abs, ascending=False)
        moves = ", ".join(
            f"{shown_quantity(str(k)).label} {f'{one:+.1f}' if abs(one) >= 0.05 else '0'}"
            for k, one in by.items()
        )
        other = str(name).removesuffix(MOVED)
        sentences.append(
            f"From {next(iter(fits))} to {other} parameters move by, in their sd: {moves}."
        )
    return tuple(sentences)
