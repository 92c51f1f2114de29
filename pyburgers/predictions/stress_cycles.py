"""Stress cycles about a median stress, and checks of what is driven by them.

What the closed form of the attenuation and the simulation in time have in common.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pyburgers.common.errors import InputError
from pyburgers.common.units import number
from pyburgers.model.display import STRESS_FACTOR, STRESS_UNIT
from pyburgers.model.laws import DASHPOT_STRESSES
from pyburgers.model.parameters import STANDARD_VALUES

FloatArray = npt.NDArray[np.float64]

PARAMETER_NAMES = (
    "maxwell_modulus",
    "kelvin_modulus",
    "kelvin_viscosity",
    "stress_exponent",
    "grain_size_exponent",
    "activation_enthalpy",
    "beta",
)
"""Parameters that a spectrum needs."""

BREAKDOWN = "breakdown_stress"
"""That of a dashpot which is a hyperbolic sine; 0, or left out, in all draws of a power law."""

HOLD_TIME = 5400.0
"""Time (s) at the median stress before the cycles: the middle of the paper's 1 to 2 h."""

MODULUS_OF_TEMPERATURE = ("modulus_temperature_coefficient", "modulus_reference_temperature")
"""By how much the Maxwell modulus changes with temperature, and where it is given."""

DRAW_DIMENSIONS = {0: (), 1: ("draw",), 2: ("chain", "draw")}


@dataclass(frozen=True)
class Regime:
    """An imposed stress: a median and the amplitude of the sinusoid on top.

    Attributes
    ----------
    median_stress : float
        sigma_m, Pa, not negative.
    amplitude : float
        sigma_0, Pa, positive; if it exceeds the median, stress changes sign.

    Raises
    ------
    InputError
        If one of the two is out of range or not finite.
    """

    median_stress: float
    amplitude: float

    def __post_init__(self) -> None:
        """Check both stresses."""
        if not (np.isfinite(self.median_stress) and self.median_stress >= 0):
            raise InputError(
                f"median_stress: found {self.median_stress:g} Pa, expected zero or a positive "
                "stress."
            )
        if not (np.isfinite(self.amplitude) and self.amplitude > 0):
            raise InputError(f"amplitude: found {self.amplitude:g} Pa, expected a positive stress.")

    @property
    def label(self) -> str:
        """Median and amplitude for legends, such as ``1 ± 0.17 MPa``."""
        median, amplitude = (
            number(stress * STRESS_FACTOR) for stress in (self.median_stress, self.amplitude)
        )
        return f"{median} ± {amplitude} {STRESS_UNIT}"


PAPER_REGIMES = (
    Regime(1e6, 0.17e6),
    Regime(1.5e6, 0.5e6),
    Regime(2e6, 0.9e6),
    Regime(4e6, 1.5e6),
)
"""The regimes of the paper's Fig. 6."""


_PAPER_REGIME_BY_NAME = {number(r.median_stress * STRESS_FACTOR): r for r in PAPER_REGIMES}


def regimes_named(names: Sequence[str]) -> tuple[Regime, ...]:
    """Return some of the paper's regimes by their median stress in MPa.

    Parameters
    ----------
    names : sequence of str
        Each one of ``"1"``, ``"1.5"``, ``"2"``, ``"4"``.

    Raises
    ------
    InputError
        If a name is none of these.
    """
    for name in names:
        if name not in _PAPER_REGIME_BY_NAME:
            raise InputError(
                f"regimes: unknown regime {name!r}, expected the median stress in {STRESS_UNIT} "
                f"of one of the paper's, {', '.join(_PAPER_REGIME_BY_NAME)}."
            )
    return tuple(_PAPER_REGIME_BY_NAME[name] for name in names)


def amplitude_regimes(median_stress: float, amplitudes: Sequence[float]) -> tuple[Regime, ...]:
    """Return regimes that share a median stress, to see what the amplitude does.

    Parameters
    ----------
    median_stress : float
        Pa.
    amplitudes : sequence of float
        Pa.

    Raises
    ------
    InputError
        If a stress is out of range (see `Regime`).
    """
    return tuple(Regime(median_stress, amplitude) for amplitude in amplitudes)


def checked_inputs(
    parameters: Mapping[str, npt.ArrayLike],
    temperature: float,
    grain_size: npt.ArrayLike,
    fabric_factor: npt.ArrayLike,
) -> tuple[dict[str, FloatArray], FloatArray, FloatArray]:
    """Return draws, grain size and fabric factor as arrays of one shape.

    Parameters
    ----------
    parameters, temperature, grain_size, fabric_factor
        As for `pyburgers.predictions.attenuation.attenuation_spectrum`.

    Raises
    ------
    InputError
        If a parameter is missing, shapes differ or a condition is not positive.
    """
    missing = [name for name in PARAMETER_NAMES if name not in parameters]
    if missing:
        raise InputError(f"parameters: {missing[0]!r} is missing, expected its draws.")
    draws = {name: np.asarray(parameters[name], dtype=np.float64) for name in PARAMETER_NAMES}
    shape = draws[PARAMETER_NAMES[0]].shape
    power_law = np.full(shape, STANDARD_VALUES[BREAKDOWN])
    draws[BREAKDOWN] = np.asarray(parameters.get(BREAKDOWN, power_law), dtype=np.float64)
    for name, law in DASHPOT_STRESSES.items():
        if not law.closed_form and np.any(np.asarray(parameters.get(name, 0.0)) != 0):
            raise InputError(
                f"{name}: found values other than 0, expected a dashpot of another law than "
                f"{law.name} because stress cycles have no closed form with it; fit and simulate "
                "them as a loading history."
            )
    if len(shape) not in DRAW_DIMENSIONS:
        raise InputError(
            f"parameters: found draws of shape {shape}, expected (chain, draw), (draw,) or ()."
        )
    for name, values in draws.items():
        if values.shape != shape:
            raise InputError(
                f"parameters: {name!r} has the shape {values.shape}, expected {shape} as "
                f"{PARAMETER_NAMES[0]!r} has."
            )
    _check_positive("temperature", "K", np.asarray(temperature, dtype=np.float64))
    frozen = []
    for name, unit, given in (
        ("grain_size", "m", grain_size),
        ("fabric_factor", "(1 = isotropic)", fabric_factor),
    ):
        values = np.asarray(given, dtype=np.float64)
        if values.shape not in ((), shape):
            raise InputError(
                f"{name}: found the shape {values.shape}, expected one number or {shape}, that "
                "of the draws."
            )
        _check_positive(name, unit, values)
        frozen.append(np.broadcast_to(values, shape))
    return draws, frozen[0], frozen[1]


def modulus_at(
    parameters: Mapping[str, npt.ArrayLike], modulus: FloatArray, temperature: float
) -> FloatArray:
    """Return the Maxwell modulus (Pa) at a temperature (K), E_M [1 + a_E (T - T_E)].

    Parameters
    ----------
    parameters : mapping of str to array
        With `MODULUS_OF_TEMPERATURE`, or it is the same at all temperatures.
    modulus : array, shape of the draws
        E_M, Pa.
    temperature : float
        K.
    """
    coefficient, reference = (
        np.asarray(parameters.get(name, STANDARD_VALUES[name]), dtype=np.float64)
        for name in MODULUS_OF_TEMPERATURE
    )
    return np.asarray(modulus * (1 + coefficient * (temperature - reference)))


def _check_positive(name: str, unit: str, values: FloatArray) -> None:
    wrong = values[~(np.isfinite(values) & (values > 0))]
    if wrong.size:
        raise InputError(f"{name}: found {wrong.flat[0]:g}, expected a positive number {unit}.")


def checked_frequencies(frequencies: Sequence[float] | FloatArray) -> FloatArray:
    """Return frequencies (Hz) as an array.

    Raises
    ------
    InputError
        If there is none, or one is not positive and finite.
    """
    frequency = np.asarray(frequencies, dtype=np.float64)
    if frequency.ndim != 1 or frequency.size == 0:
        raise InputError(
            f"frequencies: found an array of shape {frequency.shape}, expected a list of "
            "frequencies in Hz."
        )
    _check_positive("frequencies", "of Hz", frequency)
    return frequency


def checked_hold_time(hold_time: float) -> float:
    """Return the length of the hold (s).

    Raises
    ------
    InputError
        If it is not positive and finite.
    """
    if not (np.isfinite(hold_time) and hold_time > 0):
        raise InputError(f"hold_time: found {hold_time:g}, expected a positive number of s.")
    return float(hold_time)
