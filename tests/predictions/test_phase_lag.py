"""Phase lag of two series: sign, clocks, bias and coverage, a nonlinear record."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp

from pyburgers.common.errors import InputError
from pyburgers.predictions.imposed_stress import PhaseLag, phase_lag

FloatArray = npt.NDArray[np.float64]

PERIOD = 300.0
OMEGA = 2 * np.pi / PERIOD


def clocks(rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Strain and stress clocks (s) of about eight cycles, dense and sparse, both irregular."""
    strain_time = np.arange(0.0, 2400.0, 9.0)
    stress_time = np.arange(6.0, 2380.0, 25.0)
    return (
        strain_time + rng.uniform(-1, 1, strain_time.size),
        stress_time + rng.uniform(-3, 3, stress_time.size),
    )


class TestDefinition:
    @pytest.mark.parametrize("lag", [0.3, -0.3, 1.5, 3.0, -3.0])
    def test_it_is_positive_where_strain_lags_stress(self, lag: float) -> None:
        strain_time, stress_time = clocks(np.random.default_rng(1))
        found = phase_lag(
            strain_time,
            0.1 * np.sin(OMEGA * strain_time + 2.5 - lag),
            stress_time,
            4 * np.sin(OMEGA * stress_time + 2.5),
            period=PERIOD,
            degree=0,
        )
        assert found.radians == pytest.approx(lag, abs=1e-9)
        assert found.tan_delta == pytest.approx(np.tan(lag), rel=1e-7)
        assert found.strain_amplitude == pytest.approx(0.1)
        assert found.stress_amplitude == pytest.approx(4)

    def test_a_viscous_body_lags_a_quarter_of_a_cycle(self) -> None:
        time = np.linspace(0, 1500, 400)
        found = phase_lag(
            time, -np.cos(OMEGA * time) / OMEGA, time, np.sin(OMEGA * time), period=PERIOD, degree=0
        )
        assert found.radians == pytest.approx(np.pi / 2, abs=1e-9)

    def test_the_origin_of_the_common_clock_does_not_matter(self) -> None:
        strain_time, stress_time = clocks(np.random.default_rng(2))
        lags = [
            phase_lag(
                strain_time + shift,
                np.sin(OMEGA * strain_time),
                stress_time + shift,
                np.sin(OMEGA * stress_time + 0.2),
                period=PERIOD,
                degree=1,
            ).radians
            for shift in (0.0, 12345.6)
        ]
        assert lags[1] == pytest.approx(lags[0], abs=1e-9)

    def test_too_few_readings_are_refused_by_name(self) -> None:
        time = np.arange(0.0, 1200.0, 10.0)
        signal, few = np.sin(OMEGA * time), slice(None, None, 20)
        with pytest.raises(InputError, match=r"^stress: found 6 readings, expected more than 7"):
            phase_lag(time, signal, time[few], signal[few], period=PERIOD)


def artificial(
    rng: np.random.Generator, lag: float, *, degree: int | None, known_noise: bool
) -> PhaseLag:
    """Lag found in a record with trends, harmonics and noise."""
    strain_time, stress_time = clocks(rng)
    phase = rng.uniform(-np.pi, np.pi)
    strain = (
        np.sin(OMEGA * strain_time + phase - lag)
        + 0.1 * np.sin(2 * OMEGA * strain_time + rng.uniform(-np.pi, np.pi))
        + 2e-3 * strain_time
        - 2e-7 * strain_time**2
    )
    stress = (
        np.sin(OMEGA * stress_time + phase)
        + 0.05 * np.sin(3 * OMEGA * stress_time + rng.uniform(-np.pi, np.pi))
        + 3
        + 1e-4 * stress_time
    )
    spread = {"strain": np.full(strain_time.size, 0.02), "stress": np.full(stress_time.size, 0.1)}
    return phase_lag(
        strain_time,
        strain + spread["strain"] * rng.standard_normal(strain_time.size),
        stress_time,
        stress + spread["stress"] * rng.standard_normal(stress_time.size),
        period=PERIOD,
        degree=degree,
        strain_uncertainty=spread["strain"] if known_noise else None,
        stress_uncertainty=spread["stress"] if known_noise else None,
    )


@pytest.mark.parametrize(
    ("degree", "known_noise", "count"), [(2, True, 500), (2, False, 500), (None, True, 150)]
)
def test_bias_and_coverage_over_many_artificial_records(
    degree: int | None, known_noise: bool, count: int
) -> None:
    rng = np.random.default_rng(7)
    true = rng.uniform(0.05, 1.2, count)
    found = [artificial(rng, lag, degree=degree, known_noise=known_noise) for lag in true]
    for of_angle in (True, False):
        estimate = np.array([lag.radians if of_angle else lag.tan_delta for lag in found])
        stated = np.array(
            [lag.standard_error if of_angle else lag.tan_delta_standard_error for lag in found]
        )
        error = estimate - (true if of_angle else np.tan(true))
        standardised = error / stated
        assert abs(np.mean(error)) < np.mean(stated)
        # The mean of many is known better than a single one.
        assert abs(np.mean(standardised)) < 3 / np.sqrt(count)
        assert 0.85 <= np.mean(np.abs(standardised) < 1.645) <= 0.95


class TestNonlinearRecord:
    """model.md, section 6: n = 4, mean stress 4 MPa, amplitude 1.5 MPa, 1e-4 Hz."""

    MAXWELL_MODULUS, KELVIN_MODULUS, KELVIN_VISCOSITY = 4e9, 5e8, 1e11
    FLUIDITY = 1.778058e-31
    MEDIAN, AMPLITUDE, FREQUENCY = 4e6, 1.5e6, 1e-4
    TRUE_TAN_DELTA = 36.20369

    def record(self, cycles: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Times, strain and stress of settled cycles."""
        omega = 2 * np.pi * self.FREQUENCY
        time = np.linspace(0, cycles / self.FREQUENCY, 800 * cycles + 1)

        def stress(at: FloatArray) -> FloatArray:
            imposed: FloatArray = self.MEDIAN + self.AMPLITUDE * np.sin(omega * at)
            return imposed

        def rates(at: float, strains: FloatArray) -> Sequence[float]:
            now = float(stress(np.array(at)))
            kelvin = (now - self.KELVIN_MODULUS * strains[0]) / self.KELVIN_VISCOSITY
            return [kelvin, self.FLUIDITY * now**4]

        # The Kelvin element starts in its periodic state.
        loss = omega * self.KELVIN_VISCOSITY
        start = self.MEDIAN / self.KELVIN_MODULUS - self.AMPLITUDE * loss / (
            self.KELVIN_MODULUS**2 + loss**2
        )
        solution = solve_ivp(
            rates, (0, time[-1]), [start, 0.0], t_eval=time, rtol=1e-10, atol=1e-13
        )
        strain = stress(time) / self.MAXWELL_MODULUS + solution.y.sum(axis=0)
        return time, strain, stress(time)

    @pytest.mark.parametrize(("cycles", "miss"), [(3, 0.87), (6, 0.21), (12, 0.05)])
    def test_harmonics_remove_the_bias(self, cycles: int, miss: float) -> None:
        time, strain, stress = self.record(cycles)
        true = np.degrees(np.arctan(self.TRUE_TAN_DELTA))
        without, with_harmonics = (
            np.degrees(
                phase_lag(
                    time,
                    strain,
                    time,
                    stress,
                    period=1 / self.FREQUENCY,
                    degree=3,
                    n_harmonics=count,
                ).radians
            )
            - true
            for count in (1, 3)
        )
        assert abs(without) == pytest.approx(miss, rel=0.05)
        assert abs(with_harmonics) < 0.005 * abs(without)

    def test_six_cycles_give_tan_delta_to_one_percent(self) -> None:
        time, strain, stress = self.record(6)
        found = phase_lag(time, strain, time, stress, period=1 / self.FREQUENCY)
        assert found.tan_delta == pytest.approx(self.TRUE_TAN_DELTA, rel=0.01)
