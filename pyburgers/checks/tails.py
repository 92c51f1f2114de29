"""Tails of numbers: how improbable a value is that lies at their end or beyond it."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from pyburgers.common.draws import FloatArray

MOST_IN_TAIL = 100
LARGEST_TAIL = 0.2
"""How many of some numbers their tail holds, and the largest share of them."""

ALIKE = 1e-9
"""Scale of the tail of numbers that do not differ, over their size."""

MOST_SCALES = 600.0
"""Further out a share of a tail would be 0 in floating point."""


@dataclass(frozen=True, eq=False)
class Tail:
    """How often numbers are as large as a value, beyond the largest of them too.

    An exponential law of a power of the numbers takes the place of the largest: from its start,
    a number to this power, with a scale that is the mean distance from there. Beyond is the
    share of the numbers above the start.
    """

    ordered: FloatArray
    exponent: float
    start: float
    beyond: float
    scale: float

    @classmethod
    def of(cls, numbers: FloatArray, exponent: float = 1.0) -> Self:
        """Return the tail of numbers, shape (n,)."""
        ordered = np.sort(numbers)
        powers = _power(ordered, exponent)
        most = max(1, min(MOST_IN_TAIL, int(LARGEST_TAIL * ordered.size)))
        start = powers[max(0, ordered.size - most - 1)]
        if start == powers[-1]:
            start = powers[max(0, np.searchsorted(powers, start) - 1)]
        above = powers[powers > start]
        if above.size == 0:  # all are alike
            return cls(ordered, exponent, float(start), 1.0, ALIKE * max(1.0, abs(start)))
        scale = float(above.mean() - start)
        return cls(ordered, exponent, float(start), above.size / ordered.size, scale)

    def share(self, value: FloatArray) -> FloatArray:
        """Share of numbers as large as values; never 0."""
        at_least = self.ordered.size - np.searchsorted(self.ordered, value, side="left")
        away = (_power(value, self.exponent) - self.start) / self.scale
        law = self.beyond * np.exp(-np.clip(away, 0.0, MOST_SCALES))
        return np.where(away > 0, law, at_least / self.ordered.size)

    def value(self, share: float) -> float:
        """Return the value that a share of the numbers exceeds."""
        if share < self.beyond:
            power = self.start + self.scale * np.log(self.beyond / share)
            return float(_power(power, 1.0 / self.exponent))
        return float(np.quantile(self.ordered, 1.0 - share))


def _power(value: FloatArray, exponent: float) -> FloatArray:
    """Power of the size of numbers, with their sign."""
    return np.copysign(np.abs(value) ** exponent, value)
