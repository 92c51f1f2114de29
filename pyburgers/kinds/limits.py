"""Numbers that no test has, or hardly any, in SI."""

import numpy as np

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError

TEMPERATURES = (50.0, 3000.0)
"""Kelvin between which materials creep in a laboratory."""

MAX_GRAIN_SIZE = 1.0
"""Grain size (m) that no sample of a laboratory has."""

MAX_STRAIN = 20.0
"""Strain (fraction) that no test reaches."""

MAX_LIKELY_STRAIN_RATE = 1.0
"""Strain rate (1/s) beyond which a unit may be wrong."""

MAX_UNLOADED_SHARE = 0.1
"""Share of the largest stress up to which readings before anything is imposed may be error."""

MAX_ZERO_SHARE = 0.01
"""Share of the largest reading up to which one at rest goes without its size in notices."""


def unlikely_strain_rate(fastest: float) -> list[str]:
    """Say if the fastest strain rate (1/s) of tests is one that no press has."""
    is_likely = fastest <= MAX_LIKELY_STRAIN_RATE
    return [] if is_likely else [f"a strain rate of {fastest:g} 1/s is unlikely; check its unit."]


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
    largest_strain: float | None,
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
