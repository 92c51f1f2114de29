"""Closed forms of a frozen material (`stan/stress_cycles.stan`), of many draws at once.

They are the compliance, creep and relaxation times of a linear Kelvin part, and what the dashpot
adds under a hold and stress cycles.
"""

from collections.abc import Iterable, Mapping

import numpy as np
import numpy.typing as npt

from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.model.kelvin_elements import element_rows
from pyburgers.model.laws import (
    HARDENING_SWITCH,
    RELAXATION_TIMES,
    SPECTRUM_PARAMETERS,
    SPECTRUM_SWITCHES,
)
from pyburgers.model.parameters import KELVIN_REFERENCES, PROGRAM_PARAMETERS, STANDARD_VALUES

ELEMENT_ERROR = 1e-8
"""Of sums of elements, relative to the relaxed compliance."""

DIGITS = 17
"""Of the numbers that the program writes: a grain size in its steady state stays exactly that."""

N_DELAYS = 300
"""Frequencies at which a peak of a Kelvin part with many relaxation times is looked for."""

RELAXATION_PARAMETERS = (
    *SPECTRUM_PARAMETERS,
    *KELVIN_REFERENCES,
    *KELVIN_REFERENCES.values(),
)
"""Parameters that laws of the Kelvin part have beside modulus and viscosity."""

MODULUS_CHANGE = "modulus_temperature_coefficient"

NOTHING_ASKED: Mapping[str, object] = {
    **dict.fromkeys(("n_frequencies", "n_regimes", "n_sines", "n_times"), 0),
    **{
        name: [] for name in ("frequency", "median_stress", "amplitude", "node", "sine", "log_time")
    },
    "node_end": [0],
    "hold_time": 0.0,
}
"""Data of the program without frequencies, stresses and times."""


def closed_forms(
    parameters: Mapping[str, npt.ArrayLike],
    grain_size: FloatArray,
    *,
    temperature: float,
    fabric_factor: npt.ArrayLike = 1.0,
    stress: npt.ArrayLike = 0.0,
    asked: Mapping[str, object],
) -> dict[str, FloatArray]:
    """Return generated quantities of `stan/stress_cycles.stan`: shape of `grain_size`, their own.

    `parameters` (SI) and conditions (K, m, 1, Pa) are broadcast to the shape of `grain_size`.
    Without moduli and viscosity they are 1 (SI): the dashpot needs none. `asked` are data beside
    `NOTHING_ASKED`. Raises `InputError` if a number is not finite or the Maxwell modulus is not
    positive at the temperature, and `SamplingError` if the program stops.
    """
    shape = grain_size.shape
    given = {name: np.asarray(values, dtype=np.float64) for name, values in parameters.items()}
    state = [np.asarray(one, dtype=np.float64) for one in (grain_size, fabric_factor, stress)]
    columns = [*parameter_columns(given, shape), *(np.broadcast_to(one, shape) for one in state)]
    materials = np.stack(columns, axis=-1)
    if not np.isfinite(materials).all():
        raise InputError(
            "parameters: found draws that are not finite, expected finite numbers (SI)."
        )
    names = {name for times in RELAXATION_TIMES for name in (times.switch, times.width) if name}
    largest = {name: float(np.max(given.get(name, 0.0), initial=0.0)) for name in names}
    rows = element_rows(largest, ELEMENT_ERROR)
    data = {
        **NOTHING_ASKED,
        "temperature": temperature,
        "n_elements": len(rows),
        "element": rows,
        "n_delays": N_DELAYS if any(largest[name] for name in SPECTRUM_SWITCHES) else 0,
        **asked,
    }
    program = load_program(stan_directory() / "stress_cycles.stan")
    points = materials.reshape(-1, materials.shape[-1])
    solved, found = program.generate_at(data, "material", points, digits=DIGITS)
    if not solved.all():
        raise SamplingError("The closed form has no value at some draws; check their units (SI).")
    # It is linear in temperature, without a bound.
    negative = np.count_nonzero(found["maxwell_modulus"] <= 0)
    if negative:
        raise InputError(
            f"temperature: found {temperature:g} K, where the Maxwell modulus is not positive in "
            f"{negative} of {len(points)} draws, expected a temperature nearer to the fitted ones, "
            "or an elastic modulus that is given."
        )
    return {
        name: np.reshape(found[name][0], (*shape, *variable.dimensions))
        for name, variable in found.variables.items()
    }


def maxwell_modulus_at(parameters: Mapping[str, FloatArray], temperature: float) -> FloatArray:
    """Return E_M (Pa) at a temperature (K), for parameters (SI) of one shape, which it has too."""
    any_grain_size = np.ones_like(parameters["maxwell_modulus"])
    found = closed_forms(parameters, any_grain_size, temperature=temperature, asked={})
    return found["maxwell_modulus"]


def with_maxwell_modulus(
    parameters: Mapping[str, FloatArray], modulus: FloatArray
) -> dict[str, FloatArray]:
    """Return parameters (SI) with one E_M (Pa) at all temperatures, and the same delayed strain."""
    changed = {"maxwell_modulus": modulus}
    if MODULUS_CHANGE in parameters:
        changed[MODULUS_CHANGE] = np.zeros_like(modulus)
    if "peak_strength" in parameters:  # over 1/E_M
        relative = modulus / parameters["maxwell_modulus"]
        changed["peak_strength"] = parameters["peak_strength"] * relative
    return {**parameters, **changed}


def parameter_columns(
    parameters: Mapping[str, FloatArray], shape: tuple[int, ...]
) -> list[FloatArray]:
    """Return draws in the order of the programs, each of one shape (SI).

    A parameter that is not given has no effect: on a frozen microstructure, or on stresses without
    noise.
    """
    without = {"maxwell_modulus": 1.0, "kelvin_modulus": 1.0, "kelvin_viscosity": 1.0}
    return [
        np.broadcast_to(
            parameters.get(p.name, np.array(p.standard or without.get(p.name, 0.0))), shape
        )
        for p in PROGRAM_PARAMETERS
    ]


def require_standard(
    parameters: Mapping[str, npt.ArrayLike], names: Iterable[str], expected: str
) -> None:
    """Raise `InputError` if a parameter has another value than the one that leaves it no effect."""
    for name in names:
        standard = STANDARD_VALUES[name]
        if np.any(np.asarray(parameters.get(name, standard)) != standard):
            raise InputError(f"{name}: found values other than {standard:g}, expected {expected}.")


def require_no_backstress(parameters: Mapping[str, npt.ArrayLike]) -> None:
    """Raise `InputError` if the dashpot has a backstress, which stress cycles move in time."""
    require_standard(
        parameters,
        [HARDENING_SWITCH],
        "a dashpot without a backstress; fit and simulate stress cycles as a loading history "
        "(stress_series)",
    )
