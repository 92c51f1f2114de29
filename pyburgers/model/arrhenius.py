"""Rates and times at a temperature, where no Stan program is asked."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from pyburgers.common.array_types import FloatArray

GAS_CONSTANT = 8.314462618  # J/(mol K), as in stan/physics/flow_law.stan


def log_slowdown(
    enthalpy: npt.ArrayLike, temperature: npt.ArrayLike, reference: npt.ArrayLike
) -> FloatArray:
    """Return (Q/R)(1/T - 1/T_0): by what ln(time) grows, and ln(rate) falls, from T_0 to T.

    Q is the `enthalpy` in J/mol, T the `temperature` and T_0 the `reference` in K; all three are
    broadcast against each other.
    """
    colder = 1 / np.asarray(temperature) - 1 / np.asarray(reference)
    return np.asarray(np.asarray(enthalpy) / GAS_CONSTANT * colder)


def log_flow_rate(
    values: Mapping[str, npt.ArrayLike], *, stress: float, grain_size: float, temperature: float
) -> FloatArray:
    """Return ln(flow rate s) at a stress (Pa), grain size (m) and temperature (K).

    It is `log_flow_rate` of the Stan functions. The values are n, p, Q_M (J/mol) and beta (mol/J)
    by name, of any shape.
    """
    log_rate: FloatArray = (
        np.asarray(values["stress_exponent"]) * np.log(stress)
        - np.asarray(values["grain_size_exponent"]) * np.log(grain_size)
        + np.asarray(values["activation_enthalpy"])
        * (np.asarray(values["beta"]) - 1 / (GAS_CONSTANT * temperature))
    )
    return log_rate
