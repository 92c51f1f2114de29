"""What comparisons found: tables, sentences and files."""

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.checks.fit_checks import PARETO_K_LIMIT
from pyburgers.common.atomic_files import write_json, write_text
from pyburgers.common.numbers import count_points
from pyburgers.comparison.by_points import (
    BoolArray,
    Comparison,
    elpd_difference,
    has_several_tests,
    standard_error,
)
from pyburgers.comparison.by_tests import LARGEST_ERROR, ComparisonByTest, difference_by_test
from pyburgers.comparison.marginal_likelihood import LogIntegral
from pyburgers.comparison.same_data import data_hash
from pyburgers.fitting.fit import Fit

NO_DIFFERENCE = 4.0
"""Difference of elpd below which fits predict alike (Sivula et al. 2020, arXiv:2008.10296)."""

CLEAR = 2.0
"""Standard errors from which a larger difference counts as one."""

COMPARISON_TEXT = (
    "Measure: expected log predictive density of each point given all others (elpd), by importance "
    "sampling from the fit of all points; higher is better. Fits whose elpd differs by less than "
    f"{NO_DIFFERENCE:g} predict alike; a larger difference counts from {CLEAR:g} of its standard "
    f"errors on. Points with a Pareto k above {PARETO_K_LIMIT} are not reliable; pyburgers compare "
    "leaves them out by fitting again. Weights are those of the best mixture of the fits, and "
    "arbitrary between fits that predict alike."
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
            "sentences": list(sentences(comparison)),
        },
    )


def sentences(comparison: Comparison) -> tuple[str, ...]:
    """One sentence for each pair of fits, then one for points that cannot be trusted."""
    pairs = [
        pair_sentence(better, worse, *elpd_difference(results[better], results[worse]))
        for results in [comparison.results]
        for better, worse in itertools.combinations(results, 2)
    ]
    doubts = [
        f"{name}: its elpd may be far off, because of {_numbered(result.unreliable)} with a Pareto "
        f"k above {PARETO_K_LIMIT}, not left out by fitting again."
        for name, result in comparison.results.items()
        if result.unreliable.any()
    ]
    return (*pairs, *doubts)


def pair_sentence(
    better: str, worse: str, difference: float, error: float, *, what: str = "these data"
) -> str:
    """Say which of two fits predicts better.

    Parameters
    ----------
    better, worse : str
        Their names.
    difference, error : float
        Of their elpd, and its standard error.
    what : str
        What they predict.
    """
    numbers = f"difference of elpd {difference:.1f}, standard error {error:.1f}"
    if difference < NO_DIFFERENCE:
        return f"{better} and {worse} predict {what} alike ({numbers})."
    if difference < CLEAR * error:
        return (
            f"{better} predicts {what} better than {worse}, but the difference is within "
            f"{CLEAR:g} standard errors and decides nothing ({numbers})."
        )
    return f"{better} predicts {what} clearly better than {worse} ({numbers})."


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
        said = []
        for (better, one), (worse, other) in itertools.combinations(results, 2):
            difference, over_tests, monte_carlo = difference_by_test(one, other)
            error = float(np.hypot(over_tests, monte_carlo))
            said.append(pair_sentence(better, worse, difference, error, what="left-out tests"))
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
            "sentences": list(sentences_by_test(comparison)),
        },
    )


def _numbered(flags: BoolArray) -> str:
    """Say how many points, and which, numbered from 1."""
    numbers = ", ".join(str(k + 1) for k in np.flatnonzero(flags))
    return f"{count_points(int(flags.sum()))} (number {numbers})"


def origins(fits: Mapping[str, Fit], *, command: str) -> dict[str, Any]:
    """Return what the record of a comparison says about where its numbers come from.

    Parameters
    ----------
    fits : mapping of str to Fit
        The fits that were compared.
    command : str
        What regenerates the comparison.
    """
    return {
        "command": command,
        "fits": {
            name: {
                "directory": one.directory.path.name,
                "fingerprint": one.manifest["fingerprint"],
                "variant": one.variant.record(),
                **({"pooling": one.problem.pooling.record()} if one.is_joint else {}),
            }
            for name, one in fits.items()
        },
        "data": data_hash(next(iter(fits.values()))),
    }


def _record(integral: LogIntegral) -> dict[str, float]:
    return {"log": integral.value, "error": integral.error}
