"""What replicated data leave over once they are fitted as the data were.

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

from pyburgers.checks.residual_numbers import TINY
from pyburgers.common.array_types import IntArray
from pyburgers.common.draws import FloatArray

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
