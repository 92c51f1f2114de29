"""All checks of a fit of curves, and two verdicts: was it sampled well, does it describe the data.

The checks are those that the modules of this folder have, the sampling first.
"""

import json
import pkgutil
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from pyburgers import checks
from pyburgers.checks.fit_checks import Check, CheckKind, CheckResult, Outcome


@dataclass(frozen=True)
class Verdict:
    """The answer to one of the two questions, with its reason in words."""

    kind: CheckKind
    outcome: Outcome
    sentence: str

    @property
    def answer(self) -> str:
        """The answer in words, without its reason."""
        return ANSWERS[self.kind][self.outcome]


ANSWERS = {
    CheckKind.SAMPLING: {
        Outcome.YES: "The posterior was sampled well",
        Outcome.NO: "The posterior was not sampled well",
        Outcome.CANNOT_TELL: "It cannot be told whether the posterior was sampled well",
    },
    CheckKind.DESCRIPTION: {
        Outcome.YES: "The model describes the data",
        Outcome.NO: "The model does not describe the data",
        Outcome.CANNOT_TELL: "It cannot be told whether the model describes the data",
    },
}


def verdicts_record(results: Sequence[CheckResult]) -> dict[str, Any]:
    """Return both verdicts and the checks behind them as what a JSON file holds."""
    return {
        "verdicts": {
            kind.name.lower(): {"outcome": verdict.outcome.value, "sentence": verdict.sentence}
            for kind, verdict in verdicts(results).items()
        },
        "checks": [
            {
                "name": result.name,
                "kind": result.check.kind.name.lower(),
                "outcome": result.outcome.value,
                "passed": result.passed,
                "sentence": result.sentence,
                "table": json.loads(result.table.reset_index().to_json(orient="records")),
            }
            for result in results
        ],
    }


def verdicts(results: Sequence[CheckResult]) -> dict[CheckKind, Verdict]:
    """Answer both questions: no if a check failed, yes if all could tell from usable draws."""
    return {kind: _verdict(kind, results) for kind in CheckKind}


def _verdict(kind: CheckKind, results: Sequence[CheckResult]) -> Verdict:
    asked = [result for result in results if result.check.kind is kind]
    if not asked:
        return _answer(kind, Outcome.CANNOT_TELL, "no check compared it with data.")
    unusable = [result for result in results if result.unusable]
    if kind is CheckKind.DESCRIPTION and unusable:
        failed = [result for result in asked if result.outcome is Outcome.NO]
        told = f" With these draws it does not: {_reasons(failed)}" if failed else ""
        reason = f"the draws are of no use, {_reasons(unusable)}{told}"
        return _answer(kind, Outcome.CANNOT_TELL, reason)
    for outcome in (Outcome.NO, Outcome.CANNOT_TELL):
        found = [result for result in asked if result.outcome is outcome]
        found.sort(key=lambda result: not result.leads)
        if found:
            return _answer(kind, outcome, _reasons(found))
    notes = "".join(f"; {result.note}" for result in asked if result.note)
    return _answer(kind, Outcome.YES, f"all {len(asked)} checks of it passed{notes}.")


def _answer(kind: CheckKind, outcome: Outcome, reason: str) -> Verdict:
    return Verdict(kind, outcome, f"{ANSWERS[kind][outcome]}: {reason}")


def _reasons(results: Sequence[CheckResult]) -> str:
    """Return what the first check found, and the names of those that found something else."""
    sentence = results[0].sentence
    others = [result for result in results if result.sentence != sentence]
    if sentence[1:2].islower():  # not R-hat
        sentence = sentence[0].lower() + sentence[1:]
    more = f" Also: {', '.join(other.name for other in others)}." if others else ""
    return sentence + more


CHECKS: tuple[Check, ...] = tuple(
    sorted(
        {
            found: None
            for module in pkgutil.iter_modules(checks.__path__, f"{checks.__name__}.")
            if module.name != __name__
            for found in vars(import_module(module.name)).values()
            if isinstance(found, Check)
        },
        key=lambda found: list(CheckKind).index(found.kind),
    )
)
"""Console, page and exit code follow: a check is told as soon as it is in the folder."""
