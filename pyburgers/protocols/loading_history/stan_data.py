"""Data of `stan/loading_history.stan` about its tests."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pyburgers.model.prior_families import is_fixed_at
from pyburgers.model.priors import PriorSet
from pyburgers.protocols.attenuation import stan_data as attenuation
from pyburgers.protocols.attenuation.experiment import AttenuationExperiment
from pyburgers.protocols.loading_history.experiment import LoadingHistory
from pyburgers.protocols.loading_history.kelvin_rows import elements_block
from pyburgers.protocols.loading_history.measured_sections import section_times
from pyburgers.protocols.microstructure import measured_block, strains_of
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


def tests_block(
    experiments: Sequence[LoadingHistory | AttenuationExperiment], priors: Sequence[PriorSet]
) -> StanData:
    """Return the blocks `stan/data/loading_history.stan` and `stan/data/attenuation.stan`.

    Tables of attenuation have no legs; their readings stand among the points.
    """
    histories = [e for e in experiments if isinstance(e, LoadingHistory)]
    legs = [
        [
            2.0 if leg.is_force else float(leg.driven == "stress"),
            leg.end_time - leg.start_time,
            leg.start_value,
            leg.rate,
            leg.temperature,
        ]
        for experiment in histories
        for leg in experiment.legs
    ]
    outputs = [
        solver_outputs(e, section_times(e, own))
        for e, own in zip(experiments, priors, strict=True)
        if isinstance(e, LoadingHistory)
    ]
    times, counts = _times_in_legs(
        histories, [one.time for one in outputs], [one.leg for one in outputs]
    )
    by_history = {id(e): one for e, one in zip(histories, outputs, strict=True)}
    measured = [e.microstructure for e in experiments]

    def by_point(of_history: Callable[[LoadingHistory], npt.NDArray[Any]]) -> npt.NDArray[Any]:
        """Join numbers of every point, 0 of readings of a table."""
        return np.concatenate(
            [
                of_history(e) if isinstance(e, LoadingHistory) else np.zeros(e.n_points)
                for e in experiments
            ]
        )

    return {
        "leg_end": ends(len(e.legs) if isinstance(e, LoadingHistory) else 0 for e in experiments),
        "leg": np.reshape(legs, (-1, 5)).tolist(),
        "stress_scale": [
            stress_scale(e) if isinstance(e, LoadingHistory) else e.largest_stress
            for e in experiments
        ],
        "strain_scale": [
            strain_scale(e) if isinstance(e, LoadingHistory) else LABORATORY_STRAIN
            for e in experiments
        ],
        "response_observed": np.concatenate([e.response for e in experiments]).tolist(),
        "is_strain": by_point(lambda e: e.response_is_strain).astype(int).tolist(),
        "output_end": ends(
            by_history[id(e)].time.size if isinstance(e, LoadingHistory) else 0 for e in experiments
        ),
        "output_time_in_leg": np.concatenate([np.empty(0), *times]).tolist(),
        "n_outputs_in_leg": counts,
        "output_of_point": by_point(lambda e: by_history[id(e)].of_readings).astype(int).tolist(),
        "point_time": by_point(lambda e: e.time).tolist(),
        "point_stage": by_point(lambda e: e.reading_stage).astype(int).tolist(),
        "measured_end": ends(len(sections) for sections in measured),
        "output_of_measured": [
            int(place)
            for one in outputs
            for place in one.of_sections  # tables have none
        ],
        "measured_path_strain": np.concatenate(
            [np.nan_to_num(strains_of(sections)) for sections in measured]
        ).tolist(),
        "measured": measured_block(measured),
        "correlated_residuals": int(
            not all(is_fixed_at(own["residual_correlation_time"], 0.0) for own in priors)
        ),
        **elements_block(
            [
                (test if isinstance(test, LoadingHistory) else None, own)
                for test, own in zip(experiments, priors, strict=True)
            ]
        ),
        **attenuation.tables_block(_tables(experiments)),
    }


def grid_block(
    experiments: Sequence[LoadingHistory | AttenuationExperiment], grids: Sequence[FloatArray]
) -> StanData:
    """Return times (s), or places in tables, at which solutions are reported beside the readings.

    See `leg_of_times` for times at which legs meet.
    """
    histories = [
        (e, grid)
        for e, grid in zip(experiments, grids, strict=True)
        if isinstance(e, LoadingHistory)
    ]
    own = [grid for _, grid in histories]
    places = [leg_of_times(e, grid) for e, grid in histories]
    times, counts = _times_in_legs([e for e, _ in histories], own, places)
    stages = [stage_of_times(e, grid) for e, grid in histories]
    return {
        "grid_end": ends(
            grid.size if isinstance(e, LoadingHistory) else 0
            for e, grid in zip(experiments, grids, strict=True)
        ),
        "grid_time_in_leg": np.concatenate([np.empty(0), *times]).tolist(),
        "n_grid_in_leg": counts,
        "grid_time": np.concatenate([np.empty(0), *own]).tolist(),
        "grid_stage": np.concatenate([np.empty(0, dtype=np.int64), *stages]).tolist(),
        **attenuation.grid_block(_tables(experiments), grids),
    }


def _tables(
    experiments: Sequence[LoadingHistory | AttenuationExperiment],
) -> list[AttenuationExperiment | None]:
    return [None if isinstance(one, LoadingHistory) else one for one in experiments]


@dataclass(frozen=True, eq=False)
class Outputs:
    """Where the solver reports along a test: at readings and sections, in the order of time.

    Attributes
    ----------
    time, leg : array, shape (n_outputs,)
        Seconds since the start; leg from 0.
    of_readings, of_sections : array of int
        Place of each among them, from 1; 0 of a section that needs no solution.
    """

    time: FloatArray
    leg: IntArray
    of_readings: IntArray
    of_sections: IntArray


def solver_outputs(experiment: LoadingHistory, sections: Sequence[float | None]) -> Outputs:
    """Return where the solver reports.

    Parameters
    ----------
    experiment : LoadingHistory
        With its readings.
    sections : sequence of float or None
        Times (s) of sections, None for those that need no solution. A section at the time of a
        jump of the stress is ahead of it: the sample was taken out at the end of what was before.
    """
    wanted = np.array([one is not None for one in sections], dtype=np.bool_)
    own = np.array([one for one in sections if one is not None], dtype=np.float64)
    own_leg = np.array([leg_of_times(experiment, own[[k]])[0] for k in range(own.size)], np.int64)
    time = np.concatenate([experiment.time, own])
    leg = np.concatenate([leg_of_readings(experiment), own_leg])
    order = np.lexsort((time, leg))
    place = np.empty_like(order)
    place[order] = np.arange(1, order.size + 1)
    of_sections = np.zeros(wanted.size, dtype=np.int64)
    of_sections[wanted] = place[experiment.n_points :]
    return Outputs(time[order], leg[order], place[: experiment.n_points], of_sections)


def leg_of_times(experiment: LoadingHistory, time: FloatArray) -> IntArray:
    """Return the leg, from 0, of times (s) that do not decrease.

    Of equal times at which two legs meet the first is in the leg that ends there, the others are
    in the one that begins: behind a jump of the stress, if there is one.
    """
    inner = np.array([leg.end_time for leg in experiment.legs[:-1]])
    leg = np.searchsorted(inner, time, side="left")
    repeated = np.diff(time, prepend=-1.0) == 0
    return np.asarray(leg + (np.isin(time, inner) & repeated), dtype=np.int64)


def stage_of_times(experiment: LoadingHistory, time: FloatArray) -> IntArray:
    """Return the stage, from 0, of times (s); shared ends count as in `leg_of_times`."""
    stage_of_leg = np.array([leg.stage for leg in experiment.legs], dtype=np.int64)
    return stage_of_leg[leg_of_times(experiment, time)]


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
) -> tuple[list[FloatArray], list[int]]:
    """Return times since the start of their leg over its duration, and their number in each."""
    shares: list[FloatArray] = []
    counts: list[int] = []
    for experiment, time, place in zip(experiments, times, places, strict=True):
        start = np.array([leg.start_time for leg in experiment.legs])
        end = np.array([leg.end_time for leg in experiment.legs])
        since = (time - start[place]) / (end - start)[place]
        shares.append(np.clip(since, 0.0, 1.0))
        counts += np.bincount(place, minlength=start.size).tolist()
    return shares, counts
