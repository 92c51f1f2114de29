"""The strain at which a stage starts: what stages before imposed, or what was read last."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pyburgers.protocols.loading_history.readings import Readings
from pyburgers.protocols.loading_history.stages import Stage, legs_of


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

    After an imposed stress it is the last reading, and what was imposed since. The slack is the
    difference of that reading from the one before, for as long again as stress was imposed after
    it, at least once. `zero`: strain that is read of the sample at rest (fraction).
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
