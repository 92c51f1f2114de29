"""Readings of what a stage imposes itself: the solution needs none, but they tell of wrong keys."""

from collections.abc import Sequence

import numpy as np

from pyburgers.protocols.departures import departure
from pyburgers.protocols.experiment import FloatArray
from pyburgers.protocols.loading_history.readings import Readings
from pyburgers.protocols.loading_history.stages import (
    Leg,
    Stage,
    imposed_strains,
    imposed_stresses,
    legs_of,
)

LEAST_READINGS = 3
"""Of a stage behind its start, where a reading may still be that of the stage before."""


def unlike_imposed(readings: Readings, stages: Sequence[Stage]) -> list[str]:
    """Say in which stages what was read of the imposed quantity is another one.

    Strains count from the first reading of the stage behind its start.
    """
    legs = legs_of(stages)
    found = []
    for number, stage in enumerate(stages):
        time, read = readings.of(stage.driven, number)
        time, read = time[time > stage.start_time], read[time > stage.start_time]
        if time.size < LEAST_READINGS:
            continue
        imposed = _imposed(legs, number, time)
        if stage.driven == "strain":
            read, imposed = read - read[0], imposed - imposed[0]
        elsewhere = imposed_stresses(legs) if stage.driven == "stress" else imposed_strains(legs)
        largest = float(np.abs([*read, *imposed, *elsewhere]).max())
        far = departure(read, imposed, largest)
        if far is not None:
            in_mpa = f"{far.largest / 1e6:.3g} MPa"
            found.append(
                f"Stage {number + 1}: the {stage.driven} that was read lies up to "
                f"{in_mpa if stage.driven == 'stress' else f'{far.largest:.3g}'} from the one that "
                f"is imposed, which it leaves at {time[far.first]:.4g} s; check units, signs and "
                "what is imposed."
            )
    return found


def _imposed(legs: Sequence[Leg], number: int, time: FloatArray) -> FloatArray:
    """Stress (Pa) that a stage imposes at times (s) in it, or strain since its start."""
    own = [leg for leg in legs if leg.stage == number]
    starts = np.array([leg.start_time for leg in own])
    values = np.array([leg.start_value for leg in own])
    if own[0].driven == "strain":
        values = np.array([0.0, *imposed_strains(own)[:-1]])
    k = np.searchsorted(starts, time, side="right") - 1
    imposed: FloatArray = values[k] + np.array([leg.rate for leg in own])[k] * (time - starts[k])
    return imposed
