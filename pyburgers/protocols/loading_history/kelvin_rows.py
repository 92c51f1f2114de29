"""Elements of the Kelvin part in loading histories, as `stan/loading_history.stan` takes them."""

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from pyburgers.model.arrhenius import log_slowdown
from pyburgers.model.kelvin_elements import andrade_elements, band_elements, peak_elements
from pyburgers.model.prior_families import Prior, is_fixed_at
from pyburgers.model.priors import PriorSet
from pyburgers.protocols.loading_history.experiment import LoadingHistory
from pyburgers.protocols.stan_data import StanData

FloatArray = npt.NDArray[np.float64]

ELEMENT_ERROR = 1e-4
"""Of the sum, relative to the relaxed compliance, up to the widest band and peak of the priors.

Of Andrade creep, which has none, relative to the creep at any time that counts."""

MAX_PRIOR_QUANTILE = 0.99
"""Quantile of a prior without an upper bound that counts as its largest value."""

START_OF_IMAGINED = 1e-3
"""Shortest time that counts of a stage without readings, over its duration."""

_ONLY, _BAND, _PEAK, _ANDRADE, _FASTER, _SLOWER = map(float, range(6))
"""Parts of a law, as in `stan/physics/relaxation_elements.stan`."""


def elements_block(tests: Sequence[tuple[LoadingHistory | None, PriorSet]]) -> StanData:
    """Return the elements for some tests: part of the law, place in it, weight.

    `tests`: None for a table of attenuation; priors fixed at the values where a solution is asked
    for.
    """
    priors = [own for _, own in tests]
    decades = max(_largest(own["relaxation_time_decades"]) for own in priors)
    rows = [[_ONLY, 0.0, 1.0]]
    if decades > 0:
        rows = _rows(_BAND, *band_elements(decades * np.log(10), ELEMENT_ERROR))
    if not all(is_fixed_at(own["peak_strength"], 0.0) for own in priors):
        width = max(_largest(own["peak_width"]) for own in priors)
        rows += _rows(_PEAK, *peak_elements(width, ELEMENT_ERROR))
    if not all(is_fixed_at(own["andrade_exponent"], 0.0) for own in priors):
        ends = [_log_times(test, own) for test, own in tests if test is not None]
        shortest, longest = np.transpose(ends)
        places = andrade_elements(float(shortest.min()), float(longest.max()), ELEMENT_ERROR)
        rows = _rows(_ANDRADE, *places)
        rows[0][0], rows[-1][0] = _FASTER, _SLOWER
    return {"n_elements": len(rows), "element": rows}


def _rows(part: float, places: FloatArray, weights: FloatArray) -> list[list[float]]:
    return [[part, *row] for row in zip(places.tolist(), weights.tolist(), strict=True)]


def _log_times(test: LoadingHistory, priors: PriorSet) -> tuple[float, float]:
    """Return ln of the shortest and longest relaxation time (s at T_0 and d_K) that counts.

    From a leg, or the first reading of a stage, to the whole test, and further by what temperature
    and grain size may change the times by.
    """
    shortest = [leg.end_time - leg.start_time for leg in test.legs]
    for place, stage in enumerate(test.stages):
        since = test.time[test.reading_stage == place] - stage.start_time
        imagined = START_OF_IMAGINED * (stage.end_time - stage.start_time)
        shortest += since[since > 0].tolist()[:1] or [imagined]
    reference = priors["kelvin_reference_temperature"].location
    coarseness = np.log(test.initial_grain_size / priors["kelvin_reference_grain_size"].location)
    slower = [
        float(log_slowdown(enthalpy, temperature, reference)) + exponent * coarseness
        for temperature in test.temperatures
        for enthalpy in _ends(priors["kelvin_activation_enthalpy"])
        for exponent in _ends(priors["kelvin_grain_size_exponent"])
    ]
    return np.log(min(shortest)) - max(slower), np.log(test.end_time) - min(slower)


def _ends(prior: Prior) -> Iterable[float]:
    """Smallest and largest value that counts."""
    if prior.is_fixed:
        return (prior.location,)
    law = prior.distribution()
    return float(law.ppf(1 - MAX_PRIOR_QUANTILE)), float(law.ppf(MAX_PRIOR_QUANTILE))


def _largest(prior: Prior) -> float:
    if prior.is_fixed:
        return prior.location
    if np.isfinite(prior.upper):
        return prior.upper
    return float(prior.distribution().ppf(MAX_PRIOR_QUANTILE))
