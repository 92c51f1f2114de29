"""Priors are data of the program: densities, fixed parameters, and draws without likelihood."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
from conftest import ICE, FunctionValues, valley_of, with_fixed, with_priors
from independent_table import TRUTHS
from log_density import program_with
from prior_marginals import assert_prior_marginals
from scipy import stats
from stan_data import one_test_data, parameter_in
from stan_values import PHYSICS

from pyburgers.cmdstan.program import load_program
from pyburgers.common.errors import SamplingError
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.constant_rate.likelihood import LIKELIHOOD
from pyburgers.kinds.forward import simulate_data
from pyburgers.kinds.problem import plain_coordinates
from pyburgers.kinds.stan_data import REFERENCE_STRESS, SolverOptions
from pyburgers.model.parameters import PARAMETERS
from pyburgers.model.prior_families import FAMILIES, Family, Prior
from pyburgers.model.priors import PriorSet, default_priors

pytestmark = pytest.mark.usefixtures("programs")


def reference_stress(experiment: ConstantRateExperiment, values: Mapping[str, float]) -> float:
    factor = oracle.rate_factor(values, experiment.temperature)
    by_grains = experiment.initial_grain_size ** values["grain_size_exponent"]
    flow = experiment.segments[0].strain_rate * by_grains / factor
    return float(flow ** (1 / values["stress_exponent"]))


def priors_of(kind: str) -> PriorSet:
    """Return sets that between them have every family, and ln S_0 in place of Q_M and of beta."""
    if kind == "dunite":
        return default_priors("dunite")
    ice = default_priors("ice")
    if kind == "enthalpy fixed":
        changed = {
            "maxwell_modulus": Prior(
                "maxwell_modulus", "normal", 4e9, 2e9, 3e9, 4.5e9, "Pa", "test"
            ),
            "beta": Prior("beta", "normal", -7.29e-4, 2e-5, -np.inf, np.inf, "mol/J", "test"),
        }
        return with_fixed(
            with_priors(ice, changed), {"activation_enthalpy": 64e3, "critical_strain_fabric": 0.2}
        )
    return ice


KINDS = ("ice", "enthalpy fixed", "dunite")


@pytest.fixture(scope="module")
def short_test() -> ConstantRateExperiment:
    """Two readings at little strain: a quick solution for programs that need one."""
    full = load_constant_rate(ICE / "PIL40.toml")
    return replace(full, strain=full.strain[:2], stress=full.stress[:2], final_strain=0.01)


@pytest.mark.parametrize("kind", KINDS)
def test_prior_density_is_the_sum_of_the_families(
    kind: str, short_test: ConstantRateExperiment, tmp_path: Path
) -> None:
    priors = priors_of(kind).resolved(8e6)
    data = one_test_data(short_test, priors, solver=SolverOptions(), use_likelihood=False)
    coordinates = plain_coordinates(short_test, priors)
    program = program_with(LIKELIHOOD.program, data, tmp_path)
    rng = np.random.default_rng(8)
    for _ in range(3):
        values = {name: prior.sample(rng) for name, prior in priors.priors.items()}
        start = coordinates.at({**values, REFERENCE_STRESS: reference_stress(short_test, values)})
        columns = program.columns_at({"coordinate": start.tolist()})
        expected = sum(priors[name].distribution().logpdf(values[name]) for name in priors.free)
        assert columns["lprior"] == pytest.approx(expected, rel=1e-8)
        assert columns["lp__"] == pytest.approx(expected + columns["log_jacobian"], rel=1e-8)
        for parameter in PARAMETERS:
            if priors[parameter.name].is_fixed:
                found = parameter_in(columns, parameter.name)
                assert found == priors[parameter.name].location


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_without_likelihood_draws_have_the_priors_marginals(
    kind: str, short_test: ConstantRateExperiment, tmp_path: Path
) -> None:
    priors = priors_of(kind).resolved(8e6)
    data = one_test_data(short_test, priors, solver=SolverOptions(), use_likelihood=False)
    assert_prior_marginals(
        load_program(LIKELIHOOD.program),
        data,
        priors,
        tmp_path,
        draws=4000,
        least_size=1000,
    )


NARROW = {
    "maxwell_modulus": 0.03,
    "kelvin_modulus": 0.1,
    "kelvin_viscosity": 0.1,
    "stress_exponent": 0.01,
    "grain_size_exponent": 0.04,
    "activation_enthalpy": 0.002,
    "stress_noise": 0.1,
}
"""Relative widths of priors as narrow as a curve could make them."""


@pytest.mark.slow
def test_valley_coordinates_leave_the_prior_as_it_is(
    short_test: ConstantRateExperiment, tmp_path: Path
) -> None:
    """The whole priors of what softens the dashpot, narrow ones of all else.

    Under the whole priors ln S_0 lies anywhere within 1760 of the standard deviations that the
    curve fixes it to, which follow the noise: steps are too short for that funnel.

    The map is that for a curve of a middle truth: the truths of the shipped twins lie in a corner
    of the priors.
    """
    twin, rng = load_constant_rate(ICE / "PIL72.toml"), np.random.default_rng(72)
    full = simulate_data(twin, TRUTHS["middle"], rng, source="tests/support/independent_table.py")
    whole = default_priors("ice").resolved(float(np.abs(full.stress).max()))
    narrow = {
        name: replace(
            whole[name],
            family="normal",
            location=TRUTHS["middle"][name],
            scale=relative * TRUTHS["middle"][name],
        )
        for name, relative in NARROW.items()
    }
    priors = with_priors(whole, narrow)
    valley = valley_of(full, priors)
    data = one_test_data(
        short_test, priors, solver=SolverOptions(), use_likelihood=False, reference=valley
    )
    assert_prior_marginals(
        load_program(LIKELIHOOD.program),
        data,
        priors,
        tmp_path,
        draws=750,
        least_size=400,
    )


@pytest.mark.parametrize(
    ("family", "law"),
    [
        ("uniform", stats.uniform(1, 3)),
        ("normal", stats.truncnorm(-4, 2, loc=3, scale=0.5)),
        ("lognormal", stats.lognorm(0.5, scale=3)),
    ],
)
def test_families_of_priors_have_the_codes_of_the_programs(
    family: Family, law: Any, function_values: FunctionValues
) -> None:
    values = function_values("physics_values", {**PHYSICS, "prior_family": FAMILIES[family].code})
    assert values["prior_density"] == pytest.approx(law.logpdf(2.0), rel=1e-12)


@pytest.mark.parametrize("code", [-1, 5, 7])
def test_an_unknown_family_of_priors_is_refused(code: int, function_values: FunctionValues) -> None:
    with pytest.raises(SamplingError, match=f"prior family: found {code}"):
        function_values("physics_values", {**PHYSICS, "prior_family": code})
