"""Tests at piecewise constant strain rate as a protocol."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from pyburgers.kinds.constant_rate.experiment import (
    ConstantRateExperiment,
    load_constant_rate,
    strain_grid,
)
from pyburgers.kinds.constant_rate.stan_data import (
    grid_block,
    reference_origin,
    segment_of_points,
    tests_block,
)
from pyburgers.kinds.constant_rate.valley import ConstantRateValley
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.kind import Kind
from pyburgers.kinds.loading_history.conversion import as_history
from pyburgers.kinds.stan_data import StanData
from pyburgers.model.display import (
    STRAIN_FACTOR,
    STRAIN_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
    Quantity,
)
from pyburgers.model.flow_law_prior import PeakTest
from pyburgers.model.parameters import REFERENCE_STRESS_QUANTITY

FloatArray = npt.NDArray[np.float64]


class ConstantRate(Kind[ConstantRateExperiment]):
    """Strain is imposed at rates that change in steps; the response is the stress along it."""

    name = "constant_rate"
    clock = Quantity("strain", "strain", "1", STRAIN_UNIT, STRAIN_FACTOR)
    response = Quantity("stress", "stress_Pa", "Pa", STRESS_UNIT, STRESS_FACTOR)
    noise = "stress_noise"
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
    load = staticmethod(load_constant_rate)
    reference_origin = staticmethod(reference_origin)
    tests_block = staticmethod(tests_block)
    grid_block = staticmethod(grid_block)

    def without_data(self, experiment: ConstantRateExperiment) -> ConstantRateExperiment:
        """Return the test without its points."""
        return replace(experiment, strain=np.empty(0), stress=np.empty(0), microstructure=())

    def prediction_grid(self, experiment: ConstantRateExperiment) -> FloatArray:
        """Return strains, denser at each segment's start."""
        shape = np.union1d(np.geomspace(2e-3, 1.0, 30), np.linspace(0.0, 1.0, 31)[1:])
        return strain_grid(experiment, shape)

    def output_grid(self, experiment: ConstantRateExperiment) -> FloatArray:
        """Return strains, dense where stress first rises."""
        shape = np.union1d(np.geomspace(1e-4, 1.0, 120), np.linspace(0.0, 1.0, 101)[1:])
        return np.union1d(strain_grid(experiment, shape), experiment.strain)

    def solved_positions(self, data: StanData, at: FloatArray) -> FloatArray:
        """Return the wanted strains and those of rate steps."""
        return np.array(data["grid_strain"])

    def solution(
        self, experiment: ConstantRateExperiment, draw: Mapping[str, FloatArray]
    ) -> dict[str, FloatArray]:
        """Return the solution along strain."""
        return {
            "time_s": experiment.time_at(draw["grid_strain"]),
            "strain": draw["grid_strain"],
            "stress_Pa": draw["grid_stress"],
            "kelvin_strain": draw["grid_kelvin_strain"],
            "grain_size_m": draw["grid_grain_size"],
            "fabric_factor": draw["grid_fabric_factor"],
        }

    def observed_positions(
        self, experiment: ConstantRateExperiment
    ) -> dict[str, tuple[FloatArray, str]]:
        """Return strains, times since the start, segments from 0, and stated errors."""
        strain, error = experiment.strain, experiment.stress_uncertainty
        stated = {} if error is None else {"reading_error": (np.full_like(strain, error), "Pa")}
        return {
            "strain": (strain, "1"),
            "time": (experiment.time_at(strain), "s"),
            "segment": (segment_of_points(experiment).astype(np.float64), "1"),
            **stated,
        }

    def with_noise(
        self,
        experiment: ConstantRateExperiment,
        response: FloatArray,
        values: Mapping[str, float],
        rng: np.random.Generator,
    ) -> ConstantRateExperiment:
        """Put stresses with residuals, which may correlate along strain, in the place of others."""
        return replace(experiment, stress=response + _draw_residuals(experiment, values, rng))

    def noises(self, experiment: ConstantRateExperiment) -> Mapping[str, float | None]:
        """Return the noise of the stress."""
        return {self.noise: experiment.stress_uncertainty}

    def as_history(self, experiment: ConstantRateExperiment) -> Experiment:
        """Return the test as stages of constant rate."""
        return as_history(experiment)

    def peak_test(self, experiment: ConstantRateExperiment) -> PeakTest | None:
        """Return the largest stress at the first rate."""
        first = segment_of_points(experiment) == 0
        if not first.any():
            return None
        return PeakTest(
            strain_rate=experiment.segments[0].strain_rate,
            stress=float(experiment.stress[first].max()),
            temperature=experiment.temperature,
            grain_size=experiment.initial_grain_size,
        )

    def without_point(
        self, experiment: ConstantRateExperiment, point: int
    ) -> ConstantRateExperiment:
        """Return the curve without a point."""
        return replace(
            experiment,
            strain=np.delete(experiment.strain, point),
            stress=np.delete(experiment.stress, point),
        )


def _draw_residuals(
    experiment: ConstantRateExperiment, values: Mapping[str, float], rng: np.random.Generator
) -> FloatArray:
    """Residuals (Pa), shape (n_points,), as `stan/statistics/residuals.stan` describes them."""
    noise, n = values["stress_noise"], experiment.n_points
    correlation_strain = values.get("residual_correlation_strain", 0.0)
    if correlation_strain == 0:
        return np.asarray(noise * rng.standard_normal(n))
    share = values.get("residual_correlated_share", 1.0)
    part: FloatArray = np.sqrt(share) * rng.standard_normal(n)
    step = np.diff(experiment.strain) / correlation_strain
    correlation, spread = np.exp(-step), np.sqrt(-np.expm1(-2 * step))
    for k in np.flatnonzero(np.diff(segment_of_points(experiment)) == 0):
        part[k + 1] = correlation[k] * part[k] + spread[k] * part[k + 1]
    return np.asarray(noise * (part + np.sqrt(1 - share) * rng.standard_normal(n)))


KIND = ConstantRate()
