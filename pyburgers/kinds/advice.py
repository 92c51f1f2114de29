"""What to try where a fit misses the shape of a test, as several kinds of test have it."""

from collections.abc import Collection, Mapping

from pyburgers.model.laws import laws_to_try_first

OTHER_LAWS: Mapping[str, str] = laws_to_try_first()
"""Laws that answer stresses and rates otherwise, by the parameter that is free in them."""

LET_CORRELATE = (
    "for wider, honest intervals let residuals correlate (--variant residuals=autocorrelated)"
)


def laws_to_try(free: Collection[str], laws: Mapping[str, str] = OTHER_LAWS) -> str:
    """Return as options those of some laws that a fit does not have yet; empty for none."""
    return " or ".join(f"--variant {law}" for name, law in laws.items() if name not in free)
