"""Pareto smoothed importance weights, whatever the version of ArviZ."""

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from pyburgers.posterior.labelled_draws import pareto_k, relative_efficiency, smooth_weights


def test_weights_add_up_and_rise_with_the_ratios() -> None:
    ratios = np.random.default_rng(1).normal(size=500)
    log_weights, _ = smooth_weights(ratios)
    assert np.exp(log_weights).sum() == pytest.approx(1.0)
    assert np.all(np.diff(log_weights[np.argsort(ratios)]) >= 0)


def test_the_tail_of_the_ratios_counts_not_that_of_their_inverse() -> None:
    ratios = np.random.default_rng(2).normal(size=4000) ** 2
    # A chi-squared logarithm has a tail like x^(-1/2): not even a mean.
    assert pareto_k(ratios) > 1
    assert pareto_k(-ratios) < 0


def test_weights_turn_draws_of_one_normal_into_another() -> None:
    draws = np.random.default_rng(3).normal(size=8000)
    target = stats.norm(0.5, 0.8)
    log_weights, shape = smooth_weights(target.logpdf(draws) - stats.norm.logpdf(draws))
    assert shape < 0.7
    assert np.exp(log_weights) @ draws == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("n", [4, 24, 100])
def test_equal_ratios_have_equal_weights_and_no_tail(n: int) -> None:
    log_weights, shape = smooth_weights(np.full(n, -800.0))
    np.testing.assert_allclose(np.exp(log_weights), 1 / n)
    assert shape == -np.inf


def test_a_handful_of_draws_has_no_tail_to_smooth() -> None:
    ratios = np.array([0.0, 1.0, 2.0])
    log_weights, shape = smooth_weights(ratios)
    np.testing.assert_allclose(np.exp(log_weights), np.exp(ratios) / np.exp(ratios).sum())
    assert shape == np.inf


def test_efficiency_is_one_for_independent_draws_and_less_for_a_slow_chain() -> None:
    rng = np.random.default_rng(4)
    independent = rng.normal(size=(4, 1000))
    slow = np.repeat(rng.normal(size=(4, 100)), 10, axis=1)
    values = xr.DataArray(
        np.stack([independent, slow, np.ones((4, 1000))], axis=-1), dims=("chain", "draw", "point")
    )
    found = relative_efficiency(values)
    assert found[0] == pytest.approx(1.0, abs=0.2)
    assert found[1] == pytest.approx(0.1, rel=0.4)
    assert found[2] == 1.0
