"""Who decides numbers (`pyburgers.checks.prior_influence`), in tables and sentences."""

from collections.abc import Callable, Collection, Iterator, Mapping
from types import MappingProxyType

import numpy as np
import pandas as pd

from pyburgers.checks.prior_influence import (
    AT_BOUND,
    CONFLICT_LEVEL,
    LEAST_SHARE,
    NEAR_BOUND,
    PRIOR_SHARE,
    Bound,
    Influence,
    Origin,
)
from pyburgers.common.units import number
from pyburgers.model.display import shown_quantity, symbol_text, unit_after_number
from pyburgers.model.priors import JOINT_PRIOR

ORIGIN_RULES: Mapping[Origin, tuple[str, str]] = MappingProxyType(
    {
        Origin.DATA: (
            "The data decide the number.",
            f"The share of the priors is less than {LEAST_SHARE:g}.",
        ),
        Origin.BOTH: (
            "Data and priors decide it together.",
            f"The share of the priors is {LEAST_SHARE:g} to {PRIOR_SHARE:.2f}.",
        ),
        Origin.PRIOR: (
            "The priors decide it, its own or those in brackets.",
            f"The share of the priors is {PRIOR_SHARE:.2f} or more.",
        ),
        Origin.BOUND: (
            "The draws pile up at a bound of its prior.",
            f"At least {100 * AT_BOUND:.0f} % of the draws lie within {NEAR_BOUND:g} standard "
            "deviations of the bound, and the data took off half of the variance of the prior.",
        ),
        Origin.CONFLICT: (
            "Prior and data disagree; the number is a compromise.",
            "Given how much the data narrow the prior, the posterior mean lies further from its "
            "median than chance allows. A fit whose model and priors are right reports any "
            f"conflict with a probability of {CONFLICT_LEVEL:g}.",
        ),
        Origin.CANNOT_TELL: (
            "The draws are too few.",
            f"Chance alone gives the priors a share of {LEAST_SHARE:g} or more.",
        ),
    }
)
"""What it means that each of them decides a number, and by which rule."""

SHARE_TEXT = (
    "If the mean of a prior moves by one of its standard deviations, the number moves too. The "
    "share of the prior is the square of that move, in standard deviations of the posterior. "
    "Priors count on a scale on which they are normal. Brackets name the strongest priors, which "
    "have two thirds of the share of all."
)


def symbol_of(name: str) -> str:
    """Return the symbol of a quantity, also of a centre or spread, or of `JOINT_PRIOR`."""
    if name == JOINT_PRIOR:
        return "the flow law"
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
    """Say how far what a label names is from its prior's median, and what that was read off."""
    mark = READ_OFF * influence.was_read_off(influence.name)
    return f"{label} ({influence.distance:+.1f} prior sd){mark}"


CONFLICT_MEANING = (
    "what comes out is a compromise of the two, so check the prior's source, and whether the model "
    "describes the data"
)


def disagreement(influences: Mapping[str, Influence]) -> str | None:
    """Name what prior and data disagree about; None where they do not."""
    names = conflicts(influences)
    listed = ", ".join(conflict_text(_label(name), influences[name]) for name in names)
    return f"Prior and data disagree about {listed}" if names else None


def conflict_sentence(influences: Mapping[str, Influence]) -> str | None:
    """Say what prior and data disagree about, and what that means; None where they do not."""
    named = disagreement(influences)
    return named and f"{named}: {CONFLICT_MEANING}."


def decision_sentences(influences: Mapping[str, Influence]) -> tuple[str, ...]:
    """Say which numbers a bound or another prior decides, and which priors the data had part in."""
    read_off = frozenset().union(*(one.read_off for one in influences.values()))
    return (*_decisions(influences), *read_off_sentences(read_off))


def _decisions(influences: Mapping[str, Influence]) -> Iterator[str]:
    for name, one in influences.items():
        if one.origin is Origin.CANNOT_TELL:
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
    if name == JOINT_PRIOR:
        return symbol_of(name)
    base, bracket, owner = name.partition("[")
    return shown_quantity(base).label + bracket + owner


def _bound_sentence(name: str, bound: Bound) -> str:
    quantity = shown_quantity(name.split("[")[0])
    value = f"{number(bound.value * quantity.display_factor)}{unit_after_number(quantity)}"
    meaning = (
        "The quantity ends there: quote the other end of the interval as a limit, no mean and sd."
        if bound.is_physical
        else "Widen the prior, or say in its 'source' why it ends there."
    )
    return (
        f"The {bound.side} bound of the prior, {value}, decides {_label(name)}: "
        f"{100 * bound.share:.0f} % of the draws lie within {NEAR_BOUND:g} sd of it. {meaning}"
    )
