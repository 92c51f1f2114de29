"""A statement of the paper, how probable it is before and after the data, and its verdict.

A statement holds or fails in each draw, so it has a probability under the prior, under the prior
and one number of the data (the peak stress of a curve, the amplitude of an oscillation), and under
the posterior. It is agreed to only where the posterior is sure of it and the two others are not:
what the prior grants, or what the model cannot fail, is no finding of the data.

A statement about a whole distribution, such as how narrow it is, holds or does not hold under each
of the three.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Generic, TypeVar

import pandas as pd
from common import BoolArray, Fitted

from maor.before_data import LEAST_EFFECTIVE, Knowledge

LIKELY, UNLIKELY = 0.9, 0.1
"""Probabilities above and below which a statement is taken as right and as wrong."""

GROUNDS = ("our posterior", "rule")
"""Columns of the table of statements that say what verdicts rest on."""

GAIN = 3.0
"""Factor by which data have to change the odds of a statement to have had a part in its verdict."""


NARROW = 0.5
"""Share of another standard deviation below which a posterior counts as narrow."""

MOST, FEW = 2 / 3, 1 / 3
"""Shares of parameters, and of a prior's standard deviation, for the rules that count them."""

DOMINANT = 2.0
"""Ratio from which one of two numbers is called much larger than the other."""


class Verdict(StrEnum):
    """What became of a statement; only the first two are findings of the data."""

    AGREES = "agrees"
    DISAGREES = "does not agree"
    CANNOT_TELL = "cannot tell"
    CANNOT_FAIL = "cannot fail"
    CANNOT_HOLD = "cannot hold"
    PRIOR_GRANTS = "granted by the prior"
    NUMBER_GRANTS = "granted by one number"
    PRIOR_EXCLUDES = "excluded by the prior"
    NUMBER_EXCLUDES = "excluded by one number"

    @property
    def counts(self) -> bool:
        """Whether it is a finding of the whole curve or record."""
        return self in {Verdict.AGREES, Verdict.DISAGREES}


_FOR = (Verdict.CANNOT_FAIL, Verdict.PRIOR_GRANTS, Verdict.NUMBER_GRANTS, Verdict.AGREES)
_AGAINST = (
    Verdict.CANNOT_HOLD,
    Verdict.PRIOR_EXCLUDES,
    Verdict.NUMBER_EXCLUDES,
    Verdict.DISAGREES,
)
"""From what the data had no part in to what they found."""

VERDICTS_TEXT = (
    f"A statement is right where its posterior probability is above {LIKELY:g} and wrong where it "
    f"is below {UNLIKELY:g}; in between the data cannot tell. It is a finding (agrees, does not "
    "agree) only where the data added to it: where the prior alone, or the prior and one number of "
    "the data (the peak stress of a curve, the amplitude of an oscillation), say so already, or "
    f"where the data change its odds less than {GAIN:g} times, the verdict names what granted or "
    "excluded it, and the statement is not counted; nor is one that fails, or holds, in no draw "
    "of the prior. "
    "The middle probability comes from draws of the prior, weighed by how well their solutions "
    f"meet the one number; below {LEAST_EFFECTIVE:g} effective draws it is not used, and the "
    "verdict is that we cannot tell. Statements about a whole distribution hold (yes) or not (no) "
    "under each of the three; what is so without the data already, such as that a width is that of "
    "the prior, is granted or excluded by the prior as well. Of several samples or treatments the "
    "verdict is the one they share, with the least credit any of them gives."
)


@dataclass(frozen=True)
class Belief:
    """How sure one is of a statement about one test, as knowledge grows.

    Numbers are its probability under the prior, under the prior and one number, and under the
    posterior; of a statement about a whole distribution whether it holds. None stands where that
    has no meaning, or, of a whole distribution, where it is neither clearly so nor clearly not.
    Effective draws are those behind the one number.
    """

    prior: float | bool | None
    number: float | bool | None
    posterior: float | bool | None
    effective_draws: float

    @classmethod
    def of(cls, three: Iterable[float | bool | None], known: Knowledge) -> "Belief":
        """Return the belief under the prior, with one number, and under the posterior."""
        prior, number, posterior = three
        return cls(prior, number, posterior, known.effective_draws)

    @property
    def verdict(self) -> Verdict:
        """What follows for this test (`VERDICTS_TEXT`)."""
        if self.posterior is None:
            return Verdict.CANNOT_TELL
        if isinstance(self.posterior, bool):
            return self._of_a_distribution(self.posterior)
        return self._of_draws(self.posterior)

    def _of_a_distribution(self, holds: bool) -> Verdict:
        _, by_prior, by_number, by_data = _FOR if holds else _AGAINST
        if self.prior is holds:
            return by_prior
        if self.number is not None and self.effective_draws < LEAST_EFFECTIVE:
            return Verdict.CANNOT_TELL
        return by_number if self.number is holds else by_data

    def _of_draws(self, posterior: float) -> Verdict:
        prior, number = self.prior, self.number
        assert prior is not None  # of every statement on draws
        assert number is not None
        if prior == 1:
            return Verdict.CANNOT_FAIL
        if prior == 0 and posterior == 0:
            return Verdict.CANNOT_HOLD
        if UNLIKELY <= posterior <= LIKELY:
            return Verdict.CANNOT_TELL
        _, by_prior, by_number, by_data = _FOR if posterior > LIKELY else _AGAINST
        if posterior < UNLIKELY:
            prior, number, posterior = 1 - prior, 1 - number, 1 - posterior
        if granted(prior, posterior):
            return by_prior
        if self.effective_draws < LEAST_EFFECTIVE:
            return Verdict.CANNOT_TELL
        return by_number if granted(number, posterior) else by_data


def granted(before: float, after: float) -> bool:
    """Whether what is likely after the data was so before, or hardly less (probabilities)."""
    return before > LIKELY or after * (1 - before) < GAIN * before * (1 - after)


def probability_of(before: BoolArray, after: BoolArray, known: Knowledge) -> Belief:
    """Return how probable something is that is true or not in each draw of prior and posterior."""
    return Belief(
        prior=float(before.mean()),
        number=float(known.weights @ before),
        posterior=float(after.mean()),
        effective_draws=known.effective_draws,
    )


def probability(known: Knowledge, event: Callable[[Fitted], BoolArray]) -> Belief:
    """Return how probable an event is, which says of draws in which of them it is true."""
    return probability_of(event(known.prior), event(known.fit), known)


@dataclass(frozen=True)
class Statement:
    """One statement of the paper in our words, and what became of it.

    It has the place in the paper, a sentence with the numbers of our posterior, how sure one is of
    it by sample or treatment, and a sentence that says when it holds.
    """

    key: str
    source: str
    text: str
    evidence: str
    beliefs: Mapping[str, Belief] = field(hash=False)
    rule: str

    @property
    def verdict(self) -> Verdict:
        """What all samples or treatments share."""
        return common_verdict(belief.verdict for belief in self.beliefs.values())


Known = TypeVar("Known")


@dataclass(frozen=True)
class Claim(Generic[Known]):
    """A statement of the paper and how it is judged.

    The judge receives what is known of a sample or treatment, and returns the belief and what the
    posterior says in words. The evidence is the lead, then name and words of each in a format.
    """

    key: str
    source: str
    text: str
    judge: Callable[[Known], tuple[Belief, str]]
    rule: str
    lead: str = ""
    each: str = "{} {}"
    separator: str = ", "

    def judged(self, known: Mapping[str, Known]) -> Statement:
        """Judge it by samples or treatments, at least one."""
        found = {name: self.judge(one) for name, one in known.items()}
        told = (self.each.format(name, words) for name, (_, words) in found.items())
        evidence = f"{self.lead}{self.separator.join(told)}."
        beliefs = {name: belief for name, (belief, _) in found.items()}
        return Statement(
            self.key,
            self.source,
            self.text,
            f"{evidence[0].upper()}{evidence[1:]}",
            beliefs,
            self.rule,
        )


def event(
    happens: Callable[[Fitted], BoolArray], words: Callable[[Knowledge], str]
) -> Callable[[Knowledge], tuple[Belief, str]]:
    """Return the judge of an event that is true or not in each draw."""
    return lambda known: (probability(known, happens), words(known))


def statements_table(statements: Iterable[Statement]) -> pd.DataFrame:
    """Return statements as text, with what is believed before and after the data beside each."""
    rows = []
    for statement in statements:
        beliefs = statement.beliefs.values()
        rows.append(
            {
                "paper": statement.source,
                "statement": statement.text,
                "verdict": str(statement.verdict),
                "prior": " / ".join(_shown(one.prior) for one in beliefs),
                "prior and one number": " / ".join(_shown(one.number) for one in beliefs),
                "posterior": " / ".join(_shown(one.posterior) for one in beliefs),
                "effective draws": " / ".join(f"{one.effective_draws:.0f}" for one in beliefs),
                "of": " / ".join(statement.beliefs),
                "our posterior": statement.evidence,
                "rule": statement.rule,
            }
        )
    columns = [
        *("paper", "statement", "verdict", "prior", "prior and one number", "posterior"),
        *("effective draws", "of", *GROUNDS),
    ]
    return pd.DataFrame(rows, columns=columns)


def common_verdict(verdicts: Iterable[Verdict]) -> Verdict:
    """Verdict that all share, with the least credit to the data among them.

    What a model cannot fail, or hold, in one sample alone is granted, or excluded, by the prior.
    """
    found = set(verdicts)
    for side in (_FOR, _AGAINST):
        if found and found <= set(side):
            if len(found) > 1:
                found = {side[1] if verdict is side[0] else verdict for verdict in found}
            return next(verdict for verdict in side if verdict in found)
    return Verdict.CANNOT_TELL


def between(value: float, *, wrong_below: float, right_above: float) -> bool | None:
    """Whether a number is on one side or the other of a range that leaves it open (None)."""
    if value > right_above:
        return True
    return False if value < wrong_below else None


def _shown(value: float | bool | None) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.2f}"
