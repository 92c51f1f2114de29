"""What the readings of a column do along its rows, by which kinds of test are told apart."""

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from pyburgers.kinds.guessed_columns import GuessedColumn

FloatArray = npt.NDArray[np.float64]

MAX_STEADY_RANGE = 0.05
"""Relative range of readings that count as one value."""

MIN_TURN_ABOUT_LINE, MIN_TURN = 0.2, 0.02
"""Ways back that count as turning points, in shares of the range about a straight line and of the
whole range."""

MIN_CYCLES = 2
"""Cycles from which readings count as oscillating."""

MIN_LEVEL_GAP, MIN_LEVEL_DISTANCE, MIN_LEVEL_READINGS, MIN_LEVELS_SHARE = 0.1, 2.0, 3, 0.8
"""Of levels: the least distance to the next in shares of the range, and in widths of the widest;
readings of each, and the share of all readings that they are together."""

MIN_RUN_READINGS, MAX_RUN_RISE = 10, 0.2
"""Readings of a run that stays, and how little it may rise or fall, in shares of its band."""


@dataclass(frozen=True, eq=False)
class Facts:
    """What readings do.

    `values` (n,): readings that are there, in the order of the rows.
    """

    values: FloatArray

    @property
    def is_steady(self) -> bool:
        """Whether they stay the same, but for the first tenth and the first reading."""
        if self.values.size < 2:
            return False
        level = abs(float(np.median(self.values)))
        return level > 0 and self._range(max(1, self.values.size // 10)) < MAX_STEADY_RANGE * level

    @property
    def relative_range(self) -> float:
        """Range over the largest value; 0 where all are zero."""
        largest = float(np.abs(self.values).max())
        return self._range() / largest if largest > 0 else 0.0

    @property
    def only_falls(self) -> bool:
        """Whether the first is the largest by size and they fall without a turning point."""
        sizes = np.abs(self.values)
        return (
            sizes[0] > sizes[-1]
            and sizes[0] >= (1 - MAX_STEADY_RANGE) * sizes.max()
            and not self.turns
        )

    @cached_property
    def turns(self) -> tuple[int, ...]:
        """Turning points, from 0: largest and least readings between ways back that count."""
        n = self.values.size
        if n < 3:
            return ()
        place = np.arange(n)
        about = self.values - np.polyval(np.polyfit(place, self.values, 1), place)
        way_back = max(MIN_TURN_ABOUT_LINE * float(np.ptp(about)), MIN_TURN * self._range())
        return _turning_points(self.values, way_back)

    @property
    def oscillates(self) -> bool:
        """Whether they turn as often as those of some cycles."""
        return len(self.turns) >= 2 * MIN_CYCLES - 1

    @property
    def is_in_levels(self) -> bool:
        """Whether most readings lie at two or more levels, few between or in flat runs."""
        if self._is_in_flat_runs:
            return True
        ordered = np.sort(self.values)
        gaps = np.flatnonzero(np.diff(ordered) > MIN_LEVEL_GAP * self._range())
        levels = [one for one in np.split(ordered, gaps + 1) if one.size >= MIN_LEVEL_READINGS]
        widest = max((float(np.ptp(one)) for one in levels), default=0.0)
        return (
            len(levels) > 1
            and all(
                low[-1] + MIN_LEVEL_DISTANCE * widest < high[0]
                for low, high in itertools.pairwise(levels)
            )
            and sum(one.size for one in levels) >= MIN_LEVELS_SHARE * ordered.size
        )

    @property
    def _is_in_flat_runs(self) -> bool:
        """Whether most readings are in runs that stay, of several values, with ramps between."""
        band = MAX_STEADY_RANGE * float(np.abs(self.values).max())
        starts = [0]
        for k, value in enumerate(self.values):
            if abs(value - self.values[starts[-1]]) > band:
                starts.append(k)
        runs = [one for one in np.split(self.values, starts[1:]) if one.size >= MIN_RUN_READINGS]
        flat = [one for one in runs if abs(_second_half_over_first(one)) < MAX_RUN_RISE * band]
        return (
            any(abs(one.mean() - flat[0].mean()) > band for one in flat)
            and sum(one.size for one in flat) >= MIN_LEVELS_SHARE * self.values.size
        )

    @cached_property
    def held_from(self) -> int:
        """First reading, from 0, from which on all stay at the last one."""
        away = np.flatnonzero(
            np.abs(self.values - self.values[-1]) > MAX_STEADY_RANGE * np.abs(self.values).max()
        )
        return int(away[-1]) + 1 if away.size else 0

    def _range(self, start: int = 0) -> float:
        return float(np.ptp(self.values[start:]))


def _second_half_over_first(values: FloatArray) -> float:
    """Return by how much the later half of readings is larger than the earlier one."""
    half = values.size // 2
    return float(values[half:].mean() - values[:half].mean())


def _turning_points(values: FloatArray, way_back: float) -> tuple[int, ...]:
    """Return where readings turn and go back by more than so much."""
    turns, highest, lowest, direction = [], 0, 0, 0
    for k, value in enumerate(values):
        highest = k if value > values[highest] else highest
        lowest = k if value < values[lowest] else lowest
        if direction >= 0 and value < values[highest] - way_back:
            turns += [highest] if direction or highest else []
            direction, lowest = -1, k
        elif direction <= 0 and value > values[lowest] + way_back:
            turns += [lowest] if direction or lowest else []
            direction, highest = 1, k
    return tuple(turns)


def facts_of(column: GuessedColumn) -> Facts:
    """Return what the readings of a column do, in SI."""
    return Facts(column.si[np.isfinite(column.si)])


def read_together(*values: FloatArray) -> tuple[FloatArray, ...]:
    """Return readings of the rows in which all of some columns have one."""
    there = np.all(np.isfinite(values), axis=0)
    return tuple(own[there] for own in values)
