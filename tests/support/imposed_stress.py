"""Stress cycles of one material in time by the solver of predictions, and their phase lag."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.forced_oscillation.harmonics import fit_harmonics
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.predictions.evolving import solve_imposed_stress
from pyburgers.predictions.stress_cycles import HOLD_TIME, Regime, checked_inputs

TEMPERATURE, GRAIN_SIZE = 260.0, 2e-4
ICE: dict[str, float] = {
    "maxwell_modulus": 4e9,
    "kelvin_modulus": 5e8,
    "kelvin_viscosity": 1e11,
    "stress_exponent": 3.7,
    "grain_size_exponent": 0.5,
    "activation_enthalpy": 61.5e3,
    "beta": -7.29e-4,
    "critical_strain_grain_size": 0.07,
    "critical_strain_fabric": 0.2,
    "steady_state_grain_size": 1e-4,
    "steady_state_fabric_factor": 0.5,
}

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

    Times (s) count from the start of the cycles and are greater than ``-hold_time``; 0 is added.
    """
    values, size, fabric = checked_inputs(parameters, temperature, grain_size, fabric_factor)
    times = np.union1d(time, [0.0])
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
