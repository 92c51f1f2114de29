"""Who decides a number: the data, a prior (and of which quantity), both, or the bound of a prior.

Each prior counts on a scale on which it is a standard normal distribution (`normal_scores`). If
the mean of a prior moves by one standard deviation there, the posterior mean of a quantity moves by
the covariance of the quantity with the score. The squares of these moves, in standard deviations of
the quantity, are the shares of the priors in its variance; the data have the rest. For a linear
model with normal noise all of this is exact. Tables and sentences say it below.
"""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Literal

import numpy as np
import pandas as pd
import xarray as xr
from scipy.special import ndtr

from pyburgers.common.draws import FloatArray, all_draws
from pyburgers.common.units import number
from pyburgers.kinds.stan_data import CENTRE, SPREAD
from pyburgers.model.display import shown_quantity, symbol_text, unit_after_number
from pyburgers.model.parameters import RESIDUAL_CORRELATION
from pyburgers.model.prior_families import Prior, normal_scores
from pyburgers.model.priors import FLOW_LAW, JOINT_PRIOR, PriorSet
from pyburgers.model.read_quantities import BY_NOISE
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

MANY_BOUNDS = 3
"""Numbers at bounds of their priors from which a wrong input is a better guess than the priors."""

CHANCE_SHIFTS = 8
"""Shifts of draws against each other that say which share of the priors chance alone gives."""


class Origin(StrEnum):
    """Who decides a number, by the rules of `pyburgers.page.glossary.ORIGIN_RULES`."""

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
        name = prior.split("[")[0]
        return name in self.read_off or (name in FLOW_LAW and JOINT_PRIOR in self.read_off)

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
    family: int | None = None,
    derived: Mapping[str, FloatArray] = MappingProxyType({}),
    read_off: frozenset[str] = frozenset(),
    scores_beside: Mapping[str, FloatArray] = MappingProxyType({}),
) -> dict[str, Influence]:
    """Return for every sampled quantity who decides it.

    The priors are those of one test, resolved; in a joint fit the draws are a part of those of
    all tests, and `pyburgers.fitting.prior_draws.scores_beside` has the other scores. The family is
    the number of quantities of the whole fit in which a conflict may be found by chance, by default
    of the test. Derived draws have the shape (n,), chains one after the other.
    """
    draws = posterior["posterior"].to_dataset()
    values = {name: all_draws(draws[name]) for name in free_parameters(posterior)}
    own = {name: normal_scores(priors[name].distribution(), values[name]) for name in priors.free}
    if priors.flow_law is not None:
        # It is normal in its flow rate, not in Q_M, which follows from that.
        del own["activation_enthalpy"]
        values[JOINT_PRIOR] = priors.flow_law.log_flow_rate(values)
        own[JOINT_PRIOR] = priors.flow_law.flow_rate_scores(values[JOINT_PRIOR])
    bounded = {name: own[name] for name in priors.free if name in own}
    columns = {**prior_scores(posterior, priors), **scores_beside}
    of_all = posterior.root["posterior"].to_dataset()
    for name in [key.partition("[")[0] for key in scores_beside if key.endswith(f"[{CENTRE}]")]:
        for scores in (own, columns):  # of a test that feels the parameter
            scores.pop(name, None)
        for key in (own_name(name, CENTRE), own_name(name, SPREAD)):
            values[key], own[key] = all_draws(of_all[key]), scores_beside[key][:, 0]
    return {
        name: Influence(
            name,
            *_moves(name, _on_its_scale(name, one, priors, name in bounded), columns),
            *_surprise(own.get(name), family or len(own)),
            bound=_bound(one, bounded[name], priors[name]) if name in bounded else None,
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


def symbol_of(name: str) -> str:
    """Return the symbol of a quantity, also of a centre or spread, or of `JOINT_PRIOR`."""
    if name.startswith(JOINT_PRIOR):
        return f"the flow law{name.removeprefix(JOINT_PRIOR)}"
    return symbol_text(shown_quantity(name))


def decision_columns(influence: Influence | None) -> dict[str, object]:
    """Return the columns of a table of numbers that say who decides one; empty where unknown."""
    if influence is None:
        return {"decided_by": "", "by_prior_of": "", "prior_share": np.nan}
    marked = (f"{name}{READ_OFF * influence.was_read_off(name)}" for name in influence.priors)
    return {
        "decided_by": influence.origin.value,
        "by_prior_of": "; ".join(marked),
        "prior_share": influence.prior_share,
    }


READ_OFF = " [read off these data]"
"""Behind the name of a prior that was read off the data of the fit."""


def decision_text(
    name: str, decided_by: str, by_prior_of: str, symbol: Callable[[str], str] = symbol_of
) -> str:
    """Say who decides a quantity, from its `decision_columns`, such as ``prior (of Q_M)``."""
    if by_prior_of.removesuffix(READ_OFF) in ("", name):
        return decided_by + READ_OFF * by_prior_of.endswith(READ_OFF)
    shown = [
        symbol(one.removesuffix(READ_OFF)) + READ_OFF * one.endswith(READ_OFF)
        for one in by_prior_of.split("; ")
    ]
    return f"{decided_by} (of {', '.join(shown)})"


def influence_numbers(influences: Mapping[str, Influence]) -> pd.DataFrame:
    """Return every number of `Influence`, a row for each quantity and a column for each prior."""
    rows = {
        name: {
            **decision_columns(one),
            "chance": one.chance,
            "distance": one.distance,
            "conflict_probability": one.conflict_probability,
            "share_at_bound": 0.0 if one.bound is None else one.bound.share,
            **{f"moved_by_{prior}": move for prior, move in one.moves.items()},
        }
        for name, one in influences.items()
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")


def conflicts(influences: Mapping[str, Influence]) -> list[str]:
    """Return the quantities about which prior and data disagree, those furthest out first."""
    found = [name for name, influence in influences.items() if influence.is_conflict]
    return sorted(found, key=lambda name: -abs(influences[name].distance or 0.0))


def conflict_text(label: str, influence: Influence) -> str:
    """Say how far what a label names is from its prior's median, and what that was read off.

    A prior that is not normal may have no number so far out: the probability beyond is the same.
    """
    label = f"the flow rate of {label}" if influence.name == JOINT_PRIOR else label
    mark = READ_OFF * influence.was_read_off(influence.name)
    return f"{label} ({influence.distance:+.1f} sd of a normal prior){mark}"


CONFLICT_MEANING = (
    "what comes out is a compromise of the two, so check the prior's source, and whether the model "
    "describes the data"
)


OF_NOISE = frozenset({*BY_NOISE, *RESIDUAL_CORRELATION})
"""Parameters of the residuals."""

NOISE_MEANING = (
    "noise takes up what the model misses, so read first whether the model describes the data"
)


def disagreement(influences: Mapping[str, Influence]) -> str | None:
    """Name what prior and data disagree about; None where they do not."""
    names = conflicts(influences)
    listed = ", ".join(conflict_text(_label(name), influences[name]) for name in names)
    return f"Prior and data disagree about {listed}" if names else None


def conflict_sentence(influences: Mapping[str, Influence]) -> str | None:
    """Say what prior and data disagree about, and what that means; None where they do not."""
    named = disagreement(influences)
    of_noise = {one.partition("[")[0] for one in conflicts(influences)} <= OF_NOISE
    return named and f"{named}: {NOISE_MEANING if of_noise else CONFLICT_MEANING}."


def decision_sentences(influences: Mapping[str, Influence]) -> tuple[str, ...]:
    """Say which numbers a bound or another prior decides, and which priors the data had part in."""
    read_off = frozenset().union(*(one.read_off for one in influences.values()))
    return (*_decisions(influences), *read_off_sentences(read_off))


def _decisions(influences: Mapping[str, Influence]) -> Iterator[str]:
    bounds = [one.bound for one in influences.values() if one.origin is Origin.BOUND]
    n_own = sum(not bound.is_physical for bound in bounds if bound is not None)
    if n_own >= MANY_BOUNDS:
        yield (
            f"{n_own} numbers lie at bounds of their priors, which may mean a wrong input. First "
            "check the units of stress, strain rate, temperature and grain size."
        )
    for name, one in influences.items():
        # The joint prior is no number of a table.
        if one.origin is Origin.CANNOT_TELL or one.name.startswith(JOINT_PRIOR):
            continue
        if one.bound is not None:
            yield _bound_sentence(name, one.bound)
        elif one.origin is Origin.PRIOR and one.priors[0] != one.name:
            yield _priors_sentence(name, one)


def _priors_sentence(name: str, one: Influence) -> str:
    label, by = _label(name), " and ".join(map(_label, one.priors))
    moves = " or ".join(f"{abs(one.moves[prior]):.2f}" for prior in one.priors)
    said, which = (
        (f"The prior of {by} decides {label}", "that prior")
        if len(one.priors) == 1
        else (f"The priors of {by} together decide {label}", "one of them")
    )
    return (
        f"{said}, not the data. If {which} moved by one of its standard deviations, "
        f"{symbol_of(name)} would move by {moves} of its own."
    )


def read_off_sentences(names: Collection[str]) -> tuple[str, ...]:
    """Say which priors were read off the data of the fit; nothing where none was."""
    if not names:
        return ()
    return (
        f"Priors that were read off these data: {', '.join(map(symbol_of, sorted(names)))}. There "
        "the data count twice: agreement of prior and data means nothing, intervals are too "
        "narrow, and the marginal likelihood is too high.",
    )


def _label(name: str) -> str:
    """Return the label of a quantity, as `symbol_of` does its symbol."""
    if name.startswith(JOINT_PRIOR):
        return symbol_of(name)
    base, bracket, owner = name.partition("[")
    return shown_quantity(base).label + bracket + owner


def _bound_sentence(name: str, bound: Bound) -> str:
    quantity = shown_quantity(name.split("[")[0])
    value = f"{number(bound.value * quantity.display_factor)}{unit_after_number(quantity)}"
    meaning = (
        "The quantity ends there: quote the other end of the interval as a limit, no mean and sd."
        if bound.is_physical
        else "Check the data and their units first; then widen the prior, or say in its 'source' "
        "why it ends there."
    )
    return (
        f"The {bound.side} bound of the prior, {value}, decides {_label(name)}: "
        f"{100 * bound.share:.0f} % of the draws lie within {NEAR_BOUND:g} sd of it. {meaning}"
    )
