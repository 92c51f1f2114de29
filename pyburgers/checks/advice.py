"""What to try where a fit misses a test, and how far a law with a discrepancy misses it."""

from collections.abc import Collection, Mapping
from types import MappingProxyType

import numpy as np
import pandas as pd

from pyburgers.checks.discrepancies import AS_LARGE, Family, Leftover, points_of_segment
from pyburgers.checks.fit_checks import Finding, Outcome
from pyburgers.checks.residual_numbers import longest_run
from pyburgers.common.draws import BAND, TAIL, FloatArray
from pyburgers.model.laws import HARDENING_SWITCH, laws_to_try_first
from pyburgers.posterior.labelled_draws import free_parameters

LAWS_OF_HISTORIES = {
    "peak_strength": "kelvin=two_elements",
    HARDENING_SWITCH: "hardening=backstress",
}
"""Histories show transients: whether there is more than one relaxation time, or a backstress."""

ADD_DISCREPANCY = (
    "for wider, honest intervals give the law a discrepancy (--variant residuals=discrepancy)"
)


def remedy(leftover: Leftover, point: int) -> str:
    """Return what to try where the shape is missed from a point on, by what was read there."""
    group = leftover.group
    free = free_parameters(group) if "posterior" in group.children else ()
    along = group["constant_data"].to_dataset()
    if "period" in along:
        return advise_on_spectra(free)
    steps = leftover.segment[-1] > leftover.segment[0]
    if "quantity" in along and (leftover.segment.any() or leftover.quantity.any()):
        return advise_on_histories(free, is_last="residual_correlation_time" in free)
    laws = _laws_to_try(free)
    if steps or "segment" not in along:
        behind = "it lies behind a step of the rate: " if leftover.segment[point] > 0 else ""
        first = f"{behind}see whether the test was paused or unloaded there, and " + (
            f"try a law that answers changes of the rate otherwise ({laws})"
            if laws
            else "compare with other laws"
        )
    else:
        first = (
            "at one rate other laws hardly differ, so see whether the test was paused or unloaded "
            "there, whether the strain includes that of the machine (a loading_history takes "
            "[apparatus]), and fit it together with tests at other rates"
        )
    # Where strain goes back and forth no residuals correlate along it.
    if "segment" not in along or leftover.correlates:
        return first
    return f"{first}; {ADD_DISCREPANCY}"


def advise_on_spectra(free: Collection[str]) -> str:
    """Propose a band, a peak on top of it, and then to look where temperatures disagree."""
    alone = "fit the temperatures by themselves to see which of them disagrees"
    if "relaxation_time_decades" not in free:
        return (
            "compare laws of the Kelvin part, such as a band of relaxation times (--variant "
            f"kelvin=extended), or {alone}"
        )
    if "peak_strength" not in free:
        return (
            "try a peak on top of the band (--variant kelvin=extended_peak, with priors that "
            f"say where it lies), or {alone}"
        )
    return alone


def advise_on_histories(free: Collection[str], *, is_last: bool) -> str:
    """Propose other laws and, unless they are the last step, a discrepancy."""
    laws = _laws_to_try(free, LAWS_OF_HISTORIES)
    first = "see whether what was imposed there is what the stages say, and " + (
        f"try another law of the dashpot or of the Kelvin part ({laws})"
        if laws
        else "compare with other laws"
    )
    return first if is_last else f"{first}; {ADD_DISCREPANCY}"


def _laws_to_try(free: Collection[str], more: Mapping[str, str] = MappingProxyType({})) -> str:
    """Return as options the laws, named by a parameter free in them, that a fit does not have."""
    laws = {**laws_to_try_first(), **more}
    return " or ".join(f"--variant {law}" for name, law in laws.items() if name not in free)


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
            worst, _ = longest_run(leftover.residual, np.diff(leftover.segment) == 0)
            advice = "" if outcome is Outcome.YES else remedy(leftover, worst)
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
