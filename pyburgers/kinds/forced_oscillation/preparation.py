"""Raw record of a forced oscillation -> what drives the model and what it is compared with.

The paper's Methods: a sinusoid and a polynomial trend are fitted to the strain, the polynomial is
subtracted, and the derivative of the sinusoid drives the model, whose stress is compared with the
measured one. Here the sinusoid has its second and third harmonics.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.polynomial import legendre, polynomial

from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.common.errors import InputError
from pyburgers.common.units import count_points, counted, rounded_to
from pyburgers.kinds.forced_oscillation.harmonics import (
    HarmonicFit,
    choose_degree,
    estimate_period,
    fit_harmonics,
    strongest_frequency,
)
from pyburgers.kinds.loading_history.driver import ARE_USED, MAX_READINGS
from pyburgers.kinds.odd_readings import order_text, repeated

Background = Literal["removed", "kept"]

REMOVED_NOTICE = (
    "The background is removed, as in the paper: the model oscillates about zero stress, where the "
    "piezometer asks for grains as large as its stress floor allows, so that grain size, and what "
    'hangs on it, follows that floor and not the material; background = "kept" recovers known '
    "truths."
)
"""Warning of a record without its bias and drift."""

NEGLIGIBLE_SHARE = 0.01
"""Share of the errors of the strain below which it is taken as known: standard deviations of what
the stress tells come out too small by half of it."""

LEAST_RESIDUAL = 1e-12
"""Of the variance of the residuals over the stated one, below which there is no noise at all."""

MIN_CYCLES = 2
"""Cycles that a record needs: with fewer, trend and oscillation cannot be told apart."""

OFF_PEAK = 0.35
"""Of the width of a peak of the periodogram: a stated period this far from it is another one."""

MAX_SCATTER = 3.0
"""Scatter of the strain about its fit over its stated errors: beyond it these are too small."""

OPPOSITE = 2 * math.pi / 3
"""Lag (rad) beyond which strain and stress differ in sign: no solid lags by more than pi/2."""

GOLDEN_RATIO = 0.5 * (1 + math.sqrt(5))

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class OscillationRecord:
    """Readings of a forced oscillation; both clocks have one origin and do not go back.

    `strain_time`, `strain`, `strain_uncertainty` (n_strain,): s, fraction, standard deviation.
    `stress_time`, `stress`, `stress_uncertainty` (n_stress,): s, Pa, standard deviation.
    """

    strain_time: FloatArray
    strain: FloatArray
    strain_uncertainty: FloatArray
    stress_time: FloatArray
    stress: FloatArray
    stress_uncertainty: FloatArray


@dataclass(frozen=True)
class OscillationSettings:
    """How a record is prepared; None leaves the choice to the preparation.

    `period`, `strain_trend_degree`, `stress_trend_degree`: seconds; degrees of the polynomials.
    `background`: "kept" lets the strain's trend drive the model, too, and leaves the stress its
        bias. "removed" subtracts both trends, as in the paper: the truth is not recovered
        (docs/model.md).
    `start_stress`: stress (Pa) at which the model starts if the background is kept, else the bias.
    `max_readings`: stresses of a longer record that the model is compared with.
    """

    period: float | None = None
    strain_trend_degree: int | None = None
    stress_trend_degree: int | None = None
    background: Background = "kept"
    start_stress: float | None = None
    max_readings: int = MAX_READINGS


@dataclass(frozen=True, eq=False)
class PreparedOscillation:
    """A record in the form that the model takes, SI units; times are those of the record's clock.

    `period`, `start`: seconds; time of the first strain or stress reading that is used.
    `strain_fit`, `stress_fit`: fits of the two series; the first drives the model.
    `background`, `start_stress`: whether trends count; stress (Pa) at which the model starts.
    `time`, `stress`, `uncertainty` (n_points,): s; Pa for comparison, and its standard deviation.
    `background_rate` (n_background,): coefficients (1/s) of powers 0, 1, ... of the scaled time of
        `strain_fit` in the driving strain rate; zeros where the background is removed.
    `strain_error` (n_errors, 6 + n_background): what one standard deviation of each independent
        error of `strain_fit` adds to its sines, its cosines and `background_rate`, unless its share
        is `NEGLIGIBLE_SHARE`.
    `max_readings`: see `OscillationSettings`.
    `notices`: what the preparation left out: sentences.
    """

    period: float
    strain_fit: HarmonicFit
    stress_fit: HarmonicFit
    background: Background
    start_stress: float
    start: float
    time: FloatArray
    stress: FloatArray
    uncertainty: FloatArray
    background_rate: FloatArray
    strain_error: FloatArray
    max_readings: int
    notices: tuple[str, ...]

    @property
    def settings(self) -> OscillationSettings:
        """The settings, with everything that was estimated or chosen as a number."""
        return OscillationSettings(
            period=self.period,
            strain_trend_degree=self.strain_fit.degree,
            stress_trend_degree=self.stress_fit.degree,
            background=self.background,
            start_stress=self.start_stress if self.background == "kept" else None,
            max_readings=self.max_readings,
        )

    @property
    def relative_uncertainty(self) -> FloatArray:
        """Uncertainty of each stress over the root mean square of all, shape (n_points,)."""
        if self.uncertainty.size == 0:
            return self.uncertainty
        return np.asarray(self.uncertainty / np.sqrt(np.mean(self.uncertainty**2)))

    def strain(self, time: FloatArray) -> FloatArray:
        """Strain (fraction) at times (s), shape (n,): without its trend where that is removed."""
        oscillating = self.strain_fit.periodic(time)
        if self.background == "removed":
            return oscillating
        return oscillating + self.strain_fit.trend(time)

    def strain_rate(self, time: FloatArray) -> FloatArray:
        """Driving strain rate (1/s) at times (s), shape (n,)."""
        scaled = (time - self.strain_fit.t_middle) / self.strain_fit.t_half
        background = polynomial.polyval(scaled, self.background_rate)
        return np.asarray(self.strain_fit.periodic_rate(time) + background)


@dataclass(frozen=True, eq=False)
class _Series:
    """One of the two series: its name, clock (s), readings and their uncertainties."""

    name: str
    time: FloatArray
    value: FloatArray
    uncertainty: FloatArray

    @property
    def spacing(self) -> float:
        """Median time (s) between readings, of those at one time to the next ones."""
        return float(np.median(np.diff(np.unique(self.time))))

    @property
    def length(self) -> float:
        """Time (s) that the readings stand for: the last one counts as long as the others."""
        return float(self.time[-1] - self.time[0]) + self.spacing

    def within(self, start: float, end: float) -> "_Series":
        """Return the readings between two times (s)."""
        inside = (self.time >= start) & (self.time <= end)
        return _Series(self.name, self.time[inside], self.value[inside], self.uncertainty[inside])

    @property
    def data(self) -> dict[str, Any]:
        """Arguments of the functions of `pyburgers.kinds.forced_oscillation.harmonics`."""
        return {"time": self.time, "value": self.value, "uncertainty": self.uncertainty}


def prepare(
    record: OscillationRecord, settings: OscillationSettings, where: str
) -> PreparedOscillation:
    """Prepare a record, without stresses outside the strain record by more than half a reading."""
    strain = _checked("strain", record.strain_time, record.strain, record.strain_uncertainty, where)
    stress = _checked("stress", record.stress_time, record.stress, record.stress_uncertainty, where)
    if stress.time[0] > strain.time[-1] or strain.time[0] > stress.time[-1]:
        raise InputError(
            f"{where}: strain and stress clocks do not overlap: strain runs from "
            f"{strain.time[0]:g} to {strain.time[-1]:g} s, stress from {stress.time[0]:g} to "
            f"{stress.time[-1]:g} s."
        )
    period = settings.period
    if period is None:
        period = _named(where, strain, lambda: estimate_period(**strain.data))
    for series in (strain, stress):
        _check_period(where, series, period)
    margin = 0.5 * strain.spacing
    used = stress.within(strain.time[0] - margin, strain.time[-1] + margin)
    cycles = used.length / period if used.time.size > 1 else 0.0
    if cycles < MIN_CYCLES:
        raise InputError(
            f"{where}: strain and stress clocks overlap over {cycles:.2f} cycles of the period "
            f"{period:g} s, expected at least {MIN_CYCLES}."
        )
    strain_fit = _fit(where, strain, period, settings.strain_trend_degree)
    stress_fit = _fit(where, used, period, settings.stress_trend_degree)
    kept = settings.background == "kept"
    if settings.start_stress is not None and not kept:
        raise InputError(
            f"{where}: found a start_stress of {settings.start_stress:g} Pa with the background "
            "removed, expected one only with the background kept."
        )
    start = float(min(strain.time[0], used.time[0]))
    start_stress = settings.start_stress if kept else 0.0
    if start_stress is None:
        start_stress = float(stress_fit.trend(np.array([start]))[0])
    slope = _powers_of_rate(strain_fit.trend_coefficients, strain_fit.t_half)
    stresses = used.value if kept else used.value - stress_fit.trend(used.time)
    chosen = _spread_readings(used.time.size, settings.max_readings)
    return PreparedOscillation(
        period=period,
        strain_fit=strain_fit,
        stress_fit=stress_fit,
        background=settings.background,
        start_stress=start_stress,
        start=start,
        time=used.time[chosen],
        stress=stresses[chosen],
        uncertainty=used.uncertainty[chosen],
        background_rate=slope if kept else np.zeros_like(slope),
        strain_error=_strain_error(strain_fit, stress_fit, kept=kept),
        max_readings=settings.max_readings,
        notices=(
            *_thinning_told(chosen.size, used.time.size),
            *_left_out(stress.time.size - used.time.size, settings.background),
            *_coarse_clock(strain, period),
            *_coarse_clock(used, period),
            *_doubts(strain, strain_fit, stress_fit),
        ),
    )


def _checked(
    name: str, time: FloatArray, value: FloatArray, uncertainty: FloatArray, where: str
) -> _Series:
    """Check a series on its own."""
    if not time.size == value.size == uncertainty.size:
        raise InputError(
            f"{where}: the {name} has {time.size} times, {value.size} readings and "
            f"{uncertainty.size} uncertainties, expected as many of each."
        )
    n_times = np.unique(time).size
    if n_times < 2:
        raise InputError(
            f"{where}: the {name} has readings at {counted(n_times, 'time')}, expected at least "
            "two cycles of them."
        )
    backwards = np.flatnonzero(np.diff(time) < 0)
    if backwards.size > 0:
        first = backwards[0] + 1
        raise InputError(
            f"{where}: the {name}'s clock, reading {first + 1}: found {time[first]:g} s after "
            f"{time[first - 1]:g} s, expected times that do not go back.{order_text(time)}"
        )
    wrong = np.flatnonzero(~(uncertainty > 0))
    if wrong.size > 0:
        raise InputError(
            f"{where}: the {name}'s uncertainty, reading {wrong[0] + 1}: found "
            f"{uncertainty[wrong[0]]:g}, expected a positive standard deviation."
        )
    return _Series(name, time, value, uncertainty)


def _check_period(where: str, series: _Series, period: float) -> None:
    """Check that a series can show an oscillation of the period."""
    if period < 2.0 * series.spacing:
        raise InputError(
            f"{where}: the period of {period:g} s is too short for the {series.name}, expected at "
            f"least {2.0 * series.spacing:g} s, two steps of its clock."
        )
    if period > series.length:
        raise InputError(
            f"{where}: the period of {period:g} s is longer than the {series.name}'s record of "
            f"{series.length:g} s, expected at most half of it."
        )
    if series.length < MIN_CYCLES * period:
        raise InputError(
            f"{where}: the {series.name} has {series.length / period:.2f} cycles of the period "
            f"{period:g} s, expected at least {MIN_CYCLES}."
        )


def _fit(where: str, series: _Series, period: float, degree: int | None) -> HarmonicFit:
    """Fit a series, with a trend of the given degree or of the one that suits."""

    def fit() -> HarmonicFit:
        chosen = choose_degree(**series.data, period=period) if degree is None else degree
        return fit_harmonics(**series.data, period=period, degree=chosen)

    return _named(where, series, fit)


def _powers_of_rate(trend: FloatArray, t_half: float) -> FloatArray:
    """Rate (1/s) of a trend, given by its Legendre coefficients, as powers of the scaled time."""
    slope: FloatArray = legendre.legder(trend).astype(np.float64)
    powers = np.asarray(legendre.leg2poly(slope), dtype=np.float64)
    # Zeros at its end have been dropped.
    return np.pad(powers, (0, slope.size - powers.size)) / t_half


def strain_shares(strain_fit: HarmonicFit, stress_fit: HarmonicFit) -> tuple[float, float]:
    """Return how much errors of the strain count beside those of the stress, as variances.

    Of the fundamentals; and of mean strain rate and mean stress, as they count in a linear dashpot.
    """
    freedom = stress_fit.n_points - stress_fit.coefficients.size
    residual = max(stress_fit.chi_square / freedom, LEAST_RESIDUAL)
    bias = np.eye(stress_fit.degree + 1)[0]
    # From end to end: twice the Legendre polynomials of odd degree.
    rise = (np.arange(strain_fit.degree + 1) % 2).astype(np.float64)
    slow, fast = _relative_variance(strain_fit, rise), _relative_variance(stress_fit, bias)
    strain, stress = map(_relative_variance_of_fundamental, (strain_fit, stress_fit))
    return strain / (stress * residual), slow / (fast * residual)


def _relative_variance(fit: HarmonicFit, direction: FloatArray) -> float:
    """Variance of a linear function of the trend over its square; infinite where it is 0."""
    square, n = float(direction @ fit.trend_coefficients) ** 2, fit.degree + 1
    variance = float(direction @ fit.covariance[:n, :n] @ direction)
    return variance / square if square > 0 else math.inf


def _relative_variance_of_fundamental(fit: HarmonicFit) -> float:
    """Variance of the fundamental, as a complex number, over its square."""
    amplitude, error = fit.amplitude()
    return (error / amplitude) ** 2 + fit.phase()[1] ** 2


def _strain_error(strain_fit: HarmonicFit, stress_fit: HarmonicFit, *, kept: bool) -> FloatArray:
    """See `PreparedOscillation.strain_error`."""
    n_trend, n_coefficients = strain_fit.degree + 1, strain_fit.coefficients.size
    oscillation, background = strain_shares(strain_fit, stress_fit)
    used = np.zeros(n_coefficients, dtype=bool)
    used[n_trend:] = oscillation >= NEGLIGIBLE_SHARE
    # The slope of the trend drives the model, never its constant.
    used[1:n_trend] = kept and background >= NEGLIGIBLE_SHARE
    n_errors = np.count_nonzero(used)
    error = np.zeros((n_errors, n_coefficients))
    error[:, used] = np.linalg.cholesky(strain_fit.covariance[np.ix_(used, used)]).T
    rates = [_powers_of_rate(row[:n_trend], strain_fit.t_half) for row in error]
    return np.hstack([error[:, n_trend:], np.reshape(rates, (n_errors, max(1, n_trend - 1)))])


def _named(where: str, series: _Series, compute: Callable[[], T]) -> T:
    """Let errors of a computation say which series of which test they are about."""
    try:
        return compute()
    except InputError as error:
        raise InputError(f"{where}: {series.name}: {error}") from None


def _spread_readings(n: int, most: int) -> IntArray:
    """Return the indices of at most so many of n readings, one in each of as many equal parts.

    Its place in its part follows the golden ratio: at equal distances all might have one phase.
    """
    if n <= most:
        return np.arange(n)
    if n < 2 * most:
        # Parts of little more than a reading would share some: those left out are spread.
        return np.delete(np.arange(n), _spread_readings(n, n - most))
    part = np.arange(most)
    places: IntArray = np.floor((part + part * GOLDEN_RATIO % 1) * n / most).astype(np.int64)
    return places


def _thinning_told(n_chosen: int, n: int) -> Iterator[str]:
    """Say how many readings are used."""
    if n_chosen < n:
        yield (
            f"{n_chosen} of {n} {ARE_USED}, spread over the record of the stress. They are single "
            "readings: means of neighbours, if they are written to the file instead, keep what the "
            "others say."
        )


def _left_out(n_stresses: int, background: Background) -> Iterator[str]:
    """Say what was left out."""
    if n_stresses > 0:
        yield f"{count_points(n_stresses)} of the stress outside the strain record left out."
    if background == "removed":
        yield REMOVED_NOTICE


def _coarse_clock(series: _Series, period: float) -> Iterator[str]:
    """Say where readings share times, and how far the clock steps then."""
    step = f" The clock steps by {series.spacing:.3g} s, "
    step += f"{360 * series.spacing / period:.2g} degrees of a cycle."
    for said in repeated(series.time, series.value, "time", f" of the {series.name}"):
        yield said + step


def _doubts(strain: _Series, strain_fit: HarmonicFit, stress_fit: HarmonicFit) -> Iterator[str]:
    """Say where the period, an error, a sign or a clock is not that of the record."""
    period, rest = strain_fit.period, strain.value - strain_fit.trend(strain.time)
    scatter = math.sqrt(strain_fit.chi_square / (strain.time.size - strain_fit.coefficients.size))
    found, share = strongest_frequency(strain.time, rest, 0.5 / period, 2.5 / period)
    # Noise has no peak that is most of the variance.
    if share > 0.5 and abs(found - 1 / period) > OFF_PEAK / float(np.ptp(strain.time)):
        yield (
            f"The period is taken as {period:g} s, but the strain oscillates most with one of "
            f"about {1 / found:.3g} s: check 'period_s'."
        )
    elif scatter > MAX_SCATTER:
        yield (
            f"The strain scatters about its fit by {rounded_to(scatter)} times its stated "
            "uncertainty: check that and its unit, the period and the trend."
        )
    (of_strain, first_error), (of_stress, second_error) = strain_fit.phase(), stress_fit.phase()
    lead = math.remainder(of_stress - of_strain, 2 * math.pi)
    surely, apart = 3 * math.hypot(first_error, second_error), abs(math.degrees(lead))
    if abs(lead) > OPPOSITE + surely:
        yield (
            f"Strain and stress oscillate {apart:.0f} degrees apart, as if one of them had the "
            "opposite sign: check the signs of both."
        )
    elif not -surely <= lead <= math.pi / 2 + surely:
        yield (
            f"The stress oscillates {apart:.3g} degrees {'ahead of' if lead > 0 else 'behind'} the "
            "strain, expected 0 to 90 degrees ahead: check that both clocks have one origin."
        )
