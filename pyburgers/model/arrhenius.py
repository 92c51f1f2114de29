"""How a rate or a time changes with temperature, where no Stan program is asked."""

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
