"""How tables of attenuation and modulus are sampled."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from pyburgers.common.errors import InputError
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.stan_data import grid_block, reference_origin, tests_block
from pyburgers.kinds.attenuation.stretched_chart import StretchedChart
from pyburgers.kinds.likelihood import Likelihood
from pyburgers.model.parameters import REFERENCE_FLOW_RATE_QUANTITY
from pyburgers.model.prior_families import is_fixed_at
from pyburgers.model.priors import PriorSet
from pyburgers.model.read_quantities import LOG_MODULUS, LOG_TAN_DELTA, Quantity

FloatArray = npt.NDArray[np.float64]

TYPICAL_SPREAD = (0.1, 0.01)
"""Of ln(tan delta) and ln(modulus): with stated errors, what residuals are weighed by where not all
errors are stated."""

OUTPUTS_PER_SPECTRUM, PREDICTIONS_PER_SPECTRUM = 60, 25
"""Places in a spectrum of a smooth curve, and of the predictive bands."""


class AttenuationLikelihood(Likelihood[AttenuationExperiment]):
    """Logarithms of tan delta and modulus are read.

    The clock is the place in the table: spectra, each along the logarithm of the period, stand one
    after the other, those of attenuation first.
    """

    name = "attenuation"
    clock = Quantity("place", "place", "1", "spectra", 1.0)
    read = (LOG_TAN_DELTA, LOG_MODULUS)
    response = Quantity("log_reading", "log_reading", "1", "in ln", 1.0)
    reference = REFERENCE_FLOW_RATE_QUANTITY
    grid_quantities = MappingProxyType(
        {
            "grid_log_reading": ("log_reading", "1"),
            "grid_log_reading_replicated": ("log_reading_replicated", "1"),
            "grid_log_relaxation_time": ("log_relaxation_time", "1"),
            "grid_log_maxwell_time": ("log_maxwell_time", "1"),
        }
    )
    warmup = 500
    target_acceptance = 0.98
    chart = StretchedChart()
    reference_origin = staticmethod(reference_origin)
    tests_block = staticmethod(tests_block)
    grid_block = staticmethod(grid_block)

    def check_priors(self, experiment: AttenuationExperiment, priors: PriorSet) -> None:
        """Ask for what the likelihood and a dashpot without known stress need.

        Raise InputError if there is neither a scatter nor a stated error, or the dashpot of a table
        without amplitudes is not linear.
        """
        for name, stated in experiment.noises.items():
            if stated is None and is_fixed_at(priors[name], 0.0):
                raise InputError(
                    f"{experiment.id}: found readings without a stated error and no {name} in the "
                    f"priors {priors.title!r}, expected a prior of it in them."
                )
        if not experiment.amplitude_is_stated and not is_fixed_at(priors["stress_exponent"], 1.0):
            raise InputError(
                f"{experiment.id}: the amplitude of the stress is not stated, so that only a "
                "linear dashpot is known to answer it, found a stress exponent other than 1 in "
                f"the priors {priors.title!r}, expected amplitudes or the variant maxwell=linear."
            )

    def as_history(self, experiment: AttenuationExperiment) -> AttenuationExperiment:
        """Return the table: the program of loading histories takes it as it is."""
        return experiment

    def grid(self, experiment: AttenuationExperiment, *, fine: bool = False) -> FloatArray:
        """Return evenly spaced places in spectra of both quantities; fine ones with the rows."""
        per_spectrum = OUTPUTS_PER_SPECTRUM if fine else PREDICTIONS_PER_SPECTRUM
        conditions, shares = experiment.conditions, (np.arange(per_spectrum) + 0.5) / per_spectrum
        even = np.add.outer(np.arange(2 * conditions.n_spectra), shares).ravel()
        rows = [conditions.place, conditions.place + conditions.n_spectra] if fine else []
        return np.unique(np.concatenate([even, *rows]))

    def along(self, experiment: AttenuationExperiment) -> dict[str, tuple[FloatArray, str]]:
        """Return places, periods, temperatures, spectra, and errors where all are stated."""
        conditions, stated = experiment.conditions, experiment.stated_errors
        period, spectrum, quantity = conditions.at(experiment.position)
        is_stated = stated.size > 0 and bool(np.all(stated > 0))
        typical = np.hypot(np.array(TYPICAL_SPREAD)[quantity], stated)
        return {
            **super().along(experiment),
            "period": (period, "s"),
            "temperature": (conditions.temperature[conditions.first_rows[spectrum]], "K"),
            "segment": (np.floor(experiment.position), "1"),
            **(
                {"reading_error": (stated, "1")} if is_stated else {"typical_error": (typical, "1")}
            ),
        }

    def reading_noise(
        self, experiment: AttenuationExperiment, values: Mapping[str, FloatArray]
    ) -> FloatArray:
        """Return scatter and stated error of the logarithm of every reading together."""
        scatter = super().reading_noise(experiment, values)
        return np.asarray(np.hypot(scatter, experiment.stated_errors))


LIKELIHOOD = AttenuationLikelihood()
