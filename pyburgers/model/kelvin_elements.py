"""Sums of Kelvin elements in place of the integrals over relaxation times: where and how many.

An element 1/(1 + i omega t) is analytic in ln(t) but for poles at the imaginary parts +-pi/2,
+-3 pi/2, ... . How far they are from the interval decides how fast a quadrature over it converges,
and so how many elements are as good as the integral, in frequency as in time.
"""

import math
from collections.abc import Mapping

import numpy as np

from pyburgers.common.array_types import FloatArray
from pyburgers.model.laws import RELAXATION_TIMES
from pyburgers.model.parameters import PLACE

_POLE = 0.5 * math.pi
"""Distance of an element's poles from the real axis of ln(t)."""

_ALIASING = 0.75
"""Step, in standard deviations, below which the trapezoid rule is exact for a normal density."""

ANDRADE_MARGIN = math.log(30.0)
"""ln of how far elements of Andrade creep go beyond the times that count.

All faster and all slower ones are right to second order in shortest/time and time/longest, so that
what is left is below 1e-4 of the creep and of the compliance, for any exponent."""


_ONLY, _FASTER, _SLOWER = 0.0, -1.0, -2.0
"""Parts of a law that no parameter switches on, as in `stan/physics/relaxation.stan`."""


def element_rows(
    largest: Mapping[str, float], error: float, log_times: tuple[float, float] | None = None
) -> list[list[float]]:
    """Return the elements for the programs: part of the law, place in it, weight.

    `largest` has the largest values of switches and widths (SI) that count. Elements of endless
    times are given if `log_times` says which times count, ln(s). `error` is that of
    `band_elements`.
    """
    longest, beside = [[_ONLY, 0.0, 1.0]], []
    for times in RELAXATION_TIMES:
        if largest[times.switch] == 0:
            continue
        part = float(PLACE[times.switch])
        if times.spread == "band":
            longest = _rows(part, *band_elements(largest[times.width] * math.log(10), error))
        elif times.spread == "peak":
            beside += _rows(part, *peak_elements(largest[times.width], error))
        elif times.spread == "one":
            beside.append([part, 0.0, 1.0])
        elif log_times is not None:
            longest = _rows(part, *andrade_elements(*log_times, error))
            longest[0][0], longest[-1][0] = _FASTER, _SLOWER
    return longest + beside


def _rows(part: float, places: FloatArray, weights: FloatArray) -> list[list[float]]:
    return [[part, *row] for row in zip(places.tolist(), weights.tolist(), strict=True)]


def band_elements(log_width: float, error: float) -> tuple[FloatArray, FloatArray]:
    """Return elements that stand for a band of relaxation times: `place` and `weight`, shapes (n,).

    `log_width` is ln(longest/shortest relaxation time) of the widest band. `error` is that of the
    complex compliance, relative to the relaxed one. `place` is 0 at the shortest and 1 at the
    longest ln(t); `weight` is the density there, per unit of `place`.
    """
    distance = 2 * _POLE / max(log_width, 1.0)
    convergence = distance + math.hypot(1.0, distance)
    n_elements = math.ceil(0.5 * math.log(4 / error) / math.log(convergence)) + 2
    node, weight = np.polynomial.legendre.leggauss(n_elements)
    return 0.5 * (1 + node), 0.5 * weight


def peak_elements(width: float, error: float) -> tuple[FloatArray, FloatArray]:
    """Return elements that stand for a log-normal peak: `place` and `weight`, shapes (n,).

    `width` is the standard deviation of ln(t) of the widest peak; 0 is one element. `error` is that
    of `band_elements`. `place` is in standard deviations of ln(t) from the middle of the peak.
    `weight` is the share of the peak's relaxed compliance.
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


def andrade_elements(
    log_shortest: float, log_longest: float, error: float
) -> tuple[FloatArray, FloatArray]:
    """Return elements that stand for the relaxation times of Andrade creep that a test tells apart.

    Creep counts between times (s) with the logarithms `log_shortest` and `log_longest`. Times go on
    beyond both ends (`stan/kinds/loading_history_rates.stan`). `error` is that of
    `band_elements`, relative to the creep. Return ln(t/s), increasing from the one end to the
    other, and the weights of the density over ln(t) there, 0 at the ends. Both have shape (n,).
    """
    start, end = log_shortest - ANDRADE_MARGIN, log_longest + ANDRADE_MARGIN
    place, weight = band_elements(end - start, error)
    inner = start + (end - start) * place
    return (
        np.concatenate([[start], inner, [end]]),
        np.concatenate([[0.0], (end - start) * weight, [0.0]]),
    )
