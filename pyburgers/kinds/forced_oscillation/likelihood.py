"""How tests at an oscillating strain rate are sampled."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.forced_oscillation.sheared import ShearedChart
from pyburgers.kinds.forced_oscillation.stan_data import grid_block, reference_origin, tests_block
from pyburgers.kinds.likelihood import Likelihood
from pyburgers.model.parameters import REFERENCE_FLOW_RATE_QUANTITY
from pyburgers.model.read_quantities import STRESS, Quantity

FloatArray = npt.NDArray[np.float64]

OUTPUTS_PER_CYCLE, PREDICTIONS_PER_CYCLE = 60, 30
"""Times in a cycle of a smooth curve, and of the predictive bands."""


class OscillationLikelihood(Likelihood[OscillationExperiment]):
    """Stresses are read along time."""

    name = "forced_oscillation"
    clock = Quantity("time", "time_s", "s", "s", 1.0)
    read = (STRESS,)
    response = STRESS
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
    reference_origin = staticmethod(reference_origin)
    tests_block = staticmethod(tests_block)
    grid_block = staticmethod(grid_block)

    def grid(self, experiment: OscillationExperiment, *, fine: bool = False) -> FloatArray:
        """Return evenly spaced times (s) from the start of a record, or of imposed cycles."""
        (start, end), period = experiment.span, experiment.prepared.period
        per_cycle = OUTPUTS_PER_CYCLE if fine else PREDICTIONS_PER_CYCLE
        return np.linspace(start, end, round(per_cycle * (end - start) / period) + 1)

    def along(self, experiment: OscillationExperiment) -> dict[str, tuple[FloatArray, str]]:
        """Return driving strains, times, and stated errors of the stress readings."""
        prepared = experiment.prepared
        return {
            "strain": (prepared.strain(prepared.time), "1"),
            **super().along(experiment),
            "reading_error": (prepared.uncertainty, "Pa"),
        }

    def reading_noise(
        self, experiment: OscillationExperiment, values: Mapping[str, FloatArray]
    ) -> FloatArray:
        """Return the size of the noise for each reading, by its stated error."""
        return super().reading_noise(experiment, values) * experiment.prepared.relative_uncertainty


LIKELIHOOD = OscillationLikelihood()
