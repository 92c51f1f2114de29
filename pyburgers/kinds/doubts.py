"""Numbers of a test that are unlikely: those of its material, and those of its kind."""

from collections.abc import Iterator

from pyburgers.kinds.experiment import Experiment
from pyburgers.model.plausible import PlausibleRanges, plausible_ranges

MAX_LIKELY_GRAIN_SIZE = 0.05
"""Grain size (m) beyond which a unit may be wrong."""

MIN_LIKELY_STRESS = 1e3
"""Largest stress (Pa) of a test below which a unit may be wrong."""


def doubts(experiment: Experiment) -> list[str]:
    """Say which numbers of a test are unlikely; each sentence starts with its name."""
    found = [*_of_conditions(experiment), *experiment.doubts]
    if plausible_ranges(experiment.material) is None:
        found.append(
            f"there are no default priors of {experiment.material!r}, so that a fit needs --priors."
        )
    return [f"{experiment.id}: {sentence}" for sentence in found]


def _of_conditions(experiment: Experiment) -> Iterator[str]:
    """Say which grain size, temperatures and stresses are unlikely."""
    material, grain = experiment.material, experiment.initial_grain_size
    ranges = _ranges(material)
    if grain > MAX_LIKELY_GRAIN_SIZE:
        yield f"grains of {grain:g} m are unlikely; 230 um is 230e-6."
    hottest, coldest = float(experiment.temperatures.max()), float(experiment.temperatures.min())
    melting, least = ranges.melting_temperature_K, ranges.least_temperature_K
    if melting is not None and hottest > melting:
        yield f"{material} at {hottest:g} K is molten (from {melting:g} K); check the temperature."
    if least is not None and coldest < least:
        yield f"{material} at {coldest:g} K is unlikely (from {least:g} K); check the temperature."
    if experiment.n_points:
        yield from unlikely_stress(material, experiment.largest_stress)


def unlikely_stress(material: str, largest: float) -> Iterator[str]:
    """Say where the largest stress (Pa) of tests is unlikely in a material."""
    limit = _ranges(material).largest_stress_MPa
    if largest > limit * 1e6:
        yield (
            f"a stress of {largest / 1e9:g} GPa is unlikely in {material} (up to {limit:g} MPa is "
            "plausible); check its unit."
        )
    elif 0 < largest < MIN_LIKELY_STRESS:
        yield f"a largest stress of {largest:g} Pa is unlikely; check its unit."


def _ranges(material: str) -> PlausibleRanges:
    return plausible_ranges(material) or PlausibleRanges.model_validate({})
