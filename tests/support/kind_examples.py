"""Tests of every protocol and independent answers about them, for `tests/kinds/contract.py`."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any, ClassVar, Generic, TypeVar

import attenuation_oracle
import history_oracle
import numpy as np
import oscillation_oracle
from conftest import DUNITE, ICE
from history_oracle import FABRIC, GRAINS, KELVIN, STRAIN, STRESS
from history_twins import history_twin, residual_covariance
from imagined_tests import STEPS
from oscillation_records import until, with_record
from scipy import stats

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, RateSegment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment, with_background
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.forced_oscillation.preparation import Background
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stan_data import leg_of_times
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.sampling.options import SamplerOptions

TWIN_FILE = ICE.parent / "olivine" / "olivine_twin.toml"

E = TypeVar("E", bound=Experiment)


class Example(ABC, Generic[E]):
    """What a protocol itself cannot be asked.

    `twins` are synthetic tests with their truth, those of `stepped` under conditions that change.
    `quick` ones are solved in milliseconds. Columns of `measured` tests are not part of the
    project. `materials` differ so from the truth. A fit of the parameters `few` takes seconds,
    `options` are those of a fit in earnest, and densities are compared with the solver `tight`.
    """

    twins: ClassVar[tuple[str, ...]]
    columns: ClassVar[tuple[str, ...]] = (
        "time_s",
        "strain",
        "stress_Pa",
        "kelvin_strain",
        "grain_size_m",
        "fabric_factor",
    )
    measured: ClassVar[tuple[str, ...]] = ()
    stepped: ClassVar[tuple[str, ...]] = ()
    quick: ClassVar[tuple[str, ...]]
    materials: ClassVar[Mapping[str, Mapping[str, float]]] = MappingProxyType({"truth": {}})
    few: ClassVar[tuple[str, ...]]
    options: ClassVar[SamplerOptions]
    tight: ClassVar[SolverOptions] = SolverOptions(tolerance=1e-11, max_num_steps=1_000_000)

    @abstractmethod
    def load(self, name: str) -> E:
        """Return a test of one of the names above."""

    @abstractmethod
    def solution(
        self, experiment: E, values: Mapping[str, float], at: FloatArray
    ) -> dict[str, FloatArray]:
        """Solve the model with another solver, at positions on the protocol's clock (SI)."""

    @abstractmethod
    def log_likelihood(
        self, experiment: E, values: Mapping[str, float], response: FloatArray
    ) -> FloatArray:
        """Log density of every point (SI), given the response without noise."""


class ConstantRateExample(Example[ConstantRateExperiment]):
    """Curves of ice, one with steps of the rate, and of dunite."""

    twins = ("PIL40", "PIL72", "PIL105")
    measured = ("dunite_4506", "dunite_4581")
    stepped = ("rate steps",)
    quick = ("PIL72", *stepped)
    materials = MappingProxyType(
        {
            "truth": {},
            "linear dashpot": {  # of 5e10 Pa s
                "stress_exponent": 1.0,
                "grain_size_exponent": 0.0,
                "steady_state_fabric_factor": 1.0,
                "activation_enthalpy": 65e3,
                "beta": 8.358e-5,
            },
        }
    )
    few = ("maxwell_modulus", "activation_enthalpy", "stress_noise")
    options = SamplerOptions(seed=20261120)

    def load(self, name: str) -> ConstantRateExperiment:
        if name == "rate steps":
            segments = tuple(RateSegment(*segment) for segment in STEPS)
            return replace(self.load("PIL40"), segments=segments)
        folder = ICE if name in self.twins else DUNITE
        return load_constant_rate(folder / f"{name}.toml")

    def solution(
        self, experiment: ConstantRateExperiment, values: Mapping[str, float], at: FloatArray
    ) -> dict[str, FloatArray]:
        segments = [(segment.start_strain, segment.strain_rate) for segment in experiment.segments]
        state = history_oracle.at_rates(
            values, experiment.temperature, experiment.initial_grain_size, segments, at
        )
        names = ("stress_Pa", "kelvin_strain", "grain_size_m", "fabric_factor")
        return dict(zip(names, state[[STRESS, KELVIN, GRAINS, FABRIC]], strict=True))

    def log_likelihood(
        self,
        experiment: ConstantRateExperiment,
        values: Mapping[str, float],
        response: FloatArray,
    ) -> FloatArray:
        return np.asarray(stats.norm.logpdf(experiment.stress, response, values["stress_noise"]))


def short_twin(background: Background) -> OscillationExperiment:
    """The first cycles of the olivine twin."""
    full = with_background(load_forced_oscillation(TWIN_FILE), background)
    return with_record(full, until(full.record, 700.0), replace(full.settings, start_stress=None))


class ForcedOscillationExample(Example[OscillationExperiment]):
    """The olivine twin, its background removed or kept."""

    twins = ("removed", "kept")
    quick = ("removed, short", "kept, short")
    materials = MappingProxyType(
        {
            "truth": {},
            "stiff and strong": {
                "kelvin_modulus": 80e9,
                "kelvin_viscosity": 5e9,
                "activation_enthalpy": 490e3,
            },
            "fast dashpot": {"stress_exponent": 2.6, "activation_enthalpy": 380e3},
            "linear dashpot": {  # of 2e12 Pa s
                "stress_exponent": 1.0,
                "grain_size_exponent": 0.0,
                "beta": 2.387e-5,
            },
            "fast grains": {
                "grain_size_exponent": 1.4,
                "critical_strain_grain_size": 0.01,
                "beta": -7e-5,
            },
        }
    )
    few = ("kelvin_modulus", "activation_enthalpy", "stress_noise")
    options = SamplerOptions(chains=4, draws=1000, seed=20261120)

    def load(self, name: str) -> OscillationExperiment:
        background: Background = "removed" if name.startswith("removed") else "kept"
        if name in self.quick:
            return short_twin(background)
        return with_background(load_forced_oscillation(TWIN_FILE), background)

    def solution(
        self, experiment: OscillationExperiment, values: Mapping[str, float], at: FloatArray
    ) -> dict[str, FloatArray]:
        state = oscillation_oracle.solution(experiment, values, at)
        found = dict(zip(("stress_Pa", "kelvin_strain", "grain_size_m"), state, strict=True))
        return {
            **found,
            "strain": experiment.prepared.strain(at),
            "fabric_factor": np.ones_like(at),
        }

    def log_likelihood(
        self,
        experiment: OscillationExperiment,
        values: Mapping[str, float],
        response: FloatArray,
    ) -> FloatArray:
        """A trend that is removed takes as many readings as it has coefficients."""
        prepared, noise = experiment.prepared, values["stress_noise"]
        spread = noise * prepared.uncertainty / np.sqrt(np.mean(prepared.uncertainty**2))
        found = np.asarray(stats.norm.logpdf(experiment.stress, response, spread))
        if prepared.background == "removed":
            taken = (prepared.stress_fit.degree + 1) * stats.norm.logpdf(0.0, scale=noise)
            found = found - taken / experiment.n_points
        return found


class LoadingHistoryExample(Example[HistoryExperiment]):
    """Creep, loading and unloading, relaxation, and all of it in one test."""

    twins = ("creep", "load and unload", "relaxation", "mixed")
    quick = ("mixed, short",)
    materials = MappingProxyType(
        {
            "truth": {},
            "hardening": {"steady_state_fabric_factor": 1.5},
            "compliant apparatus": {"apparatus_compliance": 2e-10},
        }
    )
    few = ("kelvin_modulus", "activation_enthalpy", "stress_noise")
    # Readings of strain are good to a thousandth of the whole.
    tight = SolverOptions(tolerance=1e-13, max_num_steps=1_000_000)
    options = SamplerOptions(chains=4, draws=1000, seed=20261122)

    def load(self, name: str) -> HistoryExperiment:
        return history_twin("mixed", 16) if name in self.quick else history_twin(name, 100)

    def solution(
        self, experiment: HistoryExperiment, values: Mapping[str, float], at: FloatArray
    ) -> dict[str, FloatArray]:
        legs = leg_of_times(experiment, at)
        state = history_oracle.history(
            values,
            experiment.initial_grain_size,
            experiment.legs,
            [at[legs == k] for k in range(len(experiment.legs))],
        )
        names = ("stress_Pa", "strain", "kelvin_strain", "grain_size_m", "fabric_factor")
        return dict(zip(names, state[[STRESS, STRAIN, KELVIN, GRAINS, FABRIC]], strict=True))

    def log_likelihood(
        self, experiment: HistoryExperiment, values: Mapping[str, float], response: FloatArray
    ) -> FloatArray:
        covariance = residual_covariance(
            values, experiment.time, experiment.reading_stage, experiment.response_is_strain
        )
        factor = np.linalg.cholesky(covariance)
        scaled = np.linalg.solve(factor, experiment.reading - response)
        return np.asarray(stats.norm.logpdf(scaled) - np.log(np.diag(factor)))


class AttenuationExample(Example[AttenuationExperiment]):
    """Tables of ice about two median stresses, and of measured olivine."""

    twins = ("ice",)
    measured = ("A1802",)
    quick = ("ice",)
    columns = ("place", "is_modulus", "period_s", "temperature_K", "log_reading")
    materials = MappingProxyType(
        {
            "truth": {},
            "linear dashpot": {"stress_exponent": 1.0, "beta": -2e-5},
            "hyperbolic sine": {"breakdown_stress": 1.5e6, "stress_exponent": 2.7},
        }
    )
    few = ("kelvin_modulus", "activation_enthalpy", "attenuation_scatter")
    options = SamplerOptions(seed=20261120)

    def load(self, name: str) -> AttenuationExperiment:
        if name == "ice":
            return load_attenuation(ICE / "attenuation_twin.toml")
        return load_attenuation(ICE.parent / "olivine" / f"attenuation_{name}.toml")

    def solution(
        self, experiment: AttenuationExperiment, values: Mapping[str, float], at: FloatArray
    ) -> dict[str, FloatArray]:
        period, spectrum, quantity = experiment.conditions.at(at)
        row = experiment.conditions.first_rows[spectrum]
        found = attenuation_oracle.log_readings(experiment, values, period, row)
        return {"log_reading": found[quantity, np.arange(at.size)]}

    def log_likelihood(
        self,
        experiment: AttenuationExperiment,
        values: Mapping[str, float],
        response: FloatArray,
    ) -> FloatArray:
        """The model's readings are the oracle's: those of the program stop at a limit."""
        readings, rows = experiment.readings, np.arange(experiment.conditions.n_rows)
        tan_delta, modulus = attenuation_oracle.log_readings(
            experiment, values, experiment.conditions.period, rows
        )
        error = readings.tan_delta_error
        centre = np.log(np.hypot(np.exp(tan_delta), error))
        limited = np.maximum(centre, np.log(np.maximum(readings.limit, 1e-300)))
        np.testing.assert_allclose(response, np.append(limited, modulus), rtol=1e-9)
        law = stats.norm(centre, np.hypot(values["attenuation_scatter"], error / np.exp(centre)))
        observed = np.log(np.maximum(readings.tan_delta, readings.limit))
        moduli = stats.norm.logpdf(
            np.log(readings.modulus),
            modulus,
            np.hypot(values["modulus_scatter"], readings.modulus_error / readings.modulus),
        )
        return np.append(
            np.where(readings.is_limit, law.logcdf(observed), law.logpdf(observed)), moduli
        )


EXAMPLES: Mapping[str, Example[Any]] = {
    "constant_rate": ConstantRateExample(),
    "forced_oscillation": ForcedOscillationExample(),
    "loading_history": LoadingHistoryExample(),
    "attenuation": AttenuationExample(),
}
