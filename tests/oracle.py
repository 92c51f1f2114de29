"""The model written out again, for tests only: scipy's solver, the paper's equations, SI units."""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp
from scipy.linalg import expm

FloatArray = npt.NDArray[np.float64]
GAS_CONSTANT = 8.314462618  # J/mol/K


def rate_factor(parameters: Mapping[str, float], temperature: float) -> float:
    """exp[Q_M (beta - 1/(R T))]."""
    exponent = parameters["activation_enthalpy"] * (
        parameters["beta"] - 1 / (GAS_CONSTANT * temperature)
    )
    return float(np.exp(exponent))


def dashpot_rate(
    parameters: Mapping[str, float],
    temperature: float,
    stress: FloatArray,
    grain_size: FloatArray,
    fabric: FloatArray,
) -> FloatArray:
    """Eq. 1 of the paper (1/s), odd in stress."""
    rate: FloatArray = (
        np.sign(stress)
        * (np.abs(stress) / fabric) ** parameters["stress_exponent"]
        * grain_size ** -parameters["grain_size_exponent"]
        * rate_factor(parameters, temperature)
    )
    return rate


def six_states(
    parameters: Mapping[str, float],
    temperature: float,
    initial_grain_size: float,
    segments: Sequence[tuple[float, float]],
    strain: FloatArray,
) -> FloatArray:
    """Solve the six equations in time from rest.

    Parameters
    ----------
    segments
        Start strain and rate (1/s) of each segment.
    strain
        Increasing strains at which to report.

    Returns
    -------
    array, shape (6, n)
        Stress, Kelvin strain, elastic strain, dashpot strain, grain size, fabric factor.
    """

    def rates(_time: float, state: FloatArray, strain_rate: float) -> FloatArray:
        stress, kelvin_strain, _, _, grain_size, fabric = state
        kelvin = (stress - parameters["kelvin_modulus"] * kelvin_strain) / parameters[
            "kelvin_viscosity"
        ]
        dashpot = dashpot_rate(parameters, temperature, stress, grain_size, fabric)
        elastic = strain_rate - kelvin - dashpot
        return np.array(
            [
                parameters["maxwell_modulus"] * elastic,
                kelvin,
                elastic,
                dashpot,
                strain_rate
                * (parameters["steady_state_grain_size"] - grain_size)
                / parameters["critical_strain_grain_size"],
                strain_rate
                * (parameters["steady_state_fabric_factor"] - fabric)
                / parameters["critical_strain_fabric"],
            ]
        )

    state = np.array([0.0, 0.0, 0.0, 0.0, initial_grain_size, 1.0])
    starts = [start for start, _ in segments]
    reported = []
    for (start, strain_rate), end in zip(segments, [*starts[1:], strain[-1]], strict=True):
        inside = strain[(strain > start) & (strain <= end)]
        times = np.append(inside, end) - start
        solution = solve_ivp(
            rates,
            (0.0, times[-1] / strain_rate),
            state,
            method="LSODA",
            t_eval=np.unique(times / strain_rate),
            rtol=1e-11,
            atol=[1e-3, 1e-14, 1e-14, 1e-14, 1e-17, 1e-13],
            args=(strain_rate,),
        )
        assert solution.success, solution.message
        reported.append(solution.y[:, : inside.size])
        state = solution.y[:, -1]
    return np.concatenate(reported, axis=1)


def linear_stress(
    parameters: Mapping[str, float],
    temperature: float,
    segments: Sequence[tuple[float, float]],
    strain: FloatArray,
) -> FloatArray:
    """Stress (Pa) where n = 1, p = 0 and F = 1, by the matrix exponential.

    The state is [stress, Kelvin strain, 1]; its last entry carries the imposed rate.
    """
    modulus = parameters["maxwell_modulus"]
    kelvin_modulus = parameters["kelvin_modulus"]
    viscosity = parameters["kelvin_viscosity"]
    fluidity = rate_factor(parameters, temperature)
    state = np.array([0.0, 0.0, 1.0])
    starts = [start for start, _ in segments]
    stress = []
    for (start, strain_rate), end in zip(segments, [*starts[1:], strain[-1]], strict=True):
        system = np.array(
            [
                [
                    -modulus * (1 / viscosity + fluidity),
                    modulus * kelvin_modulus / viscosity,
                    modulus * strain_rate,
                ],
                [1 / viscosity, -kelvin_modulus / viscosity, 0.0],
                [0.0, 0.0, 0.0],
            ]
        )
        inside = strain[(strain > start) & (strain <= end)]
        stress += [(expm(system * (e - start) / strain_rate) @ state)[0] for e in inside]
        state = expm(system * (end - start) / strain_rate) @ state
    return np.array(stress)
