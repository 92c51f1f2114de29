"""Laws of the Kelvin part against direct numerical integration."""

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt
import pytest
from conftest import FunctionValues
from scipy.special import gamma
from stan_values import PHYSICS

from pyburgers.model.kelvin_elements import band_elements, peak_elements
from pyburgers.model.parameters import PROGRAM_PARAMETERS
from pyburgers.model.relaxation import kelvin_part

FloatArray = npt.NDArray[np.float64]

N_SETS = 200
GAS_CONSTANT = 8.31446261815324
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
    "one element": (),
    "two elements": ("peak_strength", "peak_time_decades"),
    "band": ("relaxation_time_decades", "relaxation_exponent"),
    "band and peak": (
        "relaxation_time_decades",
        "relaxation_exponent",
        "peak_strength",
        "peak_time_decades",
        "peak_width",
    ),
    "andrade": ("andrade_exponent",),
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
    slower = values["kelvin_activation_enthalpy"] / GAS_CONSTANT
    slower *= 1 / temperature - 1 / values["kelvin_reference_temperature"]
    coarser = grain_size / values["kelvin_reference_grain_size"]
    time = values["kelvin_viscosity"] / values["kelvin_modulus"]
    return float(time * np.exp(slower) * coarser ** values["kelvin_grain_size_exponent"])


def integral(density: Callable[[FloatArray], FloatArray], ends: tuple[float, float]) -> FloatArray:
    """Integral over ln(t) of storage and loss, by 20 Gauss nodes in panels of at most a half."""
    n_panels = int(np.ceil(2 * (ends[1] - ends[0])))
    edges = np.linspace(*ends, n_panels + 1)
    node, weight = np.polynomial.legendre.leggauss(20)
    half = 0.5 * np.diff(edges)[:, np.newaxis]
    where = edges[:-1, np.newaxis] + half * (1 + node)
    found: FloatArray = (density(where) * half * weight).sum(axis=(-2, -1))
    return found


def parts(x: FloatArray) -> FloatArray:
    """Storage and loss of one element at the logarithm of omega t."""
    return np.stack([0.5 * (1 - np.tanh(x)), 0.5 / np.cosh(x)])


def band_oracle(log_x: float, exponent: float, decades: float) -> FloatArray:
    width = decades * np.log(10)
    norm = exponent / -np.expm1(-exponent * width)
    found = integral(lambda u: np.exp(exponent * u) * parts(log_x + u), (-width, 0.0))
    return np.asarray(norm * found)


def peak_oracle(log_x: float, width: float) -> FloatArray:
    reach = 12 * width
    norm = 1 / (width * np.sqrt(2 * np.pi))
    # As fine in units of a narrow peak as in those of the relaxation itself.
    scale = min(width, 1.0)
    found = integral(
        lambda v: np.exp(-0.5 * (v * scale / width) ** 2) * parts(log_x + v * scale),
        (-reach / scale, reach / scale),
    )
    return np.asarray(norm * scale * found)


def compliance_oracle(law: str, values: Mapping[str, float], log_x: float) -> FloatArray:
    unit = 1 / values["kelvin_modulus"]
    if law == "one element":
        element = 1 / (1 + 1j * np.exp(log_x))
        return unit * np.array([element.real, -element.imag])
    if law == "two elements":
        shift = np.log(10) * values["peak_time_decades"]
        second = values["peak_strength"] / values["maxwell_modulus"]
        two = unit * parts(np.array(log_x)) + second * parts(np.array(log_x - shift))
        return np.asarray(two)
    if law == "andrade":
        exponent = values["andrade_exponent"]
        creep = gamma(1 + exponent) * (1j * np.exp(log_x)) ** -exponent
        return unit * np.array([creep.real, -creep.imag])
    found = unit * band_oracle(
        log_x, values["relaxation_exponent"], values["relaxation_time_decades"]
    )
    if law == "band":
        return found
    peak = peak_oracle(log_x - np.log(10) * values["peak_time_decades"], values["peak_width"])
    return found + values["peak_strength"] / values["maxwell_modulus"] * peak


def creep_oracle(law: str, values: Mapping[str, float], log_t: float) -> float:
    """Strain over stress (1/Pa) at the logarithm of the time over the longest relaxation time."""
    unit = 1 / values["kelvin_modulus"]
    if law == "one element":
        return float(-unit * np.expm1(-np.exp(log_t)))
    if law == "two elements":
        since = log_t + np.log(10) * values["peak_time_decades"]
        second = values["peak_strength"] / values["maxwell_modulus"]
        return float(-unit * np.expm1(-np.exp(log_t)) - second * np.expm1(-np.exp(since)))
    if law == "andrade":
        return float(unit * np.exp(values["andrade_exponent"] * log_t))
    exponent = values["relaxation_exponent"]
    width = values["relaxation_time_decades"] * np.log(10)
    norm = exponent / -np.expm1(-exponent * width)
    found = integral(
        lambda u: -norm * np.exp(exponent * u) * np.expm1(-np.exp(log_t - u)), (-width, 0.0)
    )
    if law == "band":
        return float(unit * found)
    scale, spread = min(values["peak_width"], 1.0), values["peak_width"]
    since = log_t + np.log(10) * values["peak_time_decades"]
    peak = integral(
        lambda v: -np.exp(-0.5 * (v * scale / spread) ** 2) * np.expm1(-np.exp(since - v * scale)),
        (-12 * spread / scale, 12 * spread / scale),
    )
    peak = peak * scale / (spread * np.sqrt(2 * np.pi))
    return float(unit * found + values["peak_strength"] / values["maxwell_modulus"] * peak)


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


@pytest.mark.parametrize("law", OF_LAW)
def test_sums_of_elements_answer_like_the_integrals_in_frequency_and_time(law: str) -> None:
    compliance, expected, creep, expected_creep = [], [], [], []
    for values, kelvin, size, omega in zip(random_sets(law, 3), *conditions(), strict=True):
        tau = longest_time(values, kelvin, size)
        part = kelvin_part(values, kelvin, np.array(size))
        compliance.append(np.concatenate(part.compliance(np.array([omega]))))
        expected.append(compliance_oracle(law, values, np.log(omega * tau)))
        creep.append(part.creep(1 / omega))
        expected_creep.append(creep_oracle(law, values, -np.log(omega * tau)))
    assert relative_error(np.array(compliance), np.array(expected)).max() < 1e-6
    np.testing.assert_allclose(creep, expected_creep, rtol=1e-6)


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


@pytest.mark.parametrize("law", ["band", "band and peak", "andrade"])
def test_the_spectrum_of_times_adds_up_to_the_compliance(law: str) -> None:
    sets = random_sets(law, seed=3)[:20]
    for values in sets:
        values["peak_width"] = max(values["peak_width"], 1.0)  # a grid sees no narrower peak
    drawn = {name: np.array([one[name] for one in sets]) for name in BOUNDS}
    part = kelvin_part(drawn, 1300.0, np.full(len(sets), 5e-6))
    log_time = np.log(part.longest_time)[:, np.newaxis] + np.linspace(-90.0, 60.0, 60_001)
    elements = [
        (part.spectrum(grid)[k] / (1 + 1j * np.exp(np.log(0.3) + grid)))
        for k, grid in enumerate(log_time)
    ]
    found = np.trapezoid(np.array(elements), log_time, axis=-1)
    storage, loss = part.compliance(np.array([0.3]))
    assert np.abs(found - (storage - 1j * loss)[:, 0]).max() < 2e-3 * np.abs(found).max()
