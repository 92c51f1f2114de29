"""Files of tests at piecewise constant strain rate, and such tests simulated."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pyburgers.kinds.constant_rate.experiment import (
    ConstantRateExperiment,
    load_constant_rate,
)
from pyburgers.kinds.kind import Kind, draw_residuals

FloatArray = npt.NDArray[np.float64]


class ConstantRate(Kind[ConstantRateExperiment]):
    """Strain is imposed at rates that change in steps; the response is the stress along it."""

    name = "constant_rate"
    load = staticmethod(load_constant_rate)

    def without_data(self, experiment: ConstantRateExperiment) -> ConstantRateExperiment:
        """Return the test without its points."""
        return replace(experiment, strain=np.empty(0), stress=np.empty(0), microstructure=())

    def known_columns(
        self, experiment: ConstantRateExperiment, at: FloatArray
    ) -> Mapping[str, FloatArray]:
        """Return the times of strains."""
        return {"time_s": experiment.time_at(at)}

    def with_noise(
        self,
        experiment: ConstantRateExperiment,
        response: FloatArray,
        values: Mapping[str, float],
        rng: np.random.Generator,
    ) -> ConstantRateExperiment:
        """Put stresses with residuals, which may correlate along strain, in the place of others."""
        noise = np.full(experiment.n_points, values["stress_noise"])
        residuals = draw_residuals(experiment, noise, experiment.reading_segment, values, rng)
        return replace(experiment, stress=response + residuals)


KIND = ConstantRate()
