"""Closed forms of a frozen material under a hold and stress cycles: rates, fluidity, strain.

Draws are arrays of one shape; regimes and frequencies are further dimensions behind it.
"""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from pyburgers.common.units import UNITS
from pyburgers.model.arrhenius import GAS_CONSTANT
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
    """Strain rate of the dashpot where sin(omega t) has given values.

    Parameters
    ----------
    draws : mapping of str to array
        As of `pyburgers.predictions.stress_cycles.checked_inputs`.
    regime : Regime
        Median stress and amplitude.
    sine : array, shape (n,)
        sin(omega t); 0 is the hold.
    temperature, grain_size, fabric_factor
        K, m, 1.

    Returns
    -------
    array, shape of the draws + (n,)
        1/s.
    """
    exponent = draws["stress_exponent"]
    log_fluidity = (
        draws["activation_enthalpy"] * (draws["beta"] - 1 / (GAS_CONSTANT * temperature))
        - draws["grain_size_exponent"] * np.log(grain_size)
        - exponent * np.log(fabric_factor)
    )
    stress = regime.median_stress + regime.amplitude * np.append(sine, 1.0)  # and its peak
    breakdown = (draws[BREAKDOWN] * fabric_factor)[..., np.newaxis]
    if breakdown.any():
        stress = breakdown * np.sinh(stress / breakdown)
    # Relative to its peak, stress to the power n neither over- nor underflows.
    peak = stress[..., -1]
    relative = stress[..., :-1] / peak[..., np.newaxis]
    largest_rate = np.exp(log_fluidity + exponent * np.log(peak))
    rates: FloatArray = largest_rate[..., np.newaxis] * (
        np.sign(relative) * np.abs(relative) ** exponent[..., np.newaxis]
    )
    return rates


def piezometer_grain_size(
    stress: float,
    reference_grain_size: FloatArray,
    exponent: FloatArray,
    stress_floor: FloatArray,
) -> FloatArray:
    """Return the grain size that a stress wants, d_1 (sqrt(stress^2 + floor^2)/1 MPa)^-m.

    Parameters
    ----------
    stress : float
        Pa.
    reference_grain_size, exponent, stress_floor : array, shape of the draws
        d_1 (m), m, and Pa.
    """
    floored = np.hypot(stress, stress_floor) / UNITS["stress"]["MPa"]
    size: FloatArray = reference_grain_size * floored**-exponent
    return size


def fluidity(rates: FloatArray, sine: FloatArray, amplitude: float) -> FloatArray:
    """Return the dashpot's B = 1/(pi sigma_0) * integral of rate sin(x) dx, 1/(Pa s).

    Both halves of the period give the same trapezoidal sum, so one is enough.

    Parameters
    ----------
    rates : array, shape of the draws + (n,)
        At the nodes (`dashpot_rates`).
    sine : array, shape (n,)
        Nodes (`half_period`).
    amplitude : float
        sigma_0, Pa.
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

    Spring and Kelvin element strain at the rate omega (a cos(omega t) + b sin(omega t)). The times
    x and pi - x differ in the sign of the cosine alone, and |u + v| + |u - v| = 2 max(|u|, |v|).

    Parameters
    ----------
    rates : array, shape of the draws + (n,)
        Of the dashpot at the nodes (`dashpot_rates`), 1/s.
    sine : array, shape (n,)
        Nodes (`half_period`).
    storage_amplitude, loss_amplitude : array, shape of the draws + (n_frequencies,)
        a and b, strain amplitudes of spring and Kelvin element in phase and behind.
    frequency : array, shape (n_frequencies,)
        Hz.

    Returns
    -------
    array, shape of the draws + (n_frequencies,)
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
