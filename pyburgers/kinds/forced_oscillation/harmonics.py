"""Least squares of a time series on a sinusoid, its harmonics and a polynomial trend.

value(t) = sum_j a_j P_j(x) + sum_k [s_k sin(k w t) + c_k cos(k w t)], with Legendre polynomials
P_j, x from -1 to 1 over the series, and w = 2 pi / period. Harmonics of a nonlinear record do not
average out over a few cycles: they would end up in the fundamental and in the trend.
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre
from scipy import fft, optimize, signal

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError

N_HARMONICS = 3
"""Fundamental, second and third harmonic."""

MAX_DEGREE = 6
"""Largest degree that `choose_degree` tries: beyond it a trend over a few cycles can follow the
oscillation itself."""

CUBIC = 3
"""Degree of the trend that is subtracted before the periodogram is taken."""

TRIALS_PER_PEAK = 10
"""Trial frequencies per inverse length of the series, which is the width of a peak."""

BINS_PER_CYCLE, MAX_BINS = 8, 4_000_000
"""Bins of time in a cycle of the highest frequency of a rough periodogram, and how many at most."""


@dataclass(frozen=True, eq=False)
class HarmonicFit:
    """A fitted time series; unit U is that of the series.

    `period`: seconds.
    `n_harmonics`, `degree`: harmonics, the fundamental included, and degree of the trend.
    `t_middle`, `t_half`: middle and half length (s) of the series: x = (t - t_middle)/t_half.
    `coefficients` (n_coefficients,): Legendre coefficients, amplitudes of sines, of cosines (U).
    `covariance` (n_coefficients, n_coefficients): of the coefficients (U^2).
    `chi_square`: sum of squared residuals over variances; degrees of freedom if none are given.
    """

    period: float
    n_harmonics: int
    degree: int
    t_middle: float
    t_half: float
    coefficients: FloatArray
    covariance: FloatArray
    chi_square: float
    n_points: int

    @property
    def angular_frequency(self) -> float:
        """2 pi / period (rad/s)."""
        return 2.0 * math.pi / self.period

    @property
    def sine(self) -> FloatArray:
        """Amplitudes of the sines (U), shape (n_harmonics,)."""
        return self.coefficients[self.degree + 1 :][: self.n_harmonics]

    @property
    def cosine(self) -> FloatArray:
        """Amplitudes of the cosines (U), shape (n_harmonics,)."""
        return self.coefficients[self.degree + 1 + self.n_harmonics :]

    def periodic(self, time: FloatArray) -> FloatArray:
        """Oscillating part (U) at times (s), shape (n,)."""
        angles = _angles(time, self.period, self.n_harmonics)
        return np.asarray(np.sin(angles) @ self.sine + np.cos(angles) @ self.cosine)

    def periodic_rate(self, time: FloatArray) -> FloatArray:
        """Time derivative (U/s) of the oscillating part, shape (n,)."""
        angles = _angles(time, self.period, self.n_harmonics)
        factors = self.angular_frequency * np.arange(1, self.n_harmonics + 1)
        sine, cosine = factors * self.sine, factors * self.cosine
        return np.asarray(np.cos(angles) @ sine - np.sin(angles) @ cosine)

    def trend(self, time: FloatArray) -> FloatArray:
        """Polynomial part (U), its constant included, shape (n,)."""
        return np.asarray(legendre.legval(self._scaled(time), self.trend_coefficients))

    def trend_shape(self, time: FloatArray) -> FloatArray:
        """Legendre polynomials of the trend at times (s), shape (n, degree + 1)."""
        return np.asarray(legendre.legvander(self._scaled(time), self.degree), dtype=np.float64)

    def trend_rate(self, time: FloatArray) -> FloatArray:
        """Time derivative (U/s) of the polynomial part, shape (n,)."""
        slope = legendre.legder(self.trend_coefficients)
        rate = np.asarray(legendre.legval(self._scaled(time), slope), dtype=np.float64)
        return rate / self.t_half

    def amplitude(self) -> tuple[float, float]:
        """Amplitude (U) of the fundamental, and its standard error."""
        sine, cosine = self.sine[0], self.cosine[0]
        size = math.hypot(sine, cosine)
        return size, self._standard_error(sine / size, cosine / size)

    def phase(self) -> tuple[float, float]:
        """Phase (rad, in (-pi, pi]) of the fundamental, sin(w t + phase), and its error."""
        sine, cosine = self.sine[0], self.cosine[0]
        square = sine**2 + cosine**2
        error = self._standard_error(-cosine / square, sine / square)
        return math.atan2(cosine, sine), error

    @property
    def trend_coefficients(self) -> FloatArray:
        """Legendre coefficients of the trend (U), shape (degree + 1,)."""
        return self.coefficients[: self.degree + 1]

    def _scaled(self, time: FloatArray) -> FloatArray:
        return (time - self.t_middle) / self.t_half

    def _standard_error(self, of_sine: float, of_cosine: float) -> float:
        """Propagate the covariance through derivatives by sine and cosine of the fundamental."""
        indices = [self.degree + 1, self.degree + 1 + self.n_harmonics]
        gradient = np.array([of_sine, of_cosine])
        return math.sqrt(gradient @ self.covariance[np.ix_(indices, indices)] @ gradient)


def fit_harmonics(
    time: FloatArray,
    value: FloatArray,
    *,
    period: float,
    degree: int,
    n_harmonics: int = N_HARMONICS,
    uncertainty: FloatArray | None = None,
) -> HarmonicFit:
    """Fit harmonics and a polynomial to a series (n,), unit U, at times (s) by least squares.

    Standard deviations in `uncertainty` (n,) are absolute; without them the covariance follows from
    the residuals.
    """
    weight = np.ones_like(value) if uncertainty is None else 1.0 / uncertainty
    design, solver = _least_squares(time, weight, period, degree, n_harmonics)
    coefficients = solver @ value
    residual = value - design @ coefficients
    freedom = time.size - coefficients.size
    scale = residual @ residual / freedom if uncertainty is None else 1.0
    t_middle, t_half = _span(time)
    return HarmonicFit(
        period=period,
        n_harmonics=n_harmonics,
        degree=degree,
        t_middle=t_middle,
        t_half=t_half,
        coefficients=coefficients,
        covariance=scale * (solver / weight**2) @ solver.T,
        chi_square=float(freedom if uncertainty is None else np.sum((residual * weight) ** 2)),
        n_points=time.size,
    )


def fundamentals(
    time: FloatArray,
    series: FloatArray,
    *,
    period: float,
    degree: int,
    uncertainty: FloatArray | None = None,
) -> npt.NDArray[np.complex128]:
    """Return sine plus i times cosine of the fundamental of many series (..., n), shape (...)."""
    weight = np.ones_like(time) if uncertainty is None else 1.0 / uncertainty
    _, solver = _least_squares(time, weight, period, degree, N_HARMONICS)
    sine, cosine = solver[degree + 1], solver[degree + 1 + N_HARMONICS]
    return np.asarray(series @ (sine + 1j * cosine))


def trend_projection(
    time: FloatArray, *, degree: int, uncertainty: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return Legendre polynomials (n, degree + 1), and the fit (degree + 1, n) of a series by them.

    ``shape @ (fit @ series)`` is the trend. The rest over the uncertainties has the density of the
    series with its trend integrated out under a flat prior, unlike that of `fit_harmonics`.
    """
    t_middle, t_half = _span(time)
    shape = np.asarray(legendre.legvander((time - t_middle) / t_half, degree), dtype=np.float64)
    fit: FloatArray = np.linalg.pinv(shape / uncertainty[:, None]) / uncertainty
    return shape, fit


def _span(time: FloatArray) -> tuple[float, float]:
    """Middle and half length (s) of a series."""
    return float(0.5 * (time[0] + time[-1])), float(0.5 * (time[-1] - time[0]))


def _least_squares(
    time: FloatArray, weight: FloatArray, period: float, degree: int, n_harmonics: int
) -> tuple[FloatArray, FloatArray]:
    """Return the design (n, n_coefficients), and what turns a series into coefficients."""
    t_middle, t_half = _span(time)
    angles = _angles(time, period, n_harmonics)
    design: FloatArray = np.hstack(
        [legendre.legvander((time - t_middle) / t_half, degree), np.sin(angles), np.cos(angles)]
    )
    n_readings, n_coefficients = design.shape
    if n_readings <= n_coefficients:
        raise InputError(
            f"found {n_readings} readings, expected more than {n_coefficients}, the coefficients "
            f"of {n_harmonics} harmonics and a trend of degree {degree}."
        )
    left, singular, right = np.linalg.svd(design * weight[:, None], full_matrices=False)
    if singular[-1] < 1e-10 * singular[0]:
        raise InputError(
            f"the readings do not tell {n_harmonics} harmonics of the period {period:g} s and a "
            f"trend of degree {degree} apart, expected denser or longer sampling."
        )
    solver: FloatArray = (right.T / singular) @ left.T * weight
    return design, solver


def choose_degree(
    time: FloatArray, value: FloatArray, *, period: float, uncertainty: FloatArray
) -> int:
    """Choose the degree of the trend, up to `MAX_DEGREE`, by the Bayesian information criterion."""
    # Below twice the number of cycles: a trend that turns as often could be the oscillation.
    cycles = (time[-1] - time[0]) / period
    spare = time.size - 2 - 2 * N_HARMONICS
    largest = max(0, min(MAX_DEGREE, int(2.0 * cycles) - 1, spare))

    def criterion(degree: int) -> float:
        fit = fit_harmonics(time, value, period=period, degree=degree, uncertainty=uncertainty)
        return fit.chi_square + fit.coefficients.size * math.log(time.size)

    return min(range(largest + 1), key=criterion)


def strongest_frequency(
    time: FloatArray, value: FloatArray, lowest: float, highest: float
) -> tuple[float, float]:
    """Return the frequency (Hz) of the highest peak of the periodogram, and its share of variance.

    Both ends in Hz; `value` is without its trend. Only frequencies near a rough peak are tried: all
    of them would take time and memory in proportion to readings times cycles.
    """
    spacing = 1.0 / (TRIALS_PER_PEAK * float(time[-1] - time[0]))
    trials = np.arange(lowest, highest, spacing)
    rough = _rough_frequency(time, value, lowest, highest)
    trials = trials[np.abs(trials - rough) <= TRIALS_PER_PEAK * spacing]
    power = signal.lombscargle(time, value, 2.0 * math.pi * trials, normalize=True)
    peak = int(np.argmax(power))
    return float(trials[peak]), float(power[peak])


def _rough_frequency(time: FloatArray, value: FloatArray, lowest: float, highest: float) -> float:
    """Return the frequency (Hz) of the highest peak of a series that is added up in equal bins."""
    length = float(time[-1] - time[0])
    n_bins = min(math.ceil(BINS_PER_CYCLE * highest * length), MAX_BINS)
    place = ((time - time[0]) * (n_bins / length)).astype(np.int64)
    # Zeros behind the series halve the spacing of frequencies.
    size = fft.next_fast_len(2 * n_bins, real=True)
    power = np.abs(fft.rfft(np.bincount(place, value), size))
    frequency = fft.rfftfreq(size, length / n_bins)
    inside = np.flatnonzero((frequency >= lowest) & (frequency <= highest))
    return float(frequency[inside[np.argmax(power[inside])]])


def estimate_period(time: FloatArray, value: FloatArray, *, uncertainty: FloatArray) -> float:
    """Estimate the period (s): least squares from the highest peak of the periodogram on."""
    length = float(time[-1] - time[0])
    if time.size <= CUBIC:
        raise InputError(
            f"found {time.size} readings, expected several in each of some cycles to estimate the "
            "period from."
        )
    cubic = legendre.Legendre.fit(time, value, CUBIC)
    highest = 0.5 / float(np.median(np.diff(np.unique(time))))
    frequency, _ = strongest_frequency(time, value - cubic(time), 1.0 / length, highest)
    degree = CUBIC
    # The degree can only be judged well near the right period, hence the second round.
    for _ in range(2):
        frequency = _refine(time, value, frequency, degree, uncertainty)
        degree = choose_degree(time, value, period=1.0 / frequency, uncertainty=uncertainty)
    return 1.0 / _refine(time, value, frequency, degree, uncertainty)


def _refine(
    time: FloatArray, value: FloatArray, frequency: float, degree: int, uncertainty: FloatArray
) -> float:
    """Least-squares frequency (Hz) within the peak of the periodogram around a first guess."""
    half_width = 0.5 / float(time[-1] - time[0])

    def misfit(trial: float) -> float:
        return fit_harmonics(
            time, value, period=1.0 / trial, degree=degree, uncertainty=uncertainty
        ).chi_square

    found = optimize.minimize_scalar(
        misfit,
        bounds=(max(frequency - half_width, 0.5 * frequency), frequency + half_width),
        method="bounded",
        options={"xatol": 1e-7 * frequency},
    )
    return float(found.x)


def _angles(time: FloatArray, period: float, n_harmonics: int) -> FloatArray:
    """Phase angles k w t, shape (n, n_harmonics)."""
    multiples = np.arange(1, n_harmonics + 1)
    return np.asarray(2.0 * math.pi / period * np.asarray(time)[:, None] * multiples)
