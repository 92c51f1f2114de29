"""Parts of the valley coordinates: quantiles, bounded parameters, softening at the pins."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from conftest import FunctionValues
from scipy.special import expit, logit
from stan_values import CHARTS

from pyburgers.common.array_types import FloatArray

pytestmark = pytest.mark.usefixtures("programs")

PLACES = np.arange(-6.0, 7.0)
LOG_ODDS = np.linspace(-12, 12, 4801)
DENSITIES = {
    "one hump": -0.5 * ((PLACES - 1) / 1.5) ** 2,
    "two humps": np.logaddexp(-0.5 * (PLACES + 3) ** 2, -0.5 * (PLACES - 3) ** 2 - 1),
    "skewed": -np.logaddexp(0, 3 * PLACES) - 0.3 * np.abs(PLACES),
}


def valley_data(**given: Any) -> Mapping[str, Any]:
    data: dict[str, Any] = {
        **CHARTS,
        "log_odds": LOG_ODDS,
        "remainder": np.zeros(LOG_ODDS.size),
        **given,
    }
    data = {name: np.asarray(value).tolist() for name, value in data.items()}
    return {**data, "n": len(data["log_odds"])}


@pytest.mark.parametrize("name", DENSITIES)
def test_quantile_functions_are_those_of_the_density(
    name: str, function_values: FunctionValues
) -> None:
    values = function_values("chart_values", valley_data(log_density=DENSITIES[name]))
    fine = np.linspace(PLACES[0], PLACES[-1], 20001)
    density = np.exp(np.interp(fine, PLACES, DENSITIES[name]))
    # Beyond the outermost places lies as much as in a unit of places there.
    mass = density[0] + np.cumsum(density) * (fine[1] - fine[0])
    probability = mass / (mass[-1] + density[-1])
    inside = np.abs(values["quantile_place"]) < 5
    found = np.interp(values["quantile_place"][inside], fine, probability)
    # Bends are smoothed over half a unit of the log odds.
    np.testing.assert_allclose(logit(found), LOG_ODDS[inside], atol=0.7)


@pytest.mark.parametrize("name", DENSITIES)
def test_slopes_of_quantile_functions(name: str, function_values: FunctionValues) -> None:
    values = function_values("chart_values", valley_data(log_density=DENSITIES[name]))
    slope = np.exp(values["quantile_log_slope"])
    assert np.all(np.diff(values["quantile_place"]) > 0)
    difference = np.gradient(values["quantile_place"], LOG_ODDS)
    np.testing.assert_allclose(difference[1:-1], slope[1:-1], rtol=1e-3)


@pytest.mark.parametrize("place", [-0.8, 0.0, 0.03, 0.5, 0.99, 1.7])
def test_bounded_parameters_stay_near_what_the_data_ask_for(
    place: float, function_values: FunctionValues
) -> None:
    deviation = 0.02
    remainder = np.linspace(-3, 3, LOG_ODDS.size)
    values = function_values(
        "chart_values", valley_data(place=place, deviation=deviation, remainder=remainder)
    )
    u = values["bounded"]
    within = expit(u)
    middle = within[remainder.size // 2]
    assert abs(middle - np.clip(place, 0, 1)) < 1.5 * deviation
    if 0.2 < place < 0.8:
        np.testing.assert_allclose(within, place + deviation * remainder, atol=1e-6)
    slope = np.exp(values["bounded_log_slope"])
    np.testing.assert_allclose(np.gradient(u, remainder)[1:-1], slope[1:-1], rtol=1e-4)


def test_softening_at_the_pins_and_its_slopes(function_values: FunctionValues) -> None:
    data = valley_data()
    lower, upper = np.array(data["bounds"]).T
    strain, ratio = np.array(data["strain"]), np.exp(data["log_grain_size_ratio"])

    def softening(at: FloatArray) -> tuple[FloatArray, FloatArray]:
        grain_strain, fabric_strain = (lower + (upper - lower) * expit([*at[:2], 0.0]))[:2]
        size = ratio + (1 - ratio) * np.exp(-strain / grain_strain)
        fabric = 1 - at[2] * (1 - np.exp(-strain / fabric_strain))
        return data["exponent_ratio"] * np.log(size), np.log(fabric)

    at = np.array([*data["u"], data["fabric_amplitude"]])
    values = function_values("chart_values", data)
    grain, fabric = softening(at)
    np.testing.assert_allclose(values["grain"][:, 0], grain, rtol=1e-10)
    np.testing.assert_allclose(values["fabric"][:, 0], fabric, rtol=1e-10)
    for k, (name, column) in enumerate([("grain", 1), ("fabric", 1), ("fabric", 2)]):
        step = 1e-5 * np.eye(3)[k]
        part = 0 if name == "grain" else 1
        slope = (softening(at + step)[part] - softening(at - step)[part]) / 2e-5
        np.testing.assert_allclose(values[name][:, column], slope, rtol=1e-6)


def test_a_reference_stress_takes_as_long_as_the_curve(function_values: FunctionValues) -> None:
    data = valley_data()
    strength, time = np.array(data["strength"]), np.array(data["time_spent"])
    solved = function_values("chart_values", data)["stress_of_time"]
    taken = time @ np.exp(data["stress_exponent"] * (solved - strength))
    assert taken == pytest.approx(time.sum(), rel=1e-9)


@pytest.mark.parametrize("asked", [1.0, 0.1, 0.0, -1.0, -100.0])
def test_reference_stresses_follow_the_strain_of_the_flow_down_to_what_data_can_tell(
    asked: float, function_values: FunctionValues
) -> None:
    remainder = np.linspace(-2, 2, LOG_ODDS.size)
    data = valley_data(remainder=remainder, dashpot_rate=[asked] * 3)
    values = function_values("chart_values", data)
    stress, slope = values["stress_of_flow"], np.exp(values["stress_of_flow_log_slope"])
    np.testing.assert_allclose(np.gradient(stress, remainder)[1:-1], slope[1:-1], rtol=1e-4)
    n, (seen, width) = data["stress_exponent"], data["seen"]
    floor = 0.15 + np.log1p(np.exp(20 * (asked - 0.15))) / 20
    flow = floor * np.exp(-n * (stress - values["stress_of_time"]))
    if asked == 1.0:
        # A strain that data show: about as asked for, and as wide as they leave it.
        np.testing.assert_allclose(flow, 1 - seen * remainder, atol=1.1 * seen)
        np.testing.assert_allclose(np.gradient(flow, remainder), -seen, rtol=0.05)
    if asked < -0.5:
        # None: what the other parameters suggest, in the widths of its logarithm without data.
        expected = floor * np.exp(n * (values["stress_of_time"] - data["expected_stress"]))
        assert expected < seen
        np.testing.assert_allclose(
            np.log(flow[remainder > 0] / expected), -width * remainder[remainder > 0], atol=0.3
        )
    # In none of them a step of one is a large change of the strain and of its logarithm.
    change = np.gradient(np.log(flow), remainder)
    assert np.all(np.minimum(-change / width, -change * flow / seen) <= 1.0 + 1e-3)


def test_grain_sizes_are_stretched_where_they_do_all_the_softening(
    function_values: FunctionValues,
) -> None:
    data = valley_data()
    values = function_values("chart_values", data)
    u, slope = values["at_edge"], np.exp(values["at_edge_log_slope"])
    np.testing.assert_allclose(np.gradient(u, LOG_ODDS)[1:-1], slope[1:-1], rtol=1e-4)
    lower, upper = data["grain_size_prior"][2:]
    grain_size = lower + (upper - lower) * expit(u)
    softening = data["exponent_ratio"] * np.log(data["initial_grain_size"] / grain_size)
    share = softening / data["softening"]
    assert np.all(slope[(share > 0.9) & (share < 1.1)] < 0.5)
    assert np.all(slope > 0.25)
    assert slope.min() < 0.3
    np.testing.assert_allclose(u[share < 0.4], LOG_ODDS[share < 0.4], atol=0.02)
    # At the other end all is shifted, and nothing is stretched.
    np.testing.assert_allclose(slope[[0, -1]], 1.0, atol=0.01)


def test_grain_sizes_without_an_edge_keep_their_coordinate(
    function_values: FunctionValues,
) -> None:
    """With little p even the smallest grains do not soften as much as the curve does."""
    values = function_values("chart_values", valley_data(exponent_ratio=0.02))
    inside = np.abs(LOG_ODDS) < 6
    np.testing.assert_allclose(values["at_edge"][inside], LOG_ODDS[inside], atol=1e-6)


def test_the_rate_that_others_leave_to_the_first_mechanism_makes_up_the_whole(
    function_values: FunctionValues,
) -> None:
    values = function_values("chart_values", valley_data())
    np.testing.assert_allclose(values["whole_again"], 1.0, rtol=1e-6)
