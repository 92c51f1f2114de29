"""Density of joint fits of two kinds: as single fits, by hand, its gradient."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ICE, resolved_priors, valley_of
from jacobians import assert_jacobian_is_that_of_the_map
from kind_examples import EXAMPLES
from log_density import Program, assert_gradient_is_slope, program_with
from oscillation_pair import oscillation_pair
from scipy import stats
from stan_data import one_test_data, parameter_in, parameters_in, sheared_reference

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.program_data import chart_block, program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.pooling import pooling_of
from pyburgers.model.priors import default_priors

pytestmark = pytest.mark.usefixtures("programs")

SOLVER = SolverOptions(tolerance=1e-10, max_num_steps=1_000_000)
CURVES = [load_constant_rate(ICE / f"{name}.toml") for name in ("PIL40", "PIL105")]
SHEARED = [
    sheared_reference([-0.7, 2.5, 0.8], [2.7, 0.6, 0.3]),
    sheared_reference([0.4, -1.0, 1.2], [3.2, 0.9, 0.2]),
]
PARTIAL: Mapping[str, Mapping[str, str]] = {
    "plain": dict.fromkeys(
        (
            "steady_state_grain_size",
            "steady_state_fabric_factor",
            "critical_strain_grain_size",
            "critical_strain_fabric",
        ),
        "partial",
    ),
    # The valley does not know of a pooling of the parameters that it solves for.
    "valley": dict.fromkeys(
        ("steady_state_grain_size", "kelvin_modulus", "kelvin_viscosity"), "partial"
    ),
    "plain oscillation": {"kelvin_viscosity": "partial"},
    "sheared oscillation": {"kelvin_viscosity": "partial"},
}
"""More than by default, for each system of coordinates."""

CURVE_SYSTEMS = ("plain", "valley")


@pytest.fixture(scope="module")
def records(programs: None) -> list[OscillationExperiment]:
    return oscillation_pair(end=700.0)


@pytest.fixture(params=PARTIAL)
def system(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def tests(system: str, records: list[OscillationExperiment]) -> Sequence[Experiment]:
    return CURVES if system in CURVE_SYSTEMS else records


def joint_of(tests: Sequence[Experiment], **pool: str) -> Problem:
    return problem_of(tests, default_priors(tests[0].material), pooling_of(pool))


def references_of(joint: Problem, system: str) -> Sequence[Any]:
    if system == "valley":
        return [valley_of(test, resolved_priors(test)) for test in CURVES]
    return SHEARED if system == "sheared oscillation" else [None] * 2


def joint_program(joint: Problem, system: str, folder: Path) -> Program:
    data = program_data(joint, solver=SOLVER)
    references = references_of(joint, system)
    if system == "valley":
        pooled = [own.coordinate[joint.layout.pooled] for own in references]
        pooling = np.linspace(-0.5, 0.5, 2 * len(joint.partial)).reshape(2, -1)
        data |= chart_block(joint, references, pooled=np.array(pooled), pooling=pooling)
    elif references[0] is not None:
        data |= chart_block(joint, references)
    return program_with(joint.likelihood.program, data, folder)


def test_separate_density_is_the_sum_of_single_ones(
    system: str, tests: Sequence[Experiment], tmp_path: Path
) -> None:
    joint = joint_of(tests, all="separate")
    coordinate = 0.3 * np.random.default_rng(3).standard_normal(joint.layout.size)
    program = joint_program(joint, system, tmp_path)
    density = program.columns_at({"coordinate": coordinate.tolist()})["lp__"]
    total = 0.0
    for test, reference, own in zip(
        tests, references_of(joint, system), np.split(coordinate, 2), strict=True
    ):
        data = one_test_data(test, resolved_priors(test), solver=SOLVER, reference=reference)
        single = program_with(joint.likelihood.program, data, tmp_path)
        total += single.columns_at({"coordinate": own.tolist()})["lp__"]
    # Steps of the solver make more of the last digit of a parameter.
    assert density == pytest.approx(total, rel=1e-8)


def test_pooled_density_is_that_made_by_hand(
    system: str, tests: Sequence[Experiment], tmp_path: Path
) -> None:
    """Shared parameters count once; partially pooled ones are normal on the real line."""
    joint = joint_of(tests, **PARTIAL[system])
    program = joint_program(joint, system, tmp_path)
    coordinate = 0.3 * np.random.default_rng(4).standard_normal(joint.layout.size)
    columns = program.columns_at({"coordinate": coordinate.tolist()})
    total, first = 0.0, 1
    for e, (test, priors) in enumerate(zip(tests, joint.priors, strict=True), start=1):
        places = range(first, first + test.n_points)
        first += test.n_points
        stress = np.array([columns[f"response_model.{i}"] for i in places])
        likelihood = EXAMPLES[test.protocol].log_likelihood
        total += likelihood(test, parameters_in(columns, e), stress).sum()
        own = [*joint.pooling.of_kind("separate", joint.free), *(joint.shared if e == 1 else ())]
        total += sum(priors[n].distribution().logpdf(parameter_in(columns, n, e)) for n in own)
        for h, name in enumerate(joint.partial, start=1):
            low, high = priors[name].lower, priors[name].upper
            value, centre = parameter_in(columns, name, e), columns[f"pooled_centre.{h}"]
            spread = columns[f"pooled_spread.{h}"]
            u, middle = (np.log((x - low) / (high - x)) for x in (value, centre))
            slope = (value - low) * (high - value) / (high - low)
            total += stats.norm.logpdf(u, middle, spread) - np.log(slope)
            if e == 1:
                total += priors[name].distribution().logpdf(centre)
                total += stats.halfnorm.logpdf(spread, scale=joint.pooling.spread_scales[name])
    for name in joint.shared:
        assert parameter_in(columns, name, 1) == parameter_in(columns, name, 2)
    assert columns["lp__"] == pytest.approx(total + columns["log_jacobian"], rel=1e-8)


@pytest.mark.parametrize("system", CURVE_SYSTEMS)
def test_jacobian_is_that_of_the_map(system: str, tmp_path: Path) -> None:
    """Of shared and own parameters, centres and spreads by the coordinates."""
    joint = joint_of(CURVES, **PARTIAL[system])
    program = joint_program(joint, system, tmp_path)
    own = [*joint.partial, *joint.pooling.of_kind("separate", joint.free)]

    def quantities(columns: Mapping[str, float]) -> FloatArray:
        values = [
            parameter_in(columns, name, e)
            for e in (1, 2)
            for name in (*(joint.shared if e == 1 else ()), *own)
        ]
        for h in range(1, len(joint.partial) + 1):
            values += [columns[f"pooled_centre.{h}"], columns[f"pooled_spread.{h}"]]
        return np.array(values)

    start = 0.3 * np.random.default_rng(5).standard_normal(joint.layout.size)
    assert_jacobian_is_that_of_the_map(program, start, quantities)


def test_gradient_is_the_slope_of_the_density(
    system: str, tests: Sequence[Experiment], tmp_path: Path
) -> None:
    joint = joint_of(tests, **PARTIAL[system])
    size = joint.layout.size
    program = joint_program(joint, system, tmp_path)
    coordinate = 0.2 * np.random.default_rng(6).standard_normal(size)
    assert_gradient_is_slope(program, coordinate, range(0, size, 3))
