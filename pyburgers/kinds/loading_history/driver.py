"""Measured drivers as lines: a series of readings becomes legs over which it is linear in time.

Of all lines with corners at readings that pass every reading within `TOLERANCE` times the reading
error, take one with the fewest corners, and of those the nearest to the readings. Its corners then
get the values of the least-squares line. Ramps and jumps stay, because a line that cut their
corners would miss readings. The search is by dynamic programming: slopes that pass within the
tolerance form an interval that narrows (Imai and Iri 1986, Computer Vision, Graphics, and Image
Processing 36, 31-41). A controller scatters more under a large stress, so each leg has its own
scatter.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy import stats
from scipy.interpolate import make_lsq_spline

from pyburgers.common.array_types import BoolArray, FloatArray, IntArray

TOLERANCE = 5.0
"""How far a line passes from a reading, in standard deviations of the reading error. Its corners
are readings with errors of their own, so that 5 are 3.5 of those of a difference."""

MIN_ERROR_READINGS = 20
"""Of fewer readings the error is not told from them: corners may be too large a share."""

MIN_LEG_READINGS = 6
"""Of fewer readings in a leg the scatter is not told from them."""

PLAIN_SHARE, DOUBTFUL_SHARE = 0.02, 0.01
"""Shares of the range of a series: an error up to the first is taken as it is estimated, a larger
one only if the series turns as often as noise does; else the second takes its place."""

TURNED_TOLERANCE = 1e-3
"""The least tolerance, in shares of the largest value: 0.1 % of a stress moves the rate by less
than a percent, and a series without noise would otherwise get a corner at every reading."""

MIN_RATE_RATIO, MIN_RATE_SHARE = 1.2, 1e-5
"""Ratio from which a rate follows another by a step; share of the largest from which it is one."""

MAX_RATES, MAX_LOOKED_AT = 20, 2000
"""How many rates a test has at most; of how many readings a line is searched for, whose time grows
with their square."""

FULL_SHARE, MAX_PLACES = 0.95, 10
"""Where places share readings, more places are taken until this share of the readings that may be
kept are, but not more than so many for each."""

MAX_READINGS = 400
"""How many readings of a record are used unless its file says another number."""

ARE_USED = "readings are used ('max_readings')"
"""Words of the notice of a thinned record, by which it is told from warnings."""


def distances_from_neighbours(at: FloatArray, value: FloatArray) -> FloatArray:
    """Distance of each reading (..., n) from the line through its two neighbours, scaled to errors.

    Positions (n,) do not decrease. Readings between two at one position are left out.
    """
    span = at[2:] - at[:-2]
    kept = span > 0
    share = (at[1:-1] - at[:-2])[kept] / span[kept]
    before, here, after = (value[..., k : value.shape[-1] - 2 + k][..., kept] for k in range(3))
    distance = here - (1 - share) * before - share * after
    return np.asarray(distance / np.sqrt(1 + share**2 + (1 - share) ** 2))


def scatter(time: FloatArray, value: FloatArray) -> float:
    """Return how far readings (n,) lie from their neighbours, as a robust standard deviation."""
    distances = distances_from_neighbours(time, value)
    if distances.size == 0:
        return 0.0
    return float(np.median(np.abs(distances)) / stats.norm.ppf(0.75))


def reading_error(time: FloatArray, value: FloatArray) -> float:
    """Return the standard deviation of readings (n,) by their scatter, unless corners scatter."""
    if time.size < MIN_ERROR_READINGS:
        return 0.0
    error, span = scatter(time, value), float(np.ptp(value))
    if error <= PLAIN_SHARE * span or _turns_like_noise(value):
        return error
    return DOUBTFUL_SHARE * span


def _turns_like_noise(value: FloatArray) -> bool:
    """Whether a series turns as often as independent numbers, by Kendall's variance of turns."""
    step = np.sign(np.diff(value))
    turns = np.count_nonzero(step[1:] * step[:-1] < 0)
    expected, variance = 2 * (value.size - 2) / 3, (16 * value.size - 29) / 90
    return bool(abs(turns - expected) <= 2 * np.sqrt(variance))


def tolerance_of(value: FloatArray, error: float) -> float:
    """Return how far a line passes from readings with a standard deviation, in their unit."""
    return max(TOLERANCE * error, TURNED_TOLERANCE * float(np.max(np.abs(value))))


def tolerances(time: FloatArray, value: FloatArray) -> FloatArray:
    """Return how far a line passes from the readings of a series without a stated error, (n,)."""
    error = reading_error(time, value)
    allowed = np.full(time.size, tolerance_of(value, error))
    if error != scatter(time, value):
        return allowed
    while True:
        closer = allowed.copy()
        for first, last in pairwise(_fewest_corners(time, value, allowed)):
            own = slice(first, last + 1)
            if last - first + 1 >= MIN_LEG_READINGS:
                error = max(scatter(time[own], value[own]), _rounding_error(value[own]))
                inside = slice(first + 1, last)
                closest = max(TOLERANCE * error, tolerance_of(value, 0.0))
                closer[inside] = np.minimum(closer[inside], closest)
        if np.array_equal(closer, allowed):
            return allowed
        allowed = closer


def _rounding_error(value: FloatArray) -> float:
    """Return the standard deviation of what rounding takes from readings: of their least step."""
    steps = np.diff(np.unique(value))
    return float(steps.min(initial=np.inf) / np.sqrt(12)) if steps.size else 0.0


def line_through(
    time: FloatArray, value: FloatArray, tolerance: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Return times and values (n_corners,) of the line that stands for a series (n,).

    `tolerance` (n,): how far it passes from a reading before its corners are moved; readings count
        by its inverse square.
    """
    allowed = np.broadcast_to(np.asarray(tolerance, dtype=np.float64), time.shape)
    corner = _fewest_corners(time, value, allowed)
    if corner.size == time.size:
        return time, value
    ends = time[[0, -1]]
    knots = np.concatenate([ends[:1], time[corner], ends[1:]])
    # Times from 0 to 1: least squares in seconds would lose digits.
    scaled = (knots - ends[0]) / (ends[1] - ends[0])
    line = make_lsq_spline(
        (time - ends[0]) / (ends[1] - ends[0]), value, scaled, k=1, w=_weights(allowed)
    )
    return time[corner], np.asarray(line(scaled[1:-1]))


def _weights(tolerance: FloatArray) -> FloatArray:
    """Return inverse tolerances, 1 for the least; all 1 where the readings are zero, as it is."""
    least = tolerance.min()
    return np.asarray(least / tolerance if least > 0 else np.ones_like(tolerance))


def _fewest_corners(time: FloatArray, value: FloatArray, tolerance: FloatArray) -> np.ndarray:
    """Return the readings at which the line has its corners, the first and the last too."""
    weight = _weights(tolerance) ** 2
    n = time.size
    corners = np.full(n, n)
    squares = np.full(n, np.inf)
    before = np.zeros(n, dtype=np.int64)
    corners[0], squares[0] = 0, 0.0
    for i in range(n - 1):
        after = slice(i + 1, None)
        reached, missed = _reached(
            time[after] - time[i], value[after] - value[i], tolerance[after], weight[after]
        )
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
    t: FloatArray, y: FloatArray, tolerance: FloatArray, weight: FloatArray
) -> tuple[np.ndarray, FloatArray]:
    """Return where lines from a reading at 0, 0 may end, from 1, and the squares they miss."""
    lowest = np.maximum.accumulate((y - tolerance) / t)
    highest = np.minimum.accumulate((y + tolerance) / t)
    slope = y / t
    within = np.flatnonzero((lowest <= slope) & (slope <= highest))
    squares = (
        np.cumsum(weight * y**2)
        - 2 * slope * np.cumsum(weight * t * y)
        + slope**2 * np.cumsum(weight * t**2)
    )
    return within + 1, squares[within]


def rate_steps(times: FloatArray, strains: FloatArray) -> tuple[tuple[float, float], ...]:
    """Return strains from which rates (1/s) are imposed, and those rates; none without steps."""
    time, strain = looked_at(times, np.abs(strains))
    if time.size < 2:
        return ()
    corner, value = line_through(time, strain, tolerances(time, strain))
    # A leg from one reading to the next may be a step between them: its neighbours meet there.
    long = np.diff(np.searchsorted(time, corner)) > 1
    rate, strain_at_0 = (np.diff(value) / np.diff(corner))[long], value[:-1][long]
    strain_at_0 = strain_at_0 - rate * corner[:-1][long]
    if not 1 < rate.size <= MAX_RATES or rate.min() <= MIN_RATE_SHARE * rate.max():
        return ()
    if not all(max(two) >= MIN_RATE_RATIO * min(two) for two in pairwise(rate)):
        return ()
    start = strain_at_0[:-1] - rate[:-1] * np.diff(strain_at_0) / np.diff(rate)
    if not np.all(np.diff([0.0, *start, strain.max()]) > 0):
        return ()
    rounded = [0.0, *(float(f"{one:.4g}") for one in start)]
    return tuple(zip(rounded, (float(f"{one:.3g}") for one in rate), strict=True))


def looked_at(times: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a series at times that grow; inside a long one, means of neighbours."""
    time, first = np.unique(times, return_index=True)
    value, inner = values[first], time.size - 2
    if time.size <= MAX_LOOKED_AT:
        return time, value
    starts = 1 + np.arange(MAX_LOOKED_AT - 2) * inner // (MAX_LOOKED_AT - 2)
    counts = np.diff(starts, append=1 + inner)
    time, value = (
        np.concatenate([one[:1], np.add.reduceat(one[:-1], starts) / counts, one[-1:]])
        for one in (time, value)
    )
    return time, value


def is_driven_by_rates(time: FloatArray, strain: FloatArray, stress: FloatArray) -> bool:
    """Whether steps of the rate explain the strain with fewer legs than steps of a stress, (n,)."""
    n_rates = len(rate_steps(time, strain))
    if n_rates == 0:
        return False
    moment, value = looked_at(time, stress)
    corner, _ = line_through(moment, value, tolerances(moment, value))
    # So many levels, with a leg between each two.
    return 2 * n_rates - 1 < corner.size - 1


def is_at_one_rate(time: FloatArray, strain: FloatArray) -> bool:
    """Whether the strain is one straight line over the times, (n,)."""
    moment, value = looked_at(time, strain)
    return line_through(moment, value, tolerances(moment, value))[0].size == 2


def thinned(
    time: FloatArray,
    stage: IntArray,
    value: FloatArray,
    changes: Callable[[int], FloatArray],
    most: int,
) -> BoolArray:
    """Return which readings (n_readings,) are kept: half by stages, half by their numbers."""
    kept = np.ones(time.size, dtype=np.bool_)
    if time.size <= most:
        return kept
    numbers, counts = np.unique(stage, return_counts=True)
    for number, count in zip(numbers, counts, strict=True):
        share = most * (0.5 / numbers.size + 0.5 * count / time.size)
        own = np.flatnonzero(stage == number)
        wanted = max(2, int(share))
        chosen = kept_readings(time[own], value[own], changes(int(number)), wanted)
        kept[np.delete(own, chosen)] = False
    return kept


def thinning_told(kept: BoolArray) -> list[str]:
    """Say how many readings (n_readings,) are kept of a record that is thinned."""
    if kept.all():
        return []
    return [
        f"{np.count_nonzero(kept)} of {kept.size} {ARE_USED}, more of them where what is imposed "
        "changes and where the response moves. They are single readings: means of neighbours, if "
        "they are written to the file instead, keep what the others say."
    ]


def kept_readings(
    time: FloatArray, response: FloatArray, changes: FloatArray, n_kept: int
) -> IntArray:
    """Return at most `n_kept` indices, with both ends, dense at `changes` (s) and in moves."""
    if time.size <= n_kept:
        return np.arange(time.size)
    parts = (time, _log_time(time, changes), _way(time, response))
    measure = np.mean([_from_0_to_1(part) for part in parts], axis=0)

    def nearest(n_places: int) -> IntArray:
        places = np.interp(np.linspace(0, 1, n_places), measure, np.arange(time.size))
        return np.unique(np.rint(places).astype(np.int64))

    kept, n_places = nearest(n_kept), n_kept
    while kept.size < FULL_SHARE * n_kept and n_places < MAX_PLACES * n_kept:
        n_places += n_kept - kept.size
        more = nearest(n_places)
        kept = kept if more.size > n_kept else more
    return kept


def _log_time(time: FloatArray, changes: FloatArray) -> FloatArray:
    """Logarithm of the time since the last change, added up over the changes."""
    last = np.searchsorted(changes, time, side="right") - 1
    scale = float(np.median(np.diff(np.unique(time))))
    within = np.log1p((time - changes[last]) / scale)
    spans = np.log1p(np.diff(changes) / scale)
    before = np.concatenate([[0.0], np.cumsum(spans)])
    return np.asarray(before[last] + within)


def _way(time: FloatArray, response: FloatArray) -> FloatArray:
    """Sum of all rises and falls of the response up to each reading."""
    tolerance = tolerance_of(response, reading_error(time, response))
    moment, place, count = np.unique(time, return_inverse=True, return_counts=True)
    mean = np.bincount(place, response) / count
    corners, values = line_through(*looked_at(moment, mean), tolerance)
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(values)))])
    return np.asarray(np.interp(time, corners, way))


def _from_0_to_1(measure: FloatArray) -> FloatArray:
    span = measure[-1] - measure[0]
    return np.asarray((measure - measure[0]) / span if span > 0 else np.zeros_like(measure))
