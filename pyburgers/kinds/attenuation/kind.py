"""Files of tables of attenuation and modulus, and such tables simulated."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.attenuation.table import MODULUS, NO_READINGS
from pyburgers.kinds.kind import Kind

FloatArray = npt.NDArray[np.float64]


class Attenuation(Kind[AttenuationExperiment]):
    """Stress cycles at many periods and temperatures; responses are tan delta and modulus."""

    name = "attenuation"
    load = staticmethod(load_attenuation)

    def without_data(self, experiment: AttenuationExperiment) -> AttenuationExperiment:
        """Return the table without what was read."""
        return replace(experiment, readings=NO_READINGS)

    def known_columns(
        self, experiment: AttenuationExperiment, at: FloatArray
    ) -> Mapping[str, FloatArray]:
        """Return which reading, period and temperature belong to places."""
        conditions = experiment.conditions
        period, spectrum, quantity = conditions.at(at)
        return {
            "is_modulus": (quantity == MODULUS).astype(np.float64),
            "period_s": period,
            "temperature_K": conditions.temperature[conditions.first_rows[spectrum]],
        }

    def with_noise(
        self,
        experiment: AttenuationExperiment,
        response: FloatArray,
        values: Mapping[str, float],
        rng: np.random.Generator,
    ) -> AttenuationExperiment:
        """Put readings with scatter and stated errors in the place of others."""
        readings = experiment.readings
        n = readings.tan_delta.size
        tan_delta, modulus = np.exp(response[:n]), np.exp(response[n:])
        # As in stan/kinds/attenuation_response.stan.
        tan_delta = np.hypot(tan_delta, readings.tan_delta_error)
        relative_error = readings.modulus_error / readings.modulus
        spreads = (
            np.hypot(values.get("attenuation_scatter", 0.0), readings.tan_delta_error / tan_delta),
            np.hypot(values.get("modulus_scatter", 0.0), relative_error),
        )
        tan_delta, modulus = (
            one * np.exp(spread * rng.standard_normal(one.size))
            for one, spread in zip((tan_delta, modulus), spreads, strict=True)
        )
        noisy = replace(
            readings,
            tan_delta=tan_delta,
            modulus=modulus,
            modulus_error=relative_error * modulus,
        )
        return replace(experiment, readings=noisy)


KIND = Attenuation()
