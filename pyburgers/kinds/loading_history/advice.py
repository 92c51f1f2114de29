"""What to try where a fit misses the shape of a loading history."""

from collections.abc import Collection

import xarray as xr

from pyburgers.kinds.advice import LET_CORRELATE, OTHER_LAWS, laws_to_try

LAWS = {**OTHER_LAWS, "peak_strength": "kelvin=two_elements"}
"""Histories show transients, and so whether there is more than one relaxation time."""


def advice(free: Collection[str], along: xr.Dataset) -> str | None:
    """Return what to try, None where stress was read while one stage imposed the strain."""
    if not (along["segment"].any() or along["quantity"].any()):
        return None
    laws = laws_to_try(free, LAWS)
    first = "see whether what was imposed there is what the stages say, and " + (
        f"try another law of the dashpot or of the Kelvin part ({laws})"
        if laws
        else "compare with other laws"
    )
    return first if "residual_correlation_time" in free else f"{first}; {LET_CORRELATE}"
