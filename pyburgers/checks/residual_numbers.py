"""Numbers that residuals along a clock have: how they go together, how large the largest is."""

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
