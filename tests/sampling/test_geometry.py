"""Coordinates and first metric of a fit."""

import numpy as np
import pytest
from conftest import ICE, resolved_priors

from pyburgers.cmdstan.program import load_program
from pyburgers.protocols.constant_rate.experiment import load_constant_rate
from pyburgers.protocols.constant_rate.protocol import CONSTANT_RATE
from pyburgers.protocols.forward import simulate_data
from pyburgers.protocols.stan_data import SolverOptions, program_data
from pyburgers.sampling.charts import choose_geometry
from pyburgers.sampling.metric import curvature_at, expected_rise

pytestmark = pytest.mark.usefixtures("programs")


def test_the_first_metric_fits_where_noise_is_far_below_a_percent() -> None:
    twin = load_constant_rate(ICE / "PIL40.toml")
    assert twin.true_parameters is not None
    values = {**twin.true_parameters, "stress_noise": 2e4}
    precise = simulate_data(twin, values, np.random.default_rng(2), source="a test")
    priors, solver = resolved_priors(precise), SolverOptions()
    data = program_data(precise, priors, solver=solver)
    model = load_program(CONSTANT_RATE.program)
    geometry = choose_geometry(model, data, precise, priors, wanted="valley", seed=1, solver=solver)
    assert geometry.centre is not None
    assert geometry.covariance is not None
    around = {**data, **geometry.block}
    widths = np.asarray(np.linalg.cholesky(geometry.covariance), dtype=np.float64)
    curvature = widths.T @ curvature_at(model, around, geometry.centre, 0.1 * widths) @ widths
    # 1 where the metric is right.
    assert np.linalg.eigvalsh(curvature).max() < 3
    # The optimiser comes no nearer than the solver's tolerance lets it; draws lie half a unit for
    # each coordinate below the mode.
    rise = expected_rise(model, around, geometry.centre, geometry.covariance)
    assert rise < geometry.centre.size / 2
