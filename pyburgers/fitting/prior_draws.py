"""What priors say of a test: draws that its Stan program solves, and scores from other tests."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from scipy import stats

from pyburgers.checks.prior_influence import prior_scores
from pyburgers.cmdstan.program import load_program
from pyburgers.common.draws import FloatArray, all_draws
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import Problem, one_test
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import CENTRE, SPREAD, SolverOptions
from pyburgers.model.prior_families import SCORE_AT_BOUND, normal_scores
from pyburgers.model.priors import FLOW_LAW, JOINT_PRIOR, PriorSet
from pyburgers.posterior.labelled_draws import own_name

UNCUT = 50.0
"""Half a range of a prior, in its standard deviations, that cuts nothing off."""


@dataclass(frozen=True, eq=False, repr=False)
class PriorDraws:
    """Draws of the prior of a test with their solutions, to be looked at as a fit is.

    Attributes
    ----------
    experiment : Experiment
        The test.
    priors : PriorSet
        Its priors.
    posterior : DataTree
        Groups posterior (SI) and predictions, as of a fit, of one chain; of a test with readings
        prior_predictive as well, readings with noise.
    n_unsolved : int
        Draws that were left out because they have no solution.

    Examples
    --------
    >>> drawn = pyburgers.prior_draws(test, fit.priors, draws=5)
    >>> drawn.n_unsolved
    0
    """

    experiment: Experiment
    priors: PriorSet
    posterior: xr.DataTree
    n_unsolved: int

    def __repr__(self) -> str:
        """Return a line: how many draws, of which test."""
        draws = self.posterior["posterior"].sizes["draw"]
        return f"<{draws} draws of the prior of {self.experiment.id}>"


def prior_draws(
    experiment: Experiment, priors: PriorSet, *, draws: int, seed: int = 1
) -> PriorDraws:
    """Draw from the priors of a test, each parameter by itself, and solve every draw.

    Parameters
    ----------
    experiment : Experiment
        The test; its readings take no part.
    priors : PriorSet
        Its priors, resolved, such as those of a fit.
    draws, seed : int
        How many, and the seed of the random numbers.

    Raises
    ------
    InputError
        If there are no draws, or the prior of the flow law is a joint one.
    SamplingError
        If no draw has a solution.

    Examples
    --------
    >>> drawn = pyburgers.prior_draws(test, fit.priors, draws=5)
    """
    if draws < 1:
        raise InputError(f"draws: found {draws}, expected at least 1.")
    rng = np.random.default_rng(seed)
    likelihood = likelihood_of(experiment)
    if experiment.n_points:
        priors = priors.resolved(experiment.largest_stress)
    if priors.flow_law is not None:
        raise InputError(
            f"{experiment.id}: found a joint prior of the flow law, expected a prior for each "
            "parameter by itself."
        )
    values = {
        name: np.full(draws, prior.location)
        if prior.is_fixed
        else prior.distribution().rvs(size=draws, random_state=rng)
        for name, prior in priors.priors.items()
    }
    test = experiment if experiment.n_points else experiment.to_be_solved()
    problem = one_test(test, _each_by_itself(priors))
    (coordinates,) = problem.coordinates
    names = coordinates.quantities
    places = [coordinates.of_quantity(k, values[name]) for k, name in enumerate(names)]
    rows = np.column_stack([*places, rng.standard_normal((draws, test.n_driving_errors))])
    grid = likelihood.grid(experiment)
    data = program_data(problem, solver=SolverOptions(), grids=[grid])
    kept, drawn = load_program(likelihood.program).generate_at(data, "coordinate", rows)
    if kept.any():
        drawn, kept[kept] = drawn.finite_in([next(iter(likelihood.grid_quantities))])
    if not kept.any():
        raise SamplingError(
            f"{experiment.id}: none of {draws} draws from the prior has a solution; "
            "check the units and the bounds of the priors."
        )
    clock = likelihood.clock.name
    labels = {"chain": [1], "draw": np.flatnonzero(kept)}
    own = {name: (("chain", "draw"), one[None, kept]) for name, one in values.items()}
    solved = {
        name: (("chain", "draw", clock), drawn[column], {"units": unit})
        for column, (name, unit) in likelihood.grid_quantities.items()
    }
    groups = {
        "posterior": xr.Dataset(own, labels),
        "predictions": xr.Dataset(solved, {**labels, clock: grid}),
    }
    if experiment.n_points:
        read = (("chain", "draw", "point"), drawn["response_replicated"])
        points = {**labels, "point": np.arange(experiment.n_points)}
        groups["prior_predictive"] = xr.Dataset({likelihood.response.name: read}, points)
    tree = xr.DataTree.from_dict(groups)
    return PriorDraws(experiment, priors, tree, n_unsolved=int(draws - kept.sum()))


def prior_groups(
    experiment: Experiment, priors: PriorSet, draws: int, seed: int
) -> dict[str, xr.Dataset]:
    """Return draws of the free parameters, and readings with noise for each: ArviZ's groups."""
    names = list(priors.free)
    if priors.flow_law is not None:  # a joint prior, of which there are no readings
        rng = np.random.default_rng(seed)
        rows = [priors.sample(rng) for _ in range(draws)]
        columns = {name: (("chain", "draw"), [[row[name] for row in rows]]) for name in names}
        return {"prior": xr.Dataset(columns)}
    drawn = prior_draws(experiment, priors, draws=draws, seed=seed).posterior
    return {
        "prior": drawn["posterior"].to_dataset()[names],
        "prior_predictive": drawn["prior_predictive"].to_dataset(),
    }


def _each_by_itself(priors: PriorSet) -> PriorSet:
    """Bound Q_M and beta where nothing is cut, so that no point of the flow law replaces one."""
    changed = []
    for prior in (priors["activation_enthalpy"], priors["beta"]):
        if not prior.is_fixed:
            reach = UNCUT * prior.scale
            lower = max(prior.lower, prior.location - reach)
            upper = min(prior.upper, prior.location + reach)
            changed.append(replace(prior, lower=lower, upper=upper))
    return priors.exchanging(*changed)


def scores_beside(
    problem: Problem, parts: Sequence[Problem], groups: Mapping[str, xr.DataTree]
) -> dict[str, dict[str, FloatArray]]:
    """Return scores (n, n_scores) by test and prior; parts are the tests, groups their draws.

    They are those of priors that a test alone does not have: of parameters of other tests, of
    centres and spreads, and of the deviations of all tests from these.
    """
    own: dict[str, dict[str, FloatArray]] = {}
    for e, alone in enumerate(parts):
        scores_of_test = own[alone.name] = {}
        for name, scores in prior_scores(groups[alone.name], alone.priors[0]).items():
            source = FLOW_LAW[0] if name == JOINT_PRIOR else name
            if problem.kind(source) not in ("shared", "partial"):
                scores_of_test[own_name(name, problem.owner(source, e))] = scores
    every = {name: scores for one in own.values() for name, scores in one.items()}
    pooled = _pooled_scores(problem, groups[parts[0].name].root) if problem.partial else {}
    return {
        test: pooled | {name: scores for name, scores in every.items() if name not in known}
        for test, known in own.items()
    }


def _pooled_scores(problem: Problem, of_all: xr.DataTree) -> dict[str, FloatArray]:
    """Return scores (n, 1) of centres, spreads, and deviations of tests in spreads."""
    draws, plain, found = of_all["posterior"].to_dataset(), problem.coordinates, {}
    for name in problem.partial:
        k = plain[0].quantities.index(name)
        centre, spread = (all_draws(draws[own_name(name, one)]) for one in (CENTRE, SPREAD))
        of_spread = stats.halfnorm(scale=problem.pooling.spread_scales[name])
        found[own_name(name, CENTRE)] = normal_scores(
            problem.priors[0][name].distribution(), centre
        )
        found[own_name(name, SPREAD)] = normal_scores(of_spread, spread)
        for e, own in enumerate(plain):
            if problem.has_effect(name, e):
                key = own_name(name, problem.owner(name, e))
                away = own.of_quantity(k, all_draws(draws[key])) - plain[0].of_quantity(k, centre)
                found[key] = np.clip(away / spread, -SCORE_AT_BOUND, SCORE_AT_BOUND)
    return {name: scores[:, None] for name, scores in found.items()}
