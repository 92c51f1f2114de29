"""Linear bodies: a Newtonian dashpot, frozen microstructure, and a law of the Kelvin part."""

from collections.abc import Mapping

import numpy as np

from pyburgers.model.parameters import STANDARD_VALUES

LAWS: Mapping[str, Mapping[str, float]] = {
    "linear": {},
    "two_elements": {"peak_strength": 2.0, "peak_time_decades": 1.7},
    "extended": {"relaxation_time_decades": 5.0, "relaxation_exponent": 0.3},
    "extended_peak": {
        "relaxation_time_decades": 4.0,
        "relaxation_exponent": 0.4,
        "peak_strength": 1.0,
        "peak_time_decades": 2.0,
        "peak_width": 1.5,
    },
    "andrade": {"andrade_exponent": 0.3},
}
"""Parameters that each law has beside those of one element."""


def linear_body(
    viscosity: float, kelvin_viscosity: float, temperature: float, grain_size: float
) -> dict[str, float]:
    """Parameters of a body with springs of 4 and 1 GPa and viscosities (Pa s) at a temperature."""
    enthalpy = 62e3
    return {
        **STANDARD_VALUES,
        "maxwell_modulus": 4e9,
        "kelvin_modulus": 1e9,
        "kelvin_viscosity": kelvin_viscosity,
        "stress_exponent": 1.0,
        "grain_size_exponent": 0.0,
        "activation_enthalpy": enthalpy,
        "beta": 1 / (8.31446261815324 * temperature) - np.log(viscosity) / enthalpy,
        "steady_state_grain_size": grain_size,
        "steady_state_fabric_factor": 1.0,
        "critical_strain_grain_size": 1.0,
        "critical_strain_fabric": 1.0,
        "stress_noise": 1.0,
        "kelvin_reference_grain_size": grain_size,
        "kelvin_reference_temperature": temperature,
    }
