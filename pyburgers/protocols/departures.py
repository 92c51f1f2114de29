"""How far readings of an imposed quantity run away from what a file says is imposed."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

UNLIKE = 0.05
"""Largest distance from what is imposed that is no mistake of the file, in shares of the largest
value."""


@dataclass(frozen=True)
class Departure:
    """Readings that are not those of what is imposed.

    `largest`: largest distance, in the unit of the readings.
    `first`: first reading, from 0, that is too far.
    """

    largest: float
    first: int


def departure(read: FloatArray, imposed: FloatArray, scale: float) -> Departure | None:
    """Return how far readings are from what is imposed, None where they are near.

    The largest distance counts: a test that turns or changes its rate late is right at most times.
    `read`, `imposed` (n,): in one unit.
    """
    distance = np.abs(read - imposed)
    far = np.flatnonzero(distance > UNLIKE * scale)
    return Departure(float(distance.max()), int(far[0])) if far.size else None


def slope_of(time: FloatArray, values: FloatArray) -> float | None:
    """Return the slope of the straight line through readings, None where times tell none."""
    own = time - time.mean()
    spread = float(own @ own)
    return float(own @ (values - values.mean())) / spread if spread > 0 else None
