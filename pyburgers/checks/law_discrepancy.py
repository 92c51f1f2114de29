"""How far the law of a fit with a discrepancy misses the data, and what that says of the law."""

import numpy as np
import pandas as pd

from pyburgers.checks.advice import remedy
from pyburgers.checks.discrepancies import AS_LARGE, Family, Leftover, points_of_segment
from pyburgers.checks.fit_checks import Finding, Outcome
from pyburgers.checks.residual_numbers import longest_run
from pyburgers.common.draws import BAND, TAIL, FloatArray

CLEARLY_THERE = 0.25
"""Discrepancy of a law over the reading error: less makes residuals 3 % larger at most."""


def against_reading_errors(family: Family, sizes: pd.DataFrame) -> list[Finding]:
    """Compare discrepancies of the law with the reading errors that were inferred beside them.

    A fit with a discrepancy follows any data: its size decides, and a small one that is clearly
    there is no description either. Residuals `AS_LARGE` hold as much discrepancy as error.
    """
    findings = []
    for name, leftover in family.tests.items():
        if leftover.discrepancy is not None:
            larger = float(np.mean(_over_errors(leftover).mean(axis=1) > AS_LARGE**2))
            there = float(np.quantile(leftover.discrepancy, TAIL)) > CLEARLY_THERE
            outcome = Outcome.YES
            said = f"the readings of {name} are uncertain by more than the law misses them"
            if larger >= 1.0 - TAIL:
                outcome = Outcome.NO
                said = f"the law misses {name} by more than its readings are uncertain"
            elif larger > TAIL:
                outcome = Outcome.CANNOT_TELL
                said = f"the draws do not tell whether it misses {name} by more than readings err"
            elif there:
                outcome = Outcome.CANNOT_TELL
                said = f"{said}, but {1.0 - TAIL:.0%} of the draws have a discrepancy that counts"
            advice = "" if outcome is Outcome.YES else remedy(leftover, _worst_point(leftover))
            findings.append(Finding(outcome, sizes, said, advice))
    return findings


def discrepancy_text(leftover: Leftover) -> str:
    """Say how large the discrepancy of the law is at the readings, and where it is largest.

    It is the root mean square of the residuals of the law beyond that of the reading errors, of
    which each draw has one; medians are told.
    """
    squares = _over_errors(leftover)
    low, middle, high = np.quantile(_beyond(squares - 1.0), (TAIL, 0.5, 1 - TAIL))
    errors = leftover.reading_errors / leftover.weight
    parts = [(leftover.quantity == k, int(k)) for k in np.unique(leftover.quantity)]
    sizes = [
        leftover.size_text(
            float(np.median(_beyond((errors**2 * (squares - 1.0))[:, here]))), quantity
        )
        for here, quantity in parts
    ]
    by_segment = [
        float(np.median(_beyond(squares[:, leftover.segment == k] - 1.0)))
        for k in np.unique(leftover.segment)
    ]
    worst = int(np.argmax(by_segment))
    most = f"; most in {points_of_segment(leftover, worst)[1]}: {by_segment[worst]:.1f}"
    return (
        f"the law misses {leftover.name} by a discrepancy of {' and '.join(sizes)}, {middle:.1f} "
        f"reading errors ({low:.1f} to {high:.1f} in {BAND:.0%} of the draws"
        f"{most if len(by_segment) > 1 else ''})"
    )


def _over_errors(leftover: Leftover) -> FloatArray:
    """Squares of the residuals of the law over the reading errors, shape (draws, n)."""
    return np.asarray((leftover.observed / leftover.reading_errors) ** 2)


def _beyond(squares: FloatArray) -> FloatArray:
    """Root mean square of each draw, shape (draws,), from squares less those of errors."""
    return np.asarray(np.sqrt(np.maximum(squares.mean(axis=1), 0.0)))


def _worst_point(leftover: Leftover) -> int:
    """Return the first reading of the longest run of one sign."""
    return longest_run(leftover.residual, np.diff(leftover.segment) == 0)[0]
