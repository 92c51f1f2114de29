"""Tests of other protocols as loading histories, to be fitted together with some."""

import numpy as np

from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stages import Stage


def as_history(experiment: ConstantRateExperiment) -> HistoryExperiment:
    """Return a test at piecewise constant strain rate as a history of such stages.

    The model, the readings and their density are the same; a path strain is the strain.
    """
    starts = np.array([segment.start_strain for segment in experiment.segments])
    times = experiment.time_at(np.append(starts, experiment.final_strain))
    stages = tuple(
        Stage(
            control="strain_rate",
            start_time=float(times[k]),
            end_time=float(times[k + 1]),
            temperature=experiment.temperature,
            value=segment.strain_rate,
        )
        for k, segment in enumerate(experiment.segments)
    )
    stage = experiment.reading_segment
    time = np.clip(experiment.time_at(experiment.strain), times[stage], times[stage + 1])
    return HistoryExperiment(
        id=experiment.id,
        material=experiment.material,
        temperature=experiment.temperature,
        initial_grain_size=experiment.initial_grain_size,
        provenance=experiment.provenance,
        metadata=experiment.metadata,
        notices=experiment.notices,
        true_parameters=experiment.true_parameters,
        uncertain=experiment.uncertain,
        stages=stages,
        time=time,
        reading_stage=stage,
        reading=experiment.stress,
        stress_uncertainty=experiment.stress_uncertainty,
        n_readings_in_file=experiment.n_points,
        microstructure=experiment.microstructure,
    )
