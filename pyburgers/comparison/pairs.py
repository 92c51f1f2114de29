"""Which of two fits predicts better, from their difference alone: better, alike or cannot tell."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

from pyburgers.common.draws import FloatArray

NO_DIFFERENCE = 4.0
"""Difference of elpd below which fits predict alike (Sivula et al. 2020, arXiv:2008.10296)."""

CLEAR = 2.0
"""Standard errors that a difference may be off."""

LEAST_UNITS = 3
"""Points, or tests, of which a standard error says something."""


class PairOutcome(StrEnum):
    """What a comparison of two fits comes to."""

    BETTER = "better"
    ALIKE = "alike"
    CANNOT_TELL = "cannot tell"


@dataclass(frozen=True)
class Pair:
    """Two fits, the higher elpd first; a doubt says after "because" why numbers do not decide."""

    better: str
    worse: str
    difference: float
    error: float
    doubt: str = ""

    @property
    def outcome(self) -> PairOutcome:
        """Better beyond `NO_DIFFERENCE` and `CLEAR` errors; alike if both together stay below."""
        if self.doubt or not math.isfinite(self.error):
            return PairOutcome.CANNOT_TELL
        if self.difference >= max(NO_DIFFERENCE, CLEAR * self.error):
            return PairOutcome.BETTER
        if abs(self.difference) + CLEAR * self.error < NO_DIFFERENCE:
            return PairOutcome.ALIKE
        return PairOutcome.CANNOT_TELL

    def sentence(self, what: str = "these data") -> str:
        """Say it, of predictions of `what`."""
        error = (
            f"standard error {self.error:.1f}" if math.isfinite(self.error) else "no standard error"
        )
        numbers = f"difference of elpd {self.difference:.1f}, {error}"
        because = f", because {self.doubt}" if self.doubt else ""
        match self.outcome:
            case PairOutcome.BETTER:
                said = f"{self.better} predicts {what} clearly better than {self.worse}"
            case PairOutcome.ALIKE:
                said = f"{self.better} and {self.worse} predict {what} alike"
            case PairOutcome.CANNOT_TELL:
                said = f"Cannot tell which of {self.better} and {self.worse} predicts {what} better"
        return f"{said} ({numbers}){because}."


def doubt_about(units: str, n_units: int, unreliable: Sequence[str]) -> str:
    """Say as `Pair.doubt` that units, such as "2 tests", are few or fits unreliable."""
    reasons = []
    if n_units < LEAST_UNITS:
        reasons.append(f"a standard error over {units} says nothing")
    if unreliable:
        reasons.append(f"the elpd of {' and '.join(unreliable)} may be far off")
    return " and ".join(reasons)


def weight_sentence(
    best: str, other: str, weights: tuple[float, float], gains: FloatArray, *, unit: str
) -> str | None:
    """Say why a fit of lower elpd weighs more, given its gains (n,); None if it does not."""
    if weights[1] <= weights[0]:
        return None
    won = gains > 0
    return (
        f"{other} has the larger weight ({weights[1]:.2f} against {weights[0]:.2f}) although its "
        f"elpd is lower: it predicts {int(won.sum())} of {gains.size} {unit} better than {best}, "
        f"by {gains[won].sum():.1f} together, and loses {-gains[~won].sum():.1f} at the others, "
        f"{-gains.min():.1f} of it at one. A mixture escapes such losses with a small share of "
        f"{best}; a weight is a share in it, not the probability of a fit."
    )
