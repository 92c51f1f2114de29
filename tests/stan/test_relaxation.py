"""Laws of the Kelvin part against direct numerical integration."""

from collections.abc import Mapping

import numpy as np
import pytest
from conftest import FunctionValues
from relaxation_oracle import band_oracle, compliance_oracle, creep_oracle, parts, peak_oracle
from stan_values import PHYSICS

from pyburgers.common.array_types import FloatArray
from pyburgers.model.arrhenius import log_slowdown
from pyburgers.model.closed_forms import closed_forms
from pyburgers.model.kelvin_elements import band_elements, peak_elements
from pyburgers.model.laws import KELVIN_LAWS
from pyburgers.model.parameters import PROGRAM_PARAMETERS

N_SETS = 200
BOUNDS = {
    "maxwell_modulus": (60e9, 70e9),
    "kelvin_modulus": (10e9, 100e9),
    "kelvin_viscosity": (1e8, 1e17),
    "kelvin_activation_enthalpy": (2e5, 5e5),
    "kelvin_reference_temperature": (1173.15, 1473.15),
    "kelvin_grain_size_exponent": (0.5, 3.0),
    "kelvin_reference_grain_size": (2e-6, 2e-5),
    "relaxation_time_decades": (0.01, 14.0),
    "relaxation_exponent": (0.02, 0.98),
    "peak_strength": (0.01, 1.0),
    "peak_time_decades": (0.0, 12.0),
    "peak_width": (0.1, 8.0),
    "andrade_exponent": (0.05, 0.95),
}
"""From which parameters are drawn; viscosities by their logarithm."""

OF_LAW: Mapping[str, tuple[str, ...]] = {
    law.name: law.parameters for law in KELVIN_LAWS.values() if not law.own_stress
}
THERMAL = ("kelvin_activation_enthalpy", "kelvin_reference_temperature")
GRAINS = ("kelvin_grain_size_exponent", "kelvin_reference_grain_size")


def random_sets(law: str, seed: int) -> list[dict[str, float]]:
    """Parameters of every name, those of other laws without effect."""
    rng = np.random.default_rng(seed)
    drawn = ("maxwell_modulus", "kelvin_modulus", *THERMAL, *GRAINS, *OF_LAW[law])
    sets = []
    for _ in range(N_SETS):
        values = {p.name: 1.0 if p.standard is None else p.standard for p in PROGRAM_PARAMETERS}
        values |= {name: float(rng.uniform(*BOUNDS[name])) for name in drawn}
        lower, upper = np.log(BOUNDS["kelvin_viscosity"])
        values["kelvin_viscosity"] = float(np.exp(rng.uniform(lower, upper)))
        sets.append(values)
    return sets


def longest_time(values: Mapping[str, float], temperature: float, grain_size: float) -> float:
    reference = values["kelvin_reference_temperature"]
    slower = log_slowdown(values["kelvin_activation_enthalpy"], temperature, reference)
    coarser = grain_size / values["kelvin_reference_grain_size"]
    time = values["kelvin_viscosity"] / values["kelvin_modulus"]
    return float(time * np.exp(slower) * coarser ** values["kelvin_grain_size_exponent"])


def conditions() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Temperatures (K), grain sizes (m), angular frequencies (rad/s) of the sets."""
    rng = np.random.default_rng(7)
    temperature = rng.uniform(1173.15, 1473.15, N_SETS)
    grain_size = np.exp(rng.uniform(np.log(2e-6), np.log(2e-5), N_SETS))
    return temperature, grain_size, 2 * np.pi / np.geomspace(1.0, 1000.0, N_SETS)


def relative_error(found: FloatArray, expected: FloatArray) -> FloatArray:
    """Of complex compliances given as storage and loss, shape (n, 2)."""
    return np.asarray(np.hypot(*(found - expected).T) / np.hypot(*expected.T))


@pytest.mark.parametrize("law", OF_LAW)
def test_compliance_is_that_of_direct_integration(
    law: str, function_values: FunctionValues
) -> None:
    sets = random_sets(law, seed=len(law))
    temperature, grain_size, omega = conditions()
    found = function_values(
        "physics_values",
        {
            **PHYSICS,
            "n_rows": N_SETS,
            "angular_frequency": omega.tolist(),
            "row_temperature": temperature.tolist(),
            "row_grain_size": grain_size.tolist(),
            "parameter": [list(values.values()) for values in sets],
        },
    )["compliance"]
    expected = np.array(
        [
            compliance_oracle(law, values, np.log(w * longest_time(values, kelvin, size)))
            for values, w, kelvin, size in zip(sets, omega, temperature, grain_size, strict=True)
        ]
    )
    assert relative_error(found, expected).max() < 1e-6


@pytest.mark.parametrize("since", [0.2, 15.0, 900.0])
@pytest.mark.parametrize("law", OF_LAW)
def test_sums_of_elements_answer_like_the_integrals_in_frequency_and_time(
    law: str, since: float
) -> None:
    sets, temperature = random_sets(law, 3), 1300.0
    grain_size = conditions()[1]
    drawn = {name: np.array([values[name] for values in sets]) for name in BOUNDS}
    asked = {"hold_time": since, "n_times": 1, "log_time": [0.0]}
    found = closed_forms(drawn, grain_size, temperature=temperature, asked=asked)
    tau = [longest_time(*one) for one in zip(sets, [temperature] * N_SETS, grain_size, strict=True)]
    np.testing.assert_allclose(found["longest_time"], tau, rtol=1e-8)
    log_since = np.log(since / np.array(tau))
    creep = [creep_oracle(law, *one) for one in zip(sets, log_since, strict=True)]
    np.testing.assert_allclose(found["kelvin_creep_of_hold"], creep, rtol=1e-6)
    if law == "andrade":
        return
    time, compliance = found["elements"].transpose(2, 0, 1)
    answer = (compliance / (1 + 1j * time / since)).sum(axis=-1)
    expected = [compliance_oracle(law, *one) for one in zip(sets, -log_since, strict=True)]
    assert relative_error(np.stack([answer.real, -answer.imag], 1), np.array(expected)).max() < 1e-6


@pytest.mark.parametrize("error", [1e-4, 1e-6])
@pytest.mark.parametrize("decades", [0.5, 3.0, 6.0, 12.0])
@pytest.mark.parametrize("exponent", [0.1, 0.33, 0.8])
def test_a_band_is_the_sum_of_as_many_elements_as_its_error_asks_for(
    error: float, decades: float, exponent: float
) -> None:
    width = decades * np.log(10)
    place, weight = band_elements(width, error)
    below = (1 - place) * width
    norm = exponent * width / -np.expm1(-exponent * width)
    log_x = np.linspace(-2.0, width + 2.0, 60)
    terms = norm * weight * np.exp(-exponent * below) * parts(log_x[:, np.newaxis] - below)
    expected = np.array([band_oracle(x, exponent, decades) for x in log_x])
    assert relative_error(terms.sum(axis=-1).T, expected).max() < error


@pytest.mark.parametrize("error", [1e-4, 1e-6])
@pytest.mark.parametrize("width", [0.2, 1.0, 4.0, 8.0])
def test_a_peak_is_the_sum_of_as_many_elements_as_its_error_asks_for(
    error: float, width: float
) -> None:
    place, share = peak_elements(width, error)
    log_x = np.linspace(-3 * width, 3 * width, 60)
    found = (share * parts(log_x[:, np.newaxis] + width * place)).sum(axis=-1).T
    expected = np.array([peak_oracle(x, width) for x in log_x])
    assert np.hypot(*(found - expected).T).max() < error  # the relaxed compliance is 1


def test_a_band_of_twelve_decades_takes_three_to_four_elements_a_decade() -> None:
    assert 36 <= band_elements(12 * np.log(10), 1e-4)[0].size <= 52


@pytest.mark.parametrize("law", ["extended", "extended_peak", "andrade"])
def test_the_density_of_times_adds_up_to_the_compliance(law: str) -> None:
    sets = random_sets(law, seed=3)[:20]
    for values in sets:  # a grid sees nothing narrower
        values["peak_width"] = max(values["peak_width"], 1.0)
        if law != "andrade":
            values["relaxation_time_decades"] = max(values["relaxation_time_decades"], 2.0)
        values["kelvin_viscosity"] = 1e12
    drawn = {name: np.array([one[name] for one in sets]) for name in BOUNDS}
    log_time = np.linspace(-90.0, 75.0, 16_501)
    asked = {
        "n_times": log_time.size,
        "log_time": log_time.tolist(),
        "n_frequencies": 1,
        "frequency": [0.3],
    }
    part = closed_forms(drawn, np.full(len(sets), 5e-6), temperature=1300.0, asked=asked)
    elements = part["time_density"] / (1 + 1j * np.exp(np.log(0.6 * np.pi) + log_time))
    found = np.trapezoid(elements, log_time, axis=-1)
    storage = part["storage_compliance"][:, 0] - 1 / drawn["maxwell_modulus"]
    expected = storage - 1j * part["kelvin_loss"][:, 0]
    assert np.abs(found - expected).max() < 2e-3 * np.abs(found).max()
