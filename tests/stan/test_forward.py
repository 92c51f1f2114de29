"""Forward solutions of the Stan programs against independent solutions."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import oracle
import pytest
from conftest import ICE, FunctionValues
from history_twins import PIEZOMETER
from imagined_tests import ONE_RATE, STEPS, imagined_curve
from independent_table import PEAKS, STRAIN_RATES, STRESS_OF_FAST, TRUTHS
from stan_values import PHYSICS

from pyburgers.common.errors import InputError, SamplingError
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.forward import check_parameters, simulate
from pyburgers.kinds.stan_data import REFERENCE_SOLVER
from pyburgers.model.priors import default_priors

pytestmark = pytest.mark.usefixtures("programs")


TRUTH = dict(load_constant_rate(ICE / "PIL40.toml").true_parameters or {})


def test_stress_agrees_with_the_independent_table() -> None:
    strain = np.array(list(STRESS_OF_FAST))
    test = imagined_curve([(0.0, STRAIN_RATES["fast"])], 0.2)
    solution = simulate(test, TRUTHS["fast"], at=strain)
    np.testing.assert_allclose(
        solution["stress_Pa"] / 1e6, list(STRESS_OF_FAST.values()), rtol=2e-3
    )


@pytest.mark.parametrize("name", PEAKS)
def test_peak_agrees_with_the_independent_table(name: str) -> None:
    strain = np.linspace(2e-4, 0.06, 300)
    test = imagined_curve([(0.0, STRAIN_RATES[name])], 0.06)
    solution = simulate(test, TRUTHS[name], at=strain)
    stress, at = PEAKS[name]
    assert solution["stress_Pa"].max() / 1e6 == pytest.approx(stress, rel=2e-3)
    assert strain[solution["stress_Pa"].argmax()] == pytest.approx(at, abs=3e-4)


def random_schedule(rng: np.random.Generator) -> list[tuple[float, float]]:
    """Two to five rates from 1e-8 to 1e-3 per second, at random strains."""
    n_segments = int(rng.integers(2, 6))
    steps = np.sort(rng.uniform(0.005, 0.195, n_segments - 1))
    return list(zip([0.0, *steps], 10 ** rng.uniform(-8, -3, n_segments), strict=True))


LAWS: Mapping[str, Mapping[str, float]] = {
    "standard": {},
    "power-law Kelvin": {"kelvin_stress_exponent": 3.0, "kelvin_reference_stress": 1e6},
    "piezometric": PIEZOMETER,
    "hyperbolic sine": {"breakdown_stress": 2e7},
}
EVERY_HALF_PERCENT = np.linspace(0.005, 0.2, 40)


@pytest.mark.parametrize("law", LAWS)
def test_the_reference_solver_passes_any_steps_of_the_rate(law: str) -> None:
    """Rates that drop ten thousandfold among them; 3 of 30 failed with one clock for the test."""
    rng = np.random.default_rng(0)
    schedules = [random_schedule(rng) for _ in range(20 if law == "standard" else 5)]
    # Drops on which the solver gave up.
    schedules += [
        [(0.0, 1.25e-5), (0.05, 1.02e-6), (0.1, 3.54e-8), (0.15, 3.03e-6)],
        [(0.0, 8.05e-4), (0.09639783, 6.11e-4), (0.15802729, 5.54e-8), (0.1701884, 7.3e-4)],
    ]
    for schedule in schedules:
        test, values = imagined_curve(schedule, 0.2), {**TRUTH, **LAWS[law]}
        exact = simulate(test, values, at=EVERY_HALF_PERCENT)
        loose = simulate(
            test, values, at=EVERY_HALF_PERCENT, solver=replace(REFERENCE_SOLVER, tolerance=1e-7)
        )
        np.testing.assert_allclose(exact["stress_Pa"], loose["stress_Pa"], rtol=1e-4)


@pytest.mark.slow
def test_the_reference_solver_passes_a_thousand_schedules_at_parameters_from_the_prior() -> None:
    rng, priors = np.random.default_rng(2), default_priors("ice").resolved(8e6)
    for _ in range(1000):
        solution = simulate(
            imagined_curve(random_schedule(rng), 0.2), priors.sample(rng), at=EVERY_HALF_PERCENT
        )
        assert np.isfinite(solution["stress_Pa"]).all()


def test_solution_has_the_times_of_the_protocol() -> None:
    strain = np.array([0.01, 0.03, 0.04, 0.0501, 0.1])
    solution = simulate(imagined_curve(STEPS, 0.1), TRUTH, at=strain)
    np.testing.assert_array_equal(solution["strain"], strain)
    np.testing.assert_allclose(
        solution["time_s"],
        [100, 300, 300 + 0.01 / 2e-5, 300 + 0.0201 / 2e-5, 300 + 0.0201 / 2e-5 + 0.0499 / 3e-4],
    )


def test_a_solution_that_cannot_be_found_is_an_error(tmp_path: Path) -> None:
    no_strength = {"activation_enthalpy": 65e9, "beta": 1e-3}
    with pytest.raises(SamplingError, match="solver"):
        simulate(imagined_curve(ONE_RATE, 0.1), TRUTH | no_strength)


def test_a_dashpot_that_never_flows_leaves_the_springs() -> None:
    rigid = TRUTH | {"activation_enthalpy": 65e9}
    solution = simulate(imagined_curve(ONE_RATE, 0.1), rigid, at=np.array([0.05, 0.1]))
    assert solution.attrs["reference_stress"] == np.inf
    relaxed = 1 / (1 / rigid["maxwell_modulus"] + 1 / rigid["kelvin_modulus"])
    np.testing.assert_allclose(np.diff(solution["stress_Pa"]), 0.05 * relaxed, rtol=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"beta": float("nan")}, "beta"),
        ({"apparatus_compliance": -1e-9}, "apparatus_compliance .* 1/Pa, expected zero or a pos"),
        ({"residual_correlation_time": -5.0}, "residual_correlation_time .* expected zero or a"),
        ({"stress_noise": -1.0}, "stress_noise .* expected zero or a positive number"),
        ({"grain_size_exponent": -0.1}, "grain_size_exponent .* expected zero or a positive"),
        ({"residual_correlated_share": 1.5}, "residual_correlated_share .* at most 1"),
        ({"andrade_exponent": 1.0}, "andrade_exponent .* less than 1"),
        ({"stress_calibration_error": -1.0}, "stress_calibration_error .* between -1 and 1"),
        ({"temperature_error": 1000.0}, "temperature_error is 1000 K, expected less than .* 260 K"),
        ({"temperature_error": -260.0}, "temperature_error"),
    ],
)
def test_wrong_parameters_are_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        simulate(imagined_curve(ONE_RATE, 0.1), TRUTH | change)


def test_what_may_be_zero_or_of_either_sign_is_taken() -> None:
    values = TRUTH | {
        "apparatus_compliance": 0.0,
        "stress_noise": 0.0,
        "strain_offset": -1e-3,
        "temperature_error": -2.0,
        "stress_calibration_error": -0.01,
        "modulus_temperature_coefficient": -1e-4,
    }
    assert check_parameters(values) == values
    assert check_parameters({name: np.float32(one) for name, one in values.items()})
    assert check_parameters(values | {"stress_exponent": np.int64(3)})["stress_exponent"] == 3.0


def function_data(stress: Sequence[float], path_strain: Sequence[float]) -> dict[str, object]:
    return {
        **PHYSICS,
        "n_stresses": len(stress),
        "stress": list(stress),
        "n_path_strains": len(path_strain),
        "path_strain": list(path_strain),
    }


def test_flow_law_is_odd_in_stress_and_zero_at_rest(function_values: FunctionValues) -> None:
    stress = np.array([1e3, 1e6, 8e6])
    values = function_values("physics_values", function_data([*stress, *-stress, 0.0], []))
    rate = values["dashpot_rate"]
    expected = oracle.dashpot_rate(TRUTHS["fast"], 260.0, stress, 180e-6, 0.7)
    np.testing.assert_allclose(rate[:3], expected, rtol=1e-12)
    np.testing.assert_array_equal(rate[3:6], -rate[:3])
    assert rate[6] == 0


def test_reference_stress_and_enthalpy_are_inverse(function_values: FunctionValues) -> None:
    values = function_values("physics_values", function_data([], []))
    assert values["activation_enthalpy_back"] == pytest.approx(62.08e3, rel=1e-12)
    assert values["beta_back"] == pytest.approx(-7.29e-4, rel=1e-12)
    assert values["rate_at_reference_stress"] == pytest.approx(1.69e-4, rel=1e-10)
    log_rate = values["log_rate_at_reference_stress"]
    assert log_rate == pytest.approx(np.log(1.69e-4), rel=1e-12)


def test_piezometer_is_even_and_floored(function_values: FunctionValues) -> None:
    stress = np.array([0.0, 1e3, 1e6, 30e6, 200e6])
    values = function_values("physics_values", function_data([*stress, *-stress], []))
    size = values["preferred_grain_size"]
    np.testing.assert_allclose(size[:5], [oracle.piezometer(s) for s in stress], rtol=1e-12)
    np.testing.assert_array_equal(size[5:], size[:5])
    # Eq. 5 itself where the stress is far above the floor.
    assert size[4] == pytest.approx(0.015 * 200**-1.33, rel=1e-4)
    assert size[0] == pytest.approx(0.015, rel=1e-12)


def test_closed_form_of_the_microstructure_solves_its_equation(
    function_values: FunctionValues,
) -> None:
    step = 1e-5
    middle = np.array([0.01, 0.05, 0.2])
    path = np.concatenate([[0.0], middle, middle - step, middle + step])
    values = function_values("physics_values", function_data([], path.tolist()))
    grain_size = values["grain_size_at"]
    assert grain_size[0] == pytest.approx(230e-6, rel=1e-14)
    slope = (grain_size[7:] - grain_size[4:7]) / (2 * step)  # per unit strain
    np.testing.assert_allclose(values["grain_size_rate"][1:4], slope * 1.69e-4, rtol=1e-6)
    # Strain that runs backwards goes on changing the microstructure in the same sense.
    np.testing.assert_array_equal(values["grain_size_rate_reversed"], values["grain_size_rate"])
    np.testing.assert_allclose(
        values["log_relative_grain_size"], np.log(grain_size / 230e-6), rtol=1e-10, atol=1e-15
    )


def test_a_trial_step_behind_the_start_has_a_microstructure(
    function_values: FunctionValues,
) -> None:
    """Solvers come to path strains of any size and sign before they take a shorter step."""
    values = function_values("physics_values", function_data([], [-1e-9, -0.1, -1e3]))
    np.testing.assert_array_equal(values["log_relative_grain_size"], 0.0)
