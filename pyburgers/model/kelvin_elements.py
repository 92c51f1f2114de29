"""Sums of Kelvin elements in place of the integrals over relaxation times: where and how many.

An element 1/(1 + i omega t) is analytic in ln(t) but for poles at the imaginary parts +-pi/2,
+-3 pi/2, ... . How far they are from the interval decides how fast a quadrature over it converges,
and so how many elements are as good as the integral, in frequency as in time.
"""

import math

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

_POLE = 0.5 * math.pi
"""Distance of an element's poles from the real axis of ln(t)."""

_ALIASING = 0.75
"""Step, in standard deviations, below which the trapezoid rule is exact for a normal density."""


def band_elements(log_width: float, error: float) -> tuple[FloatArray, FloatArray]:
    """Return elements that stand for a band of relaxation times.

    Parameters
    ----------
    log_width : float
        ln(longest/shortest relaxation time) of the widest band.
    error : float
        Of the complex compliance, relative to the relaxed one.

    Returns
    -------
    place : array, shape (n,)
        Of each element in the band: 0 at the shortest, 1 at the longest ln(t).
    weight : array, shape (n,)
        Of the density there, per unit of `place`.
    """
    distance = 2 * _POLE / max(log_width, 1.0)
    convergence = distance + math.hypot(1.0, distance)
    n_elements = math.ceil(0.5 * math.log(4 / error) / math.log(convergence)) + 2
    node, weight = np.polynomial.legendre.leggauss(n_elements)
    return 0.5 * (1 + node), 0.5 * weight


def peak_elements(width: float, error: float) -> tuple[FloatArray, FloatArray]:
    """Return elements that stand for a log-normal peak of relaxation times.

    Parameters
    ----------
    width : float
        Standard deviation of ln(t) of the widest peak; 0 is one element.
    error : float
        As for `band_elements`.

    Returns
    -------
    place : array, shape (n,)
        Of each element, in standard deviations of ln(t) from the middle of the peak.
    weight : array, shape (n,)
        Its share of the peak's relaxed compliance.
    """
    if width == 0:
        return np.zeros(1), np.ones(1)
    # The normal density is larger at the poles, by exp[(pole/width)^2/2].
    needed = math.log(4 / error) + 0.5 * (_POLE / width) ** 2
    step = min(_ALIASING, 2 * math.pi * _POLE / (width * needed))
    n_aside = math.ceil(math.sqrt(2 * math.log(1 / error)) / step) + 1
    place: FloatArray = step * np.arange(-n_aside, n_aside + 1.0)
    share: FloatArray = np.exp(-0.5 * place**2)
    return place, share / share.sum()
