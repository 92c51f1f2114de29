"""Whole tests left out of joint fits of ice: marginal likelihoods add up, a true law predicts."""

from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from conftest import ICE

from pyburgers.calibration import simulate_constant_rate
from pyburgers.constant_rate import ConstantRateExperiment, load_constant_rate
from pyburgers.fitting import fit
from pyburgers.joint_fitting import JointFit, fit_jointly
from pyburgers.leave_one_test_out import (
    compare_by_test,
    difference_by_test,
    leave_one_test_out,
    sentences_by_test,
)
from pyburgers.marginal_likelihood import log_marginal_likelihood
from pyburgers.priors import default_priors
from pyburgers.sampling import SamplerOptions

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("programs")]

COMMON = MappingProxyType(
    {
        "maxwell_modulus": 3.5e9,
        "kelvin_modulus": 5.6e8,
        "kelvin_viscosity": 6e10,
        "stress_exponent": 3.9,
        "grain_size_exponent": 0.5,
        "activation_enthalpy": 63e3,
        "beta": -7.29e-4,
    }
)
"""Flow law and moduli of both tests; microstructure and noise are those of the shipped twins."""

OPTIONS = SamplerOptions(chains=2, warmup=400, draws=400, seed=20261120)


@pytest.fixture(scope="module")
def experiments() -> list[ConstantRateExperiment]:
    found = []
    for k, name in ((0, "PIL40"), (2, "PIL105")):
        twin = load_constant_rate(ICE / f"{name}.toml")
        assert twin.true_parameters is not None
        values = {**twin.true_parameters, **COMMON}
        rng = np.random.default_rng([20261120, k])
        found.append(simulate_constant_rate(twin, values, rng, source="a common flow law"))
    return found


@pytest.fixture(scope="module")
def joints(
    experiments: list[ConstantRateExperiment], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, JointFit]:
    folder = tmp_path_factory.mktemp("joint")
    pools = {"default": None, "separate": {"all": "separate"}}
    return {
        name: fit_jointly(
            experiments,
            default_priors("ice"),
            pool=pool,
            out=folder / name,
            options=OPTIONS,
            report=print,
        )
        for name, pool in pools.items()
    }


def test_marginal_likelihoods_of_separate_tests_multiply(
    experiments: list[ConstantRateExperiment], joints: dict[str, JointFit], tmp_path: Path
) -> None:
    """Twice: against fits of single tests, and against the joint fit without the other test."""
    both = leave_one_test_out(joints["separate"], command="test", report=print)
    for k, test in enumerate(both.tests):
        (experiment,) = (e for e in experiments if e.id == test)
        alone = fit(
            experiment, default_priors("ice"), out=tmp_path / test, options=OPTIONS, report=print
        )
        single = log_marginal_likelihood(alone)
        error = float(np.hypot(both.error[k], single.error))
        print(f"{test}: {both.elpd[k]:.3f} +- {both.error[k]:.3f}, alone {single}")
        assert error < 0.5
        assert both.elpd[k] == pytest.approx(single.value, abs=4 * error)


def test_tests_of_one_material_are_predicted_better_where_it_is_shared(
    joints: dict[str, JointFit],
) -> None:
    comparison = compare_by_test(joints, command="test", report=print)
    for sentence in sentences_by_test(comparison):
        print(sentence)
    shared, apart = (comparison.results[name] for name in ("default", "separate"))
    difference, _, monte_carlo = difference_by_test(shared, apart)
    assert list(comparison.results) == ["default", "separate"]
    assert difference > 4 + 4 * monte_carlo
