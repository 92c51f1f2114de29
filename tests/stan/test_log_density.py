"""The log density at constant rate: an independent solution, priors and the map's determinant."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import oracle
import pytest
from conftest import ICE, resolved_priors
from log_density import Program, assert_gradient_is_slope, constant_rate_program
from oracle import GAS_CONSTANT
from scipy import stats
from stan_data import one_test_data, parameter_in

from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, RateSegment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.problem import plain_coordinates
from pyburgers.kinds.stan_data import REFERENCE_STRESS, PlainCoordinates, SolverOptions
from pyburgers.model.priors import PriorSet

pytestmark = pytest.mark.usefixtures("programs")

ONE_RATE, STEPS = ((0.0, 8e-5),), ((0.0, 8e-5), (0.04, 2e-5), (0.1, 3e-4))


@dataclass(frozen=True)
class Setting:
    """A test, its priors and its program."""

    test: ConstantRateExperiment
    priors: PriorSet
    coordinates: PlainCoordinates
    program: Program

    def coordinate_at(self, values: Mapping[str, float]) -> list[float]:
        """Plain coordinates of parameters; ln S_0 stands for Q_M."""
        enthalpy, n = values["activation_enthalpy"], values["stress_exponent"]
        log_factor = enthalpy * (values["beta"] - 1 / (GAS_CONSTANT * self.test.temperature))
        log_size = values["grain_size_exponent"] * np.log(self.test.initial_grain_size)
        log_stress = (np.log(self.test.segments[0].strain_rate) + log_size - log_factor) / n
        at = self.coordinates.at({**values, REFERENCE_STRESS: float(np.exp(log_stress))})
        return list(at.tolist())

    def log_likelihood(self, values: Mapping[str, float]) -> float:
        """Of the paper's six states, solved with scipy."""
        segments = tuple((s.start_strain, s.strain_rate) for s in self.test.segments)
        conditions = (self.test.temperature, self.test.initial_grain_size)
        stress = oracle.six_states(values, *conditions, segments, self.test.strain)[0]
        return float(stats.norm.logpdf(self.test.stress, stress, values["stress_noise"]).sum())

    def log_determinant(self, values: Mapping[str, float]) -> float:
        """Of the parameters by the coordinates, written out from the bounds of the priors."""
        total = np.log(values["stress_exponent"])  # of Q_M by ln S_0
        total -= np.log(1 / (GAS_CONSTANT * self.test.temperature) - values["beta"])
        plain = self.coordinates
        for k, name in enumerate(plain.quantities):
            low, high = plain.lower[k], plain.upper[k]
            if name == REFERENCE_STRESS or np.isinf(low):
                total += np.log(plain.scale[k])
            elif np.isinf(high):
                total += np.log(values[name] - low)
            else:
                total += np.log((values[name] - low) * (high - values[name]) / (high - low))
        return float(total)


@pytest.fixture(params=[ONE_RATE, STEPS], ids=["one rate", "rate steps"])
def setting(request: pytest.FixtureRequest, tmp_path: Path) -> Setting:
    test = replace(
        load_constant_rate(ICE / "PIL72.toml"),
        segments=tuple(RateSegment(start, rate) for start, rate in request.param),
    )
    priors = resolved_priors(test)
    solver = SolverOptions(tolerance=1e-10, max_num_steps=1_000_000)
    data = one_test_data(test, priors, solver=solver)
    coordinates = plain_coordinates(test, priors)
    assert coordinates.replaced_parameter == "activation_enthalpy"
    return Setting(test, priors, coordinates, constant_rate_program(data, tmp_path))


def test_the_density_is_likelihood_prior_and_determinant_at_prior_draws(setting: Setting) -> None:
    rng, truth = np.random.default_rng(3), setting.test.true_parameters
    assert truth is not None
    # With steps of the rate, scipy cannot follow the stiffest materials of the priors.
    share = 1.0 if len(setting.test.segments) == 1 else 0.1
    for number in range(10):
        drawn = {name: prior.sample(rng) for name, prior in setting.priors.priors.items()}
        values = {name: truth[name] + share * (drawn[name] - truth[name]) for name in drawn}
        coordinate = setting.coordinate_at(values)
        columns = setting.program.columns_at({"coordinate": coordinate})
        for name, value in values.items():
            assert parameter_in(columns, name) == pytest.approx(value, rel=1e-9), name
        prior = sum(
            own.distribution().logpdf(values[name]) for name, own in setting.priors.priors.items()
        )
        expected = setting.log_likelihood(values) + prior + setting.log_determinant(values)
        assert columns["lp__"] == pytest.approx(expected, rel=1e-6)
        if number < 4:
            assert_gradient_is_slope(setting.program, np.array(coordinate))
