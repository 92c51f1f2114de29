"""Ice tests made with one flow law and one set of moduli, for joint fits that should find them."""

from types import MappingProxyType

import numpy as np
from conftest import ICE
from independent_table import TRUTHS

from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.forward import simulate_data

NAMES = ("PIL40", "PIL72", "PIL105")
COMMON = MappingProxyType(
    {
        "maxwell_modulus": 3.5e9,
        "kelvin_modulus": 5.6e8,
        "kelvin_viscosity": 6e10,
        "stress_exponent": 3.9,
        "grain_size_exponent": 0.5,
        "activation_enthalpy": 63e3,
        "beta": -7.29e-4,
    }
)
"""Flow law and moduli of all tests; microstructure and noise are those of the independent table."""


def with_common_flow_law(name: str) -> ConstantRateExperiment:
    """The strains of a shipped twin with stresses of the common flow law."""
    twin = load_constant_rate(ICE / f"{name}.toml")
    rng = np.random.default_rng([20261120, NAMES.index(name)])
    values = {**dict(zip(NAMES, TRUTHS.values(), strict=True))[name], **COMMON}
    return simulate_data(twin, values, rng, source="a common flow law")
