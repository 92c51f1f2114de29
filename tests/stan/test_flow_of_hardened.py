"""The point of the flow law that plain coordinates of a loading history hold (hyperbolic sine)."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import oracle
import pytest
from conftest import DUNITE
from halite import LAWS, RECORD, SINE, SINE_HARDENING, halite_priors
from jacobians import assert_jacobian_is_that_of_the_map, parameters_named
from log_density import Program, program_with
from stan_data import parameters_in

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.files import load_loading_history
from pyburgers.kinds.loading_history.stan_data import strain_scale, stress_scale
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import SolverOptions


def few_readings(name: str) -> Problem:
    """The first readings, whose solution takes no time."""
    record = load_loading_history(DUNITE.parent / "halite" / f"{RECORD}.toml")
    priors = halite_priors(record, name)
    few = replace(
        record,
        time=record.time[:3],
        reading=record.reading[:3],
        reading_stage=record.reading_stage[:3],
    )
    return problem_of([few], priors)


def program_and_point(problem: Problem, folder: Path) -> tuple[Program, FloatArray]:
    """Program of coordinates alone, and a point."""
    data = program_data(problem, solver=SolverOptions(), use_likelihood=False)
    point = 0.3 * np.random.default_rng(3).standard_normal(problem.layout.size)
    return program_with(problem.likelihood.program, data, folder), np.array(point)


@pytest.mark.parametrize("name", LAWS)
def test_it_is_the_rate_of_the_material_that_the_law_is_written_for(
    name: str, tmp_path: Path
) -> None:
    """Hardened by the largest strain with a hyperbolic sine, undeformed with a power law."""
    problem = few_readings(name)
    (test,) = problem.experiments
    assert isinstance(test, HistoryExperiment)
    program, at = program_and_point(problem, tmp_path)
    columns = program.values_at(at)
    values = parameters_in(columns)
    stress, n = stress_scale(test), values["stress_exponent"]
    factor = 1.0
    flow_stress = stress
    if name in (SINE, SINE_HARDENING):
        final, critical = (
            values[part] for part in ("steady_state_fabric_factor", "critical_strain_fabric")
        )
        factor = final + (1 - final) * np.exp(-strain_scale(test) / critical)
        limit = values["breakdown_stress"]
        flow_stress = factor * limit * np.sinh(stress / (factor * limit))
    expected = (
        n * np.log(flow_stress / factor)
        - values["grain_size_exponent"] * np.log(test.initial_grain_size)
        + np.log(oracle.rate_factor(values, test.temperature))
    )
    assert columns["log_reference.1"] == pytest.approx(expected, rel=1e-9)
    (coordinates,) = problem.coordinates
    sampled = coordinates.quantities.index(problem.likelihood.reference.name)
    assert coordinates.value(sampled, at[sampled]) == pytest.approx(expected, rel=1e-9)


def test_the_jacobian_is_that_of_the_map(tmp_path: Path) -> None:
    problem = few_readings(SINE_HARDENING)
    program, at = program_and_point(problem, tmp_path)
    assert_jacobian_is_that_of_the_map(program, at, parameters_named(problem.free))
