"""Kelvin parts with many relaxation times in loading histories: sums of elements in time."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from linear_bodies import LAWS, linear_body
from scipy.integrate import solve_ivp

from pyburgers.cmdstan.program import load_program
from pyburgers.model.kelvin_laws import PARAMETERS_OF_LAW
from pyburgers.model.parameters import PROGRAM_PARAMETERS
from pyburgers.model.prior_families import fixed_prior
from pyburgers.model.priors import default_priors
from pyburgers.model.relaxation import kelvin_part
from pyburgers.protocols.loading_history.kelvin_rows import ELEMENT_ERROR, elements_block

FloatArray = npt.NDArray[np.float64]

VALUES = Path(__file__).with_name("loading_history_values.stan")
GRAIN_SIZE, TEMPERATURE = 2e-4, 263.0
VISCOSITY = 5e13
LINEAR = linear_body(VISCOSITY, 3e12, TEMPERATURE, GRAIN_SIZE)
"""Its longest relaxation time is 3000 s."""


def solve(
    values: Mapping[str, float], legs: Sequence[Sequence[float]], times: Sequence[FloatArray]
) -> FloatArray:
    """Stress (Pa), strain, Kelvin, path and dashpot strain, d/d_0, Kelvin rate: shape (7, n).

    Parameters
    ----------
    legs : sequence
        Rows: whether stress is imposed, duration (s), stress at the start (Pa), rate, temperature.
    times : sequence of array
        Since the start of each leg, over its duration.
    """
    names = [name for name in PARAMETERS_OF_LAW["extended_peak"] if name in values]
    priors = default_priors("ice").exchanging(
        *(fixed_prior(p, values[p.name], "given") for p in PROGRAM_PARAMETERS if p.name in names)
    )
    data = {
        "n_legs": len(legs),
        "n_times": sum(map(len, times)),
        "parameter": [values[p.name] for p in PROGRAM_PARAMETERS],
        "leg": [list(leg) for leg in legs],
        "time": np.concatenate(times).tolist(),
        "n_in_leg": [len(at) for at in times],
        "initial_grain_size": GRAIN_SIZE,
        "stress_scale": 1e7,
        "strain_scale": 1e-2,
        "tolerance": 1e-10,
        **elements_block([priors]),
    }
    return np.asarray(load_program(VALUES).evaluate(data)["solution"]).T


def creep(values: Mapping[str, float], time: FloatArray) -> FloatArray:
    """Strain over the stress that was put on some times (s) ago, 1/Pa."""
    kelvin = kelvin_part(values, TEMPERATURE, np.array(GRAIN_SIZE))
    recoverable = np.array([1 / values["maxwell_modulus"] + kelvin.creep(t) for t in time])
    return np.where(time >= 0, recoverable + time / VISCOSITY, 0.0)


@pytest.mark.parametrize("law", LAWS)
def test_creep_and_recovery_are_those_of_the_integral(law: str) -> None:
    values = {**LINEAR, **LAWS[law]}
    stress, loaded, rest = 2e6, 4e3, 2e4
    legs = [(1.0, loaded, stress, 0.0, TEMPERATURE), (1.0, rest, 0.0, 0.0, TEMPERATURE)]
    since = np.concatenate([[0.0], np.geomspace(1e-3, 1.0, 40)])
    found = solve(values, legs, [since, since])
    time = np.concatenate([loaded * since, loaded + rest * since])
    # The second leg starts behind the jump.
    off = np.concatenate([np.full(since.size, -1.0), rest * since])
    expected = stress * (creep(values, time) - creep(values, off))
    np.testing.assert_allclose(found[1], expected, atol=ELEMENT_ERROR * expected.max(), rtol=0)
    np.testing.assert_allclose(found[1][since.size - 1], expected[since.size - 1], rtol=1e-4)


@pytest.mark.parametrize("law", LAWS)
def test_stress_of_an_imposed_rate_and_its_relaxation_are_those_of_the_integral(law: str) -> None:
    values = {**LINEAR, **LAWS[law]}
    rate, duration, rest = 1e-6, 1500.0, 1e4
    legs = [(0.0, duration, 0.0, rate, TEMPERATURE), (0.0, rest, 0.0, 0.0, TEMPERATURE)]
    since = np.geomspace(1e-3, 1.0, 30)
    found = solve(values, legs, [since, since])
    kelvin = kelvin_part(values, TEMPERATURE, np.array(GRAIN_SIZE))
    times, shares = (np.array(x, dtype=float) for x in zip(*kelvin.elements(), strict=True))
    modulus, stress = values["maxwell_modulus"], np.zeros(0)
    state = np.zeros(1 + times.size)

    for imposed, length in ((rate, duration), (0.0, rest)):

        def slope(_: float, state: FloatArray, imposed: float = imposed) -> FloatArray:
            creeping = (shares * state[0] - state[1:]) / times
            elastic = modulus * (imposed - creeping.sum() - state[0] / VISCOSITY)
            return np.concatenate([[elastic], creeping])

        solution = solve_ivp(
            slope, (0.0, length), state, "LSODA", length * since, rtol=1e-9, atol=1e-12
        )
        stress = np.concatenate([stress, solution.y[0]])
        state = solution.y[:, -1]
    np.testing.assert_allclose(found[0], stress, rtol=0, atol=2e-4 * stress.max())
    parts = found[0] / modulus + found[2] + found[4]
    np.testing.assert_allclose(found[1], parts, rtol=0, atol=1e-10)


def test_legs_of_both_kinds_and_temperatures_hand_on_every_element() -> None:
    """Two legs in place of one change nothing; the rate of the Kelvin strain is its slope."""
    values = {**LINEAR, **LAWS["extended"], "kelvin_activation_enthalpy": 6e4}
    ramp, hold = (1.0, 2e3, 1e6, 5e2, 268.0), (0.0, 3e3, 0.0, 0.0, 258.0)
    halves = [(1.0, 1e3, 1e6, 5e2, 268.0), (1.0, 1e3, 1.5e6, 5e2, 268.0)]
    halves += [(0.0, 1.5e3, 0.0, 0.0, 258.0)] * 2
    end = np.array([1.0])
    whole = solve(values, [ramp, hold], [end, end])
    split = solve(values, halves, [end] * 4)
    np.testing.assert_allclose(split[:, [1, 3]], whole, rtol=1e-7)
    near = 1 + np.array([-2e-4, -1e-4, 0.0])
    fine = solve(values, [ramp], [near])
    slope = (fine[2][2] - fine[2][0]) / (2e-4 * 2e3)
    assert fine[6][1] == pytest.approx(slope, rel=1e-4)


def test_elements_are_as_many_as_the_priors_ask_for() -> None:
    priors = default_priors("ice")
    assert elements_block([priors]) == {"n_elements": 1, "element": [[0.0, 0.0, 1.0]]}
    fixed = {p.name: p for p in PROGRAM_PARAMETERS}
    wide, narrow = (
        elements_block([priors.exchanging(fixed_prior(fixed["relaxation_time_decades"], d, "x"))])
        for d in (8.0, 4.0)
    )
    assert wide["n_elements"] > 1.5 * narrow["n_elements"]
