"""Numbers of a test that are unlikely: those of its material, and those of its kind."""

from collections.abc import Iterator

from pyburgers.model.plausible import PlausibleRanges, plausible_ranges
from pyburgers.protocols.experiment import Experiment

COARSE_GRAINS = 0.05
"""Grain size (m) beyond which a unit may be wrong."""

SMALL_STRESS = 1e3
"""Largest stress (Pa) of a test below which a unit may be wrong."""


def doubts(experiment: Experiment) -> list[str]:
    """Say which numbers of a test are unlikely; each sentence starts with its name."""
    ranges = plausible_ranges(experiment.material)
    found = [
        *_of_conditions(experiment, ranges or PlausibleRanges.model_validate({})),
        *experiment.doubts,
    ]
    if ranges is None:
        found.append(
            f"there are no default priors of {experiment.material!r}, so that a fit needs --priors."
        )
    return [f"{experiment.id}: {sentence}" for sentence in found]


def _of_conditions(experiment: Experiment, ranges: PlausibleRanges) -> Iterator[str]:
    """Say which grain size, temperatures and stresses are unlikely."""
    material, grain = experiment.material, experiment.initial_grain_size
    if grain > COARSE_GRAINS:
        yield f"grains of {grain:g} m are unlikely; 230 um is 230e-6."
    hottest, coldest = float(experiment.temperatures.max()), float(experiment.temperatures.min())
    melting, least = ranges.melting_temperature_K, ranges.least_temperature_K
    if melting is not None and hottest > melting:
        yield f"{material} at {hottest:g} K is molten (from {melting:g} K); check the temperature."
    if least is not None and coldest < least:
        yield f"{material} at {coldest:g} K is unlikely (from {least:g} K); check the temperature."
    stress = experiment.largest_stress if experiment.n_points else 0.0
    if stress > ranges.largest_stress_MPa * 1e6:
        yield (
            f"a stress of {stress / 1e9:g} GPa is unlikely in {material} (up to "
            f"{ranges.largest_stress_MPa:g} MPa is plausible); check its unit."
        )
    elif 0 < stress < SMALL_STRESS:
        yield f"a largest stress of {stress:g} Pa is unlikely; check its unit."
