"""Priors that count for a test of a joint fit and that other tests alone have."""

from collections.abc import Mapping, Sequence

import xarray as xr

from pyburgers.checks.prior_influence import prior_scores
from pyburgers.common.draws import FloatArray
from pyburgers.kinds.problem import Problem
from pyburgers.model.priors import FLOW_LAW, JOINT_PRIOR
from pyburgers.posterior.labelled_draws import own_name


def scores_beside(
    problem: Problem, parts: Sequence[Problem], groups: Mapping[str, xr.DataTree]
) -> dict[str, dict[str, FloatArray]]:
    """Return scores (n, n_scores) by test and prior; parts are the tests, groups their draws."""
    own = {
        alone.name: {
            own_name(name, problem.owner(source, e)): scores
            for name, scores in prior_scores(groups[alone.name], alone.priors[0]).items()
            if problem.kind(source := FLOW_LAW[0] if name == JOINT_PRIOR else name)
            not in ("shared", "partial")
        }
        for e, alone in enumerate(parts)
    }
    every = {name: scores for one in own.values() for name, scores in one.items()}
    return {
        test: {name: scores for name, scores in every.items() if name not in known}
        for test, known in own.items()
    }
