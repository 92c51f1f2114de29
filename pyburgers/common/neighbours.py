"""How far readings lie from their neighbours, which tells their errors without a model."""

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def distances_from_neighbours(at: FloatArray, value: FloatArray) -> FloatArray:
    """Distance of each reading from the line through its two neighbours.

    Positions `at`, shape (n,), do not decrease; `value` has shape (..., n), the distances (..., at
    most n - 2). Readings between two neighbours at one position are left out. Independent errors of
    the readings make distances with their own standard deviation.
    """
    span = at[2:] - at[:-2]
    kept = span > 0
    share = (at[1:-1] - at[:-2])[kept] / span[kept]
    before, here, after = (value[..., k : value.shape[-1] - 2 + k][..., kept] for k in range(3))
    distance = here - (1 - share) * before - share * after
    found: FloatArray = distance / np.sqrt(1 + share**2 + (1 - share) ** 2)
    return found
