"""Coordinates of the sampler: the Jacobian is that of the map, whatever the coordinates."""

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from conftest import ICE, TESTS, needs_measured, resolved_priors, valley_of
from log_density import Program, constant_rate_program
from scipy import stats
from stan_data import one_test_data, parameter_in

from pyburgers.model.parameters import PARAMETERS
from pyburgers.model.priors import PriorSet
from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment, load_constant_rate
from pyburgers.protocols.constant_rate.stan_data import ValleyReference
from pyburgers.protocols.stan_data import SolverOptions

FloatArray = npt.NDArray[np.float64]
pytestmark = pytest.mark.usefixtures("programs")

SOLVER = SolverOptions(tolerance=1e-10, max_num_steps=1_000_000)
SIZE = len(PARAMETERS)
EXPERIMENTS = [
    *(ICE / f"{name}.toml" for name in ("PIL40", "PIL72", "PIL105")),
    *(
        pytest.param(TESTS / "data" / f"{name}.toml", marks=needs_measured)
        for name in ("dunite_4506", "dunite_4581")
    ),
]


def program_for(
    experiment: ConstantRateExperiment,
    priors: PriorSet,
    valley: ValleyReference | None,
    folder: Path,
) -> Program:
    data = one_test_data(experiment, priors, solver=SOLVER, reference=valley)
    return constant_rate_program(data, folder)


@pytest.fixture(params=["plain", "valley"])
def program(request: pytest.FixtureRequest, tmp_path: Path) -> Program:
    experiment = load_constant_rate(ICE / "PIL72.toml")
    priors = resolved_priors(experiment)
    valley = valley_of(experiment, priors) if request.param == "valley" else None
    return program_for(experiment, priors, valley, tmp_path)


def parameters_at(program: Program, coordinate: FloatArray) -> FloatArray:
    columns = program.columns_at({"coordinate": coordinate.tolist()})
    return np.array([parameter_in(columns, parameter.name) for parameter in PARAMETERS])


def derivative(program: Program, coordinate: FloatArray, k: int) -> FloatArray:
    """Derivative of the parameters by a coordinate, fourth order in the step."""
    step = 2e-3 * np.eye(SIZE)[k]
    one, two = (
        parameters_at(program, coordinate + m * step)
        - parameters_at(program, coordinate - m * step)
        for m in (1, 2)
    )
    slope: FloatArray = (8 * one - two) / (12 * 2e-3)
    return slope


def test_log_jacobian_is_that_of_the_map(program: Program) -> None:
    rng = np.random.default_rng(12)
    for _ in range(3):
        coordinate = rng.standard_normal(SIZE)
        columns = program.columns_at({"coordinate": coordinate.tolist()})
        jacobian = np.column_stack([derivative(program, coordinate, k) for k in range(SIZE)])
        # Parameters in SI differ by many powers of ten.
        scale = np.abs(parameters_at(program, coordinate))
        sign, logarithm = np.linalg.slogdet(jacobian / scale[:, None])
        assert sign != 0
        assert columns["log_jacobian"] == pytest.approx(logarithm + np.log(scale).sum(), abs=1e-5)


@pytest.mark.parametrize("system", ["plain", "valley"])
@pytest.mark.parametrize("file", EXPERIMENTS, ids=lambda file: file.stem)
def test_density_is_prior_likelihood_and_jacobian(
    programs: None, system: str, file: Path, tmp_path: Path
) -> None:
    """The density less the Jacobian's logarithm does not depend on the coordinates."""
    experiment = load_constant_rate(file)
    priors = resolved_priors(experiment)
    valley = valley_of(experiment, priors) if system == "valley" else None
    program = program_for(experiment, priors, valley, tmp_path)
    rng = np.random.default_rng(13)
    for _ in range(3):
        columns = program.columns_at({"coordinate": rng.standard_normal(SIZE).tolist()})
        prior = sum(
            priors[name].distribution().logpdf(parameter_in(columns, name)) for name in priors.free
        )
        points = range(1, experiment.n_points + 1)
        stress = np.array([columns[f"stress_model.{point}"] for point in points])
        noise = parameter_in(columns, "stress_noise")
        likelihood = np.sum(stats.norm.logpdf(experiment.stress, stress, noise))
        assert columns["lprior"] == pytest.approx(prior, rel=1e-8)
        assert columns["lp__"] == pytest.approx(
            prior + likelihood + columns["log_jacobian"], rel=1e-7
        )


def test_gradient_is_the_slope_of_the_density(program: Program) -> None:
    coordinate = 0.3 * np.random.default_rng(14).standard_normal(SIZE)
    gradient = program.at({"coordinate": coordinate.tolist()}).gradient
    step = 1e-3
    for k in range(SIZE):
        shift = step * np.eye(SIZE)[k]
        above, below = (
            program.columns_at({"coordinate": (coordinate + sign * shift).tolist()})["lp__"]
            for sign in (1, -1)
        )
        assert gradient[k] == pytest.approx(
            (above - below) / (2 * step), rel=1e-3, abs=1e-4 * np.abs(gradient).max()
        )
