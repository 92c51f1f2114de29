"""Numbers that no test has, readings far off, and readings unlike what is imposed."""

from dataclasses import dataclass

import numpy as np

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError

TEMPERATURES = (50.0, 3000.0)
"""Kelvin between which materials creep in a laboratory."""

MAX_GRAIN_SIZE = 1.0
"""Grain size (m) that no sample of a laboratory has."""

MAX_STRAIN = 20.0
"""Strain (fraction) that no test reaches."""

MIN_FAR_RATIO, MIN_FAR_READINGS = 10.0, 5
"""How many times larger than all others a reading is that may be none; of so many at least."""


def impossible_conditions(
    temperature: float, grain_size: float, names: tuple[str, str]
) -> list[str]:
    """Say which conditions no test has, under the names of both; NaN is one."""
    found = []
    low, high = TEMPERATURES
    if not low <= temperature <= high:
        hint = "; it looks like degrees Celsius, add 273.15" if temperature < low else ""
        between = f"between {low:g} and {high:g}"
        found.append(f"{names[0]}: found {temperature:g}, expected kelvin {between}{hint}.")
    if not 0 < grain_size < MAX_GRAIN_SIZE:
        found.append(
            f"{names[1]}: found {grain_size:g}, expected metres between 0 and {MAX_GRAIN_SIZE:g} "
            "(230 um is 230e-6)."
        )
    return found


def refuse_impossible(
    name: str,
    temperatures: FloatArray,
    grain_sizes: FloatArray,
    response: FloatArray,
    largest_strain: float | None = None,
) -> None:
    """Refuse a test with numbers that no test has; a sentence for each."""
    hottest = temperatures[np.argmax(np.abs(temperatures - np.mean(TEMPERATURES)))]
    coarsest = grain_sizes[np.argmax(np.abs(grain_sizes - MAX_GRAIN_SIZE / 2))]
    faults = impossible_conditions(float(hottest), float(coarsest), ("temperature", "grain size"))
    finite = np.isfinite(response)
    if not finite.all():
        faults.append(
            f"reading {np.argmin(finite) + 1}: found {response[np.argmin(finite)]:g}, expected a "
            "finite number."
        )
    if largest_strain is not None and not largest_strain <= MAX_STRAIN:
        faults.append(
            f"strain: found {largest_strain:g} as a fraction, expected at most {MAX_STRAIN:g}; "
            "check its unit, and whether the number stands for no reading."
        )
    if faults:
        raise InputError(*(f"{name}: {fault}" for fault in faults))


def far_reading(values: FloatArray, what: str) -> list[str]:
    """Say where one reading is many times larger than all others: it may stand for none."""
    size = np.sort(np.abs(values))
    if size.size < MIN_FAR_READINGS or size[-1] <= MIN_FAR_RATIO * size[-2]:
        return []
    far = values[np.argmax(np.abs(values))]
    return [
        f"one {what} of {far:g} is more than {MIN_FAR_RATIO:g} times as large as all others; if it "
        "stands for no reading, remove its row or name it in the key missing of [data]."
    ]


MAX_DEPARTURE_SHARE = 0.05
"""Largest distance from what is imposed that is no mistake of the file, in shares of the largest
value."""


@dataclass(frozen=True)
class Departure:
    """Readings unlike what is imposed: the largest distance, and the first of them, from 0."""

    largest: float
    first: int


def departure(read: FloatArray, imposed: FloatArray, scale: float) -> Departure | None:
    """Return how far readings (n,) are from what is imposed; None where they are near."""
    distance = np.abs(read - imposed)
    far = np.flatnonzero(distance > MAX_DEPARTURE_SHARE * scale)
    return Departure(float(distance.max()), int(far[0])) if far.size else None


def slope_of(time: FloatArray, values: FloatArray) -> float | None:
    """Return the slope of the straight line through readings, None where times tell none."""
    own = time - time.mean()
    spread = float(own @ own)
    return float(own @ (values - values.mean())) / spread if spread > 0 else None
