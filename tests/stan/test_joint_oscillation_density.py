"""Density of several oscillating tests: against single ones, by hand, and its gradient."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from conftest import resolved_priors
from log_density import Program, assert_gradient_is_slope, program_with
from oscillation_pair import oscillation_pair
from scipy import stats
from stan_data import one_test_data, parameter_in, sheared_reference

from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.program_data import chart_block, program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.pooling import pooling_of
from pyburgers.model.priors import default_priors

FloatArray = npt.NDArray[np.float64]
pytestmark = pytest.mark.usefixtures("programs")

SOLVER = SolverOptions(tolerance=1e-10, max_num_steps=1_000_000)
REFERENCES = [
    sheared_reference([-0.7, 2.5, 0.8], [2.7, 0.6, 0.3]),
    sheared_reference([0.4, -1.0, 1.2], [3.2, 0.9, 0.2]),
]
SYSTEMS = ["plain", "sheared"]


@pytest.fixture(scope="module")
def records(programs: None) -> list[OscillationExperiment]:
    return oscillation_pair(until=700.0)


def joint_problem(records: list[OscillationExperiment], **pool: str) -> Problem:
    return problem_of(records, default_priors("olivine"), pooling_of(pool))


def joint_program(joint: Problem, system: str, folder: Path) -> Program:
    data = program_data(joint, solver=SOLVER)
    if system == "sheared":
        data |= chart_block(joint, REFERENCES)
    return program_with(joint.likelihood.program, data, folder)


@pytest.mark.parametrize("system", SYSTEMS)
def test_separate_density_is_the_sum_of_single_ones(
    system: str, records: list[OscillationExperiment], tmp_path: Path
) -> None:
    joint = joint_problem(records, all="separate")
    coordinate = 0.3 * np.random.default_rng(3).standard_normal(joint.layout.size)
    program = joint_program(joint, system, tmp_path)
    density = program.columns_at({"coordinate": coordinate.tolist()})["lp__"]
    total = 0.0
    for record, reference, own in zip(records, REFERENCES, np.split(coordinate, 2), strict=True):
        chosen = reference if system == "sheared" else None
        data = one_test_data(record, resolved_priors(record), solver=SOLVER, reference=chosen)
        single = program_with(joint.likelihood.program, data, tmp_path)
        total += single.columns_at({"coordinate": own.tolist()})["lp__"]
    assert density == pytest.approx(total, rel=1e-9)


@pytest.mark.parametrize("system", SYSTEMS)
def test_shared_parameters_count_once(
    system: str, records: list[OscillationExperiment], tmp_path: Path
) -> None:
    """Every likelihood is in, common priors are once, and pooled ones are normal between tests."""
    joint = joint_problem(records, kelvin_viscosity="partial")
    coordinate = 0.3 * np.random.default_rng(4).standard_normal(joint.layout.size)
    program = joint_program(joint, system, tmp_path)
    columns = program.columns_at({"coordinate": coordinate.tolist()})
    total, first = 0.0, 1
    centre, spread = columns["pooled_centre.1"], columns["pooled_spread.1"]
    for e, (record, priors) in enumerate(zip(records, joint.priors, strict=True), start=1):
        places = range(first, first + record.n_points)
        first += record.n_points
        stress = np.array([columns[f"stress_model.{i}"] for i in places])
        noise = parameter_in(columns, "stress_noise", e)
        prepared = record.prepared
        deviation = noise * prepared.relative_uncertainty
        total += float(np.sum(stats.norm.logpdf(record.stress, stress, deviation)))
        # As many coefficients of the noise went with the trend.
        total -= (prepared.stress_fit.degree + 1) * stats.norm.logpdf(0.0, scale=noise)
        own = [*joint.pooling.of_kind("separate", joint.free), *(joint.shared if e == 1 else ())]
        total += sum(priors[n].distribution().logpdf(parameter_in(columns, n, e)) for n in own)
        viscosity = priors["kelvin_viscosity"]
        low, high = viscosity.lower, viscosity.upper
        value = parameter_in(columns, "kelvin_viscosity", e)
        u, middle = (np.log((x - low) / (high - x)) for x in (value, centre))
        slope = (value - low) * (high - value) / (high - low)
        total += stats.norm.logpdf(u, middle, spread) - np.log(slope)
        if e == 1:
            total += viscosity.distribution().logpdf(centre)
            total += stats.halfnorm.logpdf(spread, scale=0.5)
    for name in joint.shared:
        assert parameter_in(columns, name, 1) == parameter_in(columns, name, 2)
    assert columns["lp__"] == pytest.approx(total + columns["log_jacobian"], rel=1e-8)


@pytest.mark.parametrize("system", SYSTEMS)
def test_gradient_is_the_slope_of_the_density(
    system: str, records: list[OscillationExperiment], tmp_path: Path
) -> None:
    joint = joint_problem(records, kelvin_viscosity="partial")
    size = joint.layout.size
    program = joint_program(joint, system, tmp_path)
    coordinate = 0.2 * np.random.default_rng(6).standard_normal(size)
    assert_gradient_is_slope(program, coordinate, range(0, size, 2))
