"""Stress-controlled cycles in time: simulation, through the Stan program, and phase lag.

The time-domain counterpart of `pyburgers.predictions.attenuation`: the median stress is put on a
material at rest, held, and a sinusoid is added; the microstructure is frozen, or evolves.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.model.parameters import PIEZOMETER, PROGRAM_PARAMETERS
from pyburgers.model.relaxation import (
    RELAXATION_PARAMETERS,
    require_one_relaxation_time,
)
from pyburgers.predictions.assumptions import EVOLUTION
from pyburgers.predictions.stress_cycles import (
    BREAKDOWN,
    HOLD_TIME,
    MODULUS_OF_TEMPERATURE,
    Regime,
    checked_frequencies,
    checked_hold_time,
    checked_inputs,
    modulus_at,
)
from pyburgers.protocols.forced_oscillation.harmonics import (
    N_HARMONICS,
    HarmonicFit,
    choose_degree,
    fit_harmonics,
)
from pyburgers.protocols.forward import check_given_together
from pyburgers.protocols.stan_data import SolverOptions, solver_block

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PhaseLag:
    """Lag of the strain behind the stress at the fundamental.

    Attributes
    ----------
    radians, standard_error : float
        Phase of the stress minus that of the strain (rad), in (-pi, pi]; positive where strain
        lags stress, as in a dissipating material.
    tan_delta, tan_delta_standard_error : float
        Attenuation 1/Q, the tangent of the lag, and its standard error to first order.
    strain_amplitude, strain_amplitude_standard_error : float
        Of the fundamental, in the unit of the strain.
    stress_amplitude, stress_amplitude_standard_error : float
        Of the fundamental, in the unit of the stress.
    """

    radians: float
    standard_error: float
    tan_delta: float
    tan_delta_standard_error: float
    strain_amplitude: float
    strain_amplitude_standard_error: float
    stress_amplitude: float
    stress_amplitude_standard_error: float


def phase_lag(
    strain_time: FloatArray,
    strain: FloatArray,
    stress_time: FloatArray,
    stress: FloatArray,
    *,
    period: float,
    strain_uncertainty: FloatArray | None = None,
    stress_uncertainty: FloatArray | None = None,
    degree: int | None = None,
    n_harmonics: int = N_HARMONICS,
) -> PhaseLag:
    """Measure by how much strain lags stress.

    Each series is fitted with harmonics and a polynomial trend of its own
    (`pyburgers.protocols.forced_oscillation.harmonics`); the lag is the difference of the
    fundamental phases (cf. Maor,
    arXiv:2407.03533). Without harmonics a nonlinear record of few cycles is biased.

    Parameters
    ----------
    strain_time, strain : array, shape (n_strain,)
        Increasing times (s) and strains.
    stress_time, stress : array, shape (n_stress,)
        Increasing times (s) on a clock with the same origin, and stresses.
    period : float
        Period of the fundamental (s).
    strain_uncertainty, stress_uncertainty : array, optional
        Standard deviations of the readings; by default the scatter about the fit is taken.
    degree : int, optional
        Degree of both trends; by default chosen for each series
        (`pyburgers.protocols.forced_oscillation.harmonics.choose_degree`).
    n_harmonics : int
        Harmonics, the fundamental included.

    Raises
    ------
    InputError
        If the readings do not suffice for the fits.
    """

    def fit(
        name: str, time: FloatArray, value: FloatArray, uncertainty: FloatArray | None
    ) -> HarmonicFit:
        given: dict[str, Any] = {
            "period": period,
            "n_harmonics": n_harmonics,
            "uncertainty": uncertainty,
        }
        try:
            chosen = choose_degree(time, value, **given) if degree is None else degree
            return fit_harmonics(time, value, degree=chosen, **given)
        except InputError as error:
            raise InputError(f"{name}: {error}") from None

    strain_fit = fit("strain", strain_time, strain, strain_uncertainty)
    stress_fit = fit("stress", stress_time, stress, stress_uncertainty)
    strain_phase, strain_error = strain_fit.phase()
    stress_phase, stress_error = stress_fit.phase()
    # The remainder lies in [-pi, pi]: the one end stands for the other.
    radians = math.remainder(stress_phase - strain_phase, 2.0 * math.pi)
    radians = math.pi if radians == -math.pi else radians
    error = math.hypot(strain_error, stress_error)
    tan_delta = math.tan(radians)
    return PhaseLag(
        radians,
        error,
        tan_delta,
        (1.0 + tan_delta**2) * error,
        *strain_fit.amplitude(),
        *stress_fit.amplitude(),
    )


OTHER_PARAMETERS = (
    *RELAXATION_PARAMETERS,
    BREAKDOWN,
    *MODULUS_OF_TEMPERATURE,
    *PIEZOMETER,
    *EVOLUTION,
)
"""Parameters of variants, which may be left out, and of an evolving microstructure."""

SOLVER = SolverOptions(tolerance=1e-12, max_num_steps=1_000_000)
"""A phase is wrong by about a thousand times the tolerance; steps cost next to nothing here."""

SETTLING_TIMES = 30.0
"""Relaxation times of the Kelvin element after which its start-up transient is below 1e-13."""


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
    """Solve the model for a hold at the median stress and the cycles after it.

    Parameters
    ----------
    parameters : mapping of str to float
        `pyburgers.predictions.stress_cycles.PARAMETER_NAMES` (SI), where the microstructure evolves
        `pyburgers.predictions.assumptions.EVOLUTION`, and those of variants that are in use; others
        are ignored.
    regime : Regime
        Median stress and amplitude.
    frequency : float
        Hz.
    time : array, shape (n,)
        Seconds since the cycles started, increasing, all greater than ``-hold_time``. The start of
        the cycles, 0, is added.
    temperature, grain_size, fabric_factor : float
        K, m, 1; the last two at the start of the hold, and constant unless they evolve.
    hold_time : float
        Seconds between putting the median stress on and the cycles.
    evolving : bool
        Whether grain size and fabric evolve with the path strain, in the hold too.
    solver : SolverOptions
        Tolerance and step limit.

    Returns
    -------
    DataFrame
        Columns time_s, stress_Pa, strain, kelvin_strain, dashpot_strain; if `evolving` also
        path_strain, grain_size_m, fabric_factor.

    Raises
    ------
    InputError
        If an argument is wrong.
    SamplingError
        If the solver finds no solution.
    """
    values, size, fabric = checked_inputs(parameters, temperature, grain_size, fabric_factor)
    if size.ndim != 0:
        raise InputError(
            f"parameters: found draws of shape {size.shape}, expected a number for each parameter."
        )
    times = _with_start_of_cycles(time, hold_time)
    given = {name: parameters[name] for name in OTHER_PARAMETERS if name in parameters}
    solution = solve_imposed_stress(
        {
            name: np.atleast_1d(np.asarray(value, dtype=np.float64))
            for name, value in {**values, **given}.items()
        },
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
    """Solve for several materials at once, in one process.

    Parameters
    ----------
    parameters : mapping of str to array, shape (n_materials,)
        As for `simulate_imposed_stress`.
    regime, frequency, temperature, hold_time, evolving, solver
        As for `simulate_imposed_stress`.
    time : array, shape (n_times,)
        As there, with 0.
    grain_size, fabric_factor : array, shape (n_materials,)
        m, 1; at the start of the hold.

    Returns
    -------
    dict of str to array
        ``stress`` (Pa), shape (n_times,); ``strain``, ``kelvin_strain``, ``dashpot_strain`` and, if
        `evolving`, ``path_strain``, ``grain_size``, ``fabric_factor``, (n_materials, n_times).

    Raises
    ------
    InputError
        If a parameter is missing.
    SamplingError
        If the solver finds no solution.
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
    # The program takes the modulus as it is at the temperature of the cycles.
    given = {
        **parameters,
        "maxwell_modulus": modulus_at(parameters, parameters["maxwell_modulus"], temperature),
    }
    # What has no value has no effect: on a frozen microstructure, or on stresses without noise.
    columns = [
        np.broadcast_to(given.get(p.name, np.array(p.standard or 0.0)), grain_size.shape)
        for p in PROGRAM_PARAMETERS
    ]
    data = {
        **solver_block(solver),
        "n_materials": grain_size.size,
        "parameter": np.stack(columns, axis=-1).tolist(),
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
    """Return times of whole cycles that start when the Kelvin element has settled into them.

    Parameters
    ----------
    kelvin_time : float
        Its relaxation time eta_K/E_K, s.
    frequency : float
        Hz.
    cycles, readings_per_cycle : int
        Size of the record.

    Returns
    -------
    array, shape (cycles * readings_per_cycle,)
        Seconds since the cycles started, evenly spaced.
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
    """Simulate settled cycles and read the phase lag off the record, as of a measured one.

    A power-law Kelvin element settles more slowly than `settled_times` allows for; simulate longer
    with `simulate_imposed_stress` there.

    Parameters
    ----------
    parameters, regime, frequency, temperature, grain_size, fabric_factor
        As for `simulate_imposed_stress`.
    cycles : int
        Length of the record.
    n_harmonics : int
        Of each signal; those left out of a nonlinear record bias the phase a little.

    Returns
    -------
    PhaseLag
        To be compared with `pyburgers.predictions.attenuation.attenuation_spectrum`.

    Raises
    ------
    InputError
        If an argument is wrong.
    SamplingError
        If the solver finds no solution.
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
    time, strain, stress = (record[name].to_numpy() for name in ("time_s", "strain", "stress_Pa"))
    # With the microstructure frozen the settled strain drifts at a constant rate.
    return phase_lag(
        time, strain, time, stress, period=1 / frequency, degree=1, n_harmonics=n_harmonics
    )


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
