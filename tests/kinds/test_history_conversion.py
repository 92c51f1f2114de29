"""A test at constant strain rate as a loading history: one model, one density."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import ICE, with_fixed
from truths import truth_of

from pyburgers.cmdstan.program import load_program
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, RateSegment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.constant_rate.likelihood import LIKELIHOOD as CONSTANT_RATE
from pyburgers.kinds.experiment import Experiment, UncertainCondition
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.priors import default_priors

pytestmark = pytest.mark.usefixtures("programs")

SEGMENTS = {
    "one rate": (RateSegment(0.0, 1.69e-4),),
    "rate steps": (RateSegment(0.0, 1e-4), RateSegment(0.03, 2e-5), RateSegment(0.0501, 3e-4)),
}


@pytest.fixture(params=SEGMENTS)
def curve(request: pytest.FixtureRequest) -> ConstantRateExperiment:
    return replace(load_constant_rate(ICE / "PIL40.toml"), segments=SEGMENTS[request.param])


def density(experiment: Experiment, known: dict[str, float]) -> tuple[float, np.ndarray]:
    """Prior density, and log likelihood of every point, at given parameters."""
    problem = problem_of([experiment], with_fixed(default_priors("ice"), known))
    data = program_data(problem, solver=SolverOptions(1e-11, 1_000_000))
    free = problem.coordinates[0]
    draw = load_program(likelihood_of(experiment).program).evaluate(
        data, {"coordinate": np.full(len(free.quantities), 0.3).tolist()}
    )
    return float(draw["lprior"]), draw["log_lik"]


CONDITIONS: dict[str, tuple[UncertainCondition, ...]] = {
    "known": (),
    "uncertain": (
        UncertainCondition("temperature_error", 5.0, "F"),
        UncertainCondition("stress_calibration_error", 0.05, None),
    ),
}


@pytest.mark.parametrize("conditions", CONDITIONS)
def test_the_density_is_that_of_the_test_at_constant_rate(
    curve: ConstantRateExperiment, conditions: str
) -> None:
    curve = replace(curve, uncertain=CONDITIONS[conditions])
    truth = truth_of(load_constant_rate(ICE / "PIL40.toml"))
    # Coordinates differ in the flow rate; all but three others are known.
    few = ("maxwell_modulus", "kelvin_viscosity", "stress_noise")
    known = {name: truth[name] for name in default_priors("ice").free if name not in few}
    one, other = density(curve, known), density(CONSTANT_RATE.as_history(curve), known)
    assert one[0] == pytest.approx(other[0], rel=1e-9)
    np.testing.assert_allclose(one[1], other[1], rtol=1e-6, atol=1e-6)
