"""Closed forms of stress cycles, and the flow law (`pyburgers.model.closed_forms`)."""

from collections.abc import Mapping, Sequence
from numbers import Real

import numpy as np
import numpy.typing as npt

from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError, nearest, require_type
from pyburgers.kinds.attenuation.likelihood import stress_nodes
from pyburgers.kinds.stan_data import ends
from pyburgers.model.closed_forms import closed_forms
from pyburgers.model.laws import DASHPOT_STRESSES
from pyburgers.model.parameters import (
    ALL_ENVIRONMENT_NUMBERS,
    ENVIRONMENT,
    FURTHER_PARAMETERS,
)
from pyburgers.model.priors import FLOW_LAW
from pyburgers.predictions.stress_cycles import Regime, check_state

CYCLE_NODES = 64
"""Nodes in half a period for the strain of a cycle: the kink of |rate| limits it to about 1e-3."""


def cycles_data(
    regimes: Sequence[Regime], frequency: FloatArray, hold_time: float, *, with_strains: bool
) -> dict[str, object]:
    """Return data of `stan/stress_cycles.stan`: cycles at frequencies (Hz) after a hold (s)."""
    stresses = [(regime.median_stress, regime.amplitude) for regime in regimes]
    nodes = [stress_nodes(*one) for one in stresses]
    angles = np.pi * ((np.arange(CYCLE_NODES) + 0.5) / CYCLE_NODES - 0.5)
    sine = np.sin(angles) if with_strains else np.empty(0)
    return {
        "n_frequencies": frequency.size,
        "frequency": frequency.tolist(),
        "n_regimes": len(regimes),
        "median_stress": [median for median, _ in stresses],
        "amplitude": [amplitude for _, amplitude in stresses],
        "node_end": ends(len(own) for own in nodes),
        "node": np.concatenate([np.empty((0, 2)), *nodes]).tolist(),
        "n_sines": sine.size,
        "sine": sine.tolist(),
        "hold_time": hold_time,
    }


def flow_rate(
    parameters: Mapping[str, npt.ArrayLike],
    stress: npt.ArrayLike,
    *,
    temperature: float,
    grain_size: npt.ArrayLike,
    fabric_factor: npt.ArrayLike = 1.0,
) -> FloatArray:
    """Return the strain rate of the dashpot, the flow law of the model.

    Parameters
    ----------
    parameters : mapping of str to float or array
        SI values of stress_exponent, grain_size_exponent, activation_enthalpy and beta.
        With a breakdown_stress above zero the law is the hyperbolic sine, with a threshold_stress
        that of a threshold. A second_rate and a third_rate above zero are more mechanisms.
        Pressure, water_fugacity and melt_fraction act by the numbers of the mechanisms. Other
        names are ignored.
    stress : float or array
        Pa, of either sign.
    temperature : float
        K.
    grain_size, fabric_factor : float or array
        m; 1 is an isotropic fabric.

    Returns
    -------
    array
        1/s; all arguments are broadcast against each other.

    Raises
    ------
    InputError
        If one of the four is missing, or a number is out of range.
    ToolchainError
        If CmdStan or a compiler is missing.

    Examples
    --------
    >>> law = {"stress_exponent": 4.0, "grain_size_exponent": 0.4,
    ...        "activation_enthalpy": 62e3, "beta": -7.29e-4}
    >>> rate = pyburgers.flow_rate(law, [1e6, 2e6], temperature=263.0, grain_size=1e-3)
    >>> round(float(rate[1] / rate[0]), 6)
    16.0
    """
    missing = [name for name in FLOW_LAW if name not in parameters]
    if missing:
        known = nearest(missing[0], parameters) if parameters else "expected its value."
        raise InputError(f"parameters: {missing[0]!r} is missing, {known}")
    require_type("temperature", temperature, Real, "one number of kelvins")
    check_state(temperature, grain_size, fabric_factor)
    draws = {
        name: np.asarray(parameters[name], dtype=np.float64)
        for name in (
            *FLOW_LAW,
            *DASHPOT_STRESSES,
            *FURTHER_PARAMETERS,
            *ALL_ENVIRONMENT_NUMBERS,
            *ENVIRONMENT,
        )
        if name in parameters
    }
    state = [np.asarray(one, dtype=np.float64) for one in (grain_size, fabric_factor, stress)]
    shape = np.broadcast_shapes(*(one.shape for one in (*draws.values(), *state)))
    if 0 in shape:
        return np.empty(shape)
    found = closed_forms(
        draws,
        np.broadcast_to(state[0], shape),
        temperature=temperature,
        fabric_factor=state[1],
        stress=state[2],
        asked={},
    )
    return found["dashpot_rate"]
