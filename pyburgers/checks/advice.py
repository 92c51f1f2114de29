"""What to try where a fit misses the shape of a test."""

from collections.abc import Collection, Mapping
from types import MappingProxyType

from pyburgers.checks.discrepancies import Leftover
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
            "there, and fit it together with tests at other rates"
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
