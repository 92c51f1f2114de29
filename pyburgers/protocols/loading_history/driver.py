"""Measured drivers as lines: a series of readings becomes legs over which it is linear in time.

The rule: of all lines with corners at readings that pass every reading within `TOLERANCE` times
the reading error, take one with the fewest corners, and of those the one nearest to the readings;
then put its corners at the values of the least-squares line with the same times. Ramps and jumps
stay, since a line that cut their corners would miss readings; what is smaller than the tolerance is
taken as error of reading or control. The search is by dynamic programming: the slopes of all lines
from a reading that pass within the tolerance of those after it form an interval that narrows as
they go on (Imai and Iri 1986, Computer Vision, Graphics, and Image Processing 36, 31-41).
"""

import numpy as np
from scipy import stats
from scipy.interpolate import make_lsq_spline

from pyburgers.protocols.experiment import FloatArray

TOLERANCE = 5.0
"""How far a line passes from a reading, in standard deviations of the reading error. Its corners
are readings with errors of their own, so that 5 are 3.5 of those of a difference."""

FEWEST_READINGS = 20
"""Of fewer readings the error is not told from them: corners may be too large a share."""

PLAIN_SHARE, DOUBTFUL_SHARE = 0.02, 0.01
"""Shares of the range of a series: an error up to the first is taken as it is estimated, a larger
one only if the series turns as often as noise does; else the second takes its place."""

TURNED_TOLERANCE = 1e-3
"""The least tolerance, in shares of the largest value: 0.1 % of a stress moves the rate by less
than a percent, and a series without noise would otherwise get a corner at every reading."""


def scatter(time: FloatArray, value: FloatArray) -> float:
    """Return how far readings lie from their neighbours, as a standard deviation; 0 for under 3.

    From the median distance of a reading from the line through its neighbours, which few jumps or
    corners do not move.

    Parameters
    ----------
    time, value : array, shape (n,)
        The series, times not decreasing.
    """
    if time.size < 3:
        return 0.0
    between = time[2:] - time[:-2]
    moved = np.where(between > 0, time[1:-1] - time[:-2], 0.5)
    share = moved / np.where(between > 0, between, 1.0)
    distance = value[1:-1] - (1 - share) * value[:-2] - share * value[2:]
    scaled = distance / np.sqrt(1 + share**2 + (1 - share) ** 2)
    return float(np.median(np.abs(scaled)) / stats.norm.ppf(0.75))


def reading_error(time: FloatArray, value: FloatArray) -> float:
    """Return the standard deviation of independent errors of a series, as far as it can be told.

    Their scatter, unless corners may be what scatters: it is 0 for under `FEWEST_READINGS`, and
    limited where it is large and the series does not turn as noise does (cycles, for example).

    Parameters
    ----------
    time, value : array, shape (n,)
        The series, times not decreasing.
    """
    if time.size < FEWEST_READINGS:
        return 0.0
    error, span = scatter(time, value), float(np.ptp(value))
    if error <= PLAIN_SHARE * span or _turns_like_noise(value):
        return error
    return DOUBTFUL_SHARE * span


def _turns_like_noise(value: FloatArray) -> bool:
    """Whether a series has as many highs and lows as independent numbers.

    Two thirds of its inner readings, with the variance of Kendall's test of turning points, within
    two standard deviations.
    """
    step = np.sign(np.diff(value))
    turns = np.count_nonzero(step[1:] * step[:-1] < 0)
    expected, variance = 2 * (value.size - 2) / 3, (16 * value.size - 29) / 90
    return bool(abs(turns - expected) <= 2 * np.sqrt(variance))


def tolerance_of(value: FloatArray, error: float) -> float:
    """Return how far a line passes from readings with a standard deviation, in their unit."""
    return max(TOLERANCE * error, TURNED_TOLERANCE * float(np.max(np.abs(value))))


def line_through(
    time: FloatArray, value: FloatArray, tolerance: float
) -> tuple[FloatArray, FloatArray]:
    """Return the corners of the line that stands for a series.

    Parameters
    ----------
    time, value : array, shape (n,)
        The series, n at least 2, times increasing.
    tolerance : float
        How far the line passes from a reading before its corners are moved, in the unit of
        `value`; positive.

    Returns
    -------
    time, value : array, shape (n_corners,)
        The first and the last time are those of the series.
    """
    corner = _fewest_corners(time, value, tolerance)
    if corner.size == time.size:
        return time, value
    ends = time[[0, -1]]
    knots = np.concatenate([ends[:1], time[corner], ends[1:]])
    # Times from 0 to 1: least squares in seconds would lose digits.
    scaled = (knots - ends[0]) / (ends[1] - ends[0])
    line = make_lsq_spline((time - ends[0]) / (ends[1] - ends[0]), value, scaled, k=1)
    return time[corner], np.asarray(line(scaled[1:-1]))


def _fewest_corners(time: FloatArray, value: FloatArray, tolerance: float) -> np.ndarray:
    """Return the readings at which the line has its corners, the first and the last too."""
    n = time.size
    corners = np.full(n, n)
    squares = np.full(n, np.inf)
    before = np.zeros(n, dtype=np.int64)
    corners[0], squares[0] = 0, 0.0
    for i in range(n - 1):
        reached, missed = _reached(time[i:] - time[i], value[i:] - value[i], tolerance)
        to, total = i + reached, squares[i] + missed
        fewer = corners[i] + 1 < corners[to]
        nearer = (corners[i] + 1 == corners[to]) & (total < squares[to])
        better = fewer | nearer
        corners[to[better]] = corners[i] + 1
        squares[to[better]], before[to[better]] = total[better], i
    path = [n - 1]
    while path[-1] > 0:
        path.append(int(before[path[-1]]))
    return np.array(path[::-1])


def _reached(
    time: FloatArray, value: FloatArray, tolerance: float
) -> tuple[np.ndarray, FloatArray]:
    """Return where lines from the first reading (at 0, 0) may end, and the squares they miss."""
    t, y = time[1:], value[1:]
    lowest = np.maximum.accumulate((y - tolerance) / t)
    highest = np.minimum.accumulate((y + tolerance) / t)
    slope = y / t
    within = np.flatnonzero((lowest <= slope) & (slope <= highest))
    squares = np.cumsum(y**2) - 2 * slope * np.cumsum(t * y) + slope**2 * np.cumsum(t**2)
    return within + 1, squares[within]
