"""Loading histories solved with scipy: the equations as the paper prints them, SI units."""

from collections.abc import Mapping, Sequence

import numpy as np
import oracle
from scipy.integrate import solve_ivp
from scipy.special import lambertw

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.loading_history.stages import Leg

STRESS, STRAIN, KELVIN, DASHPOT, PATH, GRAINS, FABRIC, BACKSTRESS = range(8)
"""Rows of a solution: Pa, fractions, m, F and Pa."""


def history(
    parameters: Mapping[str, float],
    initial_grain_size: float,
    legs: Sequence[Leg],
    times: Sequence[FloatArray],
) -> FloatArray:
    """Solution of a test that starts from rest, at times (s) of each leg, shape (8, n_times).

    Every state has a rate of its own: nothing is known in advance, nothing is eliminated. A force
    (Pa over the first area) acts on an area that follows from the strain of the sample.
    """
    elastic = 1 / parameters["maxwell_modulus"]
    start = parameters.get("initial_backstress", 0.0)
    state = np.array([0.0, 0.0, 0.0, 0.0, 0.0, initial_grain_size, 1.0, start])
    parts = []
    for leg, wanted in zip(legs, times, strict=True):
        if leg.driven == "stress":
            stress = leg.start_value
            if leg.is_force:  # sigma = f exp(-sigma/E_M - creep)
                creep = state[KELVIN] + state[DASHPOT]
                stress = float(lambertw(elastic * stress * np.exp(-creep)).real) / elastic
            jump = stress - state[STRESS]
            state = state.copy()
            state[STRESS] = stress
            state[STRAIN] += (elastic + parameters.get("apparatus_compliance", 0.0)) * jump
            _deform(state, parameters, elastic * abs(jump))
        duration = leg.end_time - leg.start_time
        since = np.minimum(wanted - leg.start_time, duration)
        solved = solve_ivp(
            _rates,
            (0.0, duration),
            state,
            method="LSODA",
            rtol=1e-11,
            args=(parameters, leg),
            atol=1e-13 * np.array([1e8, 1, 1, 1, 1, 1e-3, 1, 1e8]),
            t_eval=(outputs := np.unique(np.append(since, duration))),
        )
        assert solved.success, solved.message
        parts.append(solved.y[:, np.searchsorted(outputs, since)])
        state = solved.y[:, -1]
    return np.concatenate(parts, axis=1)


def at_rates(
    parameters: Mapping[str, float],
    temperature: float,
    initial_grain_size: float,
    segments: Sequence[tuple[float, float]],
    strain: FloatArray,
) -> FloatArray:
    """Solution at increasing strains of segments with a start strain and a rate (1/s), (8, n)."""
    legs, times, now = [], [], 0.0
    ends = [*(start for start, _ in segments[1:]), strain[-1]]
    for (start, rate), end in zip(segments, ends, strict=True):
        legs.append(Leg("strain", now, now + (end - start) / rate, 0.0, rate, temperature, 0))
        inside = strain[(strain > start) & (strain <= end)]
        times.append(now + (inside - start) / rate)
        now = legs[-1].end_time
    return history(parameters, initial_grain_size, legs, times)


def _deform(state: FloatArray, parameters: Mapping[str, float], path: float) -> None:
    """Let the microstructure evolve over a path strain at once."""
    state[PATH] += path
    wanted = oracle.wanted_grain_size(parameters, state[STRESS])
    for row, steady, critical in (
        (GRAINS, wanted, "critical_strain_grain_size"),
        (FABRIC, parameters["steady_state_fabric_factor"], "critical_strain_fabric"),
    ):
        state[row] = steady + (state[row] - steady) * np.exp(-path / parameters[critical])


def _rates(
    _time: float, state: FloatArray, parameters: Mapping[str, float], leg: Leg
) -> FloatArray:
    """Rates of all states in a leg."""
    stress, grains, fabric = state[STRESS], state[GRAINS], state[FABRIC]
    apparatus = parameters.get("apparatus_compliance", 0.0)
    elastic = 1 / parameters["maxwell_modulus"]
    kelvin = oracle.kelvin_rate(parameters, leg.temperature, stress, state[KELVIN])
    dashpot, first = map(
        float,
        oracle.all_rates(parameters, leg.temperature, stress, state[BACKSTRESS], grains, fabric),
    )
    if leg.driven == "stress":
        stress_rate = leg.rate
        if leg.is_force:  # d ln(sigma) = d ln(f) - d strain
            area = np.exp(-elastic * stress - state[KELVIN] - state[DASHPOT])
            creep = stress * (kelvin + dashpot)
            stress_rate = (leg.rate * area - creep) / (1 + elastic * stress)
    else:
        stress_rate = (leg.rate - kelvin - dashpot) / (elastic + apparatus)
    specimen = elastic * stress_rate + kelvin + dashpot
    wanted = oracle.wanted_grain_size(parameters, stress)
    return np.array(
        [
            stress_rate,
            specimen + apparatus * stress_rate,
            kelvin,
            dashpot,
            abs(specimen),
            abs(specimen) * (wanted - grains) / parameters["critical_strain_grain_size"],
            abs(specimen)
            * (parameters["steady_state_fabric_factor"] - fabric)
            / parameters["critical_strain_fabric"],
            oracle.backstress_rate(parameters, leg.temperature, state[BACKSTRESS], first, grains),
        ]
    )
