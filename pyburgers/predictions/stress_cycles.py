"""Stress cycles about a median stress, the flow law, and checks of materials under them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real

import numpy as np
import numpy.typing as npt

from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError, nearest, require_type
from pyburgers.common.units import number
from pyburgers.kinds.attenuation.likelihood import stress_nodes
from pyburgers.kinds.stan_data import ends
from pyburgers.model.closed_forms import RELAXATION_PARAMETERS, closed_forms, require_standard
from pyburgers.model.display import STRESS_FACTOR, STRESS_UNIT, cycles_text
from pyburgers.model.laws import DASHPOT_STRESSES, HARDENING_SWITCH
from pyburgers.model.parameters import (
    ALL_ENVIRONMENT_NUMBERS,
    ENVIRONMENT,
    FURTHER_MECHANISMS,
    FURTHER_PARAMETERS,
    PIEZOMETER,
)
from pyburgers.model.priors import FLOW_LAW

PARAMETER_NAMES = (
    "maxwell_modulus",
    "kelvin_modulus",
    "kelvin_viscosity",
    *FLOW_LAW,
)
"""Parameters that a spectrum needs."""

EVOLUTION = (
    "critical_strain_grain_size",
    "critical_strain_fabric",
    "steady_state_grain_size",
    "steady_state_fabric_factor",
)
"""Parameters that say how the microstructure evolves."""

OTHER_PARAMETERS = (
    *RELAXATION_PARAMETERS,
    *DASHPOT_STRESSES,
    HARDENING_SWITCH,
    *FURTHER_PARAMETERS,
    *ALL_ENVIRONMENT_NUMBERS,
    *ENVIRONMENT,
    "modulus_temperature_coefficient",
    "modulus_reference_temperature",
    *PIEZOMETER,
    *EVOLUTION,
)
"""Parameters that may be left out: those of variants, and of an evolving microstructure."""

HOLD_TIME = 5400.0
"""Time (s) at the median stress before the cycles: the middle of the paper's 1 to 2 h."""

DRAW_DIMENSIONS = {0: (), 1: ("draw",), 2: ("chain", "draw")}


@dataclass(frozen=True)
class Regime:
    """An imposed axial stress: a median and the amplitude of the sinusoid on top.

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

    Examples
    --------
    >>> regime = pyburgers.Regime(median_stress=1e6, amplitude=0.2e6)
    """

    median_stress: float
    amplitude: float

    def __post_init__(self) -> None:
        """Check both stresses."""
        for name, stress in vars(self).items():
            require_type(name, stress, Real, "a stress in Pa")
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
        return cycles_text(self.median_stress, self.amplitude)


def asked_conditions(
    temperatures: Sequence[float],
    grain_size: float | None,
    *,
    frequencies: Sequence[float] | FloatArray = (),
    regimes: Sequence[Regime] = (),
) -> dict[str, tuple[float, float]]:
    """Return the ranges (SI) of conditions that a prediction is asked for, those that are given."""
    given: Mapping[str, Sequence[float] | FloatArray] = {
        "temperature": temperatures,
        "initial grain size": () if grain_size is None else (grain_size,),
        "period": 1 / np.asarray(frequencies, dtype=np.float64),
        "stress": [0.0] * bool(regimes) + [one.median_stress + one.amplitude for one in regimes],
    }
    return {name: (float(min(one)), float(max(one))) for name, one in given.items() if len(one)}


A_REGIME = "stresses, as of pyburgers.Regime(1e6, 1e5)"
PAPER_REGIMES = (
    Regime(1e6, 0.17e6),
    Regime(1.5e6, 0.5e6),
    Regime(2e6, 0.9e6),
    Regime(4e6, 1.5e6),
)
"""The regimes of the paper's Fig. 6."""

_PAPER_REGIME_BY_NAME = {number(r.median_stress * STRESS_FACTOR): r for r in PAPER_REGIMES}


def regimes_named(names: Sequence[str]) -> tuple[Regime, ...]:
    """Return some of the paper's regimes by their median stress in MPa, such as ``"1.5"``."""
    for name in names:
        if name not in _PAPER_REGIME_BY_NAME:
            raise InputError(
                f"regimes: unknown regime {name!r}, expected the median stress in {STRESS_UNIT} "
                f"of one of the paper's, {', '.join(_PAPER_REGIME_BY_NAME)}."
            )
    return tuple(_PAPER_REGIME_BY_NAME[name] for name in names)


def checked_inputs(
    parameters: Mapping[str, npt.ArrayLike],
    temperature: float,
    grain_size: npt.ArrayLike,
    fabric_factor: npt.ArrayLike,
) -> tuple[dict[str, FloatArray], FloatArray, FloatArray]:
    """Return draws, grain size (m) and fabric factor of one shape, or refuse them."""
    missing = [name for name in PARAMETER_NAMES if name not in parameters]
    if missing:
        raise InputError(f"parameters: {missing[0]!r} is missing, expected its draws.")
    draws = {
        name: np.asarray(parameters[name], dtype=np.float64)
        for name in (*PARAMETER_NAMES, *OTHER_PARAMETERS)
        if name in parameters
    }
    shape = draws[PARAMETER_NAMES[0]].shape
    for name, law in DASHPOT_STRESSES.items():
        if not law.closed_form:
            require_standard(
                parameters,
                [name],
                f"a dashpot of another law than {law.name} because stress cycles have no closed "
                "form with it; fit and simulate them as a loading history",
            )
    require_standard(
        parameters,
        [own[-1] for own in FURTHER_MECHANISMS.values()],
        "mechanisms side by side because stress cycles have no closed form with others; fit and "
        "simulate them as a loading history",
    )
    if len(shape) not in DRAW_DIMENSIONS:
        raise InputError(
            f"parameters: found draws of shape {shape}, expected (chain, draw), (draw,) or ()."
        )
    for name, values in draws.items():
        if values.shape != shape and not (name in OTHER_PARAMETERS and values.shape == ()):
            raise InputError(
                f"parameters: {name!r} has the shape {values.shape}, expected {shape} as "
                f"{PARAMETER_NAMES[0]!r} has."
            )
    size, fabric = (
        given_numbers("grain_size", grain_size),
        given_numbers("fabric_factor", fabric_factor),
    )
    for name, values in (("grain_size", size), ("fabric_factor", fabric)):
        if values.shape not in ((), shape):
            raise InputError(
                f"{name}: found the shape {values.shape}, expected one number or {shape}, that "
                "of the draws."
            )
    check_state(temperature, size, fabric)
    return draws, np.broadcast_to(size, shape), np.broadcast_to(fabric, shape)


def given_numbers(name: str, given: npt.ArrayLike) -> FloatArray:
    """Return an argument as an array; raise `InputError` if it does not hold numbers."""
    try:
        return np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name}: found {given!r:.60}, expected numbers.") from None


def check_state(
    temperature: npt.ArrayLike, grain_size: npt.ArrayLike, fabric_factor: npt.ArrayLike
) -> None:
    """Refuse temperatures (K), grain sizes (m) or fabric factors that no material has."""
    sizes = given_numbers("grain_size", grain_size)
    for name, unit, values in (
        ("temperature", " of K", given_numbers("temperature", temperature)),
        ("grain_size", " of m", sizes),
        ("fabric_factor", " (1 = isotropic)", given_numbers("fabric_factor", fabric_factor)),
    ):
        _check_positive(name, unit, values)
    if (sizes >= 1).any():
        raise InputError(
            f"grain_size: found {sizes.max():g} m, expected metres below 1; 230 um is 230e-6."
        )


def _check_positive(name: str, unit: str, values: FloatArray) -> None:
    wrong = values[~(np.isfinite(values) & (values > 0))]
    if wrong.size:
        raise InputError(f"{name}: found {wrong.flat[0]:g}, expected a positive number{unit}.")


def checked_frequencies(frequencies: Sequence[float] | FloatArray) -> FloatArray:
    """Return frequencies (Hz) as an array; raise `InputError` if one is not positive and finite."""
    frequency = given_numbers("frequencies", frequencies)
    if frequency.ndim != 1 or frequency.size == 0:
        raise InputError(
            f"frequencies: found an array of shape {frequency.shape}, expected a list of "
            "frequencies in Hz."
        )
    _check_positive("frequencies", " of Hz", frequency)
    return frequency


def checked_number(name: str, value: float, unit: str = "") -> float:
    """Return a number such as a length of the hold; raise `InputError` if it is not positive."""
    require_type(name, value, Real, f"a positive number{unit}")
    _check_positive(name, unit, np.asarray(value, dtype=np.float64))
    return float(value)


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
        name: given_numbers(name, parameters[name])
        for name in (
            *FLOW_LAW,
            *DASHPOT_STRESSES,
            *FURTHER_PARAMETERS,
            *ALL_ENVIRONMENT_NUMBERS,
            *ENVIRONMENT,
        )
        if name in parameters
    }
    of_stress = given_numbers("stress", stress)
    state = [np.asarray(one, dtype=np.float64) for one in (grain_size, fabric_factor, of_stress)]
    shapes = {one.shape: str(one.shape) for one in (*draws.values(), *state)}
    try:
        shape = np.broadcast_shapes(*shapes)
    except ValueError:
        raise InputError(
            f"parameters, stress, grain_size and fabric_factor: found the shapes "
            f"{', '.join(shapes.values())}, expected ones that broadcast against each other."
        ) from None
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
