"""What a fit leaves over, beside what replicated data leave over: the checks of the description.

At each draw a number such as the autocorrelation of the residuals is taken of the data and of the
replicated data of that draw (a posterior predictive check of a realised discrepancy, Gelman, Meng
and Stern 1996, Statistica Sinica 6, 733-807). All such numbers of all tests of a fit are one
family: the probability of the worst is compared with that of the worst of each replicate, so that
in 1 of 100 fits at most a correct model fails any of them (`docs/checks.md`), however many there
are and however they hang together.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from pyburgers.checks.fit_checks import CheckedDraws, Outcome
from pyburgers.common.draws import TAIL
from pyburgers.posterior.labelled_draws import TESTS, response_in
from pyburgers.protocols.protocol import Protocol, protocols

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

LEVEL = 0.01
"""Probability of the worst discrepancy of a fit, under a correct model, at which it counts."""

READING_ERROR_FACTOR = 1.5
"""Reading errors are seldom known better: residuals may be as much larger than the stated one."""

TINY = 1e-100
"""Keeps residuals that are exactly 0 from a division by 0."""

AUTOCORRELATION = "autocorrelation"
RUN = "longest run"
SEGMENT_TREND = "trend of a segment"
LARGEST = "largest residual"
SEGMENT_SPREAD = "spread of a segment"
OUTSIDE = "share outside"
OVER_READING_ERROR = "over reading error"


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
    observed, replicated : array, shape (draws, n)
        Residuals of the data and of replicated ones, SI; where readings have errors of their own,
        over these, times their mean. Of several quantities each is weighed by what replicates
        leave over of it.
    weight : array, shape (n,)
        What residuals are multiplied by for that; 1 where they do not differ.
    discrepancies : dict of str to (array, array), each of shape (draws,)
        Numbers of the data and of the replicates; large ones speak against the model.
    """

    name: str
    group: xr.DataTree
    protocol: Protocol[Any]
    position: FloatArray
    segment: npt.NDArray[np.int64]
    quantity: npt.NDArray[np.int64]
    observed: FloatArray
    replicated: FloatArray
    weight: FloatArray
    discrepancies: dict[str, tuple[FloatArray, FloatArray]] = field(repr=False)

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
        start, end = (f"{v:.3g}" for v in clock.display_factor * self.position[[first, last]])
        span = start if start == end else f"{start} to {end}"
        return f"{clock.name} {span} {clock.display_unit}"


@dataclass(frozen=True, eq=False)
class Family:
    """All discrepancies of a fit.

    Attributes
    ----------
    tests : dict of str to Leftover
        What is left over of each test.
    table : DataFrame
        Index discrepancy and test; columns found (mean over the draws), at_most (the mean from
        which on it fails), probability (that a replicate has as much) and family_probability (that
        a replicate has any discrepancy as improbable).
    n_draws : int
        Number of replicates.
    """

    tests: Mapping[str, Leftover]
    table: pd.DataFrame
    n_draws: int

    def outcome(self, row: "pd.Series[float]") -> Outcome:
        """Whether the model is right in a discrepancy.

        It cannot be told where it is beyond all replicates, but these are too few for `LEVEL`.
        """
        if row["family_probability"] <= LEVEL:
            return Outcome.NO
        beyond_all = row["probability"] < 2 / (self.n_draws + 1)
        return Outcome.CANNOT_TELL if beyond_all else Outcome.YES


@lru_cache(maxsize=1)
def discrepancies_of(draws: CheckedDraws) -> Family:
    """Compare what a fit leaves over with what replicated data do."""
    posterior = draws.posterior
    groups = posterior[TESTS].children if TESTS in posterior.children else {"the test": posterior}
    tests = {name: _leftover(name, group) for name, group in groups.items()}
    pairs = {
        (name, test): pair
        for test, leftover in tests.items()
        for name, pair in leftover.discrepancies.items()
    }
    found, replicated = (np.stack(each) for each in zip(*pairs.values(), strict=True))
    probability, least, family = family_probabilities(found, replicated)
    table = pd.DataFrame(
        {
            "found": found.mean(axis=1),
            "at_most": [
                _largest_mean(own, of_data, least)
                for own, of_data in zip(replicated, found, strict=True)
            ],
            "probability": probability,
            "family_probability": family,
        },
        pd.MultiIndex.from_tuples(list(pairs), names=["discrepancy", "test"]),
    )
    return Family(tests, table, found.shape[1])


def family_probabilities(
    found: FloatArray, replicated: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Probabilities of discrepancies one by one, and of the worst of all.

    Parameters
    ----------
    found, replicated : array, shape (k, draws)
        Discrepancies of the data and of replicated data at each draw.

    Returns
    -------
    probability : array, shape (k,)
        That a replicate has as much, over the draws; the data count as one replicate more.
    least : array, shape (draws,)
        The least probability of each replicate, among the others and the data.
    family : array, shape (k,)
        That the least probability of a replicate is as low as the one of a discrepancy.
    """
    n = found.shape[1]
    probability = np.array(
        [
            (1.0 + _at_least(own, of_data).mean()) / (n + 1)
            for own, of_data in zip(replicated, found, strict=True)
        ]
    )
    of_replicates = np.stack(
        [
            (_at_least(own, own) + _at_least(of_data, own) / n) / (n + 1)
            for own, of_data in zip(replicated, found, strict=True)
        ]
    )
    least = of_replicates.min(axis=0)
    family = np.array([(1.0 + np.sum(least <= p)) / (n + 1) for p in probability])
    return probability, least, family


def _largest_mean(replicated: FloatArray, found: FloatArray, least: FloatArray) -> float:
    """Return the largest mean of a discrepancy that passes, its spread over the draws as it is.

    Parameters
    ----------
    replicated, found, least : array, shape (draws,)
        A discrepancy of replicates and data, and the third result of `family_probabilities`.
    """
    n = found.size
    allowed = np.sort(least)[int(LEVEL * (n + 1)) - 1]
    about_mean = found - found.mean()
    low, high = (
        float(extreme - spread)
        for extreme, spread in (
            (replicated.min(), about_mean.max()),
            (replicated.max(), about_mean.min()),
        )
    )
    while high - low > 1e-3 * abs(high):
        middle = 0.5 * (low + high)
        probability = (1.0 + _at_least(replicated, about_mean + middle).mean()) / (n + 1)
        low, high = (middle, high) if probability >= allowed else (low, middle)
    return low


def _at_least(values: FloatArray, bounds: FloatArray) -> FloatArray:
    """Count values that are at least each bound, shape of the bounds."""
    below = np.searchsorted(np.sort(values), bounds, side="left")
    return np.asarray(values.size - below, dtype=np.float64)


def _leftover(name: str, group: xr.DataTree) -> Leftover:
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
    low, high = np.quantile(of_replicas, (TAIL, 1.0 - TAIL), axis=0)
    outside = [
        ((each < low) | (each > high)).mean(axis=1)
        for each in (data.to_numpy()[np.newaxis], of_replicas)
    ]
    pairs = {OUTSIDE: (np.repeat(outside[0], len(outside[1])), outside[1])}
    of_data, of_replicates = (
        _numbers(residuals, segment, position) for residuals in (observed, replicated)
    )
    pairs |= {each: (of_data[each], of_replicates[each]) for each in of_data}
    if error is not None:
        pairs[OVER_READING_ERROR] = _over_reading_error(observed / error.mean())
    return Leftover(
        name,
        group,
        protocol,
        position,
        segment,
        quantity,
        observed,
        replicated,
        weight,
        pairs,
    )


def _of_one_size(replicated: FloatArray, quantity: npt.NDArray[np.int64]) -> FloatArray:
    """Weights of readings, shape (n,), that make residuals of all quantities as large."""
    sizes = {k: float(np.sqrt((replicated[:, quantity == k] ** 2).mean())) for k in set(quantity)}
    largest = max(sizes.values())
    return np.array([largest / max(sizes[k], TINY) for k in quantity])


def _numbers(
    residuals: FloatArray, segment: npt.NDArray[np.int64], position: FloatArray
) -> dict[str, FloatArray]:
    """Discrepancies that residuals alone say, each of shape (draws,)."""
    joined = np.diff(segment) == 0
    trend, spread = segment_parts(residuals, segment, position)
    found = {
        AUTOCORRELATION: autocorrelation(residuals, joined),
        RUN: longest_runs(residuals, joined),
        LARGEST: largest_residual(residuals),
        SEGMENT_TREND: trend.max(axis=0),
    }
    return found if len(spread) == 1 else {**found, SEGMENT_SPREAD: spread.max(axis=0)}


def _by_draw(values: xr.DataArray) -> FloatArray:
    """Draws of points, shape (draws, n)."""
    ordered = values.transpose("chain", "draw", "point").to_numpy()
    return np.asarray(ordered.reshape(-1, ordered.shape[-1]), dtype=np.float64)


def _over_reading_error(scaled: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Root mean square of residuals over the reading error, and of normal errors as large.

    Parameters
    ----------
    scaled : array, shape (draws, n)
        Residuals over the reading error.
    """
    draws, n = scaled.shape
    squares = np.random.default_rng(n).chisquare(n, draws)
    errors = READING_ERROR_FACTOR * np.sqrt(squares / n)
    return np.sqrt((scaled**2).mean(axis=1)), errors


def autocorrelation(residuals: FloatArray, joined: BoolArray) -> FloatArray:
    """Lag-1 autocorrelation about zero.

    Parameters
    ----------
    residuals : array, shape (..., n)
        Along the clock.
    joined : array of bool, shape (n - 1,)
        Whether a point and the next one are of one segment, and so count as a pair.

    Returns
    -------
    array, shape (...,)
    """
    pairs = residuals[..., 1:] * residuals[..., :-1]
    found: FloatArray = pairs @ joined / np.maximum((residuals**2).sum(-1), TINY)
    return found


def longest_runs(residuals: FloatArray, joined: BoolArray) -> FloatArray:
    """Length of the longest run of residuals of one sign in one segment.

    Parameters
    ----------
    residuals : array, shape (draws, n)
        Along the clock.
    joined : array of bool, shape (n - 1,)
        As for `autocorrelation`.

    Returns
    -------
    array, shape (draws,)
    """
    positive = residuals > 0
    run = np.ones(residuals.shape[0])
    longest = run.copy()
    for i, together in enumerate(joined, start=1):
        goes_on = together & (positive[:, i] == positive[:, i - 1])
        run = np.where(goes_on, run + 1, 1)
        np.maximum(longest, run, out=longest)
    return longest


def longest_run(residuals: FloatArray, joined: BoolArray) -> tuple[int, int]:
    """Return the first and the last point, from 0, of the longest run of one sign in one segment.

    Parameters
    ----------
    residuals : array, shape (n,)
        Along the clock.
    joined : array of bool, shape (n - 1,)
        As for `autocorrelation`.
    """
    ends = np.flatnonzero((np.diff(residuals > 0) != 0) | ~joined) + 1
    edges = np.concatenate([[0], ends, [residuals.size]])
    longest = int(np.diff(edges).argmax())
    return int(edges[longest]), int(edges[longest + 1]) - 1


def largest_residual(residuals: FloatArray) -> FloatArray:
    """Largest residual over the root mean square of the others, shape (draws,)."""
    squares = residuals**2
    largest = squares.max(axis=1)
    others = np.maximum(squares.sum(axis=1) - largest, TINY)
    found: FloatArray = np.sqrt(largest * max(1, squares.shape[1] - 1) / others)
    return found


def segment_parts(
    residuals: FloatArray, segment: npt.NDArray[np.int64], position: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """How much of a test's residuals each segment holds, as a straight line and in all.

    Parameters
    ----------
    residuals : array, shape (draws, n)
        Along the clock.
    segment, position : array, shape (n,)
        Of the readings.

    Returns
    -------
    trend : array, shape (segments, draws)
        Sum of squares of the straight line through the residuals of the segment, over the mean
        square of all.
    spread : array, shape (segments, draws)
        Mean square of the segment over that of all.
    """
    squares = residuals**2
    mean_square = np.maximum(squares.mean(axis=1), TINY)
    trend, spread = [], []
    for one in np.unique(segment):
        here = segment == one
        line = _line_basis(position[here])
        trend.append(((residuals[:, here] @ line) ** 2).sum(axis=1) / mean_square)
        spread.append(squares[:, here].mean(axis=1) / mean_square)
    return np.stack(trend), np.stack(spread)


def _line_basis(position: FloatArray) -> FloatArray:
    """Orthonormal columns that span straight lines at positions, shape (n, 1 or 2)."""
    level: FloatArray = np.full((position.size, 1), position.size**-0.5)
    slope = position - position.mean()
    length = np.linalg.norm(slope)
    if length == 0 or position.size < 3:
        return level
    return np.column_stack([level, slope / length])
