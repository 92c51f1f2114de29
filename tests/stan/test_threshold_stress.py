"""A dashpot with a threshold stress: limits, solutions, density, gradients, refusals."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import oracle
import pytest
from conftest import ICE
from history_twins import TRUTH, history_twin
from log_density import assert_gradient_is_slope, program_with
from oscillation_beside_oracle import check_law_beside_oracle
from scipy import stats
from stan_data import parameters_in

from pyburgers.common.errors import InputError
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.constant_rate.experiment import (
    ConstantRateExperiment,
    RateSegment,
    load_constant_rate,
)
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forced_oscillation.experiment import (
    load_forced_oscillation,
    with_background,
)
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.priors import PriorSet, default_priors
from pyburgers.model.variants import ModelVariant, variant_of, with_variant
from pyburgers.predictions.attenuation import attenuation_spectrum
from pyburgers.predictions.stress_cycles import Regime

FloatArray = npt.NDArray[np.float64]
pytestmark = pytest.mark.usefixtures("programs")

OLIVINE = Path(__file__).parents[2] / "data" / "olivine" / "olivine_twin.toml"
THRESHOLD = {"maxwell": "threshold_stress"}
STRAIN = np.concatenate([np.geomspace(1e-4, 0.01, 15), np.linspace(0.015, 0.2, 20)])
STEPS = ((0.0, 1e-4), (0.03, 2e-5), (0.0501, 3e-4))
MATERIALS: Mapping[str, Mapping[str, float]] = {
    "linear Kelvin element": {},
    "power-law Kelvin element": {"kelvin_stress_exponent": 2.5, "kelvin_reference_stress": 2e6},
    "piezometer": {
        "steady_state_grain_size": 230e-6,  # that of the start: the piezometer is in use
        "piezometer_reference_grain_size": 2e-3,
        "piezometer_exponent": 1.33,
        "piezometer_stress_floor": 1e6,
    },
}


def truth(**changes: float) -> dict[str, float]:
    parameters = load_constant_rate(ICE / "PIL40.toml").true_parameters
    assert parameters is not None
    return {**parameters, **changes}


def ice_test(segments: tuple[tuple[float, float], ...] = STEPS) -> ConstantRateExperiment:
    return replace(
        load_constant_rate(ICE / "PIL40.toml"),
        segments=tuple(RateSegment(start, rate) for start, rate in segments),
        strain=np.empty(0),
        stress=np.empty(0),
        final_strain=max(0.2, segments[-1][0] + 0.1),
    )


def along(segments: tuple[tuple[float, float], ...] = STEPS) -> FloatArray:
    return np.union1d(STRAIN, [start for start, _ in segments[1:]])


@pytest.mark.parametrize("material", MATERIALS)
def test_without_a_threshold_it_is_the_power_law(material: str) -> None:
    others = MATERIALS[material]
    none, tiny, power_law = (
        simulate(ice_test(), truth(**others, **threshold), at=along())
        for threshold in ({"threshold_stress": 0.0}, {"threshold_stress": 1e-3}, {})
    )
    assert none.equals(power_law)
    np.testing.assert_allclose(tiny["stress_Pa"], power_law["stress_Pa"], rtol=1e-7)


@pytest.mark.parametrize("exponent", [1.0, 3.0])
def test_a_steady_stress_is_the_threshold_and_that_of_the_power_law(exponent: float) -> None:
    threshold, segments = 2e6, ((0.0, 1e-4), (3.0, 1e-6), (6.0, 5e-4))
    parameters = truth(
        stress_exponent=exponent,
        grain_size_exponent=0.0,
        steady_state_fabric_factor=1.0,
        threshold_stress=threshold,
        activation_enthalpy=60e3,
    )
    test = replace(ice_test(segments), final_strain=9.0)
    rates = np.array([rate for _, rate in segments])
    # A rate factor with which the power law has 3 MPa at the first rate.
    parameters["beta"] = (
        1 / (oracle.GAS_CONSTANT * test.temperature)
        + (np.log(rates[0]) - exponent * np.log(3e6)) / parameters["activation_enthalpy"]
    )
    found = simulate(test, parameters, at=np.array([3.0, 6.0, 9.0]))["stress_Pa"]
    expected = threshold + 3e6 * (rates / rates[0]) ** (1 / exponent)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_up_to_the_threshold_the_dashpot_stands_still() -> None:
    test = history_twin("creep", 20)
    below, above = (
        simulate(test, {**TRUTH, "threshold_stress": threshold}) for threshold in (5.001e6, 4.9e6)
    )
    spring = below["stress_Pa"] / TRUTH["maxwell_modulus"]
    np.testing.assert_allclose(below["strain"], spring + below["kelvin_strain"], rtol=1e-14)
    assert (above["strain"].iloc[-1] - below["strain"].iloc[-1]) > 0


@pytest.mark.parametrize("material", MATERIALS)
@pytest.mark.parametrize("threshold", [1e6, 5e6])
def test_solutions_agree_with_scipy(threshold: float, material: str) -> None:
    parameters = truth(threshold_stress=threshold, **MATERIALS[material])
    found = simulate(ice_test(), parameters, at=along())
    independent = oracle.six_states(parameters, 260.0, 230e-6, STEPS, along())
    np.testing.assert_allclose(found["stress_Pa"], independent[0], rtol=1e-5)
    np.testing.assert_allclose(found["kelvin_strain"], independent[1], rtol=1e-5, atol=1e-10)
    power_law = simulate(ice_test(), truth(**MATERIALS[material]), at=along())
    assert np.max(np.abs(found["stress_Pa"] / power_law["stress_Pa"] - 1)) > 0.05


def test_an_oscillating_test_agrees_with_scipy() -> None:
    twin = with_background(load_forced_oscillation(OLIVINE), "removed")
    assert twin.true_parameters is not None
    # A dashpot that is a thousand times faster counts in an oscillation of this size.
    faster = np.log(1e3) / twin.true_parameters["activation_enthalpy"]
    fast = {**twin.true_parameters, "beta": twin.true_parameters["beta"] + faster}
    law = {"threshold_stress": 0.3 * twin.largest_stress}
    check_law_beside_oracle(twin, fast, law)


def test_the_log_likelihood_is_that_of_the_independent_solution(tmp_path: Path) -> None:
    test = load_constant_rate(ICE / "PIL40.toml")
    problem = problem_of([test], with_variant(default_priors("ice"), test, THRESHOLD))
    data = program_data(problem, solver=SolverOptions(1e-10))
    program = program_with(likelihood_of(test).program, data, tmp_path / "program")
    at = np.array(0.2 * np.random.default_rng(4).standard_normal(data["n_coordinates"]))
    columns = program.columns_at({"coordinate": at.tolist()})
    values = parameters_in(columns)
    assert 0 < values["threshold_stress"] < test.largest_stress
    segments = tuple((s.start_strain, s.strain_rate) for s in test.segments)
    stress = oracle.six_states(
        values, test.temperature, test.initial_grain_size, segments, test.strain
    )[0]
    expected = stats.norm.logpdf(test.stress, stress, values["stress_noise"])
    found = [columns[f"log_lik.{i + 1}"] for i in range(test.n_points)]
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)


def the_tests() -> dict[str, Experiment]:
    return {
        "constant rate": load_constant_rate(ICE / "PIL40.toml"),
        "loading history": history_twin("mixed", 16),
        "oscillation": load_forced_oscillation(OLIVINE),
    }


def priors_for(test: Experiment, dashpot: str) -> PriorSet:
    """Priors with a threshold; of a linear dashpot those with n = 1."""
    priors = default_priors(test.material, test.protocol)
    if dashpot == "linear":
        priors = with_variant(priors, test, {"maxwell": "linear"})
    return with_variant(priors, test, THRESHOLD)


@pytest.mark.parametrize("dashpot", ["power law", "linear"])
@pytest.mark.parametrize("kind", ["constant rate", "loading history", "oscillation"])
def test_gradients_are_slopes_of_the_density(kind: str, dashpot: str, tmp_path: Path) -> None:
    """Every test passes its threshold; with n = 1 the slope of the rate jumps there."""
    test = the_tests()[kind]
    problem = problem_of([test], priors_for(test, dashpot))
    data = program_data(problem, solver=SolverOptions(1e-11, 1_000_000))
    program = program_with(likelihood_of(test).program, data, tmp_path / "program")
    point = np.array(0.1 * np.random.default_rng(2).standard_normal(data["n_coordinates"]))
    names = list(problem.layout.names)
    free = [names.index("threshold_stress"), names.index("kelvin_viscosity")]
    assert_gradient_is_slope(program, point, free)


def test_its_prior_is_about_a_tenth_of_the_largest_stress() -> None:
    ice, priors = load_constant_rate(ICE / "PIL40.toml"), default_priors("ice")
    changed = with_variant(priors, ice, THRESHOLD)
    assert variant_of(changed, ice) == ModelVariant(maxwell="threshold_stress")
    threshold = changed["threshold_stress"]
    assert (threshold.family, threshold.location, threshold.scale) == ("lognormal", 8e5, 1.0)
    assert set(changed.free) - set(priors.free) == {"threshold_stress"}
    assert with_variant(changed, ice, THRESHOLD) == changed
    sine = with_variant(changed, ice, {"maxwell": "hyperbolic_sine"})
    assert variant_of(sine, ice) == ModelVariant(maxwell="hyperbolic_sine")
    back = with_variant(changed, ice, {"maxwell": "power_law"})
    assert back.free == priors.free


def test_two_laws_of_the_dashpot_are_refused() -> None:
    ice, priors = load_constant_rate(ICE / "PIL40.toml"), default_priors("ice")
    sine = with_variant(priors, ice, {"maxwell": "hyperbolic_sine"})
    threshold = with_variant(priors, ice, THRESHOLD)["threshold_stress"]
    with pytest.raises(InputError, match="breakdown_stress and threshold_stress"):
        variant_of(sine.exchanging(threshold), ice)


def test_what_needs_a_closed_form_refuses_it() -> None:
    table = load_attenuation(ICE / "attenuation_twin.toml")
    with pytest.raises(InputError, match="maxwell=threshold_stress is not for tests of"):
        with_variant(default_priors("ice", "attenuation"), table, THRESHOLD)
    with pytest.raises(InputError, match="maxwell=threshold_stress is not for tests of"):
        simulate(table, {**(table.true_parameters or {}), "threshold_stress": 1e5})
    with pytest.raises(InputError, match="threshold_stress: found values other than 0"):
        attenuation_spectrum(
            truth(threshold_stress=1e5),
            [1e-3],
            [Regime(2e6, 1e6)],
            temperature=263.0,
            grain_size=2e-4,
        )
