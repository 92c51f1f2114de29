"""The study of Europa's shell: moduli of draws of a law, without the solver of tides."""

import europa
import numpy as np
import numpy.typing as npt
import pytest
import xarray as xr


def rates_of(viscosity: npt.NDArray[np.float64], stress: float) -> xr.Dataset:
    """Draws of a linear law (n_draws, n) of shear viscosities (Pa s)."""
    log_rate = np.log(stress / (3.0 * viscosity))
    return xr.Dataset(
        {
            "log_strain_rate": (("draw", "condition"), log_rate),
            "stress_exponent": (("draw", "condition"), np.ones_like(log_rate)),
        }
    )


def test_a_linear_law_is_a_maxwell_body() -> None:
    viscosity = np.array([[1e13, 1e15], [1e14, 1e16]])
    found = europa.complex_moduli(rates_of(viscosity, 3e4), np.array([265.0, 240.0]), 3e4)
    omega = 2.0 * np.pi / europa.PERIOD
    expected = 1.0 / (1.0 / europa.SHEAR_MODULUS + 1.0 / (1j * omega * viscosity))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_a_power_law_loses_less_than_a_linear_one_of_the_same_rate_at_the_amplitude() -> None:
    rates = rates_of(np.array([[1e14]]), 3e4)
    rates["stress_exponent"] = rates["stress_exponent"] * 3.0
    found = europa.complex_moduli(rates, np.array([260.0]), 3e4)
    omega = 2.0 * np.pi / europa.PERIOD
    # The mean of sin^4 over that of sin^2 is 3/4.
    expected = 1.0 / (1.0 / europa.SHEAR_MODULUS + 0.75 / (1j * omega * 1e14))
    assert found[0, 0] == pytest.approx(expected, rel=1e-6)


def test_the_shell_is_coldest_at_its_surface() -> None:
    temperature = europa.shell_temperature()
    assert temperature[0] == europa.BASE_TEMPERATURE
    assert temperature[-1] == pytest.approx(europa.SURFACE_TEMPERATURE)
    assert (np.diff(temperature) < 0).all()
