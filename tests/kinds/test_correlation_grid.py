"""Which problems sum over how residuals correlate, and over what grid."""

from dataclasses import replace

import numpy as np
import pytest
from history_twins import history_twin
from scipy import stats

from pyburgers.kinds.problem import MOST_SUMMED, Problem, problem_of
from pyburgers.kinds.program_data import correlation_block, program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.pooling import pooling_of
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import with_variant

TIME, SHARE = "residual_correlation_time", "residual_correlated_share"


def two_tests(**pooling: str) -> Problem:
    tests = [history_twin("creep", 12), history_twin("relaxation", 8)]
    return problem_of(tests, default_priors("ice"), pooling_of(pooling))


def test_values_of_each_test_have_no_coordinates() -> None:
    problem = two_tests()
    assert {TIME, SHARE} <= {*problem.free}
    assert {*problem.free} - {*problem.layout.names} == {*problem.summed} == {TIME, SHARE}
    data = program_data(problem, solver=SolverOptions())
    assert data["n_coordinates"] == problem.layout.size
    assert data["block_end"] == [0, 1, 3]
    assert sum(data["n_in_block"]) == sum(one.n_points for one in problem.experiments)


@pytest.mark.parametrize("pooling", [{TIME: "shared"}, {SHARE: "partial"}], ids=str)
def test_values_that_hang_together_have_coordinates(pooling: dict[str, str]) -> None:
    problem = two_tests(**pooling)
    assert problem.summed == ()
    assert {TIME, SHARE} <= {*problem.layout.names}
    assert correlation_block(problem)["n_shares"] == 0
    # Modes of single tests are starts of the joint one.
    assert {one.layout.names for one in problem.alone()} == {problem.layout.names}


def test_long_tests_are_not_summed() -> None:
    """Whose sum would cost more than the solver."""
    short = history_twin("creep", 12)
    long = replace(
        short,
        time=np.linspace(1.0, 4000.0, MOST_SUMMED + 1),
        reading=np.linspace(0.001, 0.01, MOST_SUMMED + 1),
        reading_stage=np.zeros(MOST_SUMMED + 1, dtype=np.int64),
    )
    assert problem_of([short], default_priors("ice")).summed
    assert problem_of([long], default_priors("ice")).summed == ()


def test_independent_residuals_have_no_grid() -> None:
    test = history_twin("creep", 12)
    priors = with_variant(default_priors("ice"), test, {"residuals": "independent"})
    problem = problem_of([test], priors)
    assert problem.summed == ()
    assert correlation_block(problem)["share_spline"] == []


def prior(name: str, family: str, **numbers: float) -> Prior:
    return Prior.of_family(name, family, numbers, unit="1", source="test")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "own",
    [
        prior(SHARE, "uniform", lower=0.0, upper=1.0),
        prior(SHARE, "uniform", lower=0.2, upper=0.9),
        prior(SHARE, "normal", location=0.5, scale=0.4, lower=0.0),
        prior(SHARE, "fixed", value=0.4),
        prior(TIME, "lognormal", location=300.0, scale=1.5),
        prior(TIME, "uniform", lower=0.0, upper=2000.0),
        prior(TIME, "half_normal", scale=500.0),
        prior(TIME, "fixed", value=200.0),
    ],
    ids=lambda own: f"{own.parameter} {own.family} {own.lower:g}",
)
def test_the_grid_follows_the_prior(own: Prior) -> None:
    """Masses of cells are those of the prior between their edges, up to its cuts."""
    test = history_twin("creep", 12)
    (priors,) = problem_of([test], default_priors("ice")).priors
    grid = correlation_block(problem_of([test], priors.exchanging(own)))
    name = "share" if own.parameter == SHARE else "length"
    node = np.array(grid[f"{name}_node"][0])
    edge = np.array(
        grid["share_edge"][0] if own.parameter == SHARE else np.exp(grid["log_length_edge"][0])
    )
    mass = np.exp(grid[f"log_{name}_mass"])
    assert mass.sum() == pytest.approx(1.0)
    if own.is_fixed:
        assert node == pytest.approx([own.location])
        assert edge == pytest.approx([own.location] * 2)
        return
    assert (np.diff(node) > 0).all()
    assert (np.diff(edge) > 0).all()
    assert edge[0] < node[0]
    assert node[-1] < edge[-1]
    below = own.distribution().cdf(edge)
    np.testing.assert_allclose(np.diff(below) / (below[-1] - below[0]), mass, rtol=1e-6)
    cut = 2 * stats.norm.sf(3.0) if name == "length" else own.distribution().sf(1.0)
    assert below[-1] - below[0] == pytest.approx(1 - cut, abs=1e-9)
