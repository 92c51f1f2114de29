"""Laws of the Kelvin part by direct numerical integration: compliance and creep.

Laws are named as in `pyburgers.model.laws.KELVIN_LAWS`.
"""

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt
from scipy.special import gamma

FloatArray = npt.NDArray[np.float64]


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
    if law == "linear":
        element = 1 / (1 + 1j * np.exp(log_x))
        return unit * np.array([element.real, -element.imag])
    if law == "two_elements":
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
    if law == "extended":
        return found
    peak = peak_oracle(log_x - np.log(10) * values["peak_time_decades"], values["peak_width"])
    return found + values["peak_strength"] / values["maxwell_modulus"] * peak


def creep_oracle(law: str, values: Mapping[str, float], log_t: float) -> float:
    """Strain over stress (1/Pa) at the logarithm of the time over the longest relaxation time."""
    unit = 1 / values["kelvin_modulus"]
    if law == "linear":
        return float(-unit * np.expm1(-np.exp(log_t)))
    if law == "two_elements":
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
    if law == "extended":
        return float(unit * found)
    scale, spread = min(values["peak_width"], 1.0), values["peak_width"]
    since = log_t + np.log(10) * values["peak_time_decades"]
    peak = integral(
        lambda v: -np.exp(-0.5 * (v * scale / spread) ** 2) * np.expm1(-np.exp(since - v * scale)),
        (-12 * spread / scale, 12 * spread / scale),
    )
    peak = peak * scale / (spread * np.sqrt(2 * np.pi))
    return float(unit * found + values["peak_strength"] / values["maxwell_modulus"] * peak)
