"""Laws of the Kelvin part by direct numerical integration: compliance and creep.

Laws are named as in `pyburgers.model.laws.KELVIN_LAWS`. An answer of one element is a function of
the logarithm of its relaxation time, times omega or over the time since loading.
"""

from collections.abc import Callable, Mapping

import numpy as np
from scipy.special import gamma

from pyburgers.common.array_types import FloatArray

Answer = Callable[[FloatArray], FloatArray]


def integral(density: Answer, ends: tuple[float, float]) -> FloatArray:
    """Integral over ln(t) of an answer, by 20 Gauss nodes in panels of at most a half."""
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


def creep_of_element(x: FloatArray) -> FloatArray:
    """Creep of one element at the logarithm of its relaxation time over the time since loading."""
    return -np.expm1(-np.exp(-x))


def band_oracle(
    log_x: float, exponent: float, decades: float, answer: Answer = parts
) -> FloatArray:
    width = decades * np.log(10)
    norm = exponent / -np.expm1(-exponent * width)
    found = integral(lambda u: np.exp(exponent * u) * answer(log_x + u), (-width, 0.0))
    return np.asarray(norm * found)


def peak_oracle(log_x: float, width: float, answer: Answer = parts) -> FloatArray:
    reach = 12 * width
    norm = 1 / (width * np.sqrt(2 * np.pi))
    # As fine in units of a narrow peak as in those of the relaxation itself.
    scale = min(width, 1.0)
    found = integral(
        lambda v: np.exp(-0.5 * (v * scale / width) ** 2) * answer(log_x + v * scale),
        (-reach / scale, reach / scale),
    )
    return np.asarray(norm * scale * found)


def compliance_oracle(law: str, values: Mapping[str, float], log_x: float) -> FloatArray:
    """Storage and loss (1/Pa) at the logarithm of omega times the longest relaxation time."""
    if law == "andrade":
        exponent = values["andrade_exponent"]
        creep = gamma(1 + exponent) * (1j * np.exp(log_x)) ** -exponent
        return np.array([creep.real, -creep.imag]) / values["kelvin_modulus"]
    return _of_elements(law, values, log_x, parts)


def creep_oracle(law: str, values: Mapping[str, float], log_t: float) -> float:
    """Strain over stress (1/Pa) at the logarithm of the time over the longest relaxation time."""
    if law == "andrade":
        return float(np.exp(values["andrade_exponent"] * log_t) / values["kelvin_modulus"])
    return float(_of_elements(law, values, -log_t, creep_of_element))


def _of_elements(law: str, values: Mapping[str, float], log_x: float, answer: Answer) -> FloatArray:
    """Answer of a law whose elements have an answer."""
    if law in ("linear", "two_elements"):
        found = answer(np.array(log_x))
    else:
        band = values["relaxation_exponent"], values["relaxation_time_decades"]
        found = band_oracle(log_x, *band, answer)
    found = found / values["kelvin_modulus"]
    if law in ("linear", "extended"):
        return found
    of_peak = log_x - np.log(10) * values["peak_time_decades"]
    peak = (
        answer(np.array(of_peak))
        if law == "two_elements"
        else peak_oracle(of_peak, values["peak_width"], answer)
    )
    return found + values["peak_strength"] / values["maxwell_modulus"] * peak
