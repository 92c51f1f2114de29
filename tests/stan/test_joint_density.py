"""Density of joint fits: against fits of single tests, by hand, its gradient, and in threads."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from conftest import ICE, resolved_priors, valley_of
from default_chains import sampled
from log_density import Program, assert_gradient_is_slope, constant_rate_program
from scipy import stats
from stan_data import one_test_data, parameter_in

from pyburgers.cmdstan.program import load_program
from pyburgers.kinds.constant_rate.experiment import load_constant_rate
from pyburgers.kinds.constant_rate.likelihood import LIKELIHOOD as CONSTANT_RATE
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.program_data import chart_block, program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.pooling import pooling_of
from pyburgers.model.priors import default_priors

FloatArray = npt.NDArray[np.float64]
pytestmark = pytest.mark.usefixtures("programs")

SOLVER = SolverOptions(tolerance=1e-10, max_num_steps=1_000_000)
EXPERIMENTS = [load_constant_rate(ICE / f"{name}.toml") for name in ("PIL40", "PIL105")]


MICROSTRUCTURE = {
    "steady_state_grain_size": "partial",
    "steady_state_fabric_factor": "partial",
    "critical_strain_grain_size": "partial",
    "critical_strain_fabric": "partial",
}
"""More than by default."""

PARTIAL = {
    "plain": MICROSTRUCTURE,
    # The valley does not know of a pooling of the parameters that it solves for.
    "valley": {
        "steady_state_grain_size": "partial",
        "kelvin_modulus": "partial",
        "kelvin_viscosity": "partial",
    },
}


def problem(**pool: str) -> Problem:
    return problem_of(EXPERIMENTS, default_priors("ice"), pooling_of(pool))


def joint_program(joint: Problem, system: str, folder: Path) -> Program:
    data = program_data(joint, solver=SOLVER)
    if system == "valley":
        references = [valley_of(e, resolved_priors(e)) for e in EXPERIMENTS]
        pooled = [own.coordinate[joint.layout.pooled] for own in references]
        pooling = np.linspace(-0.5, 0.5, 2 * len(joint.partial)).reshape(2, -1)
        data |= chart_block(joint, references, pooled=np.array(pooled), pooling=pooling)
    return constant_rate_program(data, folder)


@pytest.mark.parametrize("system", ["plain", "valley"])
def test_separate_density_is_the_sum_of_single_ones(system: str, tmp_path: Path) -> None:
    joint = joint_program(problem(all="separate"), system, tmp_path)
    coordinate = 0.5 * np.random.default_rng(3).standard_normal(24)
    density = joint.columns_at({"coordinate": coordinate.tolist()})["lp__"]
    total = 0.0
    for experiment, own in zip(EXPERIMENTS, np.split(coordinate, 2), strict=True):
        priors = resolved_priors(experiment)
        valley = valley_of(experiment, priors) if system == "valley" else None
        data = one_test_data(experiment, priors, solver=SOLVER, reference=valley)
        single = constant_rate_program(data, tmp_path)
        total += single.columns_at({"coordinate": own.tolist()})["lp__"]
    assert density == pytest.approx(total, rel=1e-9)


@pytest.mark.parametrize("system", ["plain", "valley"])
def test_pooled_density_is_that_made_by_hand(system: str, tmp_path: Path) -> None:
    """Shared parameters count once; partially pooled ones are normal on the real line."""
    joint = problem(**PARTIAL[system])
    layout = joint.layout
    program = joint_program(joint, system, tmp_path)
    coordinate = 0.3 * np.random.default_rng(4).standard_normal(layout.size)
    columns = program.columns_at({"coordinate": coordinate.tolist()})
    total, first = 0.0, 1
    for e, (experiment, priors) in enumerate(zip(EXPERIMENTS, joint.priors, strict=True), start=1):
        stress = np.array(
            [columns[f"stress_model.{i}"] for i in range(first, first + experiment.n_points)]
        )
        first += experiment.n_points
        noise = parameter_in(columns, "stress_noise", e)
        total += float(np.sum(stats.norm.logpdf(experiment.stress, stress, noise)))
        separate = joint.pooling.of_kind("separate", joint.free)
        names = [*separate, *(joint.shared if e == 1 else ())]
        total += sum(
            priors[name].distribution().logpdf(parameter_in(columns, name, e)) for name in names
        )
        for h, name in enumerate(joint.partial, start=1):
            low, high = priors[name].lower, priors[name].upper
            logit = [
                np.log((value - low) / (high - value))
                for value in (
                    parameter_in(columns, name, e),
                    columns[f"pooled_centre.{h}"],
                )
            ]
            spread = columns[f"pooled_spread.{h}"]
            value = parameter_in(columns, name, e)
            slope = (value - low) * (high - value) / (high - low)
            total += stats.norm.logpdf(logit[0], logit[1], spread) - np.log(slope)
            if e == 1:
                total += priors[name].distribution().logpdf(columns[f"pooled_centre.{h}"])
                total += stats.halfnorm.logpdf(spread, scale=joint.pooling.spread_scales[name])
    exponents = [parameter_in(columns, "stress_exponent", e) for e in (1, 2)]
    assert exponents[0] == exponents[1]
    assert columns["lp__"] == pytest.approx(total + columns["log_jacobian"], rel=1e-8)


@pytest.mark.parametrize("system", ["plain", "valley"])
def test_jacobian_is_that_of_the_map(system: str, tmp_path: Path) -> None:
    """Of shared and own parameters, centres and spreads by the coordinates."""
    joint = problem(**PARTIAL[system])
    layout = joint.layout
    program = joint_program(joint, system, tmp_path)
    start = 0.3 * np.random.default_rng(5).standard_normal(layout.size)

    def quantities(coordinate: FloatArray) -> tuple[FloatArray, float]:
        columns = program.columns_at({"coordinate": coordinate.tolist()})
        values = []
        for e in range(1, len(joint.priors) + 1):
            own = [*joint.partial, *joint.pooling.of_kind("separate", joint.free)]
            names = [*joint.shared, *own] if e == 1 else own
            values += [parameter_in(columns, name, e) for name in names]
        for h in range(1, len(joint.partial) + 1):
            values += [columns[f"pooled_centre.{h}"], columns[f"pooled_spread.{h}"]]
        return np.array(values), columns["log_jacobian"]

    values, log_jacobian = quantities(start)
    step = 2e-3
    columns = []
    for k in range(layout.size):
        shift = step * np.eye(layout.size)[k]
        one, two = (
            quantities(start + m * shift)[0] - quantities(start - m * shift)[0] for m in (1, 2)
        )
        columns.append((8 * one - two) / (12 * step))
    scale = np.abs(values)
    _, logarithm = np.linalg.slogdet(np.column_stack(columns) / scale[:, None])
    assert log_jacobian == pytest.approx(logarithm + np.log(scale).sum(), abs=1e-4)


@pytest.mark.parametrize("system", ["plain", "valley"])
def test_gradient_is_the_slope_of_the_density(system: str, tmp_path: Path) -> None:
    joint = problem(**PARTIAL[system])
    size = joint.layout.size
    program = joint_program(joint, system, tmp_path)
    coordinate = 0.2 * np.random.default_rng(6).standard_normal(size)
    assert_gradient_is_slope(program, coordinate, range(0, size, 3))


@pytest.mark.slow
@pytest.mark.parametrize("system", ["plain", "valley"])
def test_threads_change_neither_density_nor_gradient(system: str, tmp_path: Path) -> None:
    joint = problem(**PARTIAL[system])
    alone = joint_program(joint, system, tmp_path)
    shared = load_program(CONSTANT_RATE.program, threads=2)
    shared_program = replace(alone, executable=shared.executable, threads=shared.threads)
    coordinate = 0.3 * np.random.default_rng(7).standard_normal(joint.layout.size)
    one, other = (
        program.at({"coordinate": coordinate.tolist()}) for program in (alone, shared_program)
    )
    assert other.log_density == pytest.approx(one.log_density, rel=1e-12)
    np.testing.assert_allclose(
        other.gradient, one.gradient, rtol=1e-6, atol=1e-9 * np.abs(one.gradient).max()
    )


@pytest.mark.slow
def test_draws_do_not_depend_on_the_number_of_threads(tmp_path: Path) -> None:
    """Terms are summed up in one order, whichever thread is ready first."""
    joint = problem()
    joint_program(joint, "valley", tmp_path)
    data = json.loads((tmp_path / "data.json").read_text(encoding="utf-8"))
    one, two, three = (
        sampled(
            load_program(CONSTANT_RATE.program, threads=threads),
            {**data, "tolerance": 1e-5},
            tmp_path / f"{threads}",
            chains=1,
            seed=3,
            warmup=20,
            draws=20,
            algorithm=("engine=nuts", "max_depth=4", "stepsize=0.05"),
        )
        for threads in (2, 2, 3)
    )
    np.testing.assert_array_equal(two.values, one.values)
    np.testing.assert_array_equal(three.values, one.values)
