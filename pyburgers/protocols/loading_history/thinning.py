"""Which readings of a long record are kept.

Equal numbers are given to equal parts of a measure along the record that is the mean of three, each
counted from 0 to 1: time; the logarithm of the time since what is imposed last changed, so that
transients keep their readings; and the way that the response goes up and down (along the line that
`driver` puts through it, so that noise does not count), so that ramps keep theirs. The first and
the last reading stay, and readings are taken as they are: none is averaged.
"""

import numpy as np

from pyburgers.protocols.experiment import FloatArray
from pyburgers.protocols.loading_history.driver import (
    line_through,
    reading_error,
    tolerance_of,
)


def kept_readings(
    time: FloatArray, response: FloatArray, changes: FloatArray, n_kept: int
) -> np.ndarray:
    """Return the indices of the readings that are kept, increasing.

    `time`, `response` (n,): readings of one quantity, times (s) not decreasing, two different ones
    at least. `changes` (n_changes,): times (s) at which what is imposed changes its value or rate,
    the first not after the first reading.
    """
    if time.size <= n_kept:
        return np.arange(time.size)
    measure = np.mean(
        [_from_0_to_1(part) for part in (time, _log_time(time, changes), _way(time, response))],
        axis=0,
    )
    wanted = np.linspace(0.0, 1.0, n_kept)
    return np.unique(np.rint(np.interp(wanted, measure, np.arange(time.size))).astype(np.int64))


def _log_time(time: FloatArray, changes: FloatArray) -> FloatArray:
    """Logarithm of the time since the last change, added up over the changes."""
    last = np.searchsorted(changes, time, side="right") - 1
    scale = float(np.median(np.diff(np.unique(time))))
    within = np.log1p((time - changes[last]) / scale)
    spans = np.log1p(np.diff(changes) / scale)
    before = np.concatenate([[0.0], np.cumsum(spans)])
    added: FloatArray = before[last] + within
    return added


def _way(time: FloatArray, response: FloatArray) -> FloatArray:
    """Sum of all rises and falls of the response up to each reading."""
    tolerance = tolerance_of(response, reading_error(time, response))
    moment, place, count = np.unique(time, return_inverse=True, return_counts=True)
    corners, values = line_through(moment, np.bincount(place, response) / count, tolerance)
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(values)))])
    up_to: FloatArray = np.interp(time, corners, way)
    return up_to


def _from_0_to_1(measure: FloatArray) -> FloatArray:
    span = measure[-1] - measure[0]
    scaled: FloatArray = (measure - measure[0]) / span if span > 0 else np.zeros_like(measure)
    return scaled
