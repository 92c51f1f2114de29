"""Draws of a fit as ArviZ takes them: in 0.x and 1.x, with the names that each version has."""

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np
import pytest
from matplotlib import pyplot as plt

from pyburgers.fitting.fit import Fit

az: Any = import_module("arviz")  # of either version
IS_0 = az.__version__.startswith("0.")

GROUPS = {
    *("posterior", "prior", "posterior_predictive", "prior_predictive", "log_likelihood"),
    *("log_prior", "sample_stats", "observed_data", "constant_data"),
}


@pytest.fixture(scope="module")
def data(small_fit: Fit) -> Any:
    return small_fit.to_arviz(prior_draws=50)


def groups_of(data: Any) -> set[str]:
    return set(data.groups()) if IS_0 else set(data.children)


def test_groups_hold_what_was_sampled_with_units(data: Any, small_fit: Fit) -> None:
    assert groups_of(data) == GROUPS
    assert set(data["posterior"].data_vars) == {*small_fit.priors.free, "reference_stress"}
    assert data["posterior"]["maxwell_modulus"].attrs["units"] == "Pa"
    assert set(data["prior"].data_vars) == set(small_fit.priors.free)
    readings = small_fit.experiment.n_points
    for name in ("posterior_predictive", "prior_predictive", "log_likelihood", "observed_data"):
        assert data[name]["stress"].sizes["point"] == readings
    assert data["constant_data"]["strain"].attrs["units"] == "1"
    np.testing.assert_array_equal(data["observed_data"]["stress"], small_fit.experiment.response)


def test_draws_of_the_prior_are_left_out_on_request(small_fit: Fit, joint: Fit) -> None:
    without = GROUPS - {"prior", "prior_predictive"}
    assert groups_of(small_fit.to_arviz(prior_draws=0)) == without
    assert groups_of(joint.to_arviz()) <= without
    names = {str(name) for name in joint.to_arviz()["posterior"].data_vars}
    assert "stress_noise[PIL40]" in names


def test_the_prior_predictive_scatters_as_the_prior_does(data: Any) -> None:
    drawn = data["prior_predictive"]["stress"].to_numpy()
    posterior = data["posterior_predictive"]["stress"].to_numpy()
    assert np.isfinite(drawn).all()
    assert drawn[..., -1].std() > 3 * posterior[..., -1].std()


CALLS: dict[str, Callable[[Any], object]] = {
    "summary": lambda data: az.summary(data),
    "trace": lambda data: az.plot_trace(data),
    "posterior": lambda data: (az.plot_posterior if IS_0 else az.plot_dist)(data),
    "pair": lambda data: az.plot_pair(data),
    "forest": lambda data: az.plot_forest(data),
    "rank": lambda data: az.plot_rank(data),
    "ppc": lambda data: (az.plot_ppc if IS_0 else az.plot_ppc_dist)(data),
    "prior ppc": lambda data: (
        az.plot_ppc(data, group="prior")
        if IS_0
        else az.plot_ppc_dist(data, group="prior_predictive")
    ),
    "loo": lambda data: az.loo(data, pointwise=True),
    "compare": lambda data: az.compare({"one": data, "other": data}),
    "psense": lambda data: az.psens(data, component="prior") if IS_0 else az.psense_summary(data),
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", CALLS)
def test_arviz_takes_the_draws(data: Any, name: str) -> None:
    assert CALLS[name](data) is not None
    plt.close("all")
