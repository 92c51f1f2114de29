"""Closed forms of a frozen material under a hold and stress cycles: rates, fluidity, strain.

Draws are arrays of one shape; regimes and frequencies are further dimensions behind it.
"""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from pyburgers.common.units import UNITS
from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.model.priors import FLOW_LAW
from pyburgers.predictions.stress_cycles import BREAKDOWN, Regime

FloatArray = npt.NDArray[np.float64]

_NODES = 64
_NODES_SIGN_CHANGE = 1024
"""Nodes in half a period of stress. The fluidity is good to 1e-10 for stress exponents from 2.5;
where stress changes sign, the flow law has a kink in a higher derivative and the sum converges less
fast."""


def half_period(regime: Regime) -> FloatArray:
    """Return sin(omega t) at the midpoints of equal steps from lowest to highest stress."""
    n_nodes = _NODES_SIGN_CHANGE if regime.amplitude > regime.median_stress else _NODES
    nodes: FloatArray = np.sin(np.pi * ((np.arange(n_nodes) + 0.5) / n_nodes - 0.5))
    return nodes


def dashpot_rates(
    draws: Mapping[str, FloatArray],
    regime: Regime,
    sine: FloatArray,
    *,
    temperature: float,
    grain_size: FloatArray,
    fabric_factor: FloatArray,
) -> FloatArray:
    """Strain rate of the dashpot (1/s) where sin(omega t) has given values, shape of the draws + n.

    `draws` are as of `pyburgers.predictions.stress_cycles.checked_inputs`; `sine` has shape (n,),
    and is 0 in the hold; temperature is in K, grain sizes in m.
    """
    return flow_rate(
        {name: values[..., np.newaxis] for name, values in draws.items()},
        regime.median_stress + regime.amplitude * sine,
        temperature=temperature,
        grain_size=grain_size[..., np.newaxis],
        fabric_factor=fabric_factor[..., np.newaxis],
    )


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
        SI values of stress_exponent, grain_size_exponent, activation_enthalpy and beta; with a
        breakdown_stress above zero the law is the hyperbolic sine. Other names are ignored.
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
    """
    exponent, p, enthalpy, beta, breakdown, size, fabric, load = (
        np.asarray(values, dtype=np.float64)
        for values in (
            *(parameters[name] for name in FLOW_LAW),
            parameters.get(BREAKDOWN, 0.0),
            grain_size,
            fabric_factor,
            stress,
        )
    )
    log_fluidity = (
        enthalpy * (beta - 1 / (GAS_CONSTANT * temperature))
        - p * np.log(size)
        - exponent * np.log(fabric)
    )
    limit = breakdown * fabric
    if limit.any():
        load = limit * np.sinh(load / limit)
    with np.errstate(divide="ignore"):  # no load, no flow
        # As a logarithm, stress to the power n neither over- nor underflows.
        rates: FloatArray = np.sign(load) * np.exp(log_fluidity + exponent * np.log(np.abs(load)))
    return rates


def piezometer_grain_size(
    stress: float,
    reference_grain_size: FloatArray,
    exponent: FloatArray,
    stress_floor: FloatArray,
) -> FloatArray:
    """Grain size (m) that a stress (Pa) wants, d_1 (sqrt(stress^2 + floor^2)/1 MPa)^-m."""
    floored = np.hypot(stress, stress_floor) / UNITS["stress"]["MPa"]
    size: FloatArray = reference_grain_size * floored**-exponent
    return size


def fluidity(rates: FloatArray, sine: FloatArray, amplitude: float) -> FloatArray:
    """Return the dashpot's B = 1/(pi sigma_0) * integral of rate sin(x) dx, 1/(Pa s).

    Rates (1/s) are those of `dashpot_rates` at the nodes of `half_period`, the amplitude sigma_0 is
    in Pa. Both halves of the period give the same trapezoidal sum, so one is enough.
    """
    values: FloatArray = rates @ (2 / sine.size * sine) / amplitude
    return values


def cycle_strain(
    rates: FloatArray,
    sine: FloatArray,
    storage_amplitude: FloatArray,
    loss_amplitude: FloatArray,
    frequency: FloatArray,
) -> FloatArray:
    """Return the path strain of a settled cycle, the integral of |strain rate| over a period.

    Spring and Kelvin element strain at the rate omega (a cos(omega t) + b sin(omega t)), a and b
    (of shape draws + n_frequencies) being the storage and loss amplitude; the dashpot's rates are
    those of `dashpot_rates` at the nodes of `half_period`. The times x and pi - x differ in the
    sign of the cosine alone, and |u + v| + |u - v| = 2 max(|u|, |v|).
    """
    in_phase = 2 * np.pi * storage_amplitude
    behind = 2 * np.pi * loss_amplitude
    period = 1 / frequency
    total = np.zeros(np.broadcast_shapes(in_phase.shape, behind.shape))
    stride = max(1, sine.size // _NODES)  # the kink of |rate| limits it to about 1e-3 anyway
    nodes = range(stride // 2, sine.size, stride)
    for k in nodes:
        even = behind * sine[k] + rates[..., k, np.newaxis] * period
        odd = in_phase * np.sqrt(1 - sine[k] ** 2)
        total += np.maximum(np.abs(even), odd)
    path: FloatArray = total / len(nodes)
    return path
