"""Laws of the Kelvin part against direct numerical integration."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from scipy.special import gamma

from pyburgers.cmdstan.program import load_program
from pyburgers.model.parameters import PROGRAM_PARAMETERS

FloatArray = npt.NDArray[np.float64]

PROGRAM = Path(__file__).with_name("relaxation_values.stan")

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


@pytest.mark.parametrize("law", OF_LAW)
def test_compliance_is_that_of_direct_integration(law: str) -> None:
    sets = random_sets(law, seed=len(law))
    rng = np.random.default_rng(7)
    temperature = rng.uniform(1173.15, 1473.15, N_SETS)
    grain_size = np.exp(rng.uniform(np.log(2e-6), np.log(2e-5), N_SETS))
    frequency = 2 * np.pi / np.geomspace(1.0, 1000.0, N_SETS)
    found = load_program(PROGRAM).evaluate(
        {
            "n": N_SETS,
            "angular_frequency": frequency.tolist(),
            "temperature": temperature.tolist(),
            "grain_size": grain_size.tolist(),
            "parameter": [list(values.values()) for values in sets],
        },
    )["compliance"]
    expected = np.array(
        [
            compliance_oracle(law, values, np.log(omega * longest_time(values, kelvin, size)))
            for values, omega, kelvin, size in zip(
                sets, frequency, temperature, grain_size, strict=True
            )
        ]
    )
    error = np.hypot(*(found - expected).T) / np.hypot(*expected.T)
    assert error.max() < 1e-6
