"""Data of `stan/loading_history.stan` about its tests."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from pyburgers.model.prior_families import is_fixed_at
from pyburgers.model.priors import PriorSet
from pyburgers.protocols.loading_history.experiment import LoadingHistory
from pyburgers.protocols.loading_history.kelvin_rows import elements_block
from pyburgers.protocols.stan_data import StanData, ends

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

REFERENCE_FLOW_RATE_SCALE = 0.2
"""Scale of ln(flow rate s): data fix it to a few hundredths, the prior to about 1."""

LABORATORY_STRESS, LABORATORY_STRAIN = 1e7, 1e-2
"""Scales (Pa, fraction) of a test that neither imposes them nor has readings."""


def stress_scale(experiment: LoadingHistory) -> float:
    """Return the stress (Pa) of the reference flow rate, which scales the solver's states too.

    The largest one that is imposed or read.
    """
    stress_driven = any(stage.driven == "stress" for stage in experiment.stages)
    if not stress_driven and experiment.n_points == 0:
        return LABORATORY_STRESS
    return experiment.largest_stress or LABORATORY_STRESS


def strain_scale(experiment: LoadingHistory) -> float:
    """Return the largest strain that is read, or that is imposed in all."""
    imposed = sum(abs(leg.end_value) for leg in experiment.legs if leg.driven == "strain")
    read = np.abs(experiment.reading[experiment.response_is_strain])
    return max(imposed, float(read.max(initial=0.0))) or LABORATORY_STRAIN


def reference_origin(experiment: LoadingHistory) -> tuple[float, float]:
    """Origin and size of ln(flow rate s): strain over time of the test."""
    rate = strain_scale(experiment) / experiment.end_time
    return float(np.log(rate)), REFERENCE_FLOW_RATE_SCALE


def tests_block(experiments: Sequence[LoadingHistory], priors: Sequence[PriorSet]) -> StanData:
    """Return the block `stan/data/loading_history.stan`."""
    legs = [
        [
            float(leg.driven == "stress"),
            leg.end_time - leg.start_time,
            leg.start_value,
            leg.rate,
            leg.temperature,
        ]
        for experiment in experiments
        for leg in experiment.legs
    ]
    places = [leg_of_readings(experiment) for experiment in experiments]
    times, counts = _times_in_legs(experiments, [e.time for e in experiments], places)
    return {
        "leg_end": ends(len(e.legs) for e in experiments),
        "leg": legs,
        "stress_scale": [stress_scale(e) for e in experiments],
        "strain_scale": [strain_scale(e) for e in experiments],
        "response_observed": np.concatenate([e.reading for e in experiments]).tolist(),
        "is_strain": np.concatenate([e.response_is_strain for e in experiments])
        .astype(int)
        .tolist(),
        "point_time_in_leg": times,
        "n_points_in_leg": counts,
        "point_time": np.concatenate([e.time for e in experiments]).tolist(),
        "point_stage": np.concatenate([e.reading_stage for e in experiments]).tolist(),
        "correlated_residuals": int(
            not all(is_fixed_at(own["residual_correlation_time"], 0.0) for own in priors)
        ),
        **elements_block(priors),
    }


def grid_block(experiments: Sequence[LoadingHistory], grids: Sequence[FloatArray]) -> StanData:
    """Return the times (s) at which the solutions are reported apart from the readings.

    See `leg_of_times` for times at which legs meet.
    """
    places = [leg_of_times(e, grid) for e, grid in zip(experiments, grids, strict=True)]
    times, counts = _times_in_legs(experiments, grids, places)
    stages = [
        np.array([leg.stage for leg in experiment.legs], dtype=np.int64)[place]
        for experiment, place in zip(experiments, places, strict=True)
    ]
    return {
        "grid_end": ends(grid.size for grid in grids),
        "grid_time_in_leg": times,
        "n_grid_in_leg": counts,
        "grid_time": np.concatenate(grids).tolist(),
        "grid_stage": np.concatenate(stages).tolist(),
    }


def leg_of_times(experiment: LoadingHistory, time: FloatArray) -> IntArray:
    """Return the leg, from 0, of times (s) that do not decrease.

    Of equal times at which two legs meet the first is in the leg that ends there, the others are
    in the one that begins: behind a jump of the stress, if there is one.
    """
    inner = np.array([leg.end_time for leg in experiment.legs[:-1]])
    leg = np.searchsorted(inner, time, side="left")
    repeated = np.diff(time, prepend=-1.0) == 0
    return np.asarray(leg + (np.isin(time, inner) & repeated), dtype=np.int64)


def times_of_readings(experiment: LoadingHistory) -> tuple[FloatArray, IntArray]:
    """Return times at which a solution holds every reading, and the place of each among them.

    A reading at the start of a stage stands behind the jump there, so that its time comes twice.
    """
    start = np.array([stage.start_time for stage in experiment.stages])
    is_behind = (experiment.reading_stage > 0) & (
        experiment.time == start[experiment.reading_stage]
    )
    time = np.repeat(experiment.time, 1 + is_behind)
    return time, np.cumsum(1 + is_behind) - 1


def leg_of_readings(experiment: LoadingHistory) -> IntArray:
    """Return the leg of each reading, from 0."""
    time, place = times_of_readings(experiment)
    leg: IntArray = leg_of_times(experiment, time)[place]
    return leg


def _times_in_legs(
    experiments: Sequence[LoadingHistory],
    times: Sequence[FloatArray],
    places: Sequence[IntArray],
) -> tuple[list[float], list[int]]:
    """Return times since the start of their leg over its duration, and their number in each."""
    shares: list[float] = []
    counts: list[int] = []
    for experiment, time, place in zip(experiments, times, places, strict=True):
        start = np.array([leg.start_time for leg in experiment.legs])
        end = np.array([leg.end_time for leg in experiment.legs])
        since = (time - start[place]) / (end - start)[place]
        shares += np.clip(since, 0.0, 1.0).tolist()
        counts += np.bincount(place, minlength=start.size).tolist()
    return shares, counts
