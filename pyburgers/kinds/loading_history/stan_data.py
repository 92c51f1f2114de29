"""Data of `stan/loading_history.stan`: tests, sections, grids, and elements of the Kelvin part."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.common.errors import InputError
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.likelihood import LIKELIHOOD as TABLES
from pyburgers.kinds.attenuation.likelihood import tables_block
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.experiment_file import PATH_STRAIN_ROUNDING
from pyburgers.kinds.likelihood import measured_block, strains_of
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stages import Leg
from pyburgers.kinds.stan_data import StanData, ends, joined
from pyburgers.model.arrhenius import GAS_CONSTANT, log_slowdown
from pyburgers.model.kelvin_elements import element_rows
from pyburgers.model.laws import RELAXATION_TIMES
from pyburgers.model.parameters import ENVIRONMENT, ENVIRONMENT_NUMBERS, PLACE, STANDARD_VALUES
from pyburgers.model.prior_families import Prior, is_fixed_at
from pyburgers.model.priors import PriorSet
from pyburgers.model.variants import variant_of

HistoryOrTable = HistoryExperiment | AttenuationExperiment

REFERENCE_FLOW_RATE_SCALE = 0.2
"""Scale of ln(flow rate s): data fix it to a few hundredths, the prior to about 1."""

LABORATORY_STRESS, LABORATORY_STRAIN = 1e7, 1e-2
"""Scales (Pa, fraction) of a test that neither imposes them nor has readings."""


def stress_scale(experiment: HistoryExperiment) -> float:
    """Return the stress (Pa) of the reference flow rate: the largest that is imposed or read."""
    stress_driven = any(stage.driven == "stress" for stage in experiment.stages)
    if not stress_driven and experiment.n_points == 0:
        return LABORATORY_STRESS
    return experiment.largest_stress or LABORATORY_STRESS


def strain_scale(experiment: HistoryExperiment) -> float:
    """Return the largest strain that is read, or that is imposed in all."""
    imposed = sum(abs(leg.end_value) for leg in experiment.legs if leg.driven == "strain")
    read = np.abs(experiment.reading[experiment.response_is_strain])
    return max(imposed, float(read.max(initial=0.0))) or LABORATORY_STRAIN


def reference_origin(experiment: HistoryExperiment) -> tuple[float, float]:
    """Origin and size of ln(flow rate s): strain over time of the test."""
    rate = strain_scale(experiment) / experiment.end_time
    return float(np.log(rate)), REFERENCE_FLOW_RATE_SCALE


def tests_block(experiments: Sequence[HistoryOrTable], priors: Sequence[PriorSet]) -> StanData:
    """Return the blocks `stan/data/loading_history.stan` and `stan/data/attenuation.stan`."""
    entries = [_entries(e, own) for e, own in zip(experiments, priors, strict=True)]
    measured = [e.microstructure for e in experiments]
    return {
        **joined(entries),
        "leg_end": ends(len(own["leg"]) for own in entries),
        "output_end": ends(len(own["output_time_in_leg"]) for own in entries),
        "measured_end": ends(map(len, measured)),
        "measured_path_strain": np.concatenate(
            [np.nan_to_num(strains_of(sections)) for sections in measured]
        ).tolist(),
        "measured": measured_block(measured),
        "reference_stress_rate": [0.0] * len(experiments),
        **residuals_block(experiments, priors),
        **elements_block(list(zip(experiments, priors, strict=True))),
        **tables_block(_tables(experiments)),
    }


def residuals_block(experiments: Sequence[Experiment], priors: Sequence[PriorSet]) -> StanData:
    """Return whether residuals correlate, by which parameter, and the positions of readings."""
    name = experiments[0].residual_correlation
    return {
        "correlated_residuals": int(not all(is_fixed_at(own[name], 0.0) for own in priors)),
        "correlation_parameter": PLACE[name],
        "point_position": np.concatenate([one.position for one in experiments]).tolist(),
    }


def grid_block(experiments: Sequence[HistoryOrTable], grids: Sequence[FloatArray]) -> StanData:
    """Return times (s), or places in tables, at which solutions are reported beside readings."""
    entries = [_grid_entries(e, grid) for e, grid in zip(experiments, grids, strict=True)]
    return {
        **joined(entries),
        "grid_end": ends(len(own["grid_position"]) for own in entries),
        **TABLES.grid_block(_tables(experiments), grids),
    }


def _tables(experiments: Sequence[HistoryOrTable]) -> list[AttenuationExperiment | None]:
    """Return the tables, as many as the tests, with None for the others."""
    return [one if isinstance(one, AttenuationExperiment) else None for one in experiments]


def _entries(test: HistoryOrTable, priors: PriorSet) -> StanData:
    """Return what a test adds to lists of the data: of legs, outputs, points and sections."""
    if isinstance(test, AttenuationExperiment):
        nothing = [0] * test.n_points
        return {
            "leg": [],
            "stress_scale": [test.largest_stress],
            "strain_scale": [LABORATORY_STRAIN],
            "response_observed": test.response.tolist(),
            "is_strain": nothing,
            "output_time_in_leg": [],
            "n_outputs_in_leg": [],
            "output_of_point": nothing,
            "point_stage": nothing,
            "output_of_measured": [],
        }
    outputs = solver_outputs(test, section_times(test, priors))
    times, counts = _times_in_legs(test, outputs.time, outputs.leg)
    return {
        "leg": [
            [
                2.0 if leg.is_force else float(leg.driven == "stress"),
                leg.end_time - leg.start_time,
                leg.start_value,
                leg.rate,
                leg.temperature,
            ]
            for leg in test.legs
        ],
        "stress_scale": [stress_scale(test)],
        "strain_scale": [strain_scale(test)],
        "response_observed": test.response.tolist(),
        "is_strain": test.response_is_strain.astype(int).tolist(),
        "output_time_in_leg": times,
        "n_outputs_in_leg": counts,
        "output_of_point": outputs.of_readings.tolist(),
        "point_stage": test.reading_stage.tolist(),
        "output_of_measured": outputs.of_sections.tolist(),
    }


def _grid_entries(test: HistoryOrTable, grid: FloatArray) -> StanData:
    """Return what a test adds to lists of the grid; none of a table."""
    if isinstance(test, AttenuationExperiment):
        return {"grid_time_in_leg": [], "n_grid_in_leg": [], "grid_position": [], "grid_stage": []}
    leg = leg_of_times(test, grid)
    times, counts = _times_in_legs(test, grid, leg)
    return {
        "grid_time_in_leg": times,
        "n_grid_in_leg": counts,
        "grid_position": grid.tolist(),
        "grid_stage": stage_of_times(test, grid).tolist(),
    }


def section_times(experiment: HistoryExperiment, priors: PriorSet) -> list[float | None]:
    """Return the time (s) at which each section needs a solution; None if its strain says all."""
    if variant_of(priors, experiment).grain_size != "piezometric":
        return [one.time for one in experiment.microstructure]
    is_rigid = experiment.apparatus_compliance is None and (
        "apparatus_compliance" not in priors.priors
        or is_fixed_at(priors["apparatus_compliance"], 0.0)
    )
    times: list[float | None] = []
    for number, one in enumerate(experiment.microstructure, start=1):
        time = one.time
        if one.strain is not None:
            time = _time_at(experiment.legs, one.strain) if is_rigid else None
        if time is None:
            raise InputError(
                f"{experiment.id}: [[microstructure]] number {number}: found the key 'strain' with "
                "grain_size = piezometric, expected 'time' because the grain size depends on the "
                "stress on the way, and when the path strain is reached is not known in advance."
            )
        times.append(time)
    return times


def _time_at(legs: Sequence[Leg], path_strain: float) -> float | None:
    """Return the time (s) of a path strain; None where a stress imposed before makes it unknown."""
    before = 0.0
    for leg in legs:
        if leg.driven == "stress":
            return None
        after = before + abs(leg.end_value)
        if before < path_strain <= (1 + PATH_STRAIN_ROUNDING) * after:
            return min(leg.start_time + (path_strain - before) / abs(leg.rate), leg.end_time)
        before = after
    return None


@dataclass(frozen=True, eq=False)
class Outputs:
    """Where the solver reports along a test: at readings and sections, in the order of time.

    `time`, `leg` (n_outputs,): seconds since the start; leg from 0.
    `of_readings`, `of_sections`: their places among them, from 1; 0 if no solution is needed.
    """

    time: FloatArray
    leg: IntArray
    of_readings: IntArray
    of_sections: IntArray


def solver_outputs(experiment: HistoryExperiment, sections: Sequence[float | None]) -> Outputs:
    """Return where the solver reports, sections (s, or None) ahead of a jump at their time."""
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


def leg_of_times(experiment: HistoryExperiment, time: FloatArray) -> IntArray:
    """Return the leg, from 0, of times (s) that do not decrease."""
    # Of equal times at which two legs meet the first is in the leg that ends there.
    inner = np.array([leg.end_time for leg in experiment.legs[:-1]])
    leg = np.searchsorted(inner, time, side="left")
    repeated = np.diff(time, prepend=-1.0) == 0
    return np.asarray(leg + (np.isin(time, inner) & repeated), dtype=np.int64)


def stage_of_times(experiment: HistoryExperiment, time: FloatArray) -> IntArray:
    """Return the stage, from 0, of times (s); shared ends count as in `leg_of_times`."""
    stage_of_leg = np.array([leg.stage for leg in experiment.legs], dtype=np.int64)
    return stage_of_leg[leg_of_times(experiment, time)]


def leg_of_readings(experiment: HistoryExperiment) -> IntArray:
    """Return the leg of each reading, from 0."""
    time, place = experiment.reading_places()
    return np.asarray(leg_of_times(experiment, time)[place])


def _times_in_legs(
    experiment: HistoryExperiment, time: FloatArray, place: IntArray
) -> tuple[list[float], list[int]]:
    """Return times since the start of their leg over its duration, and their number in each."""
    start = np.array([leg.start_time for leg in experiment.legs])
    end = np.array([leg.end_time for leg in experiment.legs])
    since = (time - start[place]) / (end - start)[place]
    return np.clip(since, 0.0, 1.0).tolist(), np.bincount(place, minlength=start.size).tolist()


ELEMENT_ERROR = 1e-4
"""Of the sum, relative to the relaxed compliance, up to the widest band and peak of the priors.

Of Andrade creep, which has none, relative to the creep at any time that counts."""

MAX_PRIOR_QUANTILE = 0.99
"""Quantile of a prior without an upper bound that counts as its largest value."""

START_OF_IMAGINED = 1e-3
"""Shortest time that counts of a stage without readings, over its duration."""


def elements_block(tests: Sequence[tuple[HistoryOrTable | None, PriorSet]]) -> StanData:
    """Return part of the law, place in it and weight of each element."""
    names = {name for times in RELAXATION_TIMES for name in (times.switch, times.width) if name}
    largest = {name: max(_largest(own[name]) for _, own in tests) for name in names}
    log_times = None
    if any(largest[times.switch] for times in RELAXATION_TIMES if times.spread == "endless"):
        histories = ((test, own) for test, own in tests if isinstance(test, HistoryExperiment))
        starts, ends = zip(*(_log_times(test, own) for test, own in histories), strict=True)
        log_times = min(starts), max(ends)
    rows = element_rows(largest, ELEMENT_ERROR, log_times)
    return {"n_elements": len(rows), "element": rows}


def _log_times(test: HistoryExperiment, priors: PriorSet) -> tuple[float, float]:
    """Return ln of the shortest and longest relaxation time (s at T_0 and d_K) that counts."""
    shortest = [leg.end_time - leg.start_time for leg in test.legs]
    for place, stage in enumerate(test.stages):
        since = test.time[test.reading_stage == place] - stage.start_time
        imagined = START_OF_IMAGINED * (stage.end_time - stage.start_time)
        shortest += since[since > 0].tolist()[:1] or [imagined]
    reference = priors["kelvin_reference_temperature"].location
    coarseness = np.log(test.initial_grain_size / priors["kelvin_reference_grain_size"].location)
    slower = [
        float(log_slowdown(enthalpy, temperature, reference)) + exponent * coarseness - faster
        for temperature in test.temperatures
        for enthalpy in _ends(priors["kelvin_activation_enthalpy"])
        for exponent in _ends(priors["kelvin_grain_size_exponent"])
        for faster in _log_factors(test, priors, temperature)
    ]
    return float(np.log(min(shortest))) - max(slower), float(np.log(test.end_time)) - min(slower)


def _log_factors(test: HistoryExperiment, priors: PriorSet, temperature: float) -> Iterable[float]:
    """Return ends of ln of the factor of 1/time by the environment, at a temperature (K)."""
    pressure, fugacity, melt = (
        test.environment.get(name, STANDARD_VALUES[name]) for name in ENVIRONMENT
    )
    changes = (
        -pressure / (GAS_CONSTANT * temperature),
        np.log(fugacity / STANDARD_VALUES["water_fugacity"]),
        melt,
    )
    numbers = (_ends(priors[f"kelvin_{name}"]) for name in ENVIRONMENT_NUMBERS)
    return (float(np.dot(changes, ends)) for ends in product(*numbers))


def _ends(prior: Prior) -> Iterable[float]:
    """Smallest and largest value that counts."""
    if prior.is_fixed:
        return (prior.location,)
    law = prior.distribution()
    return float(law.ppf(1 - MAX_PRIOR_QUANTILE)), float(law.ppf(MAX_PRIOR_QUANTILE))


def _largest(prior: Prior) -> float:
    if prior.is_fixed:
        return prior.location
    if np.isfinite(prior.upper):
        return prior.upper
    return float(prior.distribution().ppf(MAX_PRIOR_QUANTILE))
