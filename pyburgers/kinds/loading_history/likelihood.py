"""How tests under any loading history are sampled."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pyburgers.common.array_types import BoolArray, FloatArray
from pyburgers.common.errors import InputError
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.likelihood import MICROSTRUCTURE, Likelihood, grid_quantities, spread_over
from pyburgers.kinds.loading_history.experiment import HistoryExperiment, creep_intervals
from pyburgers.kinds.loading_history.stan_data import (
    grid_block,
    leg_of_times,
    reference_origin,
    section_times,
    tests_block,
)
from pyburgers.kinds.loading_history.valley import LoadingHistoryValley
from pyburgers.kinds.problem import stated_priors
from pyburgers.model.display import time_unit
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.model.prior_families import fixed_prior, is_fixed_at, priors_of_freed_parameters
from pyburgers.model.priors import PriorSet
from pyburgers.model.read_quantities import STRAIN, STRESS, Quantity
from pyburgers.model.reference_quantities import REFERENCE_FLOW_RATE_QUANTITY
from pyburgers.model.variants import with_variant

STRAIN_NOISE_SHARE = 0.01
"""Median of the strain noise, over the range of the strain readings."""


TIMES_IN_A_LOAD = 48
"""Times beside those of its stage in a load that is only part of it: as many as a stage has."""


MOST_TIMES_IN_LOADS = 480
"""Of all such loads of a test, so that bands and files stay small: of more than ten loads each has
its share of them."""


SHORTEST_STEP = 1e-4
"""From the start of a load to the first of its times, and from the last to its end, as a share."""


class HistoryLikelihood(Likelihood[HistoryExperiment]):
    """Stress is read where strain is imposed, strain where stress is."""

    name = "loading_history"
    clock = Quantity("time", "time_s", "s", "s", 1.0)
    read = (STRESS, STRAIN)
    response = Quantity("response", "response", "SI", "SI", 1.0)
    reference = REFERENCE_FLOW_RATE_QUANTITY
    grid_quantities = grid_quantities(
        "stress",
        "stress_replicated",
        "strain",
        "strain_replicated",
        "strain_rate",
        "kelvin_strain",
        "path_strain",
        *MICROSTRUCTURE,
    )
    warmup = 300
    # One chain in some has steps half as long again as the others, and at 0.98 loses trajectories
    # where grains shrink to the bound of their prior (docs/coordinates_trials.md).
    target_acceptance = 0.99
    has_fast_solver = True
    chart = LoadingHistoryValley()
    reference_origin = staticmethod(reference_origin)
    tests_block = staticmethod(tests_block)
    grid_block = staticmethod(grid_block)

    def grid(self, experiment: HistoryExperiment, *, fine: bool = False) -> FloatArray:
        """Return times, denser at the start of every stage, and unless fine of every load."""
        first, n = (1e-5, (80, 81)) if fine else (1e-4, (24, 25))
        shape = np.union1d(np.geomspace(first, 1, n[0]), np.linspace(0, 1, n[1]))
        starts, ends = np.transpose([(one.start_time, one.end_time) for one in experiment.stages])
        times = spread_over(starts, ends, shape).ravel()
        if fine:
            return times
        # Equal times at which stages meet all stay.
        return np.sort(np.concatenate([times, np.setdiff1d(_load_times(experiment), times)]))

    def shown_clock(self, last: float) -> Quantity:
        """Return time in a unit of which the test has at least ten."""
        unit, seconds = time_unit(last)
        return replace(self.clock, display_unit=unit, display_factor=1.0 / seconds)

    def is_read(self, experiment: HistoryExperiment, at: FloatArray) -> BoolArray:
        """Return where strain is imposed, so that stress is read, and where stress is."""
        driven = np.array([leg.driven for leg in experiment.legs])[leg_of_times(experiment, at)]
        return np.stack([driven == "strain", driven == "stress"])

    def along(self, experiment: HistoryExperiment) -> dict[str, tuple[FloatArray, str]]:
        """Return times, stages from 0, what is read, and stated errors where all have one."""
        quantity = experiment.quantity
        errors = (experiment.stress_uncertainty, experiment.strain_uncertainty)
        stated = np.array([np.nan if error is None else error for error in errors])[quantity]
        has_errors = not np.isnan(stated).any()
        return {
            **super().along(experiment),
            "segment": (experiment.reading_stage.astype(np.float64), "1"),
            **({"reading_error": (stated, "SI")} if has_errors else {}),
        }

    def own_priors(
        self, experiments: Sequence[HistoryExperiment | AttenuationExperiment], priors: PriorSet
    ) -> tuple[PriorSet, ...]:
        """Return priors of each of some histories; those of tables behind them are the first's.

        If strain is read, its noise is free and residuals correlate in time unless priors say
        otherwise. Stress that is not read has no noise.
        """
        histories = [one for one in experiments if isinstance(one, HistoryExperiment)]
        for experiment in histories:
            if not is_fixed_at(priors["residual_correlation_strain"], 0.0):
                raise InputError(
                    f"{experiment.id}: residuals of a loading history correlate in time, found a "
                    "prior of residual_correlation_strain, expected one of "
                    "residual_correlation_time."
                )
        reads_strain = any(e.response_is_strain.any() for e in histories)
        reads_stress = any((~e.response_is_strain).any() for e in histories)
        found = tuple(
            _priors_of_readings(e, priors, reads_strain, reads_stress).exchanging(
                *stated_priors(e).values()
            )
            for e in histories
        )
        return found + found[:1] * (len(experiments) - len(histories))

    def check_priors(self, experiment: HistoryExperiment, priors: PriorSet) -> None:
        """Refuse sections at unknown times where the grain size follows the stress."""
        section_times(experiment, priors)

    def as_history(self, experiment: HistoryExperiment) -> Experiment:
        """Return the test, which is one."""
        return experiment


def _priors_of_readings(
    experiment: HistoryExperiment, priors: PriorSet, reads_strain: bool, reads_stress: bool
) -> PriorSet:
    """Return priors of a history with noise and correlation of what is read in a fit."""
    if not reads_stress:
        noise = fixed_prior(PARAMETER_BY_NAME["stress_noise"], 1.0, "no stress is read")
        priors = priors.exchanging(noise)
    if reads_strain and "strain_noise" not in priors.priors:
        strain = experiment.reading[experiment.response_is_strain]
        free = priors_of_freed_parameters()["strain_noise"]
        if strain.size > 0 and np.ptp(strain) > 0:
            median = float(f"{STRAIN_NOISE_SHARE * np.ptp(strain):.0e}")
            free = replace(free, location=median)
        priors = priors.exchanging(free)
    correlate = reads_strain or not is_fixed_at(priors["residual_correlated_share"], 1.0)
    if correlate and experiment.residual_correlation not in priors.priors:
        priors = with_variant(priors, experiment, {"residuals": "autocorrelated"})
    return priors


def _load_times(experiment: HistoryExperiment) -> FloatArray:
    """Return times inside the loads that are part of a stage, dense at the start of each."""
    ends = [(one.start_time, one.end_time) for one in experiment.stages]
    loads = [
        one
        for one in creep_intervals(experiment)
        if (one.start_time, one.end_time) != ends[one.stage]
    ]
    number = min(TIMES_IN_A_LOAD, MOST_TIMES_IN_LOADS // max(1, len(loads)))
    n_even = number - number // 2
    even = np.arange(1, n_even + 1) / n_even
    even[-1] = 1 - SHORTEST_STEP  # at the end itself the rate may be that of what comes after
    shape = np.union1d(np.geomspace(SHORTEST_STEP, 1.0, number // 2 + 1)[:-1], even)
    times = [load.start_time + shape * load.duration for load in loads]
    return np.concatenate([np.empty(0), *times])


LIKELIHOOD = HistoryLikelihood()
