"""Who decides a number: the data, a prior (and of which quantity), both, or the bound of a prior.

Each prior counts on a scale on which it is a standard normal distribution (`normal_scores`). If
the mean of a prior moves by one standard deviation there, the posterior mean of a quantity moves by
the covariance of the quantity with the score. The squares of these moves, in standard deviations of
the quantity, are the shares of the priors in its variance; the data have the rest. For a linear
model with normal noise all of this is exact.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Literal

import numpy as np
import xarray as xr
from scipy import stats
from scipy.special import ndtr

from pyburgers.common.draws import FloatArray, all_draws
from pyburgers.kinds.stan_data import CENTRE, SPREAD
from pyburgers.model.prior_families import Prior, normal_scores
from pyburgers.model.priors import FLOW_LAW, JOINT_PRIOR, PriorSet
from pyburgers.model.reference_quantities import REFERENCE_QUANTITIES
from pyburgers.posterior.labelled_draws import free_parameters, on_scale_of_prior, own_name

PRIOR_SHARE = 2.0 / 3.0
"""Share of the priors in the variance of a quantity from which its number is theirs."""

LEAST_SHARE = 0.1
"""Share of the priors below which the data decide: a move by 0.3 sd."""

CONFLICT_LEVEL = 0.01
"""Probability with which a fit of a correct model reports any conflict."""

MOST_LEFT = 0.9
"""Share of the prior's variance that may be left for a conflict to be looked for."""

NEAR_BOUND, AT_BOUND = 0.5, 0.15
"""A posterior as flat as its uniform prior has 0.144 of its draws within 0.5 sd of a bound: from
the second number on, draws pile up there."""

MOST_LEFT_AT_BOUND = 0.5
"""Share of the prior's variance that may be left for a bound to be called the one that decides."""

CHANCE_SHIFTS = 8
"""Shifts of draws against each other that say which share of the priors chance alone gives."""


class Origin(StrEnum):
    """Who decides a number, by the rules of `pyburgers.checks.prior_sentences.ORIGIN_RULES`."""

    PRIOR = "prior"
    DATA = "data"
    BOTH = "both"
    CONFLICT = "conflict"
    BOUND = "bound"
    CANNOT_TELL = "cannot tell"


@dataclass(frozen=True)
class Bound:
    """A bound of a prior at which the posterior piles up."""

    side: Literal["lower", "upper"]
    value: float  # SI
    share: float  # of the draws, within `NEAR_BOUND` standard deviations of it
    is_physical: bool  # whether the model itself ends there, such as at zero


@dataclass(frozen=True)
class Influence:
    """Who decides one quantity.

    Moves say, by prior, how far the posterior mean moves if the prior moves by one of its
    standard deviations; of `JOINT_PRIOR` it is the furthest. Chance is the share that priors of
    other quantities have by chance alone. The distance of the posterior mean from the prior's
    median is in standard deviations, counted by probability. The conflict probability is that
    of any quantity of a fit of a correct model to be that far out; 1 if unknown.
    """

    name: str
    moves: Mapping[str, float]
    chance: float = 0.0
    distance: float | None = None
    conflict_probability: float = 1.0
    bound: Bound | None = None
    read_off: frozenset[str] = frozenset()
    usable: bool = True

    @property
    def prior_share(self) -> float:
        """Share of all priors in the variance of the quantity, 0 to 1."""
        found = sum(move**2 for move in self.moves.values()) - self.chance
        return float(np.clip(found, 0.0, 1.0))

    @property
    def is_conflict(self) -> bool:
        """Whether prior and data disagree about it."""
        return self.usable and self.conflict_probability <= CONFLICT_LEVEL

    @property
    def origin(self) -> Origin:
        """Who decides it."""
        if not self.usable or self.chance >= LEAST_SHARE:
            return Origin.CANNOT_TELL
        if self.bound is not None:
            return Origin.BOUND
        if self.is_conflict:
            return Origin.CONFLICT
        if self.prior_share >= PRIOR_SHARE:
            return Origin.PRIOR
        return Origin.BOTH if self.prior_share >= LEAST_SHARE else Origin.DATA

    def was_read_off(self, prior: str) -> bool:
        """Whether a prior, be it by itself or in the joint one, was read off the data."""
        of_joint = prior in FLOW_LAW and JOINT_PRIOR in self.read_off
        return of_joint or prior.split("[")[0] in self.read_off

    @property
    def priors(self) -> tuple[str, ...]:
        """Strongest priors in the decision, which have `PRIOR_SHARE` of what all have in it.

        At a bound or in a conflict it is the quantity's own, then those that would decide without.
        """
        if self.origin in (Origin.DATA, Origin.CANNOT_TELL):
            return ()
        own = (self.name,) if self.origin in (Origin.CONFLICT, Origin.BOUND) else ()
        if own and self.prior_share < PRIOR_SHARE:
            return own
        shares = {name: move**2 for name, move in self.moves.items()}
        ordered = sorted(shares, key=lambda name: -shares[name])
        reached = np.cumsum([shares[name] for name in ordered])
        strongest = ordered[: 1 + int(np.searchsorted(reached, PRIOR_SHARE * reached[-1]))]
        return (*own, *(name for name in strongest if name not in own))


def prior_influence(
    posterior: xr.DataTree,
    priors: PriorSet,
    *,
    spread_scales: Mapping[str, float] = MappingProxyType({}),
    family: int | None = None,
    derived: Mapping[str, FloatArray] = MappingProxyType({}),
    read_off: frozenset[str] = frozenset(),
    of_other_tests: Mapping[str, FloatArray] = MappingProxyType({}),
) -> dict[str, Influence]:
    """Return for every sampled quantity who decides it.

    The priors are those of one test, resolved; in a joint fit the draws are a part of those of
    all tests. A partially pooled parameter has the prior of its centre; the scale is that of
    the prior of its spread. The family is the number of quantities of the whole fit in which a
    conflict may be found by chance, by default of the test. Derived draws have the shape (n,),
    chains one after the other. Scores of priors that other tests alone have are `prior_scores`.
    """
    draws = posterior["posterior"].to_dataset()
    values = {name: all_draws(draws[name]) for name in free_parameters(posterior)}
    own = {name: normal_scores(priors[name].distribution(), values[name]) for name in priors.free}
    columns = prior_scores(posterior, priors)
    of_all = posterior.root["posterior"].to_dataset()
    for name, scale in spread_scales.items():
        centre, spread = own_name(name, CENTRE), own_name(name, SPREAD)
        if centre not in of_all:
            continue
        del own[name], columns[name]
        values |= {key: all_draws(of_all[key]) for key in (centre, spread)}
        own[centre] = normal_scores(priors[name].distribution(), values[centre])
        own[spread] = normal_scores(stats.halfnorm(scale=scale), values[spread])
        columns |= {key: own[key][:, None] for key in (centre, spread)}
    columns |= of_other_tests
    bounded = own.keys() & set(priors.free)
    return {
        name: Influence(
            name,
            *_moves(name, _on_its_scale(name, one, priors, name in bounded), columns),
            *_surprise(own.get(name), family or len(own)),
            bound=_bound(one, own[name], priors[name]) if name in bounded else None,
            read_off=read_off,
        )
        for name, one in {**values, **derived}.items()
    }


def prior_scores(posterior: xr.DataTree, priors: PriorSet) -> dict[str, FloatArray]:
    """Return scores (n, n_scores) of the priors of a test, on a scale on which they are normal."""
    draws = posterior["posterior"].to_dataset()
    values = {name: all_draws(draws[name]) for name in priors.free}
    found = {
        name: normal_scores(priors[name].distribution(), one)[:, None]
        for name, one in values.items()
        if priors.flow_law is None or name not in FLOW_LAW
    }
    if priors.flow_law is not None:
        found[JOINT_PRIOR] = priors.flow_law.scores({name: values[name] for name in FLOW_LAW})
    return found


def _on_its_scale(name: str, draws: FloatArray, priors: PriorSet, has_prior: bool) -> FloatArray:
    """Return draws, or their logarithms if the prior or the sampler counts in these."""
    if has_prior:
        return on_scale_of_prior(draws, priors[name])
    return np.log(draws) if name in REFERENCE_QUANTITIES else draws


def _moves(
    name: str, values: FloatArray, columns: Mapping[str, FloatArray]
) -> tuple[dict[str, float], float]:
    """Return how far each prior moves a quantity, and its share by chance, from shifted draws."""
    sd = float(np.std(values, ddof=1))
    if sd == 0:  # a derived quantity of known parameters
        return dict.fromkeys(columns, 0.0), 0.0
    standard = (values - values.mean()) / sd
    others = [score for prior, score in columns.items() if prior != name]
    shifts = [k * values.size // (CHANCE_SHIFTS + 1) for k in range(1, CHANCE_SHIFTS + 1)]
    by_shift = [
        sum(_move(np.roll(standard, shift), score) ** 2 for score in others) for shift in shifts
    ]
    moves = {prior: _move(standard, score) for prior, score in columns.items()}
    return moves, float(np.mean(by_shift))


def _move(standard: FloatArray, scores: FloatArray) -> float:
    """Covariance with the scores of a prior; of several scores the length of the covariances."""
    found = standard @ (scores - scores.mean(axis=0)) / (standard.size - 1)
    return float(found[0] if found.size == 1 else np.linalg.norm(found))


def _surprise(scores: FloatArray | None, family: int) -> tuple[float | None, float]:
    """Return how far a posterior is from its prior, and the probability of that in a whole fit."""
    if scores is None:
        return None, 1.0
    mean, left = float(scores.mean()), float(scores.var(ddof=1))
    if left > MOST_LEFT:
        return mean, 1.0
    return mean, float(min(1.0, family * 2.0 * ndtr(-abs(mean) / np.sqrt(1.0 - left))))


def _bound(values: FloatArray, scores: FloatArray, prior: Prior) -> Bound | None:
    """Return the bound of a prior at which draws pile up, unless they are nearly the prior's."""
    if prior.family == "lognormal" or scores.var(ddof=1) >= MOST_LEFT_AT_BOUND:
        return None
    reach, physical = NEAR_BOUND * float(np.std(values, ddof=1)), prior.physical_bounds
    lower = float(np.mean(values <= prior.lower + reach))
    upper = float(np.mean(values >= prior.upper - reach))
    if max(lower, upper) < AT_BOUND:
        return None
    if lower >= upper:
        return Bound("lower", prior.lower, lower, physical[0])
    return Bound("upper", prior.upper, upper, physical[1])
