"""Arrays of draws: all chains in one row, and fewer of them."""

import numpy as np
import numpy.typing as npt
import xarray as xr

FloatArray = npt.NDArray[np.float64]


def all_draws(values: xr.DataArray) -> FloatArray:
    """All draws of all chains along the first axis."""
    ordered = values.transpose("chain", "draw", ...).to_numpy()
    flat: FloatArray = ordered.reshape(-1, *ordered.shape[2:])
    return flat


def evenly_spaced(rows: FloatArray, at_most: int) -> FloatArray:
    """Thin rows at a fixed stride to a number that can be drawn.

    Parameters
    ----------
    rows : array, shape (n, ...)
        What is thinned along its first axis.
    at_most : int
        Rows to keep, at most.
    """
    kept = min(len(rows), at_most)
    thinned: FloatArray = rows[np.arange(kept) * len(rows) // max(kept, 1)]
    return thinned
