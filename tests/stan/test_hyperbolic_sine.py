"""The hyperbolic-sine dashpot: limits, closed forms, independent solutions, gradients, a fit."""

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import oracle
import pytest
from conftest import ICE, Problem, write_problem
from log_density import constant_rate_program
from oscillation_beside_oracle import check_law_beside_oracle
from scipy.integrate import quad
from stan_data import one_test_data

from pyburgers.cli.main import main
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.constant_rate.experiment import (
    ConstantRateExperiment,
    RateSegment,
    load_constant_rate,
)
from pyburgers.kinds.forced_oscillation.experiment import (
    load_forced_oscillation,
    with_background,
)
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.priors import default_priors, load_priors
from pyburgers.model.variants import ModelVariant, variant_of, with_variant
from pyburgers.predictions.attenuation import attenuation_spectrum, predict_attenuation
from pyburgers.predictions.imposed_stress import simulate_imposed_stress
from pyburgers.predictions.stress_cycles import Regime

FloatArray = npt.NDArray[np.float64]
pytestmark = pytest.mark.usefixtures("programs")

OLIVINE = Path(__file__).parents[2] / "data" / "olivine" / "olivine_twin.toml"
STRAIN = np.concatenate([np.geomspace(1e-4, 0.01, 15), np.linspace(0.015, 0.2, 20)])
STEPS = ((0.0, 1e-4), (0.03, 2e-5), (0.0501, 3e-4))


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


def along(segments: tuple[tuple[float, float], ...]) -> FloatArray:
    return np.union1d(STRAIN, [start for start, _ in segments[1:]])


def test_far_below_the_breakdown_it_is_the_power_law() -> None:
    """Other arguments of the solver, the same solution."""
    power_law, sine = (
        simulate(ice_test(), truth(breakdown_stress=breakdown), at=along(STEPS))
        for breakdown in (0.0, 1e12)
    )
    np.testing.assert_allclose(sine["stress_Pa"], power_law["stress_Pa"], rtol=1e-8)
    assert sine.attrs == power_law.attrs


def test_steady_stress_of_the_second_equation_of_the_paper() -> None:
    breakdown, segments = 2e6, ((0.0, 1e-4), (3.0, 1e-6), (6.0, 5e-3))
    parameters = truth(
        stress_exponent=1.0,
        grain_size_exponent=0.0,
        steady_state_fabric_factor=1.0,
        breakdown_stress=breakdown,
        beta=-3.3e-4,
        activation_enthalpy=30e3,
    )
    test = replace(ice_test(segments), final_strain=9.0)
    found = simulate(test, parameters, at=np.array([3.0, 6.0, 9.0]))["stress_Pa"]
    fluidity = oracle.rate_factor(parameters, test.temperature)
    rates = np.array([rate for _, rate in segments])
    expected = breakdown * np.arcsinh(rates / (fluidity * breakdown))
    assert expected.max() > 2 * breakdown
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_steady_stress_may_be_any_number_of_breakdown_stresses() -> None:
    """Salt that hardens comes to 80, and its posterior goes beyond."""
    breakdown, times, enthalpy = 0.1e6, 160.0, 60e3
    test = replace(ice_test(((0.0, 1e-5),)), final_strain=3.0)
    log_factor = np.log(1e-5 / breakdown) - np.log(np.sinh(times))
    parameters = truth(
        stress_exponent=1.0,
        grain_size_exponent=0.0,
        steady_state_fabric_factor=1.0,
        breakdown_stress=breakdown,
        activation_enthalpy=enthalpy,
        beta=log_factor / enthalpy + 1 / (oracle.GAS_CONSTANT * test.temperature),
    )
    found = simulate(test, parameters, at=np.array([3.0]))["stress_Pa"].item()
    assert found == pytest.approx(times * breakdown, rel=1e-6)


@pytest.mark.parametrize(
    "others",
    [
        {},
        {"kelvin_stress_exponent": 2.5, "kelvin_reference_stress": 2e6},
        {
            "steady_state_grain_size": 230e-6,  # that of the start: the piezometer is in use
            "piezometer_reference_grain_size": 2e-3,
            "piezometer_exponent": 1.33,
            "piezometer_stress_floor": 1e6,
        },
    ],
    ids=["linear Kelvin element", "power-law Kelvin element", "piezometer"],
)
@pytest.mark.parametrize("breakdown", [1e6, 8e6])
def test_solutions_agree_with_scipy(breakdown: float, others: dict[str, float]) -> None:
    parameters = truth(breakdown_stress=breakdown, **others)
    strain = along(STEPS)
    found = simulate(ice_test(), parameters, at=strain)
    independent = oracle.six_states(parameters, 260.0, 230e-6, STEPS, strain)
    np.testing.assert_allclose(found["stress_Pa"], independent[0], rtol=1e-5)
    np.testing.assert_allclose(found["kelvin_strain"], independent[1], rtol=1e-5, atol=1e-10)
    power_law = simulate(ice_test(), truth(**others), at=strain)
    assert np.max(np.abs(found["stress_Pa"] / power_law["stress_Pa"] - 1)) > 0.02


def test_an_oscillating_test_agrees_with_scipy() -> None:
    twin = with_background(load_forced_oscillation(OLIVINE), "removed")
    assert twin.true_parameters is not None
    law = {"breakdown_stress": 0.3 * twin.largest_stress}
    check_law_beside_oracle(twin, twin.true_parameters, law)


REGIMES = (Regime(2e6, 0.9e6), Regime(0.5e6, 2e6))
CONDITIONS: dict[str, Any] = {"temperature": 263.0, "grain_size": 2e-4, "fabric_factor": 0.7}


def dashpot_rate(parameters: dict[str, float], stress: float) -> float:
    size, fabric = np.array(CONDITIONS["grain_size"]), np.array(CONDITIONS["fabric_factor"])
    return float(oracle.dashpot_rate(parameters, 263.0, np.array(stress), size, fabric))


@pytest.mark.parametrize("regime", REGIMES, ids=["median", "changing sign"])
def test_stress_cycles_and_attenuation_agree_with_quadrature(regime: Regime) -> None:
    parameters, frequency, hold = truth(breakdown_stress=0.8e6), 1e-3, 3600.0

    def rate(angle: float) -> float:
        stress = regime.median_stress + regime.amplitude * np.sin(angle)
        return dashpot_rate(parameters, stress)

    def over_a_cycle(integrand: Callable[[float], float]) -> float:
        zero = float(np.arcsin(min(1.0, regime.median_stress / regime.amplitude)))
        corners = [0.0, np.pi + zero, 2 * np.pi - zero, 2 * np.pi]
        parts = [
            float(quad(integrand, low, high, epsabs=0.0, epsrel=1e-11, limit=400)[0])
            for low, high in itertools.pairwise(corners)
            if high > low
        ]
        return sum(parts)

    spectrum = attenuation_spectrum(
        {**parameters, "kelvin_viscosity": 0.0}, [1.0], [regime], **CONDITIONS
    )
    loss = over_a_cycle(lambda angle: rate(angle) * float(np.sin(angle)))
    expected = loss / (np.pi * regime.amplitude * 2 * np.pi)
    assert spectrum["loss_compliance"].item() == pytest.approx(expected, rel=1e-8)

    cycle = simulate_imposed_stress(
        parameters,
        regime,
        frequency,
        np.array([1 / frequency]),
        temperature=263.0,
        grain_size=2e-4,
        fabric_factor=0.7,
        hold_time=hold,
    )
    drift = over_a_cycle(rate) / (2 * np.pi * frequency)
    held, after = cycle["dashpot_strain"]
    assert held == pytest.approx(hold * dashpot_rate(parameters, regime.median_stress), rel=1e-8)
    assert after - held == pytest.approx(drift, rel=1e-7)


def test_the_attenuation_of_a_power_law_is_the_limit() -> None:
    far = {name: np.array([value]) for name, value in truth(breakdown_stress=1e12).items()}
    sine, power_law = (
        attenuation_spectrum(draws, [1e-3], REGIMES, **CONDITIONS)["tan_delta"].to_numpy()
        for draws in (far, {**far, "breakdown_stress": np.array([0.0])})
    )
    np.testing.assert_allclose(sine, power_law, rtol=1e-9)


def test_a_breakdown_far_below_the_stress_is_solved_or_refused_but_never_nan() -> None:
    for breakdown in (1e5, 1e2, 1e-3):
        try:
            found = simulate(ice_test(((0.0, 1e-4),)), truth(breakdown_stress=breakdown))
        except SamplingError:
            continue
        assert np.isfinite(found["stress_Pa"]).all()
        assert found["stress_Pa"].max() < 40 * breakdown


def test_gradients_are_finite_and_those_of_the_density(
    small_problem: Problem, tmp_path: Path
) -> None:
    experiment = small_problem.experiment
    priors = with_variant(small_problem.priors, experiment, {"maxwell": "hyperbolic_sine"})
    data = one_test_data(
        experiment, priors.resolved(experiment.largest_stress), solver=SolverOptions(1e-10)
    )
    program = constant_rate_program(data, tmp_path / "program")
    size, rng = data["n_coordinates"], np.random.default_rng(1)
    assert size == len(priors.free)
    for spread in (0.3, 1.0, 2.0):
        at = np.array(0.2 * rng.standard_normal(size))
        at[-1] = spread * rng.standard_normal()
        here = program.at({"coordinate": at.tolist()})
        assert np.isfinite(here.gradient).all()
        step = 1e-4
        around = [
            program.columns_at({"coordinate": (at + sign * step * np.eye(size)[-1]).tolist()})
            for sign in (1, -1)
        ]
        slope = (around[0]["lp__"] - around[1]["lp__"]) / (2 * step)
        assert here.gradient[-1] == pytest.approx(slope, rel=1e-3, abs=1e-3)


def test_the_prior_of_the_breakdown_stress_is_about_the_largest_stress() -> None:
    ice, priors = load_constant_rate(ICE / "PIL40.toml"), default_priors("ice")
    changed = with_variant(priors, ice, {"maxwell": "hyperbolic_sine"})
    assert variant_of(changed, ice) == ModelVariant(maxwell="hyperbolic_sine")
    breakdown = changed["breakdown_stress"]
    assert (breakdown.family, breakdown.location, breakdown.scale) == ("lognormal", 8e6, 1.0)
    assert set(changed.free) - set(priors.free) == {"breakdown_stress"}
    assert with_variant(changed, ice, {"maxwell": "hyperbolic_sine"}) == changed
    back = with_variant(changed, ice, {"maxwell": "power_law"})
    assert variant_of(back, ice) == ModelVariant()
    assert back.free == priors.free
    linear = with_variant(changed, ice, {"maxwell": "linear"})
    assert variant_of(linear, ice) == ModelVariant(maxwell="linear")


def test_a_prior_with_mass_at_no_breakdown_stress_at_all_is_refused(tmp_path: Path) -> None:
    text = (ICE.parent / "priors" / "ice.toml").read_text(encoding="utf-8")
    table = '[parameters.breakdown_stress]\nsource = "test"\nfamily = "half_normal"\nscale = 1\n'
    (tmp_path / "priors.toml").write_text(f'{text}\n{table}unit = "MPa"\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"breakdown_stress.*the model breaks down at zero"):
        load_priors(tmp_path / "priors.toml")


@pytest.mark.slow
def test_a_short_test_is_fitted(tmp_path: Path) -> None:
    free = {"maxwell_modulus", "activation_enthalpy", "stress_noise"}
    # Beyond the peak, where the dashpot carries the whole rate.
    problem = write_problem(tmp_path / "inputs", free=free, max_strain=0.05, stride=2)
    code = main(
        [
            *("fit", str(problem.experiment_file), "--out", str(tmp_path / "run")),
            *("--priors", str(problem.priors_file), "--variant", "maxwell=hyperbolic_sine"),
            *("--chains", "1", "--warmup", "100", "--draws", "60", "--seed", "11"),
            *("--adapt-delta", "0.8"),
        ]
    )
    assert code in (0, 3)
    fit = Fit.load(tmp_path / "run")
    assert fit.variant.short_text == "maxwell=hyperbolic_sine"
    assert fit.manifest["coordinates"]["system"] == "plain"
    assert "hyperbolic sine" in fit.manifest["coordinates"]["reason"]
    # The data are those of a power law: a breakdown within their stresses is ruled out.
    breakdown = fit.posterior["posterior"]["breakdown_stress"]
    assert float(breakdown.min()) > 0.5 * fit.experiment.largest_stress
    spectrum = predict_attenuation(fit, [1e-3])
    assert np.isfinite(spectrum["tan_delta"]).all()
