"""Numbers that residuals have, and what replicated data leave over once fitted as the data were.

A posterior follows the data that it is held against: what a fit leaves over is smaller and less
smooth than the noise was. Replicated data beside the draw that made them show the noise, not what a
fit leaves of it. So each replicate is fitted too, with the response taken as linear in the
parameters and normal (a calibration of posterior predictive probabilities as of Hjort, Dahl and
Steinbakk 2006, Journal of the American Statistical Association 101, 1157-1174, with linear fits in
place of new chains). Tails say how improbable a number is beside those of replicates.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from pyburgers.common.array_types import BoolArray, IntArray
from pyburgers.common.draws import FloatArray
from pyburgers.kinds.loading_history.driver import distances_from_neighbours

TINY = 1e-100
"""Keeps residuals that are exactly 0 from a division by 0."""

FEWEST_NEIGHBOURS = 5
"""Readings between two others, without which an error is not estimated from them."""


def autocorrelation(residuals: FloatArray, joined: BoolArray) -> FloatArray:
    """Return the lag-1 autocorrelation of residuals (..., n) over the `joined` (n - 1,) pairs."""
    pairs = residuals[..., 1:] * residuals[..., :-1]
    found: FloatArray = pairs @ joined / np.maximum((residuals**2).sum(-1), TINY)
    return found


def signed_ranks(residuals: FloatArray) -> FloatArray:
    """Return the rank of each residual's size, from 1, over their number, with its sign.

    The shape (..., n) stays. A few bad readings hold most of the squares and hide how the
    others go together; no rank is more than 1.7 times the root mean square of all.
    """
    order = np.abs(residuals).argsort(axis=-1)
    ranks = np.empty_like(residuals)
    every = np.arange(1.0, residuals.shape[-1] + 1) / residuals.shape[-1]
    np.put_along_axis(ranks, order, np.broadcast_to(every, order.shape), axis=-1)
    return np.copysign(ranks, residuals)


def longest_runs(residuals: FloatArray, joined: BoolArray) -> FloatArray:
    """Return the longest run of one sign over `joined` pairs of residuals (draws, n), (draws,)."""
    positive = residuals > 0
    run = np.ones(residuals.shape[0])
    longest = run.copy()
    for i, together in enumerate(joined, start=1):
        goes_on = together & (positive[:, i] == positive[:, i - 1])
        run = np.where(goes_on, run + 1, 1)
        np.maximum(longest, run, out=longest)
    return longest


def longest_run(residuals: FloatArray, joined: BoolArray) -> tuple[int, int]:
    """Return first and last point, from 0, of the longest run of one sign of residuals (n,)."""
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


def mean_squares(residuals: FloatArray, quantity: IntArray) -> FloatArray:
    """Return mean squares of residuals (draws, n) of each quantity, shape (quantities, draws)."""
    kinds = np.unique(quantity)
    return np.stack([(residuals[:, quantity == one] ** 2).mean(axis=1) for one in kinds])


def offsets(residuals: FloatArray, quantity: IntArray) -> FloatArray:
    """Return mean residuals (draws, n) of each quantity in standard errors, (quantities, draws)."""
    found = []
    for one in np.unique(quantity):
        here = residuals[:, quantity == one]
        size = np.sqrt(np.maximum((here**2).mean(axis=1), TINY))
        found.append(np.sqrt(here.shape[1]) * here.mean(axis=1) / size)
    return np.stack(found)


def over_scatter(
    residuals: FloatArray,
    position: FloatArray,
    segment: IntArray,
    quantity: IntArray,
    least: FloatArray,
) -> FloatArray:
    """Return the root mean square of residuals over the error that their neighbours tell.

    Residuals have the shape (any, n), readings and their least errors (n,). Only those of one
    segment and quantity are neighbours. The result has the shape (quantities, any), of
    quantities with `FEWEST_NEIGHBOURS` readings between two others.
    """
    found = []
    for one in np.unique(quantity):
        parts = [
            distances_from_neighbours(position[here], residuals[:, here])
            for here in ((quantity == one) & (segment == k) for k in np.unique(segment))
            if here.sum() > 2
        ]
        distances = np.concatenate([residuals[:, :0], *parts], axis=1)
        if distances.shape[1] >= FEWEST_NEIGHBOURS:
            # Of normal errors; the mean distance says more of few readings than the median.
            error = np.abs(distances).mean(axis=1) * np.sqrt(np.pi / 2)
            error = np.maximum(error, max(TINY, least[quantity == one].max()))
            size = np.sqrt((residuals[:, quantity == one] ** 2).mean(axis=1))
            found.append(size / error)
    return np.stack(found) if found else np.empty((0, len(residuals)))


def segment_parts(
    residuals: FloatArray, segment: IntArray, position: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return trend and spread of residuals (draws, n) in each segment, (segments, draws).

    Trend is the sum of squares of the straight line through the residuals of the segment,
    spread the mean square of the segment, both over the mean square of all.
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


def straight_line(position: FloatArray, residuals: FloatArray) -> FloatArray:
    """Straight line through residuals at their positions; themselves where there is none."""
    if position.size < 3 or np.ptp(position) == 0:
        return residuals
    line = np.polyval(np.polyfit(position, residuals, 1), position)
    return np.asarray(line, dtype=np.float64)


def _line_basis(position: FloatArray) -> FloatArray:
    """Orthonormal columns that span straight lines at positions, shape (n, 1 or 2)."""
    level: FloatArray = np.full((position.size, 1), position.size**-0.5)
    slope = position - position.mean()
    length = np.linalg.norm(slope)
    if length == 0 or position.size < 3:
        return level
    return np.column_stack([level, slope / length])


MOST_REPLICATES = 2000
"""Replicates that are fitted, evenly spaced among the draws."""

DRAWS_OF_REFIT = 20
"""Draws of the posterior of each."""

CHUNK = 2_000_000
"""Numbers held at a time."""


def evenly(n_draws: int, wanted: int) -> IntArray:
    """Return positions of draws, evenly spaced, all where there are no more than wanted."""
    return np.linspace(0, n_draws - 1, min(n_draws, wanted)).astype(np.int64)


def refitted_means(observed: FloatArray, noise: FloatArray, *, correlated: bool) -> FloatArray:
    """Return mean residuals of replicated data over their own posteriors, shape (replicates, n).

    Residuals of the data, and of the replicated data of each draw, have the shape (draws, n).
    With q the deviations of the draws of the response from their mean, V the covariance of the
    noise (diagonal if residuals do not correlate) and K = cov(q) / V the share of a change of
    the data that the posterior mean follows, a replicate that lies a from the mean response of
    the data's fit leaves a - K (a - r), where r is the residual of the data.
    """
    mean = observed.mean(axis=0)
    deviation = observed - mean
    away = (noise - deviation)[evenly(len(noise), MOST_REPLICATES)]
    factor = np.diag(np.sqrt(np.maximum(np.mean(noise**2, axis=0), TINY)))
    if correlated:
        factor = np.linalg.cholesky(noise.T @ noise / len(noise) + 1e-6 * factor**2)
    whitened = np.linalg.solve(factor, deviation.T)
    share, axes = np.linalg.eigh(whitened @ whitened.T / len(observed))
    # A posterior of a response that is linear follows data by no more than they change.
    follows = (axes * np.minimum(share, 1.0)) @ axes.T
    gain = factor @ np.linalg.solve(factor.T, follows.T).T
    return np.asarray(away - (away - mean) @ gain.T, dtype=np.float64)


def scale_of(means: FloatArray) -> FloatArray:
    """Return each replicate's size over that of all, (replicates, 1), with which noise goes."""
    squares = np.mean(means**2, axis=1, keepdims=True)
    size: FloatArray = np.sqrt(squares / max(float(squares.mean()), TINY))
    return size


def refitted_residuals(observed: FloatArray, means: FloatArray) -> Iterator[FloatArray]:
    """Yield residuals (some replicates, `DRAWS_OF_REFIT`, n) from data (draws, n) and means."""
    deviation = (observed - observed.mean(axis=0))[evenly(len(observed), DRAWS_OF_REFIT)]
    scale = scale_of(means)
    step = max(1, CHUNK // deviation.size)
    for start in range(0, len(means), step):
        part = slice(start, start + step)
        yield means[part, None, :] + scale[part, :, None] * deviation


MOST_IN_TAIL = 100
LARGEST_TAIL = 0.2
"""How many of some numbers their tail holds, and the largest share of them."""

ALIKE = 1e-9
"""Scale of the tail of numbers that do not differ, over their size."""

MOST_SCALES = 600.0
"""Further out a share of a tail would be 0 in floating point."""


@dataclass(frozen=True, eq=False)
class Tail:
    """How often numbers are as large as a value, beyond the largest of them too.

    An exponential law of a power of the numbers takes the place of the largest: from its start,
    a number to this power, with a scale that is the mean distance from there. Beyond is the
    share of the numbers above the start.
    """

    ordered: FloatArray
    exponent: float
    start: float
    beyond: float
    scale: float

    @classmethod
    def of(cls, numbers: FloatArray, exponent: float = 1.0) -> Self:
        """Return the tail of numbers, shape (n,)."""
        ordered = np.sort(numbers)
        powers = _power(ordered, exponent)
        most = max(1, min(MOST_IN_TAIL, int(LARGEST_TAIL * ordered.size)))
        start = powers[max(0, ordered.size - most - 1)]
        if start == powers[-1]:
            start = powers[max(0, np.searchsorted(powers, start) - 1)]
        above = powers[powers > start]
        if above.size == 0:  # all are alike
            return cls(ordered, exponent, float(start), 1.0, ALIKE * max(1.0, abs(start)))
        scale = float(above.mean() - start)
        return cls(ordered, exponent, float(start), above.size / ordered.size, scale)

    def share(self, value: FloatArray) -> FloatArray:
        """Share of numbers as large as values; never 0."""
        at_least = self.ordered.size - np.searchsorted(self.ordered, value, side="left")
        away = (_power(value, self.exponent) - self.start) / self.scale
        law = self.beyond * np.exp(-np.clip(away, 0.0, MOST_SCALES))
        return np.where(away > 0, law, at_least / self.ordered.size)

    def value(self, share: float) -> float:
        """Return the value that a share of the numbers exceeds."""
        if share < self.beyond:
            power = self.start + self.scale * np.log(self.beyond / share)
            return float(_power(power, 1.0 / self.exponent))
        return float(np.quantile(self.ordered, 1.0 - share))


def _power(value: FloatArray, exponent: float) -> FloatArray:
    """Power of the size of numbers, with their sign."""
    return np.copysign(np.abs(value) ** exponent, value)


def outside_band(values: FloatArray, band: FloatArray, sizes: FloatArray) -> BoolArray:
    """Return which readings, shape (..., n), lie outside a band, shape (2, n).

    Upper limits lie on the end of a band that reaches down to them, but for the rounding of numbers
    of some sizes, shape (n,) or (): readings of several quantities have sizes of their own.
    """
    rounding = 1e-9 * sizes
    outside: BoolArray = (values < band[0] - rounding) | (values > band[1] + rounding)
    return outside
