"""Parts of a loading history in which a nearly constant stress stands: where it is a creep test."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stages import Leg

NEARLY_CONSTANT = 0.02
"""How far a stress may lie from its mean, as a share of it: flow with an exponent of 4 is then
within 8 % of that under the mean, about as well as minimum rates of two tests agree."""

LEAST_DURATION = 0.05
"""Share of a stage from which on a nearly constant stress is a load, whatever lies beside it."""

STEEPEST = 10.0
"""How many times faster than `NEARLY_CONSTANT` allows over a whole part its stress may change in
the first and the last leg. Faster ones begin the loading or unloading beside it, whose elastic
strain is no creep."""


@dataclass(frozen=True)
class CreepInterval:
    """Part of a stage in which a nearly constant compressive stress stands.

    `stage`: to which it belongs, from 0.
    `start_time`, `end_time`: seconds since the start of the test.
    `stress`: mean over time (Pa).
    """

    stage: int
    start_time: float
    end_time: float
    stress: float

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.end_time - self.start_time


def creep_intervals(experiment: HistoryExperiment) -> tuple[CreepInterval, ...]:
    """Return the creep of a test, in the order of time.

    A stage of constant stress is one interval; of one in which the stress varies the longest parts
    are taken whose stress is within `NEARLY_CONSTANT` of its mean.
    """
    found = []
    for number, stage in enumerate(experiment.stages):
        legs = [leg for leg in experiment.legs if leg.stage == number]
        least = LEAST_DURATION * (stage.end_time - stage.start_time)
        if stage.driven == "stress":
            parts = [
                one for one in _steady_parts(legs) if one.duration >= least or _rests(one, legs)
            ]
            found += _longest(parts)
    return tuple(found)


def _rests(part: CreepInterval, legs: Sequence[Leg]) -> bool:
    """Whether a short part is a load: no ramp, nor a ramp on which the stress rests for a while.

    Its stress changes `STEEPEST` times slower than in the legs beside it, of which at least one is
    no longer than the part.
    """
    inside = [
        abs(leg.rate)
        for leg in legs
        if part.start_time <= leg.start_time and leg.end_time <= part.end_time
    ]
    beside = [leg for leg in legs if part.start_time == leg.end_time]
    beside += [leg for leg in legs if part.end_time == leg.start_time]
    shortest = min(leg.end_time - leg.start_time for leg in beside)
    is_level = STEEPEST * max(inside) <= min(abs(leg.rate) for leg in beside)
    return is_level and shortest <= part.duration


def _steady_parts(legs: Sequence[Leg]) -> list[CreepInterval]:
    """Return every sequence of legs of a stage with a nearly constant stress."""
    found = []
    for first in range(len(legs)):
        least, largest, impulse = np.inf, -np.inf, 0.0
        for leg in legs[first:]:
            ends = leg.start_value, leg.end_value
            least, largest = min(least, *ends), max(largest, *ends)
            impulse += 0.5 * sum(ends) * (leg.end_time - leg.start_time)
            start = legs[first].start_time
            duration = leg.end_time - start
            stress = impulse / duration
            steepest = max(abs(legs[first].rate), abs(leg.rate))
            is_ramp = steepest * duration > STEEPEST * 2 * NEARLY_CONSTANT * stress
            if least <= 0 or largest - least > 2 * NEARLY_CONSTANT * largest:
                break
            if not is_ramp and max(largest - stress, stress - least) <= NEARLY_CONSTANT * stress:
                found.append(CreepInterval(leg.stage, start, leg.end_time, stress))
    return found


def _longest(parts: Sequence[CreepInterval]) -> list[CreepInterval]:
    """Return the longest parts that do not overlap, in the order of time."""
    kept: list[CreepInterval] = []
    for part in sorted(parts, key=lambda one: -one.duration):
        if all(part.end_time <= o.start_time or o.end_time <= part.start_time for o in kept):
            kept.append(part)
    return sorted(kept, key=lambda one: one.start_time)
