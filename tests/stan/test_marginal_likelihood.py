"""Marginal likelihoods through Stan: the density, prior-only fits, quadrature."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import SMALL_RUN, Problem

from pyburgers.cmdstan.draw_files import read_draws
from pyburgers.cmdstan.program import Density, load_program
from pyburgers.common.array_types import FloatArray
from pyburgers.comparison.marginal_likelihood import log_marginal_likelihood
from pyburgers.fitting.fit import Fit, fit_problem
from pyburgers.kinds.constant_rate.likelihood import LIKELIHOOD as CONSTANT_RATE
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.stan_data import REFERENCE_SOLVER, solver_block
from pyburgers.model.pooling import pooling_of

pytestmark = pytest.mark.usefixtures("programs")


def coordinates_of(one: Fit) -> FloatArray:
    """All draws, shape (n_draws, n_coordinates)."""
    return np.concatenate(read_draws(one.directory.draws_files())["coordinate"])


def density_at(one: Fit, points: FloatArray) -> FloatArray:
    data = json.loads(one.directory.stan_data_file.read_text(encoding="utf-8"))
    program = load_program(CONSTANT_RATE.program)
    return Density(program, {**data, **solver_block(REFERENCE_SOLVER)}).at(points)


def test_the_density_is_that_which_the_chains_sampled(small_fit: Fit, tmp_path: Path) -> None:
    stats = small_fit.posterior["sample_stats"].to_dataset()
    sampled = np.concatenate((stats["lp"] + stats["solver_log_ratio"]).to_numpy())
    found = density_at(small_fit, coordinates_of(small_fit))
    # Log likelihoods of single points at the reference tolerance are kept with six digits.
    np.testing.assert_allclose(found, sampled, atol=2e-3)


def test_a_point_without_solution_has_no_density_and_the_others_keep_theirs(
    small_fit: Fit, tmp_path: Path
) -> None:
    points = coordinates_of(small_fit)[:5]
    alone = density_at(small_fit, points)
    with_bad = np.insert(points, [0, 3], np.full(points.shape[1], 1e4), axis=0)
    found = density_at(small_fit, with_bad)
    assert np.flatnonzero(np.isneginf(found)).tolist() == [0, 4]
    np.testing.assert_array_equal(found[np.isfinite(found)], alone)


def test_the_marginal_likelihood_is_that_of_quadrature(long_fit: Fit, tmp_path: Path) -> None:
    """Gauss and Hermite's, in three coordinates scaled by the draws."""
    draws = coordinates_of(long_fit)
    node, weight = np.polynomial.hermite_e.hermegauss(10)
    grid = np.array(np.meshgrid(node, node, node)).reshape(3, -1).T
    weights = np.prod(np.meshgrid(weight, weight, weight), axis=0).ravel()
    factor = 1.1 * np.linalg.cholesky(np.cov(draws.T))
    density = density_at(long_fit, draws.mean(axis=0) + grid @ factor.T)
    terms = density + 0.5 * np.sum(grid**2, axis=1)
    largest = terms.max()
    exact = largest + np.log(weights @ np.exp(terms - largest)) + np.linalg.slogdet(factor)[1]
    found = log_marginal_likelihood(long_fit)
    assert found.error < 0.1
    assert found.value == pytest.approx(float(exact), abs=4 * found.error)


def test_without_data_it_is_one(small_problem: Problem, tmp_path: Path) -> None:
    prior = small_problem.fit(tmp_path / "prior", use_likelihood=False)
    found = log_marginal_likelihood(prior)
    assert found.error < 0.1
    assert found.value == pytest.approx(0.0, abs=4 * found.error)


@pytest.mark.slow
def test_without_data_it_is_one_for_pooled_parameters_too(
    small_problem: Problem, tmp_path: Path
) -> None:
    """Centre and spread, and parameters given them, have normalised densities."""
    problem = problem_of(
        [small_problem.experiment], small_problem.priors, pooling_of({"maxwell_modulus": "partial"})
    )
    prior = fit_problem(
        problem,
        out=tmp_path / "prior",
        options=replace(SMALL_RUN, draws=1000),
        use_likelihood=False,
        command="test",
    )
    found = log_marginal_likelihood(prior)
    assert found.error < 0.1
    assert found.value == pytest.approx(0.0, abs=4 * found.error)
