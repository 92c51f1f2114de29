"""Coordinates and first metric of a fit."""

import numpy as np
import pytest
from charts_at_modes import chart_at_mode
from conftest import ICE

from pyburgers.cmdstan.program import load_program
from pyburgers.kinds.constant_rate.experiment import load_constant_rate
from pyburgers.kinds.constant_rate.likelihood import LIKELIHOOD as CONSTANT_RATE
from pyburgers.kinds.forward import simulate_data
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.priors import default_priors
from pyburgers.sampling.charts import expected_rise
from pyburgers.sampling.laplace import curvature_at

pytestmark = pytest.mark.usefixtures("programs")


@pytest.fixture(scope="module")
def precise() -> Problem:
    """A curve whose noise is far below a percent."""
    twin = load_constant_rate(ICE / "PIL40.toml")
    assert twin.true_parameters is not None
    values = {**twin.true_parameters, "stress_noise": 2e4}
    curve = simulate_data(twin, values, np.random.default_rng(2), source="a test")
    return problem_of([curve], default_priors("ice"))


def test_the_first_metric_fits_where_noise_is_far_below_a_percent(precise: Problem) -> None:
    problem, solver = precise, SolverOptions()
    data = program_data(problem, solver=solver)
    model = load_program(CONSTANT_RATE.program)
    chart = chart_at_mode(problem, data, solver, wanted="valley")
    assert chart.centre is not None
    assert chart.covariance is not None
    around = {**data, **chart.block}
    widths = np.asarray(np.linalg.cholesky(chart.covariance), dtype=np.float64)
    curvature = widths.T @ curvature_at(model, around, chart.centre, 0.1 * widths) @ widths
    # 1 where the metric is right.
    assert np.linalg.eigvalsh(curvature).max() < 3
    # The optimiser comes no nearer than the solver's tolerance lets it; draws lie half a unit for
    # each coordinate below the mode.
    rise = expected_rise(model, around, chart.centre, chart.covariance)
    assert rise < chart.centre.size / 2


def test_the_sampler_moves_in_standard_deviations_of_plain_coordinates(precise: Problem) -> None:
    """Stan pulls variances of the adapted metric to 1e-3, above those of precise data."""
    solver = SolverOptions()
    data = program_data(precise, solver=solver)
    model = load_program(CONSTANT_RATE.program)
    chart = chart_at_mode(precise, data, solver, wanted="plain")
    assert chart.centre is not None
    assert chart.covariance is not None
    assert chart.first_metric is not None
    spread = np.sqrt(np.diag(chart.covariance))
    assert np.abs(np.log(spread)).max() > 0.5
    np.testing.assert_allclose(np.diag(chart.first_metric), 1)
    # A gradient of Stan's is one by what the sampler moves in.
    points = [chart.centre + 0.3 * spread]
    in_units = model.gradients({**data, **chart.block}, "coordinate", points)
    by_coordinate = model.gradients(data, "coordinate", points)
    np.testing.assert_allclose(in_units, by_coordinate * spread, rtol=1e-4)
