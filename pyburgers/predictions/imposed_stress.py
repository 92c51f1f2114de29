"""Stress-controlled cycles in time, solved by `stan/imposed_stress.stan`.

The median stress is put on a material at rest, held, and a sinusoid is added; the microstructure is
frozen, or evolves.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.kinds.forced_oscillation.harmonics import fit_harmonics
from pyburgers.kinds.forward import check_given_together
from pyburgers.kinds.stan_data import SolverOptions, solver_block
from pyburgers.model.closed_forms import parameter_columns, require_one_relaxation_time
from pyburgers.predictions.stress_cycles import (
    EVOLUTION,
    HOLD_TIME,
    OTHER_PARAMETERS,
    Regime,
    checked_frequencies,
    checked_hold_time,
    checked_inputs,
)

SOLVER = SolverOptions(tolerance=1e-12, max_num_steps=1_000_000)
"""A phase is wrong by about a thousand times the tolerance; steps cost next to nothing here."""

SETTLING_TIMES = 30.0
"""Relaxation times of the Kelvin element after which its start-up transient is below 1e-13."""


@dataclass(frozen=True)
class PhaseLag:
    """Lag of the strain behind the stress at the fundamental (rad), and its tangent, 1/Q."""

    radians: float
    tan_delta: float


def simulate_imposed_stress(
    parameters: Mapping[str, float],
    regime: Regime,
    frequency: float,
    time: FloatArray,
    *,
    temperature: float,
    grain_size: float,
    fabric_factor: float = 1.0,
    hold_time: float = HOLD_TIME,
    evolving: bool = False,
    solver: SolverOptions = SOLVER,
) -> pd.DataFrame:
    """Solve a material (SI) under a hold at the median stress and the cycles after it.

    Times (s) count from the start of the cycles, increase and are greater than ``-hold_time``; 0 is
    added. The columns are time_s, stress_Pa, strain, kelvin_strain and dashpot_strain, and of an
    evolving microstructure path_strain, grain_size_m and fabric_factor. Raises `InputError` if an
    argument is wrong, and `SamplingError` if the solver finds no solution.
    """
    values, size, fabric = checked_inputs(parameters, temperature, grain_size, fabric_factor)
    if size.ndim != 0:
        raise InputError(
            f"parameters: found draws of shape {size.shape}, expected a number for each parameter."
        )
    times = _with_start_of_cycles(time, hold_time)
    solution = solve_imposed_stress(
        {name: np.atleast_1d(value) for name, value in values.items()},
        regime,
        frequency,
        times,
        temperature=temperature,
        grain_size=np.atleast_1d(size),
        fabric_factor=np.atleast_1d(fabric),
        hold_time=hold_time,
        evolving=evolving,
        solver=solver,
    )
    strains = ("strain", "kelvin_strain", "dashpot_strain")
    columns = {"time_s": times, "stress_Pa": solution["stress"]}
    columns |= {name: solution[name][0] for name in strains}
    if evolving:
        columns |= {
            "path_strain": solution["path_strain"][0],
            "grain_size_m": solution["grain_size"][0],
            "fabric_factor": solution["fabric_factor"][0],
        }
    return pd.DataFrame(columns)


def solve_imposed_stress(
    parameters: Mapping[str, FloatArray],
    regime: Regime,
    frequency: float,
    time: FloatArray,
    *,
    temperature: float,
    grain_size: FloatArray,
    fabric_factor: FloatArray,
    hold_time: float,
    evolving: bool,
    solver: SolverOptions,
) -> dict[str, FloatArray]:
    """Solve for several materials at once, as `simulate_imposed_stress` does for one.

    Parameters, grain size (m) and fabric have the shape (n_materials,); 0 is among the times.
    ``stress`` (Pa) has the shape (n_times,). ``strain``, ``kelvin_strain``, ``dashpot_strain``, and
    of an evolving microstructure ``path_strain``, ``grain_size`` and ``fabric_factor``, have
    (n_materials, n_times).
    """
    checked_frequencies([frequency])
    require_one_relaxation_time(parameters)
    check_given_together(
        {name: float(np.max(parameters[name])) for name in OTHER_PARAMETERS if name in parameters},
        "parameters",
    )
    missing = [name for name in EVOLUTION if evolving and name not in parameters]
    if missing:
        raise InputError(
            f"parameters: {missing[0]!r} is missing, expected it where the microstructure evolves."
        )
    data = {
        **solver_block(solver),
        "n_materials": grain_size.size,
        "parameter": np.stack(parameter_columns(parameters, grain_size.shape), axis=-1).tolist(),
        "initial": np.stack([grain_size, fabric_factor], axis=-1).tolist(),
        "evolves": int(evolving),
        "temperature": temperature,
        "median_stress": regime.median_stress,
        "amplitude": regime.amplitude,
        "frequency": frequency,
        "hold_time": hold_time,
        "n_times": time.size,
        "time": time.tolist(),
        "n_in_hold": int(np.count_nonzero(time <= 0)),
    }
    solution = load_program(stan_directory() / "imposed_stress.stan").evaluate(data)
    if not np.isfinite(solution["strain"]).all():
        raise SamplingError(
            "The solver found no finite strain at these parameters; check their units (SI) and "
            "the sign of beta."
        )
    return solution


def settled_times(
    kelvin_time: float, frequency: float, *, cycles: int = 6, readings_per_cycle: int = 64
) -> FloatArray:
    """Return times (s) of whole cycles, evenly spaced, from where a Kelvin element has settled.

    Its relaxation time is in s, the frequency in Hz; the shape is (cycles * readings_per_cycle,).
    """
    skipped = int(np.ceil(SETTLING_TIMES * kelvin_time * frequency))
    readings = np.arange(1, cycles * readings_per_cycle + 1)
    times: FloatArray = (skipped + readings / readings_per_cycle) / frequency
    return times


def simulated_phase_lag(
    parameters: Mapping[str, float],
    regime: Regime,
    frequency: float,
    *,
    temperature: float,
    grain_size: float,
    fabric_factor: float = 1.0,
    cycles: int = 6,
    n_harmonics: int = 3,
) -> PhaseLag:
    """Simulate settled cycles and fit harmonics to the strain, as to a measured one.

    Harmonics that are left out bias the phase a little. A power-law Kelvin element settles more
    slowly than `settled_times` allows for. Raises as `simulate_imposed_stress` does.
    """
    values, _, _ = checked_inputs(parameters, temperature, grain_size, fabric_factor)
    kelvin_time = float(values["kelvin_viscosity"] / values["kelvin_modulus"])
    record = simulate_imposed_stress(
        parameters,
        regime,
        frequency,
        settled_times(kelvin_time, frequency, cycles=cycles),
        temperature=temperature,
        grain_size=grain_size,
        fabric_factor=fabric_factor,
    ).iloc[1:]  # the start of the cycles is no part of the record
    time, strain = (record[name].to_numpy() for name in ("time_s", "strain"))
    # With the microstructure frozen the settled strain drifts at a constant rate.
    fit = fit_harmonics(time, strain, period=1 / frequency, degree=1, n_harmonics=n_harmonics)
    strain_phase, _ = fit.phase()
    return PhaseLag(-strain_phase, math.tan(-strain_phase))


def _with_start_of_cycles(time: FloatArray, hold_time: float) -> FloatArray:
    """Check output times and add 0."""
    checked_hold_time(hold_time)
    times = np.asarray(time, dtype=np.float64)
    if not np.isfinite(times).all() or (np.diff(times) <= 0).any() or (times <= -hold_time).any():
        raise InputError(
            f"time: found values that are not increasing or not greater than {-hold_time:g} s, "
            "expected increasing times after the start of the hold."
        )
    return np.union1d(times, [0.0])
