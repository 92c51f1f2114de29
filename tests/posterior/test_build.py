"""Groups of draws: the solution at the mean of the parameters, if there is one."""

import logging

import numpy as np
import pytest
import xarray as xr
from conftest import ICE

from pyburgers.fitting.charts_at_modes import draw_priors
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.problem import problem_of
from pyburgers.model.priors import load_priors
from pyburgers.posterior.build import _solution_at_mean


def test_draws_are_kept_though_their_mean_has_no_solution(
    caplog: pytest.LogCaptureFixture,
) -> None:
    test = load_experiment(ICE.parent / "olivine" / "olivine_twin.toml")
    priors = load_priors(ICE.parent / "priors" / "olivine.toml")
    (values,) = draw_priors(problem_of([test], priors), np.random.default_rng(1))
    values |= test.true_parameters or {}
    draws = xr.Dataset({name: ("draw", [value] * 2) for name, value in values.items()})
    found = _solution_at_mean(draws, priors, test)
    assert np.isfinite(found["posterior_mean_solution"]["stress"]).all()
    with caplog.at_level(logging.INFO):
        assert _solution_at_mean(draws.assign(beta=-draws["beta"]), priors, test) == {}
    assert "The posterior mean of the parameters has no solution" in caplog.text
