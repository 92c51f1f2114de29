"""Density of joint fits: against fits of single tests, by hand, and its gradient."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from conftest import ICE, resolved_priors, valley_of
from log_density import Program, constant_rate_program
from scipy import stats

from pyburgers.model.parameters import PROGRAM_PARAMETERS
from pyburgers.model.pooling import pooling_of
from pyburgers.model.priors import default_priors
from pyburgers.protocols.constant_rate.experiment import load_constant_rate
from pyburgers.protocols.layout import layout_of
from pyburgers.protocols.stan_data import SolverOptions
from pyburgers.sampling.problem import Problem, problem_of

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
"""More than by default, so that parameters that the valley solves for are pooled too."""


def problem(**pool: str) -> Problem:
    return problem_of(EXPERIMENTS, default_priors("ice"), pooling_of(pool))


def joint_program(joint: Problem, system: str, folder: Path) -> Program:
    valley = None
    if system == "valley":
        references = tuple(valley_of(e, resolved_priors(e)) for e in EXPERIMENTS)
        valley = JointValley(references, np.linspace(-0.5, 0.5, 2 * len(joint.partial)))
    data = joint_data(joint, solver=SOLVER, valley=valley)
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
        data = constant_rate_data(experiment, priors, solver=SOLVER, valley=valley)
        single = constant_rate_program(data, tmp_path)
        total += single.columns_at({"coordinate": own.tolist()})["lp__"]
    assert density == pytest.approx(total, rel=1e-9)


@pytest.mark.parametrize("system", ["plain", "valley"])
def test_pooled_density_is_that_made_by_hand(system: str, tmp_path: Path) -> None:
    """Shared parameters count once; partially pooled ones are normal on the real line."""
    joint = problem(**MICROSTRUCTURE)
    layout = layout_of(joint)
    program = joint_program(joint, system, tmp_path)
    coordinate = 0.3 * np.random.default_rng(4).standard_normal(layout.size)
    columns = program.columns_at({"coordinate": coordinate.tolist()})
    total, first = 0.0, 1
    for e, (experiment, priors) in enumerate(zip(EXPERIMENTS, joint.priors, strict=True), start=1):
        stress = np.array(
            [columns[f"stress_model.{i}"] for i in range(first, first + experiment.n_points)]
        )
        first += experiment.n_points
        noise = columns[f"parameter.{e}.{place('stress_noise')}"]
        total += float(np.sum(stats.norm.logpdf(experiment.stress, stress, noise)))
        names = ["stress_noise"] + (list(joint.shared) if e == 1 else [])
        total += sum(
            priors[name].distribution().logpdf(columns[f"parameter.{e}.{place(name)}"])
            for name in names
        )
        for h, name in enumerate(joint.partial, start=1):
            low, high = priors[name].lower, priors[name].upper
            logit = [
                np.log((value - low) / (high - value))
                for value in (
                    columns[f"parameter.{e}.{place(name)}"],
                    columns[f"pooled_centre.{h}"],
                )
            ]
            spread = columns[f"pooled_spread.{h}"]
            value = columns[f"parameter.{e}.{place(name)}"]
            slope = (value - low) * (high - value) / (high - low)
            total += stats.norm.logpdf(logit[0], logit[1], spread) - np.log(slope)
            if e == 1:
                total += priors[name].distribution().logpdf(columns[f"pooled_centre.{h}"])
                total += stats.halfnorm.logpdf(spread, scale=joint.pooling.spread_scales[name])
    exponent = place("stress_exponent")
    assert columns[f"parameter.1.{exponent}"] == columns[f"parameter.2.{exponent}"]
    assert columns["lp__"] == pytest.approx(total + columns["log_jacobian"], rel=1e-8)


def place(name: str) -> int:
    """Number of a parameter in the program, from 1."""
    return [parameter.name for parameter in PROGRAM_PARAMETERS].index(name) + 1


@pytest.mark.parametrize("system", ["plain", "valley"])
def test_jacobian_is_that_of_the_map(system: str, tmp_path: Path) -> None:
    """Of shared and own parameters, centres and spreads by the coordinates."""
    joint = problem(**MICROSTRUCTURE)
    layout = layout_of(joint)
    program = joint_program(joint, system, tmp_path)
    start = 0.3 * np.random.default_rng(5).standard_normal(layout.size)

    def quantities(coordinate: FloatArray) -> tuple[FloatArray, float]:
        columns = program.columns_at({"coordinate": coordinate.tolist()})
        values = []
        for e in range(1, len(joint.priors) + 1):
            own = [*joint.partial, "stress_noise"]
            names = [*joint.shared, *own] if e == 1 else own
            values += [columns[f"parameter.{e}.{place(name)}"] for name in names]
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
    joint = problem(**MICROSTRUCTURE)
    size = layout_of(joint).size
    program = joint_program(joint, system, tmp_path)
    coordinate = 0.2 * np.random.default_rng(6).standard_normal(size)
    gradient = program.at({"coordinate": coordinate.tolist()}).gradient
    step = 1e-3
    for k in range(0, size, 3):
        shift = step * np.eye(size)[k]
        above, below = (
            program.columns_at({"coordinate": (coordinate + sign * shift).tolist()})["lp__"]
            for sign in (1, -1)
        )
        assert gradient[k] == pytest.approx(
            (above - below) / (2 * step), rel=1e-3, abs=1e-4 * np.abs(gradient).max()
        )
