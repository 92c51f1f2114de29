"""Arrays of draws: all chains in one row, fewer of them, and the band that holds most of them."""

import math
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import xarray as xr

from pyburgers.common.array_types import FloatArray as FloatArray
from pyburgers.common.units import number, with_error

Number = TypeVar("Number", bound=np.number[Any])

TAIL = 0.05
"""Share of draws on either side of the bands of figures and tables."""

BAND = 1.0 - 2.0 * TAIL
"""Share inside."""

NORMAL_BAND = 3.29
"""Width of the band of a normal distribution, in standard deviations."""

WIDE = 0.75
"""Standard deviation over the mean from which mean ± sd says little of a positive number: a normal
distribution would have a tenth of its draws below 0."""

HEAVY_TAIL = 2.0
"""Standard deviation over that of a normal distribution with the same band. Above this ratio a few
far draws make the standard deviation."""


def all_draws(values: xr.DataArray) -> FloatArray:
    """All draws of all chains along the first axis."""
    ordered = values.transpose("chain", "draw", ...).to_numpy()
    return np.asarray(ordered.reshape(-1, *ordered.shape[2:]))


def evenly_spaced(rows: npt.NDArray[Number], at_most: int) -> npt.NDArray[Number]:
    """Thin rows, shape (n, ...), at a fixed stride: `at_most` rows at most, which can be drawn."""
    kept = min(len(rows), at_most)
    thinned: npt.NDArray[Number] = rows[np.arange(kept) * len(rows) // max(kept, 1)]
    return thinned


def central_band(draws: FloatArray) -> FloatArray:
    """Return lower end, median and upper end of the central 90 % of draws (n, ...), without NaN."""
    return np.asarray(np.nanquantile(draws, [TAIL, 0.5, 1.0 - TAIL], axis=0))


def is_misled_by_sd(mean: float, sd: float, low: float, high: float) -> bool:
    """Whether mean ± sd says little of draws with such a band: they are wide, or have a tail."""
    normal_sd = (high - low) / NORMAL_BAND
    return normal_sd > 0 and ((low > 0 and sd > WIDE * mean) or sd > HEAVY_TAIL * normal_sd)


def band_text(low: float, median: float, high: float) -> str:
    """Return ``median (low to high)``, with two digits of the width at least."""
    sd = (high - low) / NORMAL_BAND
    digits = 2 + math.floor(math.log10(max(abs(low), abs(high)) / sd))
    low_text, median_text, high_text = (
        number(float(f"{one:.{digits}g}")) for one in (low, median, high)
    )
    return f"{median_text} ({low_text} to {high_text})"


def value_text(draws: FloatArray) -> str:
    """Return mean ± sd of draws (n,), or median and band where these say more."""
    mean, sd = float(draws.mean()), float(draws.std(ddof=1))
    low, median, high = map(float, central_band(draws))
    is_misled = is_misled_by_sd(mean, sd, low, high)
    return band_text(low, median, high) if is_misled else with_error(mean, sd)
