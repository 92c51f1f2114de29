"""Oscillating tests in Stan: solution, trend, spin-up and files against independent judges."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import ICE, FunctionValues
from oscillation_records import part_of, with_record
from scipy.integrate import simpson
from scipy.stats import multivariate_normal, norm
from stan_values import CHARTS

from pyburgers.cmdstan.program import load_program
from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment, with_background
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.forced_oscillation.preparation import (
    OscillationSettings,
)
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import one_test
from pyburgers.kinds.program_data import given_parameters, program_data, solve
from pyburgers.kinds.stan_data import REFERENCE_SOLVER

pytestmark = pytest.mark.usefixtures("programs")

TWIN_FILE = ICE.parent / "olivine" / "olivine_twin.toml"
PERIOD = 300.0
NOISE = 4e6  # Pa, of the twin


@pytest.fixture(params=["removed", "kept"])
def twin(request: pytest.FixtureRequest) -> OscillationExperiment:
    return with_background(load_forced_oscillation(TWIN_FILE), request.param)


def numbers_of(
    value: FloatArray, quantity: FloatArray, function_values: FunctionValues
) -> FloatArray:
    data = {
        **CHARTS,
        "quantity": quantity.tolist(),
        "n_values": value.size,
        "value": value.tolist(),
    }
    return function_values("chart_values", data)["real_number"]


def truth() -> dict[str, float]:
    return dict(load_forced_oscillation(TWIN_FILE).true_parameters or {})


def test_strains_of_the_elements_add_up(twin: OscillationExperiment) -> None:
    """The dashpot's strain, by quadrature of its rate, is what the springs leave over."""
    parameters = truth()
    time = np.linspace(0.0, 1800.0, 6001)
    draw = solve(twin, parameters, time, solver=REFERENCE_SOLVER)
    sprung = draw["grid_stress"] / parameters["maxwell_modulus"] + draw["grid_kelvin_strain"]
    strain = twin.prepared.strain(time)
    for last in (1500, 3000, 6000):
        dashpot = simpson(draw["grid_dashpot_rate"][: last + 1], x=time[: last + 1])
        total = sprung[last] - sprung[0] + dashpot
        assert total == pytest.approx(strain[last] - strain[0], abs=1e-10)


def test_the_trend_that_is_removed_is_that_of_the_residuals() -> None:
    twin = with_background(load_forced_oscillation(TWIN_FILE), "removed")
    prepared = twin.prepared
    draw = solve(twin, truth(), prepared.time, solver=REFERENCE_SOLVER)
    position = (prepared.time - prepared.time.mean()) / np.ptp(prepared.time)
    weight = 1.0 / prepared.uncertainty
    trend = np.polyfit(
        position, draw["grid_stress"] - prepared.stress, prepared.stress_fit.degree, w=weight
    )
    expected = draw["grid_stress"] - np.polyval(trend, position)
    assert np.abs(np.polyval(trend, position)).max() > 1.0
    for name in ("response_model", "grid_oscillating_stress"):
        np.testing.assert_allclose(draw[name], expected, atol=1.0, rtol=0)
    for series in (prepared.stress, draw["response_replicated"]):
        left = np.polyfit(
            position, series - draw["response_model"], prepared.stress_fit.degree, w=weight
        )
        np.testing.assert_allclose(left, 0.0, atol=1.0)


def of_cycles(experiment: OscillationExperiment, n_cycles: int) -> OscillationExperiment:
    """The first cycles of a record, with a background that is removed and a linear trend."""
    record = experiment.record
    shorter = part_of(
        record,
        *(
            time <= time[0] + (n_cycles + 0.1) * PERIOD
            for time in (record.strain_time, record.stress_time)
        ),
    )
    uneven = 1 + 0.5 * (np.arange(shorter.stress.size) % 2)
    shorter = replace(shorter, stress_uncertainty=uneven * shorter.stress_uncertainty)
    return with_record(experiment, shorter, OscillationSettings(PERIOD, 1, 1, "removed"))


@pytest.mark.parametrize("n_cycles", [2, 6])
def test_the_likelihood_is_the_dense_one_with_the_trend_integrated_out(n_cycles: int) -> None:
    """The raw readings, with a covariance that holds any trend: no projection takes part."""
    test = with_background(load_forced_oscillation(TWIN_FILE), "removed")
    if n_cycles < 6:
        test = of_cycles(test, n_cycles)
    prepared = test.prepared
    position = 2 * (prepared.time - prepared.time[0]) / np.ptp(prepared.time) - 1
    trends = np.vander(position, prepared.stress_fit.degree + 1) * 1e10
    used = np.isin(test.record.stress_time, prepared.time)
    found, expected = [], []
    for noise, factor in ((4e6, 1.0), (3e6, 1.0), (4e6, 1.1), (6e6, 0.8)):
        values = truth() | {
            "stress_noise": noise,
            "kelvin_modulus": factor * truth()["kelvin_modulus"],
        }
        draw = solve(test, values, prepared.time, solver=REFERENCE_SOLVER)
        found.append(draw["log_lik"].sum())
        covariance = np.diag((noise * prepared.relative_uncertainty) ** 2) + trends @ trends.T
        expected.append(
            multivariate_normal.logpdf(
                test.record.stress[used], draw["grid_stress"], covariance, allow_singular=False
            )
        )
    # The flat prior leaves a constant open.
    np.testing.assert_allclose(np.diff(found), np.diff(expected), atol=1e-3, rtol=0)


def test_a_kept_background_leaves_the_stress_as_it_is() -> None:
    twin = with_background(load_forced_oscillation(TWIN_FILE), "kept")
    draw = solve(twin, truth(), twin.prepared.time, solver=REFERENCE_SOLVER)
    np.testing.assert_array_equal(draw["response_model"], draw["grid_stress"])
    np.testing.assert_array_equal(draw["grid_oscillating_stress"], draw["grid_stress"])


def with_strain_noise(experiment: OscillationExperiment, strain_sd: float) -> OscillationExperiment:
    """The test with another standard deviation of its strains, as stated."""
    spread = np.full_like(experiment.record.strain, strain_sd)
    return with_record(experiment, replace(experiment.record, strain_uncertainty=spread))


def test_errors_of_the_strain_change_what_drives_the_model(twin: OscillationExperiment) -> None:
    test = with_strain_noise(twin, 1e-4)
    prepared = test.prepared
    error = np.random.default_rng(2).standard_normal(test.n_driving_errors)
    data = program_data(
        one_test(test, given_parameters("olivine", truth())), solver=REFERENCE_SOLVER
    )
    found = load_program(likelihood_of(test).program).evaluate(data, {"coordinate": error.tolist()})
    sine, cosine, background = np.split(error @ prepared.strain_error, [3, 6])
    rate = prepared.background_rate + background
    # The start of the spin-up and the units of the states are those of the strain as fitted.
    by_hand = {
        **data,
        "strain_sine": [(prepared.strain_fit.sine + sine).tolist()],
        "strain_cosine": [(prepared.strain_fit.cosine + cosine).tolist()],
        "background": [(rate * PERIOD).tolist()[: data["n_background"]]],
        "error_end": [0, 0],
        "strain_error": [],
        "n_coordinates": 0,
        "unit": [],
    }
    expected = load_program(likelihood_of(test).program).evaluate(by_hand)
    size = np.abs(expected["response_model"]).max()
    np.testing.assert_allclose(
        found["response_model"], expected["response_model"], atol=1e-7 * size, rtol=0
    )
    assert found["log_pooling"] == pytest.approx(norm.logpdf(error).sum(), rel=1e-9)
    unchanged = solve(test, truth(), prepared.time, solver=REFERENCE_SOLVER)["response_model"]
    assert np.abs(found["response_model"] - unchanged).max() > 1e-3 * size


def test_without_background_more_spin_up_changes_nothing() -> None:
    twin = with_background(load_forced_oscillation(TWIN_FILE), "removed")
    assert spin_up_effect(twin, cycles=40).max() < 1e-4
    assert spin_up_effect(twin, cycles=40, name="grid_stress").max() < 0.01


def test_with_background_more_spin_up_changes_less_than_the_noise() -> None:
    """The bias creeps to where the dashpot carries the background, over tens of cycles."""
    twin = with_background(load_forced_oscillation(TWIN_FILE), "kept")
    change = spin_up_effect(twin, cycles=40)
    assert change.max() < 0.6
    assert np.sqrt(np.mean(change**2)) < 0.35


def spin_up_effect(
    twin: OscillationExperiment, *, cycles: int, name: str = "response_model"
) -> FloatArray:
    """Change of the stress by more cycles ahead of the record, in standard deviations."""
    one, other = (
        solve(replace(twin, spin_up_cycles=n), truth(), twin.prepared.time, solver=REFERENCE_SOLVER)
        for n in (twin.spin_up_cycles, cycles)
    )
    change: FloatArray = np.abs(one[name] - other[name]) / NOISE
    return change


def test_dashpot_compliance_is_log_linear_between_solutions_and_beyond(
    function_values: FunctionValues,
) -> None:
    solutions = [-27.0, -26.0, -25.8, -24.3]
    log_rate = [-1.0, 0.0, 0.2, 0.5, 0.9, 1.3, 2.0]
    found = function_values(
        "chart_values",
        {
            **CHARTS,
            "n_solutions": len(solutions),
            "log_dashpot_compliance": solutions,
            "n_rates": len(log_rate),
            "log_rate": log_rate,
        },
    )["dashpot_loss"]
    expected = [-29.0, -27.0, -26.6, -26.0, -25.84, -24.9, -22.8]
    np.testing.assert_allclose(np.log(found), expected, rtol=1e-12)


def test_kelvin_element_has_the_compliance_that_is_left(function_values: FunctionValues) -> None:
    kelvin = function_values("chart_values", CHARTS)["kelvin"]
    compliance = 1 / (kelvin[0] + 2j * np.pi / PERIOD * kelvin[1])
    assert compliance.real == pytest.approx(3.8e-11 - 1 / 203e9, rel=1e-3)
    assert -compliance.imag == pytest.approx(1.7e-11 - 1e-12, rel=1e-3)


def test_kelvin_element_keeps_a_tenth_where_nothing_is_left(
    function_values: FunctionValues,
) -> None:
    loss = []
    for dashpot in (1e-12, 1.3e-11, 1.7e-11, 3e-11, 6e-11):
        kelvin = function_values("chart_values", {**CHARTS, "dashpot": dashpot})["kelvin"]
        loss.append(-(1 / (kelvin[0] + 2j * np.pi / PERIOD * kelvin[1])).imag)
    assert np.all(np.diff(loss) < 0)
    np.testing.assert_allclose(loss[-2:], 0.1 * 1.7e-11, rtol=1e-3)


TWO_BOUNDS = np.array([0.0, 1.0, 3.0, 8.0])
ONE_BOUND = np.array([0.0, 2.0, 3.0, np.inf])


@pytest.mark.parametrize("quantity", [TWO_BOUNDS, ONE_BOUND], ids=["two bounds", "one bound"])
def test_a_left_over_value_is_taken_as_it_is_well_within_its_bounds(
    quantity: FloatArray, function_values: FunctionValues
) -> None:
    value = 3 + 5 * np.linspace(0.01, 0.7, 50)
    found = numbers_of(value, quantity, function_values)
    expected = np.log((value - 3) / (8 - value if np.isfinite(quantity[3]) else 2.0))
    np.testing.assert_allclose(found, expected, atol=2e-3)


def test_a_left_over_value_is_kept_within_its_bounds(function_values: FunctionValues) -> None:
    value = np.linspace(-2, 13, 150_001)
    two = numbers_of(value, TWO_BOUNDS, function_values)
    one = numbers_of(value, ONE_BOUND, function_values)
    np.testing.assert_allclose(two[[0, -1]], np.log([1e-3 / 2, 2 / 0.05]), atol=1e-2)
    assert one[0] == pytest.approx(np.log(1e-3), abs=1e-12)
    for found in (two, one):
        assert np.all(np.diff(found) >= 0)
        slope = np.gradient(found, value)
        seen = slope[slope > 1e-3 * slope.max()]
        assert np.abs(np.diff(np.log(seen))).max() < 0.06  # in a step of 1e-4: no kink
