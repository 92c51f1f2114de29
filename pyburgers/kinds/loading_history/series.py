"""What drives a stage: its readings up to both of its ends, and the strain that it starts at."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.kinds.loading_history.readings import Readings
from pyburgers.kinds.loading_history.stages import Stage, legs_of


def one_reading_each(
    source: Path | None, time: FloatArray, value: FloatArray, text: Callable[[float], str]
) -> tuple[FloatArray, FloatArray]:
    """Return readings (n,) that drive a stage, of equal ones of one moment the first."""
    again = np.diff(time, prepend=-np.inf) == 0
    if np.any(again[1:] & (np.diff(value) != 0)):
        moments, counts = np.unique(time[again], return_counts=True)
        listed = ", ".join(
            f"{text(moment)} ({count + 1} readings)"
            for moment, count in zip(moments, counts, strict=True)
        )
        raise InputError(
            f"{source}: found times that occur more than once with different readings, {listed}; "
            "expected one reading of a moment, because these drive the stage: if the times were "
            "rounded, write them in full; if one moment was read several times, write the mean; if "
            'the stress is constant, impose it (control = "stress"), and all readings are kept.'
        )
    return time[~again], value[~again]


MAX_GAP_SHARE = 0.05
"""Share of a stage at either end in which nothing need be read; more where readings lie as far
apart."""

ROUNDING = 1e-9
"""Relative error of differences of times."""


@dataclass(frozen=True, eq=False)
class Series:
    """What was read of a quantity over a stage: s since the start of the test; Pa or fraction.

    `time`, `value` (n,): the first and the last are at the ends of the stage.
    `n_read`, `gaps`: readings among them; shares of the stage before the first and after the last.
    """

    time: FloatArray
    value: FloatArray
    n_read: int
    gaps: tuple[float, float]

    @property
    def unread(self) -> str:
        """Words about the ends in which nothing was read, to follow a sentence; empty for none."""
        ends = [
            f"its {name} {100 * gap:.2g} %"
            for name, gap in zip(("first", "last"), self.gaps, strict=True)
            if gap > 0
        ]
        return f" Nothing was read in {' and '.join(ends)}." if ends else ""


def own_readings(
    readings: Readings,
    quantity: Literal["stress", "strain"],
    stage: int,
    span: tuple[float, float],
    shared: tuple[bool, bool],
) -> tuple[FloatArray, FloatArray]:
    """Return times (s) and values of the readings that are of a stage; `span` are its ends (s)."""
    time, value = readings.of(quantity, stage)
    every, values = readings.of(quantity)
    for end, nothing_jumps in zip(span, shared, strict=True):
        there = np.flatnonzero(every == end)
        if nothing_jumps and there.size and end not in time:
            place = int(np.searchsorted(time, end))
            time = np.insert(time, place, end)
            value = np.insert(value, place, values[there[0]])
    return time, value


def too_long_a_gap(time: FloatArray, span: tuple[float, float]) -> bool:
    """Whether readings (s) leave more of an end of a stage out than they may."""
    start, end = span
    allowed = MAX_GAP_SHARE * (end - start)
    spacing = np.diff(time)
    return bool(
        time[0] - start > max(allowed, spacing[0]) * (1 + ROUNDING)
        or end - time[-1] > max(allowed, spacing[-1]) * (1 + ROUNDING)
    )


def with_ends(
    readings: Readings,
    quantity: Literal["stress", "strain"],
    own: tuple[FloatArray, FloatArray],
    span: tuple[float, float],
) -> Series:
    """Add values at the ends of a stage (s) where none was read; at least two readings are."""
    time, value = own
    n_read, duration = time.size, span[1] - span[0]
    gaps = float(time[0] - span[0]) / duration, float(span[1] - time[-1]) / duration
    beside = np.interp(span, *readings.of(quantity))
    if gaps[0] > 0:
        first = _gone_on(time[1::-1], value[1::-1], span[0], beside[0])
        time, value = np.insert(time, 0, span[0]), np.insert(value, 0, first)
    if gaps[1] > 0:
        last = _gone_on(time[-2:], value[-2:], span[1], beside[1])
        time, value = np.append(time, span[1]), np.append(value, last)
    return Series(time, value, n_read, gaps)


def _gone_on(time: FloatArray, value: FloatArray, end: float, beside: float) -> float:
    """Value at an end of a stage (s) to which the line through two readings is drawn on.

    Not beyond `beside`, so that a ramp goes on and a jump does not; nor over a time longer than
    theirs.
    """
    share = (end - time[1]) / (time[1] - time[0])
    if share > 1 + ROUNDING:
        return float(value[1])
    drawn = value[1] + share * (value[1] - value[0])
    return float(np.clip(drawn, min(value[1], beside), max(value[1], beside)))


@dataclass(frozen=True)
class StartStrain:
    """Strain at the start of a stage.

    `value`: true strain of the sample (fraction), without the zero of the readings.
    `slack`: how much it may have changed since it was read; 0 where it was imposed.
    """

    value: float
    slack: float


def strain_at_start(
    before: Sequence[Stage], readings: Readings, zero: float, *, read_there: bool
) -> StartStrain | None:
    """Return the strain at the end of stages, None where stress was imposed and no strain read.

    After an imposed stress it is the last reading, and what was imposed since. Its slack is the
    change from the reading before, for the time that stress was imposed after it.
    """
    loaded = [number for number, stage in enumerate(before) if stage.driven == "stress"]
    if not loaded:
        return StartStrain(_imposed(before, 0.0), 0.0)
    last, now = loaded[-1], before[-1].end_time
    there = (readings.stage >= last) & (readings.time <= now) & np.isfinite(readings.strain)
    there &= (readings.stage < len(before)) | read_there
    time, strain = readings.time[there], readings.strain[there] - zero
    if time.size == 0:
        return None
    value = float(strain[-1]) + _imposed(before[last + 1 :], float(time[-1]))
    earlier = np.flatnonzero(time < time[-1])
    if earlier.size == 0:
        return StartStrain(value, abs(float(strain[0])))
    k = earlier[-1]
    longer = (before[last].end_time - time[-1]) / (time[-1] - time[k])
    return StartStrain(value, float(abs(strain[-1] - strain[k]) * max(1.0, longer)))


def _imposed(stages: Sequence[Stage], since: float) -> float:
    """Strain that stages impose after a time (s)."""
    return sum(
        leg.rate * max(0.0, leg.end_time - max(leg.start_time, since)) for leg in legs_of(stages)
    )
