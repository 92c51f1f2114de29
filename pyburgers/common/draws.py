"""Arrays of draws: all chains in one row, fewer of them, and the band that holds most of them."""

from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import xarray as xr

from pyburgers.common.array_types import FloatArray as FloatArray

Number = TypeVar("Number", bound=np.number[Any])

TAIL = 0.05
"""Share of draws on either side of the bands of figures and tables."""

BAND = 1.0 - 2.0 * TAIL
"""Share inside."""


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
