"""Solutions of the model by an independent solver: three truths, their peaks, one curve.

Tests at one strain rate, at 260 K and an initial grain size of 230 um.
"""

from types import MappingProxyType

COMMON = MappingProxyType({"beta": -7.29e-4, "stress_noise": 0.1e6})

TRUTHS = MappingProxyType(
    {
        "fast": {
            **COMMON,
            "maxwell_modulus": 4.83e9,
            "kelvin_modulus": 527e6,
            "kelvin_viscosity": 2.40e10,
            "stress_exponent": 3.779,
            "grain_size_exponent": 0.55,
            "activation_enthalpy": 62.08e3,
            "steady_state_grain_size": 159e-6,
            "steady_state_fabric_factor": 0.54,
            "critical_strain_grain_size": 0.074,
            "critical_strain_fabric": 0.112,
        },
        "middle": {
            **COMMON,
            "maxwell_modulus": 2.84e9,
            "kelvin_modulus": 589e6,
            "kelvin_viscosity": 7.93e10,
            "stress_exponent": 4.200,
            "grain_size_exponent": 0.33,
            "activation_enthalpy": 65.68e3,
            "steady_state_grain_size": 82e-6,
            "steady_state_fabric_factor": 0.37,
            "critical_strain_grain_size": 0.083,
            "critical_strain_fabric": 0.283,
        },
        "slow": {
            **COMMON,
            "maxwell_modulus": 1.24e9,
            "kelvin_modulus": 521e6,
            "kelvin_viscosity": 1.79e11,
            "stress_exponent": 3.951,
            "grain_size_exponent": 0.57,
            "activation_enthalpy": 63.95e3,
            "steady_state_grain_size": 173e-6,
            "steady_state_fabric_factor": 0.55,
            "critical_strain_grain_size": 0.068,
            "critical_strain_fabric": 0.181,
        },
    }
)
"""SI values."""

STRAIN_RATES = MappingProxyType({"fast": 1.69e-4, "middle": 8.0e-5, "slow": 2.53e-5})
"""1/s."""

PEAKS = MappingProxyType(
    {"fast": (7.995, 0.0313), "middle": (6.118, 0.0279), "slow": (4.420, 0.0272)}
)
"""Peak stress (MPa) and its strain."""

STRESS_OF_FAST = MappingProxyType(
    {0.002: 3.93, 0.005: 5.23, 0.01: 6.54, 0.05: 7.72, 0.1: 6.67, 0.2: 5.55}
)
"""Stress (MPa) by strain."""
