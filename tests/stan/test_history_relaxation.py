"""Kelvin parts with many relaxation times in loading histories: sums of elements in time."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import FunctionValues
from history_twins import history_twin
from imagined_tests import imagined_history
from linear_bodies import LAWS, linear_body
from log_density import assert_gradient_is_slope, program_with
from relaxation_oracle import creep_oracle
from scipy.integrate import solve_ivp
from stan_values import CHARTS
from truth_as_mode import at_truth

from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stages import Stage
from pyburgers.kinds.loading_history.stan_data import ELEMENT_ERROR, elements_block
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.arrhenius import GAS_CONSTANT, log_slowdown
from pyburgers.model.closed_forms import closed_forms
from pyburgers.model.laws import KELVIN_LAWS, SPECTRUM_PARAMETERS
from pyburgers.model.parameters import PROGRAM_PARAMETERS
from pyburgers.model.prior_families import fixed_prior
from pyburgers.model.priors import PriorSet, default_priors
from pyburgers.model.variants import with_variant

VALUES = Path(__file__).with_name("loading_history_values.stan")
GRAIN_SIZE, TEMPERATURE = 2e-4, 263.0
VISCOSITY = 5e13
LINEAR = linear_body(VISCOSITY, 3e12, TEMPERATURE, GRAIN_SIZE)
"""Its longest relaxation time is 3000 s."""


def imagined_test(legs: Sequence[Sequence[float]]) -> HistoryExperiment:
    """A test of such legs without readings."""
    stages, start = [], 0.0
    for is_stress, duration, stress, rate, temperature in legs:
        end = start + duration
        stages.append(
            Stage("stress_rate", start, end, temperature, rate, start_stress=stress)
            if is_stress
            else Stage("strain_rate", start, end, temperature, rate)
        )
        start = end
    test = imagined_history(*stages)
    return replace(test, temperature=TEMPERATURE, initial_grain_size=GRAIN_SIZE)


def fixed_at(values: Mapping[str, float]) -> PriorSet:
    """Priors that fix everything the Kelvin part has."""
    names = {
        *SPECTRUM_PARAMETERS,
        "kelvin_activation_enthalpy",
        "kelvin_grain_size_exponent",
        "kelvin_reference_temperature",
        "kelvin_reference_grain_size",
    }
    return default_priors("ice").exchanging(
        *(fixed_prior(p, values[p.name], "given") for p in PROGRAM_PARAMETERS if p.name in names)
    )


def solve(
    values: Mapping[str, float],
    legs: Sequence[Sequence[float]],
    times: Sequence[FloatArray],
    *,
    elements_of: Sequence[Sequence[float]] = (),
) -> FloatArray:
    """Stress (Pa), strain, Kelvin, path and dashpot strain, d/d_0, Kelvin rate: shape (7, n).

    A leg says whether stress is imposed, its duration (s), stress at its start (Pa), rate and
    temperature. Times are those since its start over its duration. Elements may be those for the
    legs of another test.
    """
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
        **elements_block([(imagined_test(elements_of or legs), fixed_at(values))]),
    }
    return np.asarray(load_program(VALUES).evaluate(data)["solution"]).T


def creep(law: str, values: Mapping[str, float], time: FloatArray) -> FloatArray:
    """Strain over the stress that was put on some times (s) ago, 1/Pa."""
    tau = values["kelvin_viscosity"] / values["kelvin_modulus"]
    kelvin = [creep_oracle(law, values, np.log(t / tau)) if t > 0 else 0.0 for t in time]
    recoverable = 1 / values["maxwell_modulus"] + np.array(kelvin)
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
    expected = stress * (creep(law, values, time) - creep(law, values, off))
    np.testing.assert_allclose(found[1], expected, atol=ELEMENT_ERROR * expected.max(), rtol=0)
    np.testing.assert_allclose(found[1][since.size - 1], expected[since.size - 1], rtol=1e-4)


def stress_of_strain(
    values: Mapping[str, float], time: FloatArray, strain: FloatArray
) -> FloatArray:
    """Stress (Pa) of a body of Andrade creep at rest before the first time, which is 0.

    Boltzmann's integral over a stress that is linear between the times, solved in their order.
    """
    a, tau = values["andrade_exponent"], values["kelvin_viscosity"] / values["kelvin_modulus"]

    def integral(since: FloatArray) -> FloatArray:
        """Of the creep compliance over the time since a unit of stress was put on."""
        creeping = tau * (since / tau) ** (1 + a) / ((1 + a) * values["kelvin_modulus"])
        return np.asarray(since / values["maxwell_modulus"] + since**2 / (2 * VISCOSITY) + creeping)

    rates = np.zeros(time.size - 1)
    for i in range(1, time.size):
        since = integral(time[i] - time[: i + 1])
        shares = since[:-1] - since[1:]
        rates[i - 1] = (strain[i] - shares[:-1] @ rates[: i - 1]) / shares[-1]
    return np.append(0.0, np.cumsum(rates * np.diff(time)))


@pytest.mark.parametrize("driven_to", ["a hold", "another rate"])
def test_stress_of_andrade_creep_is_that_of_boltzmann_s_integral(driven_to: str) -> None:
    values = {**LINEAR, **LAWS["andrade"]}
    rate, duration, rest = 1e-6, 1500.0, 1e4
    after = {"a hold": 0.0, "another rate": 2e-7}[driven_to]
    legs = [(0.0, duration, 0.0, rate, TEMPERATURE), (0.0, rest, 0.0, after, TEMPERATURE)]
    shape = np.geomspace(1e-5, 1.0, 900)
    time = np.concatenate([[0.0], duration * shape, duration + rest * shape])
    strain = rate * np.minimum(time, duration) + after * np.maximum(time - duration, 0.0)
    expected = stress_of_strain(values, time, strain)
    found = solve(values, legs, [shape, shape])
    np.testing.assert_allclose(found[0], expected[1:], rtol=0, atol=2e-4 * expected.max())


@pytest.mark.parametrize("law", [law for law in LAWS if law != "andrade"])
def test_stress_of_an_imposed_rate_and_its_relaxation_are_those_of_the_integral(law: str) -> None:
    values = {**LINEAR, **LAWS[law]}
    rate, duration, rest = 1e-6, 1500.0, 1e4
    legs = [(0.0, duration, 0.0, rate, TEMPERATURE), (0.0, rest, 0.0, 0.0, TEMPERATURE)]
    since = np.geomspace(1e-3, 1.0, 30)
    found = solve(values, legs, [since, since])
    asked = {"n_times": 1, "log_time": [0.0]}
    part = closed_forms(values, np.array(GRAIN_SIZE), temperature=TEMPERATURE, asked=asked)
    times, shares = part["elements"].T
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


@pytest.mark.parametrize("law", ["extended", "andrade"])
def test_legs_of_both_kinds_and_temperatures_hand_on_every_element(law: str) -> None:
    """Two legs in place of one change nothing; the rate of the Kelvin strain is its slope."""
    values = {**LINEAR, **LAWS[law], "kelvin_activation_enthalpy": 6e4}
    ramp, hold = (1.0, 2e3, 1e6, 5e2, 268.0), (0.0, 3e3, 0.0, 0.0, 258.0)
    halves = [(1.0, 1e3, 1e6, 5e2, 268.0), (1.0, 1e3, 1.5e6, 5e2, 268.0)]
    halves += [(0.0, 1.5e3, 0.0, 0.0, 258.0)] * 2
    end = np.array([1.0])
    whole = solve(values, [ramp, hold], [end, end], elements_of=halves)
    split = solve(values, halves, [end] * 4)
    np.testing.assert_allclose(split[:, [1, 3]], whole, rtol=1e-7)
    near = 1 + np.array([-2e-4, -1e-4, 0.0])
    fine = solve(values, [ramp], [near])
    slope = (fine[2][2] - fine[2][0]) / (2e-4 * 2e3)
    assert fine[6][1] == pytest.approx(slope, rel=1e-4)


def test_andrade_creep_of_a_colder_leg_is_that_of_longer_times() -> None:
    enthalpy, cold = 6e4, 243.0
    values = {**LINEAR, **LAWS["andrade"], "kelvin_activation_enthalpy": enthalpy}
    slower = np.exp(enthalpy / GAS_CONSTANT * (1 / cold - 1 / TEMPERATURE))
    since = np.geomspace(1e-3, 1.0, 20)
    found = solve(values, [(1.0, 4e3, 2e6, 0.0, cold)], [since])
    tau = slower * values["kelvin_viscosity"] / values["kelvin_modulus"]
    expected = 2e6 / values["kelvin_modulus"] * (4e3 * since / tau) ** values["andrade_exponent"]
    np.testing.assert_allclose(found[2], expected, rtol=ELEMENT_ERROR)


def test_elements_are_as_many_as_the_priors_ask_for() -> None:
    test, priors = imagined_test([(1.0, 1e4, 1e6, 0.0, TEMPERATURE)]), default_priors("ice")
    one = {"n_elements": 1, "element": [[0.0, 0.0, 1.0]]}
    assert elements_block([(test, priors), (None, priors)]) == one
    fixed = {p.name: p for p in PROGRAM_PARAMETERS}
    exponent = fixed_prior(fixed["relaxation_exponent"], 0.3, "x")
    wide, narrow = (
        elements_block([(test, priors.exchanging(decades, exponent))])
        for decades in (
            fixed_prior(fixed["relaxation_time_decades"], value, "x") for value in (8.0, 4.0)
        )
    )
    assert wide["n_elements"] > 1.5 * narrow["n_elements"]


def test_elements_of_andrade_creep_reach_from_the_first_reading_to_the_end_of_the_test() -> None:
    priors = fixed_at({**LINEAR, **LAWS["andrade"]})
    imagined = imagined_test([(1.0, 1e4, 1e6, 0.0, TEMPERATURE)])
    read = replace(
        imagined,
        time=np.array([0.0, 100.0, 1e4]),
        reading_stage=np.zeros(3, dtype=np.int64),
        reading=np.zeros(3),
    )
    ends = []
    for test in (imagined, read):
        part, log_time, _ = np.transpose(
            elements_block([(test, priors), (None, priors)])["element"]
        )
        assert (np.diff(log_time) > 0).all()
        assert part[[0, -1]].tolist() == [-1.0, -2.0]
        ends.append(np.exp(log_time[[0, -1]]))
    np.testing.assert_allclose(ends, [[10 / 30, 30e4], [100 / 30, 30e4]])


@pytest.mark.parametrize("law", ["two_elements", "extended", "andrade"])
def test_the_gradient_along_what_a_law_frees_is_the_slope_of_the_density(
    law: str, tmp_path: Path
) -> None:
    twin = history_twin("mixed", 6)
    assert twin.true_parameters is not None
    given = {**twin.true_parameters, **LAWS[law], "kelvin_viscosity": 2e11}
    test = replace(twin, true_parameters=given)
    priors = with_variant(default_priors("ice"), test, {"kelvin": law})
    # Twelve decades would be 49 states.
    priors = priors.exchanging(
        *(
            replace(priors[name], location=3.5, scale=2.5, upper=6.0)
            for name in priors.free
            if name == "relaxation_time_decades"
        )
    )
    problem = problem_of([test], priors)
    centre = at_truth(test, priors, SolverOptions()).mode.coordinate
    data = program_data(problem, solver=SolverOptions(1e-9, max_num_steps=1_000_000))
    program = program_with(stan_directory() / "loading_history.stan", data, tmp_path)
    names = (*KELVIN_LAWS[law].parameters, "kelvin_viscosity")
    assert_gradient_is_slope(program, centre, [problem.layout.names.index(name) for name in names])


@pytest.mark.parametrize("law", LAWS)
def test_elements_of_the_kelvin_part_creep_like_it_and_give_in_a_rise(
    law: str, function_values: FunctionValues
) -> None:
    """Colder and coarser than what its viscosity is stated for; a stress that grows with time."""
    values = {
        **LINEAR,
        **LAWS[law],
        "kelvin_activation_enthalpy": 60e3,
        "kelvin_grain_size_exponent": 1.5,
    }
    colder, coarser, time = TEMPERATURE - 10, 1.5 * GRAIN_SIZE, 400.0
    slower = log_slowdown(values["kelvin_activation_enthalpy"], colder, TEMPERATURE)
    tau = values["kelvin_viscosity"] / values["kelvin_modulus"] * np.exp(slower) * 1.5**1.5
    test = imagined_test([(True, 4000.0, 1e6, 0.0, colder)])
    found = function_values(
        "chart_values",
        {
            **CHARTS,
            **elements_block([(test, fixed_at(values))]),
            "parameter": [values[p.name] for p in PROGRAM_PARAMETERS],
            "temperature": colder,
            "initial_grain_size": coarser,
            "rise_time": time,
        },
    )
    modulus, viscosity = found["element_of_test"].reshape(-1, 2).T
    creep = -np.sum(np.expm1(-time * modulus / viscosity) / modulus)
    assert creep == pytest.approx(creep_oracle(law, values, np.log(time / tau)), rel=3e-4)
    since = time * (0.5 + 0.5 * np.polynomial.legendre.leggauss(60)[0])
    weights = 0.5 * np.polynomial.legendre.leggauss(60)[1]
    creeps = [creep_oracle(law, values, np.log(t / tau)) for t in since]
    grown = float(weights @ np.array(creeps))
    assert found["rise_compliance"] == pytest.approx(grown, rel=1e-3)
