"""Harmonics and trend of a time series: exact recovery, stated errors, degree, period."""

import tracemalloc

import numpy as np
import pytest

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.kinds.forced_oscillation.harmonics import (
    choose_degree,
    estimate_period,
    fit_harmonics,
    strongest_frequency,
    trend_projection,
)

PERIOD = 300.0
OMEGA = 2 * np.pi / PERIOD
NOISE = 0.05


def times(cycles: float = 8.0, interval: float = 9.0) -> FloatArray:
    """Irregular clock (s)."""
    rng = np.random.default_rng(0)
    regular = np.arange(20.0, 20.0 + cycles * PERIOD, interval)
    return regular + 0.2 * interval * rng.uniform(-1, 1, regular.size)


def oscillation(time: FloatArray) -> FloatArray:
    """Fundamental of amplitude 2 and phase 0.4, and two harmonics."""
    return (
        2 * np.sin(OMEGA * time + 0.4)
        + 0.3 * np.sin(2 * OMEGA * time - 1.0)
        + 0.1 * np.cos(3 * OMEGA * time)
    )


def drift(time: FloatArray) -> FloatArray:
    return 5 + 3e-3 * time - 1e-6 * time**2


def degree_of(time: FloatArray, value: FloatArray) -> int:
    return choose_degree(time, value, period=PERIOD, uncertainty=np.full(time.size, NOISE))


class TestFit:
    def test_a_series_of_the_fitted_form_is_recovered_exactly(self) -> None:
        time = times()
        fit = fit_harmonics(time, oscillation(time) + drift(time), period=PERIOD, degree=2)
        elsewhere = np.linspace(0, 3000, 50)
        np.testing.assert_allclose(fit.periodic(elsewhere), oscillation(elsewhere), atol=1e-10)
        np.testing.assert_allclose(fit.trend(elsewhere), drift(elsewhere), atol=1e-9)
        np.testing.assert_allclose(np.hypot(fit.sine, fit.cosine), [2, 0.3, 0.1])
        np.testing.assert_allclose(np.arctan2(fit.cosine, fit.sine), [0.4, -1.0, np.pi / 2])
        assert (fit.amplitude()[0], fit.phase()[0]) == pytest.approx((2, 0.4))

    def test_rates_are_time_derivatives(self) -> None:
        time = times()
        fit = fit_harmonics(time, oscillation(time) + drift(time), period=PERIOD, degree=2)
        at = np.linspace(100, 2300, 30)
        step = 1e-2
        for value, rate in ((fit.periodic, fit.periodic_rate), (fit.trend, fit.trend_rate)):
            numerical = (value(at + step) - value(at - step)) / (2 * step)
            np.testing.assert_allclose(rate(at), numerical, rtol=1e-6, atol=1e-9)

    def test_a_constant_trend_has_no_rate(self) -> None:
        time = times()
        fit = fit_harmonics(time, oscillation(time) + 7, period=PERIOD, degree=0)
        np.testing.assert_allclose(fit.trend(time), 7)
        np.testing.assert_array_equal(fit.trend_rate(time), 0)

    def test_standard_errors_are_the_scatter_of_repeated_fits(self) -> None:
        time, rng = times(cycles=4), np.random.default_rng(3)
        uncertainty = NOISE * rng.uniform(0.5, 1.5, time.size)
        clean = oscillation(time) + drift(time)
        fits = [
            fit_harmonics(
                time,
                clean + uncertainty * rng.standard_normal(time.size),
                period=PERIOD,
                degree=2,
                uncertainty=uncertainty,
            )
            for _ in range(500)
        ]
        for measure in ("amplitude", "phase"):
            values = np.array([getattr(fit, measure)() for fit in fits])
            assert np.std(values[:, 0]) == pytest.approx(np.mean(values[:, 1]), rel=0.15)
        found = np.std([fit.coefficients for fit in fits], axis=0)
        np.testing.assert_allclose(found, np.sqrt(np.diag(fits[0].covariance)), rtol=0.15)
        misfit = np.mean([fit.chi_square for fit in fits])
        assert misfit == pytest.approx(time.size - 9, rel=0.02)

    def test_given_uncertainties_are_absolute(self) -> None:
        time, rng = times(), np.random.default_rng(1)
        value = oscillation(time) + NOISE * rng.standard_normal(time.size)
        one, two = (
            fit_harmonics(
                time, value, period=PERIOD, degree=1, uncertainty=np.full(time.size, size)
            )
            for size in (NOISE, 2 * NOISE)
        )
        np.testing.assert_allclose(two.coefficients, one.coefficients, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(two.covariance, 4 * one.covariance, rtol=1e-9)
        assert two.chi_square == pytest.approx(one.chi_square / 4)

    def test_without_uncertainties_the_scatter_is_taken(self) -> None:
        time, rng = times(), np.random.default_rng(1)
        noise = NOISE * rng.standard_normal(time.size)
        value = oscillation(time) + noise
        fit = fit_harmonics(time, value, period=PERIOD, degree=1)
        left = value - fit.periodic(time) - fit.trend(time)
        spread = np.full(time.size, np.sqrt(left @ left / (time.size - fit.coefficients.size)))
        assert spread[0] == pytest.approx(NOISE, rel=0.1)
        known = fit_harmonics(time, value, period=PERIOD, degree=1, uncertainty=spread)
        np.testing.assert_allclose(fit.covariance, known.covariance, rtol=1e-9)

    def test_an_uncertain_reading_hardly_counts(self) -> None:
        time = times()
        value, uncertainty = oscillation(time), np.full(time.size, NOISE)
        value[40] += 100
        uncertainty[40] = 1e6
        fit = fit_harmonics(time, value, period=PERIOD, degree=0, uncertainty=uncertainty)
        assert fit.amplitude()[0] == pytest.approx(2, abs=1e-6)

    @pytest.mark.parametrize("cycles", [2.0, 6.0])
    def test_without_its_trend_a_series_knows_the_harmonics_as_well_as_with_it(
        self, cycles: float
    ) -> None:
        """And no better, as it would without the trend that a joint fit has found."""
        time = times(cycles=cycles)
        uncertainty = np.random.default_rng(5).uniform(0.5, 1.5, time.size)
        angles = 2 * np.pi / PERIOD * np.outer(time, [1, 2, 3])
        harmonics = np.hstack([np.sin(angles), np.cos(angles)])
        shape, fit = trend_projection(time, degree=2, uncertainty=uncertainty)
        left = (harmonics - shape @ (fit @ harmonics)) / uncertainty[:, None]
        joint = fit_harmonics(
            time, oscillation(time), period=PERIOD, degree=2, uncertainty=uncertainty
        )
        np.testing.assert_allclose(
            np.linalg.inv(left.T @ left), joint.covariance[3:, 3:], rtol=1e-9, atol=1e-12
        )

    def test_too_few_readings(self) -> None:
        time = times()[:8]
        with pytest.raises(InputError, match=r"found 8 readings, expected more than 8, .*degree 1"):
            fit_harmonics(time, oscillation(time), period=PERIOD, degree=1)

    def test_three_readings_a_cycle_cannot_show_the_third_harmonic(self) -> None:
        time = np.arange(0.0, 2400.0, 100.0)
        with pytest.raises(InputError, match=r"do not tell 3 harmonics of the period 300 s"):
            fit_harmonics(time, oscillation(time), period=PERIOD, degree=1)


class TestDegree:
    def test_the_true_degree_is_found(self) -> None:
        time = times()
        found = []
        for seed in range(20):
            noise = NOISE * np.random.default_rng(seed).standard_normal(time.size)
            found.append(degree_of(time, oscillation(time) + drift(time) + noise))
        assert found.count(2) >= 18

    def test_no_trend_is_invented(self) -> None:
        time = times()
        noise = NOISE * np.random.default_rng(4).standard_normal(time.size)
        assert degree_of(time, oscillation(time) + noise) == 0

    def test_two_cycles_leave_room_for_a_cubic_at_most(self) -> None:
        time = times(cycles=2.2)
        steep = oscillation(time) + 1e-11 * (time - 300) ** 5
        assert degree_of(time, steep) == 3

    def test_few_readings_bound_the_degree(self) -> None:
        time = times(cycles=4, interval=110)
        assert degree_of(time, oscillation(time)) <= time.size - 8


class TestPeriod:
    @pytest.mark.parametrize("true", [45.0, 137.0, 300.0, 610.0])
    def test_noise_and_a_strong_drift_leave_it_close(self, true: float) -> None:
        time, rng = times(), np.random.default_rng(2)
        value = 2 * np.sin(2 * np.pi * time / true) + 0.01 * time - 2e-6 * time**2
        noisy = value + NOISE * rng.standard_normal(time.size)
        period = estimate_period(time, noisy, uncertainty=np.full(time.size, NOISE))
        assert period == pytest.approx(true, rel=1e-3)

    @pytest.mark.parametrize("n_readings", [2, 3, 4])
    def test_a_few_readings_have_none(self, n_readings: int) -> None:
        time = times()[:n_readings]
        with pytest.raises(InputError, match=f"found {n_readings} readings, expected"):
            estimate_period(time, oscillation(time), uncertainty=np.full(time.size, NOISE))

    def test_a_long_record_takes_little_memory(self) -> None:
        time, rng = 0.6 * np.arange(1e5), np.random.default_rng(1)
        value = np.sin(OMEGA * time) + rng.standard_normal(time.size)
        tracemalloc.start()
        found, share = strongest_frequency(time, value, 0.5 / PERIOD, 0.5 / 0.6)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert found == pytest.approx(1 / PERIOD, rel=1e-3)
        assert share == pytest.approx(1 / 3, rel=0.05)
        assert peak < 500e6
