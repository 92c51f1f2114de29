"""Files of tests under any loading history, and such tests simulated."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.kinds.kind import Kind, draw_residuals
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.files import load_loading_history
from pyburgers.kinds.loading_history.stan_data import times_of_readings

FloatArray = npt.NDArray[np.float64]


class LoadingHistoryKind(Kind[HistoryExperiment]):
    """Strain or stress is imposed in stages; the other one is read along time."""

    name = "loading_history"
    load = staticmethod(load_loading_history)

    def without_data(self, experiment: HistoryExperiment) -> HistoryExperiment:
        """Return the test with its readings, which set the scales of the solution."""
        return replace(experiment, microstructure=())

    def simulated_positions(self, experiment: HistoryExperiment) -> FloatArray:
        """Return the times of the readings, twice where one stands behind a jump."""
        return times_of_readings(experiment)[0]

    def response_in(self, experiment: HistoryExperiment, solution: pd.DataFrame) -> FloatArray:
        """Return stress or strain of every reading."""
        at_readings = solution.iloc[times_of_readings(experiment)[1]]
        is_strain = experiment.response_is_strain
        return np.where(is_strain, at_readings["strain"], at_readings["stress_Pa"])

    def with_noise(
        self,
        experiment: HistoryExperiment,
        response: FloatArray,
        values: Mapping[str, float],
        rng: np.random.Generator,
    ) -> HistoryExperiment:
        """Put readings with residuals, which may correlate in time, in the place of others."""
        sizes = np.array([values["stress_noise"], values.get("strain_noise", 0.0)])
        noise, stage = sizes[experiment.quantity], experiment.reading_stage
        residuals = draw_residuals(experiment, noise, stage, values, rng)
        return replace(experiment, reading=response + residuals)


KIND = LoadingHistoryKind()
