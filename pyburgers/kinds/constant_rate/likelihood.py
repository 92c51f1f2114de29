"""How tests at piecewise constant strain rate are sampled."""

from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, strain_grid
from pyburgers.kinds.constant_rate.stan_data import grid_block, reference_origin, tests_block
from pyburgers.kinds.constant_rate.valley import ConstantRateValley
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.likelihood import Likelihood
from pyburgers.kinds.loading_history.conversion import as_history
from pyburgers.model.parameters import REFERENCE_STRESS_QUANTITY
from pyburgers.model.read_quantities import STRAIN, STRESS

FloatArray = npt.NDArray[np.float64]


class ConstantRateLikelihood(Likelihood[ConstantRateExperiment]):
    """Stresses are read along strain."""

    name = "constant_rate"
    clock = STRAIN
    read = (STRESS,)
    response = STRESS
    reference = REFERENCE_STRESS_QUANTITY
    grid_quantities = MappingProxyType(
        {
            "grid_stress": ("stress", "Pa"),
            "grid_stress_replicated": ("stress_replicated", "Pa"),
            "grid_kelvin_strain": ("kelvin_strain", "1"),
            "grid_grain_size": ("grain_size", "m"),
            "grid_fabric_factor": ("fabric_factor", "1"),
            "grid_grain_size_softening": ("grain_size_softening", "1"),
            "grid_fabric_softening": ("fabric_softening", "1"),
        }
    )
    warmup = 300
    target_acceptance = 0.98
    chart = ConstantRateValley()
    reference_origin = staticmethod(reference_origin)
    tests_block = staticmethod(tests_block)
    grid_block = staticmethod(grid_block)

    def grid(self, experiment: ConstantRateExperiment, *, fine: bool = False) -> FloatArray:
        """Return strains, denser at each segment's start; fine ones where stress first rises."""
        first, n = (1e-4, (120, 101)) if fine else (2e-3, (30, 31))
        shape = np.union1d(np.geomspace(first, 1.0, n[0]), np.linspace(0.0, 1.0, n[1])[1:])
        return strain_grid(experiment, shape)

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

    def as_history(self, experiment: ConstantRateExperiment) -> Experiment:
        """Return the test as stages of constant rate."""
        return as_history(experiment)


LIKELIHOOD = ConstantRateLikelihood()
