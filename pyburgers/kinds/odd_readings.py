"""Readings that may be none, rows that stand twice, and the order of rows."""

import numpy as np

from pyburgers.common.array_types import FloatArray
from pyburgers.common.units import count_points

MIN_FAR_RATIO, MIN_FAR_READINGS = 10.0, 5
"""How many times larger than all others readings are that may be none; of so many at least."""

MIN_CLIPPED, MAX_EQUAL_SHARE = 10, 0.02
"""Equal readings in a row that may be the end of a range, if few others equal their neighbours."""

MIN_BESIDE_SHARE = 0.1
"""Share of the largest reading that both neighbours of zeros have which may be none."""


def odd_readings(values: FloatArray, what: str) -> list[str]:
    """Say which readings may stand for none, or for the end of a range; values in their order."""
    return [*_far_readings(values, what), *_clipped(values, what), *_zeros(values, what)]


def _far_readings(values: FloatArray, what: str) -> list[str]:
    """Say where one reading, or several equal ones, are many times larger than all others."""
    size = np.abs(values)
    others = size[size < size.max(initial=0.0)]
    if others.size < MIN_FAR_READINGS - 1 or size.max() <= MIN_FAR_RATIO * others.max():
        return []
    far, n = values[size.argmax()], size.size - others.size
    which = f"one {what} of {far:g} is" if n == 1 else f"{n} readings of {what}, {far:g}, are"
    them, rows = ("it stands", "its row") if n == 1 else ("they stand", "their rows")
    name = "it" if n == 1 else "them"
    return [
        f"{which} more than {MIN_FAR_RATIO:g} times as large as all others; if {them} for no "
        f"reading, remove {rows} or name {name} in the key missing of [data]."
    ]


def _clipped(values: FloatArray, what: str) -> list[str]:
    """Say where the largest reading stays the same while others, which are no steps, change."""
    if values.size < MIN_CLIPPED:
        return []
    is_largest, same = np.abs(values) == np.abs(values).max(), np.diff(values) == 0
    among_largest = is_largest[1:] & is_largest[:-1]
    ends = np.flatnonzero(np.diff(np.concatenate([[0], same & among_largest, [0]])))
    longest = 1 + int(np.max(np.diff(ends)[::2], initial=0))
    are_steps = np.sum(same & ~among_largest) > MAX_EQUAL_SHARE * values.size
    if are_steps or not MIN_CLIPPED <= longest < values.size:
        return []
    return [
        f"{longest} readings of {what} in a row are exactly {values[is_largest.argmax()]:g}, the "
        "largest; check whether the instrument was at the end of its range."
    ]


def _zeros(values: FloatArray, what: str) -> list[str]:
    """Say where exact zeros stand between readings that are clearly larger."""
    known = np.flatnonzero(values)
    is_large = np.abs(values[known]) > MIN_BESIDE_SHARE * np.abs(values).max(initial=0.0)
    n_zeros = int(np.sum((np.diff(known) - 1)[is_large[1:] & is_large[:-1]]))
    if n_zeros == 0:
        return []
    which = f"one {what} is" if n_zeros == 1 else f"{n_zeros} readings of {what} are"
    return [f"{which} exactly 0 between larger ones; if that is no reading, leave the cell empty."]


def opposed_stresses(stress: FloatArray, *, compressed: bool) -> list[str]:
    """Say where most stresses (n,) have another sign than the imposed strain."""
    if not stress.size or np.mean(stress < 0 if compressed else stress > 0) <= 0.5:
        return []
    here, own, read = ("compression", "positive", "negative")
    if not compressed:
        here, own, read = ("extension", read, own)
    return [f"Most stresses are {read}, but {here} is {own} in this model: check the sign."]


def repeated(at: FloatArray, values: FloatArray, axis: str, of: str = "") -> list[str]:
    """Say where rows stand twice, or readings (n,) at one place `at` of an axis; `of`: of what."""
    n_same = np.count_nonzero(np.diff(at) == 0)
    if all(np.array_equal(one[::2], one[1::2]) for one in (at, values)):
        return [f"Every row{of} stands twice: remove one of each, as each counts as a reading."]
    if n_same == 0:
        return []
    return [
        f"{count_points(n_same)}{of} at the same {axis} as the point before: each counts as a "
        "reading."
    ]


def order_text(clock: FloatArray) -> str:
    """Say what rows whose clock (n_rows,) goes back may be, to follow a sentence; else empty."""
    half, steps = clock.size // 2, np.diff(clock)
    if not (steps < 0).any():
        return ""
    if (steps <= 0).all():
        return " The rows stand in reverse order: turn them round."
    if clock.size == 2 * half and np.array_equal(clock[:half], clock[half:]):
        return " The second half of the rows repeats the first: remove it."
    last_rise = int(np.flatnonzero(steps > 0)[-1])
    if last_rise + 1 == clock.argmax() < clock.size - 1:
        return (
            " All rows after the largest go back: leave them out if the sample was unloaded there."
        )
    return ""
