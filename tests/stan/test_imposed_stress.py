"""Simulated stress cycles: closed forms of the hold, and the phase lag against the spectrum."""

from typing import Any

import numpy as np
import oracle
import pytest
from imposed_stress import (
    settled_times,
    simulate_imposed_stress,
    simulated_phase_lag,
)

from pyburgers.common.errors import SamplingError
from pyburgers.predictions.attenuation import attenuation_spectrum
from pyburgers.predictions.stress_cycles import PAPER_REGIMES, Regime

CONDITIONS: dict[str, Any] = {"temperature": 260.0, "grain_size": 180e-6, "fabric_factor": 0.7}
FREQUENCIES = (1e-4, 1e-3, 1e-2)


def material(exponent: float, fluidity: float) -> dict[str, float]:
    """Elements of model.md, section 6; `fluidity` is that of the dashpot under `CONDITIONS`."""
    enthalpy, grain_size_exponent = 60e3, 0.5
    log_rate_factor = (
        np.log(fluidity)
        + grain_size_exponent * np.log(CONDITIONS["grain_size"])
        + exponent * np.log(CONDITIONS["fabric_factor"])
    )
    return {
        "maxwell_modulus": 4e9,
        "kelvin_modulus": 5e8,
        "kelvin_viscosity": 1e11,
        "stress_exponent": exponent,
        "grain_size_exponent": grain_size_exponent,
        "activation_enthalpy": enthalpy,
        "beta": log_rate_factor / enthalpy + 1 / (oracle.GAS_CONSTANT * CONDITIONS["temperature"]),
    }


ICE = material(4.0, 1.778058e-31)


def exact_tan_delta(parameters: dict[str, float], regime: Regime, frequency: float) -> float:
    spectrum = attenuation_spectrum(parameters, [frequency], [regime], **CONDITIONS)
    return float(spectrum["tan_delta"].item())


@pytest.mark.parametrize("frequency", FREQUENCIES)
@pytest.mark.parametrize("regime", PAPER_REGIMES, ids=lambda regime: regime.label)
def test_six_simulated_cycles_have_the_phase_of_the_closed_form(
    regime: Regime, frequency: float
) -> None:
    exact = exact_tan_delta(ICE, regime, frequency)
    found = simulated_phase_lag(ICE, regime, frequency, cycles=6, **CONDITIONS)
    assert found.tan_delta == pytest.approx(exact, rel=1e-3)
    # With the fourth harmonic, the last that a fourth power has, the solver's error is left.
    found = simulated_phase_lag(ICE, regime, frequency, cycles=6, n_harmonics=4, **CONDITIONS)
    assert found.tan_delta == pytest.approx(exact, rel=1e-7)


@pytest.mark.parametrize("frequency", FREQUENCIES)
@pytest.mark.parametrize("regime", [PAPER_REGIMES[0], Regime(0.0, 2e6)], ids=lambda r: r.label)
def test_linear_cycles_have_the_phase_of_complex_algebra(regime: Regime, frequency: float) -> None:
    fluidity = 2e-12
    omega = 2 * np.pi * frequency
    compliance = 1 / 4e9 + 1 / (5e8 + 1j * omega * 1e11) + fluidity / (1j * omega)
    found = simulated_phase_lag(material(1.0, fluidity), regime, frequency, **CONDITIONS)
    assert found.tan_delta == pytest.approx(-compliance.imag / compliance.real, rel=1e-7)
    assert found.radians == pytest.approx(-np.angle(compliance), abs=1e-8)


def test_stress_that_changes_sign_has_the_phase_of_the_closed_form() -> None:
    parameters, regime, frequency = material(3.3, 1e-27), Regime(1e6, 3e6), 3e-4
    found = simulated_phase_lag(parameters, regime, frequency, n_harmonics=6, **CONDITIONS)
    assert found.tan_delta == pytest.approx(
        exact_tan_delta(parameters, regime, frequency), rel=1e-4
    )


def test_the_hold_is_creep_under_constant_stress() -> None:
    regime, hold = PAPER_REGIMES[1], 5000.0
    times = np.array([-4999.0, -4900.0, -4500.0, -2000.0, -1.0])
    record = simulate_imposed_stress(ICE, regime, 1e-3, times, hold_time=hold, **CONDITIONS)
    since_loading = record["time_s"] + hold
    np.testing.assert_array_equal(record["time_s"], [*times, 0.0])
    np.testing.assert_allclose(record["stress_Pa"], 1.5e6, rtol=1e-15)
    np.testing.assert_allclose(
        record["kelvin_strain"],
        1.5e6 / 5e8 * -np.expm1(-since_loading * 5e8 / 1e11),
        rtol=1e-8,
    )
    np.testing.assert_allclose(
        record["dashpot_strain"], 1.778058e-31 * 1.5e6**4 * since_loading, rtol=1e-8
    )


def test_the_elements_follow_the_imposed_stress() -> None:
    """Strains add up, and the dashpot's drift is the mean of its rate over a cycle."""
    regime, frequency = PAPER_REGIMES[3], 1e-3
    times = settled_times(200.0, frequency, cycles=2, readings_per_cycle=50)
    record = simulate_imposed_stress(ICE, regime, frequency, times, **CONDITIONS).iloc[1:]
    stress = 4e6 + 1.5e6 * np.sin(2 * np.pi * frequency * times)
    np.testing.assert_allclose(record["stress_Pa"], stress, rtol=1e-12)
    np.testing.assert_allclose(
        record["strain"],
        stress / 4e9 + record["kelvin_strain"] + record["dashpot_strain"],
        rtol=1e-14,
    )
    kelvin, dashpot = (record[name].to_numpy() for name in ("kelvin_strain", "dashpot_strain"))
    np.testing.assert_allclose(kelvin[50:], kelvin[:50], rtol=1e-9)
    # The mean of sin^4 is 3/8, that of sin^2 1/2.
    mean_rate = 1.778058e-31 * (4e6**4 + 3 * 4e6**2 * 1.5e6**2 + 0.375 * 1.5e6**4)
    np.testing.assert_allclose(dashpot[50:] - dashpot[:50], mean_rate / frequency, rtol=1e-9)


def test_a_solution_that_cannot_be_found_is_an_error() -> None:
    with pytest.raises(SamplingError):
        simulate_imposed_stress(
            {**ICE, "beta": 7.29e-2}, PAPER_REGIMES[0], 1e-3, np.array([1.0]), **CONDITIONS
        )
