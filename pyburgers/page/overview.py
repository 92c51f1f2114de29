"""The top of a page: a row for each fit, and both verdicts on it in words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from pyburgers.checks.fit_checks import CheckKind, CheckResult, Outcome, coverage
from pyburgers.checks.prior_influence import (
    Influence,
    Origin,
    conflict_text,
    conflicts,
    decision_columns,
    decision_sentences,
    decision_text,
    disagreement,
    symbol_of,
)
from pyburgers.checks.verdicts import ANSWERS, Verdict, verdicts
from pyburgers.common.draws import all_draws, value_text
from pyburgers.common.units import number
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import SampledFit

ANSWER_COLUMNS = {
    CheckKind.SAMPLING: "sampled well?",
    CheckKind.DESCRIPTION: "describes the data?",
}
CONFLICT_COLUMN = "prior against data"
SHOWN_CONFLICTS = 2
"""Quantities whose symbols a row has at most; the section names all."""


@dataclass(frozen=True, eq=False)
class Entry:
    """What the top of the page says about one fit; `key` is the anchor of its section.

    `conflict`: what prior and data disagree about, in words, else None. `decisions`: sentences
    about numbers that a bound or another prior decides, and priors read off the data.
    """

    key: str
    name: str
    is_synthetic: bool
    verdicts: Mapping[CheckKind, Verdict]
    checks: tuple[CheckResult, ...]
    conflict: str | None
    decisions: tuple[str, ...]
    row: dict[str, str]

    @property
    def about(self) -> str:
        """Name, and the answers that are not yes."""
        name = self.name + " (synthetic data)" * self.is_synthetic
        told = (one.answer for one in self.verdicts.values() if one.outcome is not Outcome.YES)
        return ": ".join(filter(None, (name, "; ".join(told))))

    def doubts(self, kind: CheckKind) -> list[str]:
        """Say what speaks against a yes to a question, without what to do about it."""
        verdict = self.verdicts[kind]
        if verdict.outcome is Outcome.YES:
            notes = (one.note for one in self.checks if one.check.kind is kind and one.note)
            return ["; ".join((ANSWERS[kind][verdict.outcome], *notes)) + "."]
        found = [one for one in self.checks if one.check.kind is kind and not one.passed]
        if kind is CheckKind.DESCRIPTION and any(one.unusable for one in self.checks):
            return [f"{ANSWERS[kind][verdict.outcome]}: the draws are of no use."]
        if not found:
            return [verdict.sentence]
        said = [f"{ANSWERS[kind][verdict.outcome]}."]
        meanings = {one.meaning: one.name[0].upper() + one.name[1:] for one in reversed(found)}
        return said + [
            f"{meanings[text]}: {text}{'.' * (text[-1] != '.')}" for text in reversed(meanings)
        ]


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer to one of the two questions for all fits; that of `doubtful` ones is not yes."""

    kind: CheckKind
    doubtful: tuple[Entry, ...]

    @property
    def outcome(self) -> Outcome:
        """Yes where it is yes for all fits, no where it is no for one."""
        outcomes = {entry.verdicts[self.kind].outcome for entry in self.doubtful}
        if Outcome.NO in outcomes:
            return Outcome.NO
        return Outcome.CANNOT_TELL if outcomes else Outcome.YES

    def of(self, outcome: Outcome) -> list[Entry]:
        """Return the fits with one answer that is not yes."""
        return [entry for entry in self.doubtful if entry.verdicts[self.kind].outcome is outcome]


def answers(entries: Sequence[Entry]) -> tuple[Answer, ...]:
    """Answer both questions for all fits of a page."""
    return tuple(
        Answer(kind, tuple(e for e in entries if e.verdicts[kind].outcome is not Outcome.YES))
        for kind in CheckKind
    )


def remedies(entries: Sequence[Entry]) -> dict[tuple[str, str], list[Entry]]:
    """Gather by check and what to do the fits that did not pass it, for all fits of a page."""
    found: dict[tuple[str, str], list[Entry]] = {}
    for entry in entries:
        for one in entry.checks:
            if one.remedy and not one.passed:
                found.setdefault((one.name, one.remedy), []).append(entry)
    return found


def entry_of(
    key: str,
    name: str,
    fit: SampledFit,
    checks: Sequence[CheckResult],
    influences: Mapping[str, Influence],
) -> Entry:
    """Gather what the top of the page says about a fit; without likelihood influences are empty."""
    answered, kind = verdicts(checks), fit.provenance.kind
    row = {
        "run": name,
        "data": kind,
        "model": fit.variant.short_text if isinstance(fit, Fit) else "flow law",
        **_answers_text(answered, checks),
        "stress exponent n": _stress_exponent(fit, influences),
        "in 90 % band": f"{100.0 * coverage(fit.posterior):.0f} %",
        CONFLICT_COLUMN: _conflicts_text(influences),
    }
    to_mind = (*fit.prior_doubts, *decision_sentences(influences))
    said = disagreement(influences), to_mind
    return Entry(key, name, kind == "synthetic", answered, tuple(checks), *said, row)


def joint_entry(key: str, name: str, joint: Fit) -> Entry:
    """Gather what the top of the page says about a joint fit as a whole."""
    checks = joint.checks()
    answered = verdicts(checks)
    kinds = [test.provenance.kind for test in joint.problem.experiments]
    row = {
        "run": f"{name}, all tests together",
        "data": ", ".join(dict.fromkeys(kinds)),
        "model": joint.variant.short_text,
        **_answers_text(answered, checks),
    }
    if "stress_exponent" in joint.problem.shared:
        row["stress exponent n"] = _stress_exponent(joint, joint.decisions())
    return Entry(key, name, "synthetic" in kinds, answered, tuple(checks), None, (), row)


def overview_table(entries: Sequence[Entry]) -> pd.DataFrame:
    """Return the rows of all fits; what a joint fit has by test only is left empty."""
    rows = [entry.row for entry in entries]
    columns = dict.fromkeys(name for row in sorted(rows, key=len, reverse=True) for name in row)
    return pd.DataFrame(rows, columns=list(columns)).fillna("")


def bad_answers(entries: Sequence[Entry]) -> dict[str, list[bool]]:
    """Tell by column of the table in which rows an answer is not yes."""
    return {
        column: [entry.verdicts[kind].outcome is not Outcome.YES for entry in entries]
        for kind, column in ANSWER_COLUMNS.items()
    }


def _answers_text(
    answered: Mapping[CheckKind, Verdict], checks: Sequence[CheckResult]
) -> dict[str, str]:
    """Both answers, each that is not yes with the checks behind it."""
    found = {}
    for kind, column in ANSWER_COLUMNS.items():
        outcome = answered[kind].outcome
        names = [c.name for c in checks if c.check.kind is kind and c.outcome is not Outcome.YES]
        word = "NO" if outcome is Outcome.NO else outcome.value
        found[column] = f"{word}: {', '.join(names)}" if names else word
    return found


def _conflicts_text(influences: Mapping[str, Influence]) -> str:
    names = conflicts(influences)
    shown = [conflict_text(symbol_of(name), influences[name]) for name in names[:SHOWN_CONFLICTS]]
    more = len(names) - len(shown)
    told = ", ".join(shown) + (f" and {more} more" if more else "")
    at_bound = [symbol_of(name) for name, one in influences.items() if one.origin is Origin.BOUND]
    bounds = f"at a bound: {', '.join(at_bound)}" if at_bound else ""
    return "; ".join(filter(None, (told, bounds)))


def _stress_exponent(fit: SampledFit, influences: Mapping[str, Influence]) -> str:
    """Value and who decides it, of each mechanism, or the value that was not inferred."""
    said = []
    for name, draws in fit.posterior["posterior"].to_dataset().items():
        if str(name).split("[")[0] != "stress_exponent":
            continue
        if draws.attrs["fixed"]:
            said.append(f"{number(float(draws[0, 0]))} (fixed)")
            continue
        decided = decision_columns(influences.get(str(name)))
        text = decision_text(str(name), str(decided["decided_by"]), str(decided["by_prior_of"]))
        said.append(", ".join(filter(None, (value_text(all_draws(draws)), text))))
    return "; ".join(said)
