"""Times (s) at which solutions of a loading history are told."""

import numpy as np

from pyburgers.kinds.experiment import FloatArray
from pyburgers.kinds.loading_history.creep_intervals import CreepInterval, creep_intervals
from pyburgers.kinds.loading_history.experiment import HistoryExperiment

TIMES_IN_A_LOAD = 48
"""Times beside those of its stage in a load that is only part of it: as many as a stage has."""

MOST_TIMES_IN_LOADS = 480
"""Of all such loads of a test, so that bands and files stay small: of more than ten loads each has
its share of them."""

SHORTEST_STEP = 1e-4
"""From the start of a load to the first of its times, and from the last to its end, as a share."""


def stage_times(experiment: HistoryExperiment, shape: FloatArray) -> FloatArray:
    """Return times spread in the same way over every stage, from its start to its end: both count.

    The start of a later stage is so the second of two equal times, behind a jump of the stress.
    """
    parts = []
    for stage in experiment.stages:
        time = stage.start_time + shape * (stage.end_time - stage.start_time)
        time[-1] = stage.end_time
        parts.append(time)
    return np.concatenate(parts)


def load_times(experiment: HistoryExperiment) -> FloatArray:
    """Return times inside the loads that are part of a stage, dense at the start of each.

    A load that fills its stage has the times of the stage.
    """
    loads = [one for one in creep_intervals(experiment) if not _fills_its_stage(experiment, one)]
    number = min(TIMES_IN_A_LOAD, MOST_TIMES_IN_LOADS // max(1, len(loads)))
    n_even = number - number // 2
    even = np.arange(1, n_even + 1) / n_even
    even[-1] = 1 - SHORTEST_STEP  # at the end itself the rate may be that of what comes after
    shape = np.union1d(np.geomspace(SHORTEST_STEP, 1.0, number // 2 + 1)[:-1], even)
    times = [load.start_time + shape * load.duration for load in loads]
    return np.concatenate([np.empty(0), *times])


def _fills_its_stage(experiment: HistoryExperiment, load: CreepInterval) -> bool:
    stage = experiment.stages[load.stage]
    return (load.start_time, load.end_time) == (stage.start_time, stage.end_time)
