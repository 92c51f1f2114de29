"""What a fit leaves over, beside what replicated data leave over: the checks of the description.

At each draw a number such as the autocorrelation of the residuals is taken of the data and of the
replicated data of that draw (a posterior predictive check of a realised discrepancy, Gelman, Meng
and Stern 1996, Statistica Sinica 6, 733-807). All such numbers of all tests of a fit are one
family: the probability of the worst is compared with that of the worst of each replicate that is
fitted as the data were (`pyburgers.checks.refits`), so that in 1 of 100 fits at most a correct
model fails any of them (`docs/checks.md`), however many there are, however they hang together and
however far the posterior follows the data.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from pyburgers.checks.fit_checks import CheckedDraws, Finding, Outcome
from pyburgers.checks.refits import refitted_means, refitted_residuals, scale_of
from pyburgers.checks.residual_numbers import (
    TINY,
    autocorrelation,
    largest_residual,
    longest_runs,
    segment_parts,
    signed_ranks,
)
from pyburgers.common.draws import TAIL
from pyburgers.common.units import span_text
from pyburgers.posterior.labelled_draws import CORRELATED, groups_of_tests, response_in
from pyburgers.protocols.protocol import Protocol, protocols

FloatArray = npt.NDArray[np.float64]
Pair: TypeAlias = tuple[FloatArray, FloatArray]

LEVEL = 0.003
"""Family probability at which a discrepancy counts. Simulated fits of correct models have it about
as often as it says (`benchmarks/check_sizes.py`); it is well below 1 in 100 so that the upper
confidence limit of such a count is, too."""

READING_ERROR_FACTOR = 1.5
"""Reading errors are seldom known better: residuals may be as much larger than the stated one."""

AUTOCORRELATION = "autocorrelation"
RUN = "longest run"
SEGMENT_TREND = "trend of a segment"
LARGEST = "largest residual"
SEGMENT_SPREAD = "spread of a segment"
OUTSIDE = "share outside"
OVER_READING_ERROR = "over reading error"

ENOUGH_FOR_SHARES = 10
"""Readings of a test. Of fewer a band of 90 % misses less than one by chance, and even all of one
sign are none too rare: 2 of 2^10 are less than `LEVEL`, 2 of 2^9 more."""

ENOUGH = 5
"""Readings of a test: a line and the size of the noise, which are taken from them, leave two."""

LEAST_READINGS = {
    OUTSIDE: ENOUGH_FOR_SHARES,
    AUTOCORRELATION: ENOUGH_FOR_SHARES,
    RUN: ENOUGH_FOR_SHARES,
    SEGMENT_TREND: ENOUGH,
    LARGEST: ENOUGH,
    SEGMENT_SPREAD: ENOUGH,
    OVER_READING_ERROR: 1,
}
"""Readings without which a discrepancy of a test tells nothing, and is left out. A stated error
needs no other readings to be compared with."""


@dataclass(frozen=True, eq=False)
class Leftover:
    """What a fit leaves over of one test.

    Attributes
    ----------
    name : str
        Of the test.
    group : DataTree
        Its labelled draws.
    protocol : Protocol
        What is observed, along which clock.
    position : array, shape (n,)
        Of the readings on the clock (SI), not decreasing.
    segment : array of int, shape (n,)
        Part of the test that each reading belongs to, from 0.
    quantity : array of int, shape (n,)
        What each reading is of: number in the protocol's `read`.
    observed : array, shape (draws, n)
        Residuals of the data, SI; where readings have errors of their own, over these, times their
        mean. Of several quantities each is weighed by what replicates leave over of it.
    weight : array, shape (n,)
        What residuals are multiplied by for that; 1 where they do not differ.
    discrepancies : dict of str to (array, array)
        Numbers of the data, shape (draws,), and of replicated data that are fitted as the data
        were, shape (replicates, their draws); large ones speak against the model. Only those for
        which there are enough readings.
    """

    name: str
    group: xr.DataTree
    protocol: Protocol[Any]
    position: FloatArray
    segment: npt.NDArray[np.int64]
    quantity: npt.NDArray[np.int64]
    observed: FloatArray
    weight: FloatArray
    discrepancies: dict[str, Pair] = field(repr=False)

    @property
    def residual(self) -> FloatArray:
        """Mean residual of each reading over the draws, shape (n,)."""
        mean: FloatArray = self.observed.mean(axis=0)
        return mean

    def size_text(self, size: float, quantity: int) -> str:
        """Return a size of residuals of a quantity (SI) in its display unit."""
        read = self.protocol.read[quantity]
        return f"{size * read.display_factor:.3g} {read.display_unit}"

    def place(self, first: int, last: int) -> str:
        """Return where readings lie, such as ``strain 5.1 to 6 %``."""
        along = self.group["constant_data"].to_dataset()
        said = self.protocol.place_text(along, first, last)
        if said is not None:
            return said
        clock = self.protocol.clock
        span = span_text(clock.display_factor * self.position[[first, last]], digits=3)
        return f"{clock.name} {span} {clock.display_unit}"


@dataclass(frozen=True, eq=False)
class Judged:
    """Numbers of the data beside those of replicates that are fitted as the data were.

    Attributes
    ----------
    table : DataFrame
        Index discrepancy and test; columns found (mean over the draws), at_most (the mean from
        which on it fails), probability (that a replicate has as much) and family_probability (that
        a replicate has any discrepancy as improbable).
    n_replicates : int
        Number of replicates.
    """

    table: pd.DataFrame
    n_replicates: int

    def outcome(self, row: "pd.Series[float]") -> Outcome:
        """Whether the model is right in a discrepancy.

        It cannot be told where it is beyond all replicates, but these are too few for `LEVEL`.
        """
        if row["family_probability"] <= LEVEL:
            return Outcome.NO
        beyond_all = row["family_probability"] * (self.n_replicates + 1) < 1.5
        return Outcome.CANNOT_TELL if beyond_all else Outcome.YES

    def finding(
        self, row: "pd.Series[float]", table: pd.DataFrame, good: str, bad: str, remedy: str
    ) -> Finding:
        """Put the outcome of a discrepancy into words, its numbers in a table."""
        outcome = self.outcome(row)
        if outcome is Outcome.YES:
            return Finding(outcome, table, good)
        if outcome is Outcome.CANNOT_TELL:
            few = f"{self.n_replicates} draws are too few to tell whether it is chance: "
            return Finding(outcome, table, few + bad, "raise --draws")
        return Finding(outcome, table, bad, remedy)


@dataclass(frozen=True, eq=False)
class Family(Judged):
    """All discrepancies of a fit.

    Attributes
    ----------
    table, n_replicates
        As of every `Judged`.
    tests : dict of str to Leftover
        What is left over of each test.
    """

    tests: Mapping[str, Leftover]


@lru_cache(maxsize=1)
def discrepancies_of(draws: CheckedDraws) -> Family:
    """Compare what a fit leaves over with what fits of replicated data do."""
    groups = groups_of_tests(draws.posterior)
    tests = {name: _leftover(name, group, k) for k, (name, group) in enumerate(groups.items())}
    pairs = {
        (name, test): pair
        for test, leftover in tests.items()
        for name, pair in leftover.discrepancies.items()
    }
    judged = beside_replicates(pairs)
    return Family(judged.table, judged.n_replicates, tests)


def beside_replicates(pairs: Mapping[tuple[str, str], Pair]) -> Judged:
    """Compare numbers of the data with those of replicates that are fitted as the data were.

    Parameters
    ----------
    pairs : mapping of (str, str) to (array, array)
        By discrepancy and test, as `Leftover.discrepancies` has them.
    """
    # Errors as stated are so far below what they may be that they are a family of their own.
    alone = {key: key[0] == OVER_READING_ERROR for key in pairs}
    ordered = {key: np.sort(refits, axis=None) for key, (_, refits) in pairs.items()}
    shares = {
        key: share_as_large(ordered[key], refits).mean(axis=1) for key, (_, refits) in pairs.items()
    }
    least = {
        kind: np.min([shares[key] for key in pairs if alone[key] == kind], axis=0)
        for kind in set(alone.values())
    }
    rows = []
    for key, (found, _) in pairs.items():
        probability = float(share_as_large(ordered[key], found).mean())
        of_family = least[alone[key]]
        rows.append(
            {
                "found": found.mean(),
                "at_most": _largest_mean(ordered[key], found, of_family),
                "probability": probability,
                "family_probability": family_probability(probability, of_family),
            }
        )
    index = pd.MultiIndex.from_tuples(list(pairs), names=["discrepancy", "test"])
    return Judged(pd.DataFrame(rows, index), next(iter(least.values())).size)


def family_probability(probability: float, least: FloatArray) -> float:
    """Probability that the worst discrepancy of a replicate is as improbable.

    Parameters
    ----------
    probability : float
        Of a discrepancy of the data.
    least : array, shape (replicates,)
        Least probability of each replicate that was fitted as the data were.
    """
    return float((1 + np.sum(least <= probability)) / (least.size + 1))


def share_as_large(ordered: FloatArray, found: FloatArray) -> FloatArray:
    """Share of ascending numbers that are as large, what was found counted as one more.

    Returns
    -------
    array, shape of `found`
    """
    below = np.searchsorted(ordered, found, side="left")
    return np.asarray((1.0 + ordered.size - below) / (ordered.size + 1), dtype=np.float64)


def _largest_mean(ordered: FloatArray, found: FloatArray, least: FloatArray) -> float:
    """Return the largest mean of a discrepancy that passes, its spread over the draws as it is.

    Parameters
    ----------
    ordered : array
        A discrepancy of replicates, ascending.
    found : array, shape (draws,)
        Of the data.
    least : array, shape (replicates,)
        As for `family_probability`.
    """
    allowed = np.sort(least)[max(0, int(LEVEL * (least.size + 1)) - 1)]
    about_mean = found - found.mean()
    low, high = (
        float(extreme - spread)
        for extreme, spread in (
            (ordered[0], about_mean.max()),
            (ordered[-1], about_mean.min()),
        )
    )
    while high - low > 1e-3 * abs(high):
        middle = 0.5 * (low + high)
        probability = share_as_large(ordered, about_mean + middle).mean()
        low, high = (middle, high) if probability >= allowed else (low, middle)
    return low


def _leftover(name: str, group: xr.DataTree, number: int) -> Leftover:
    data, model, replicas = (
        response_in(group, part)
        for part in ("observed_data", "model_response", "posterior_predictive")
    )
    along = group["constant_data"].to_dataset()
    protocol = next(
        p
        for p in protocols().values()
        if p.clock.name in group["predictions"].dims and p.response.name == data.name
    )
    position = along[protocol.clock.name].to_numpy()
    segment = (
        along["segment"].to_numpy().astype(np.int64)
        if "segment" in along
        else np.zeros(position.size, dtype=np.int64)
    )
    quantity = (
        along["quantity"].to_numpy().astype(np.int64)
        if "quantity" in along
        else np.zeros(position.size, dtype=np.int64)
    )
    error = along["reading_error"].to_numpy() if "reading_error" in along else None
    spread = along["typical_error"].to_numpy() if "typical_error" in along else error
    observed, replicated = (_by_draw(values - model) for values in (data, replicas))
    weight = _of_one_size(replicated, quantity) if spread is None else spread.mean() / spread
    observed, replicated = observed * weight, replicated * weight
    of_replicas = _by_draw(replicas)
    band = np.quantile(of_replicas, (TAIL, 1.0 - TAIL), axis=0)
    pairs = data_and_refits(
        observed,
        replicated,
        (band - _by_draw(model).mean(axis=0)) * weight,
        partial(_numbers, segment=segment, position=position),
        correlated=CORRELATED in group.children,
    )
    if error is not None:
        over_error = np.sqrt(((observed / error.mean()) ** 2).mean(axis=1))
        n_replicates = len(pairs[OUTSIDE][1])
        pairs[OVER_READING_ERROR] = (
            over_error,
            _sizes_of_errors(n_replicates, position.size, number),
        )
    enough = {key: pair for key, pair in pairs.items() if position.size >= LEAST_READINGS[key]}
    return Leftover(name, group, protocol, position, segment, quantity, observed, weight, enough)


def _of_one_size(replicated: FloatArray, quantity: npt.NDArray[np.int64]) -> FloatArray:
    """Weights of readings, shape (n,), that make residuals of all quantities as large."""
    sizes = {k: float(np.sqrt((replicated[:, quantity == k] ** 2).mean())) for k in set(quantity)}
    largest = max(sizes.values())
    return np.array([largest / max(sizes[k], TINY) for k in quantity])


def data_and_refits(
    observed: FloatArray,
    replicated: FloatArray,
    band: FloatArray,
    numbers: Callable[[FloatArray], dict[str, FloatArray]],
    *,
    correlated: bool,
) -> dict[str, Pair]:
    """Numbers of the data, and of replicates that are fitted as the data were.

    Parameters
    ----------
    observed, replicated : array, shape (draws, n)
        Residuals of the data, and of the replicated data of each draw.
    band : array, shape (2, n)
        Predictive band about the mean response of the model; the share of readings outside is one
        more number. Replicates have widths of their own.
    numbers : callable
        Of residuals, shape (any, n); arrays of shape (any,).
    correlated : bool
        Whether residuals correlate in the model.
    """
    means = refitted_means(observed, replicated, correlated=correlated)
    found = numbers(observed)
    parts = [
        {
            name: values.reshape(residuals.shape[:2])
            for name, values in numbers(residuals.reshape(-1, observed.shape[1])).items()
        }
        for residuals in refitted_residuals(observed, means)
    ]
    pairs = {name: (found[name], np.concatenate([part[name] for part in parts])) for name in found}
    pairs[OUTSIDE] = (
        np.full(len(observed), _outside(observed.mean(axis=0), band)),
        _outside(means / scale_of(means), band)[:, None],
    )
    return pairs


def _outside(values: FloatArray, band: FloatArray) -> FloatArray:
    """Share of readings, shape (..., n), outside a band, shape (2, n)."""
    share: FloatArray = ((values < band[0]) | (values > band[1])).mean(axis=-1)
    return share


def _numbers(
    residuals: FloatArray, segment: npt.NDArray[np.int64], position: FloatArray
) -> dict[str, FloatArray]:
    """Discrepancies that residuals alone say, each of shape (draws,)."""
    joined = np.diff(segment) == 0
    trend, spread = segment_parts(residuals, segment, position)
    found = {
        AUTOCORRELATION: autocorrelation(signed_ranks(residuals), joined),
        RUN: longest_runs(residuals, joined),
        LARGEST: largest_residual(residuals),
        SEGMENT_TREND: trend.max(axis=0),
    }
    return found if len(spread) == 1 else {**found, SEGMENT_SPREAD: spread.max(axis=0)}


def _by_draw(values: xr.DataArray) -> FloatArray:
    """Draws of points, shape (draws, n)."""
    ordered = values.transpose("chain", "draw", "point").to_numpy()
    return np.asarray(ordered.reshape(-1, ordered.shape[-1]), dtype=np.float64)


def _sizes_of_errors(n_replicates: int, n: int, number: int) -> FloatArray:
    """Root mean squares of n errors as much larger than stated as they may be, over the stated one.

    Those of tests by another number are independent: the worst of all tests is judged.

    Returns
    -------
    array, shape (n_replicates, 1)
    """
    squares = np.random.default_rng([n, number]).chisquare(n, (n_replicates, 1))
    sizes: FloatArray = READING_ERROR_FACTOR * np.sqrt(squares / n)
    return sizes
