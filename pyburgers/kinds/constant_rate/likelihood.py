"""How tests at piecewise constant strain rate are sampled: as loading histories along strain."""

from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, _strain_at
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.likelihood import (
    MICROSTRUCTURE,
    AtMode,
    Likelihood,
    grid_quantities,
    spread_over,
)
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.likelihood import LIKELIHOOD as HISTORIES
from pyburgers.kinds.loading_history.stages import Stage
from pyburgers.kinds.loading_history.stan_data import residuals_block, stress_scale
from pyburgers.kinds.loading_history.valley import LoadingHistoryValley
from pyburgers.kinds.stan_data import StanData
from pyburgers.kinds.valley import Pins, ValleyChart
from pyburgers.model.priors import PriorSet
from pyburgers.model.read_quantities import STRAIN, STRESS
from pyburgers.model.reference_quantities import REFERENCE_STRESS_QUANTITY


class ConstantRateValley(ValleyChart[ConstantRateExperiment]):
    """Pins are those of the loading history; ln S_0 belongs to the first rate."""

    def pins(self, test: AtMode[ConstantRateExperiment]) -> Pins:
        """Set the pins of the loading history."""
        own: AtMode[Any] = test
        segments = test.experiment.segments
        history = replace(
            own,
            experiment=LIKELIHOOD.as_history(test.experiment),
            solution=lambda time: test.solution(_strain_at(time, segments)),
        )
        return replace(LoadingHistoryValley().pins(history), reference_rate=segments[0].strain_rate)


REFERENCE_STRESS_SCALE = 0.1
"""Scale of ln S_0: data fix it to about 0.01, the prior to about 1."""


class ConstantRateLikelihood(Likelihood[ConstantRateExperiment]):
    """Stresses are read along strain."""

    name = "constant_rate"
    clock = STRAIN
    read = (STRESS,)
    response = STRESS
    reference = REFERENCE_STRESS_QUANTITY
    grid_quantities = grid_quantities(
        "stress", "stress_replicated", "kelvin_strain", *MICROSTRUCTURE
    )
    warmup = 300
    target_acceptance = 0.98
    has_fast_solver = True
    chart = ConstantRateValley()

    @property
    def program(self) -> Path:
        """Path of the program of loading histories."""
        return HISTORIES.program

    def reference_origin(self, experiment: ConstantRateExperiment) -> tuple[float, float]:
        """Origin and size of ln S_0: the largest observed stress."""
        return float(np.log(stress_scale(self.as_history(experiment)))), REFERENCE_STRESS_SCALE

    def tests_block(
        self, experiments: Sequence[ConstantRateExperiment], priors: Sequence[PriorSet]
    ) -> StanData:
        """Return the block of the histories, with S_0 at first rates and residuals along strain."""
        return {
            **HISTORIES.tests_block([self.as_history(one) for one in experiments], priors),
            "reference_stress_rate": [one.segments[0].strain_rate for one in experiments],
            **residuals_block(experiments, priors),
        }

    def grid_block(
        self, experiments: Sequence[ConstantRateExperiment], grids: Sequence[FloatArray]
    ) -> StanData:
        """Return the strains at which the solutions are reported apart from the observed ones."""
        times = [one.time_at(grid) for one, grid in zip(experiments, grids, strict=True)]
        return {
            **HISTORIES.grid_block([self.as_history(one) for one in experiments], times),
            "grid_position": np.concatenate(grids).tolist(),
        }

    def grid(self, experiment: ConstantRateExperiment, *, fine: bool = False) -> FloatArray:
        """Return strains, denser at each segment's start; fine ones where stress first rises."""
        first, n = (1e-4, (120, 101)) if fine else (2e-3, (30, 31))
        shape = np.union1d(np.geomspace(first, 1.0, n[0]), np.linspace(0.0, 1.0, n[1])[1:])
        return spread_over(experiment.bounds[:-1], experiment.bounds[1:], shape).ravel()

    def along(self, experiment: ConstantRateExperiment) -> dict[str, tuple[FloatArray, str]]:
        """Return strains, times since the start, segments from 0, and stated errors."""
        strain, error = experiment.strain, experiment.stress_uncertainty
        stated = {} if error is None else {"reading_error": (np.full_like(strain, error), "Pa")}
        return {
            **super().along(experiment),
            "time": (experiment.time_at(strain), "s"),
            "segment": (experiment.reading_segment.astype(np.float64), "1"),
            **stated,
        }

    def as_history(self, experiment: ConstantRateExperiment) -> HistoryExperiment:
        """Return the test as stages with the same readings and density; path strain is strain."""
        times = experiment.time_at(experiment.bounds)
        spans = zip(pairwise(times.tolist()), experiment.segments, strict=True)
        stages = tuple(
            Stage("strain_rate", start, end, experiment.temperature, segment.strain_rate)
            for (start, end), segment in spans
        )
        stage = experiment.reading_segment
        time = np.clip(experiment.time_at(experiment.strain), times[stage], times[stage + 1])
        shared = {one.name: getattr(experiment, one.name) for one in fields(Experiment)}
        return HistoryExperiment(
            **shared,
            stages=stages,
            time=time,
            reading_stage=stage,
            reading=experiment.stress,
            stress_uncertainty=experiment.stress_uncertainty,
            n_readings_in_file=experiment.n_points,
        )


LIKELIHOOD = ConstantRateLikelihood()
