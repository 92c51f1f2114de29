"""Tests at an oscillating strain rate as a protocol."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from pyburgers.kinds.forced_oscillation.experiment import (
    OscillationExperiment,
    load_forced_oscillation,
    with_known_strain,
)
from pyburgers.kinds.forced_oscillation.preparation import (
    prepare,
)
from pyburgers.kinds.forced_oscillation.sheared import ShearedChart
from pyburgers.kinds.forced_oscillation.stan_data import (
    grid_block,
    reference_origin,
    tests_block,
)
from pyburgers.kinds.kind import Kind
from pyburgers.model.display import STRESS_FACTOR, STRESS_UNIT, Quantity
from pyburgers.model.parameters import REFERENCE_FLOW_RATE_QUANTITY

FloatArray = npt.NDArray[np.float64]

FABRIC_OF_OLIVINE = 1.0
"""Oscillating tests have no fabric evolution (Eq. 5 of the paper)."""

OUTPUTS_PER_CYCLE, PREDICTIONS_PER_CYCLE = 60, 30
"""Times in a cycle of a smooth curve, and of the predictive bands."""


class ForcedOscillation(Kind[OscillationExperiment]):
    """Strain oscillates; the response is the stress along time."""

    name = "forced_oscillation"
    clock = Quantity("time", "time_s", "s", "s", 1.0)
    response = Quantity("stress", "stress_Pa", "Pa", STRESS_UNIT, STRESS_FACTOR)
    noise = "stress_noise"
    reference = REFERENCE_FLOW_RATE_QUANTITY
    grid_quantities = MappingProxyType(
        {
            "grid_oscillating_stress": ("stress", "Pa"),
            "grid_stress_replicated": ("stress_replicated", "Pa"),
            "grid_kelvin_strain": ("kelvin_strain", "1"),
            "grid_grain_size": ("grain_size", "m"),
            "grid_dashpot_rate": ("dashpot_rate", "1/s"),
        }
    )
    warmup = 250
    target_acceptance = 0.95
    chart = ShearedChart()
    points_together = "a record of oscillations is prepared as a whole"
    load = staticmethod(load_forced_oscillation)
    reference_origin = staticmethod(reference_origin)
    tests_block = staticmethod(tests_block)
    grid_block = staticmethod(grid_block)

    def without_data(self, experiment: OscillationExperiment) -> OscillationExperiment:
        """Return the test driven by the strain as it was fitted.

        What drives it and what it starts from come from its record.
        """
        return with_known_strain(experiment)

    def prediction_grid(self, experiment: OscillationExperiment) -> FloatArray:
        """Return evenly spaced times."""
        return _time_grid(experiment, PREDICTIONS_PER_CYCLE)

    def output_grid(self, experiment: OscillationExperiment) -> FloatArray:
        """Return evenly spaced times and those of the readings."""
        return np.union1d(_time_grid(experiment, OUTPUTS_PER_CYCLE), experiment.prepared.time)

    def solution(
        self, experiment: OscillationExperiment, draw: Mapping[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Return the solution; the strain is without its trend where that is removed."""
        time = draw["grid_time"]
        return {
            "time_s": time,
            "strain": experiment.prepared.strain(time),
            "stress_Pa": draw["grid_stress"],
            "kelvin_strain": draw["grid_kelvin_strain"],
            "grain_size_m": draw["grid_grain_size"],
            "fabric_factor": np.full_like(time, FABRIC_OF_OLIVINE),
        }

    def observed_positions(
        self, experiment: OscillationExperiment
    ) -> dict[str, tuple[FloatArray, str]]:
        """Return driving strains, times, and stated errors of the stress readings."""
        prepared = experiment.prepared
        return {
            "strain": (prepared.strain(prepared.time), "1"),
            "time": (prepared.time, "s"),
            "reading_error": (prepared.uncertainty, "Pa"),
        }

    def with_noise(
        self,
        experiment: OscillationExperiment,
        response: FloatArray,
        values: Mapping[str, float],
        rng: np.random.Generator,
    ) -> OscillationExperiment:
        """Put stresses and strains with noise in the place of others, prepared as measured ones.

        Period, degrees and the stress where the model starts are those of the test, and its fitted
        strain is the true one.
        """
        template, strain_time = experiment.prepared, experiment.record.strain_time
        noise = values["stress_noise"] * template.relative_uncertainty
        strain = template.strain_fit.periodic(strain_time) + template.strain_fit.trend(strain_time)
        strain_noise = experiment.record.strain_uncertainty
        record = replace(
            experiment.record,
            strain=strain + strain_noise * rng.standard_normal(strain.size),
            stress_time=template.time,
            stress=response + noise * rng.standard_normal(response.size),
            stress_uncertainty=template.uncertainty,
        )
        # Where the model starts, too: simulated data have no bias before they are there.
        settings = template.settings
        prepared = prepare(record, settings, experiment.id)
        return replace(experiment, record=record, settings=settings, prepared=prepared)

    def reading_noise(
        self, experiment: OscillationExperiment, values: Mapping[str, FloatArray]
    ) -> FloatArray:
        """Return what the noise is for each reading, by its stated error."""
        noise: FloatArray = values[self.noise][:, np.newaxis]
        return noise * experiment.prepared.relative_uncertainty

    def driving_error(
        self, experiment: OscillationExperiment, true: OscillationExperiment
    ) -> FloatArray:
        """Return the errors of the strain's fit, in a test that knows the true strain."""
        found, wanted = (
            np.concatenate([one.strain_sine, one.strain_cosine, one.background_rate])
            for one in (experiment.prepared, true.prepared)
        )
        error = experiment.prepared.strain_error
        if len(error) == 0:
            return np.empty(0)
        size = np.sqrt(np.sum(error**2, axis=0))
        used = size > 0
        solved: FloatArray = np.linalg.lstsq(
            (error[:, used] / size[used]).T, (wanted - found)[used] / size[used]
        )[0]
        return solved


def _time_grid(experiment: OscillationExperiment, per_cycle: int) -> FloatArray:
    """Evenly spaced times (s) from the start of a record, or of imposed cycles, to its end."""
    prepared = experiment.prepared
    start, end = prepared.start, experiment.end
    return np.linspace(start, end, round(per_cycle * (end - start) / prepared.period) + 1)


KIND = ForcedOscillation()
