"""Elements of the Kelvin part in loading histories, as `stan/loading_history.stan` takes them."""

from collections.abc import Sequence

import numpy as np

from pyburgers.model.kelvin_elements import band_elements, peak_elements
from pyburgers.model.prior_families import Prior, is_fixed_at
from pyburgers.model.priors import PriorSet
from pyburgers.protocols.stan_data import StanData

ELEMENT_ERROR = 1e-4
"""Of the sum, relative to the relaxed compliance, up to the widest band and peak of the priors."""

WIDEST = 0.99
"""Quantile of a prior without an upper bound that counts as its largest value."""

_ONLY, _BAND, _PEAK = 0.0, 1.0, 2.0
"""Parts of a law, as in `stan/protocols/loading_history_rates.stan`."""


def elements_block(priors: Sequence[PriorSet]) -> StanData:
    """Return the elements for some tests: part of the law, place in it, weight.

    Parameters
    ----------
    priors : sequence of PriorSet
        Of each test; fixed at the values where a solution is asked for.
    """
    decades = max(_largest(own["relaxation_time_decades"]) for own in priors)
    rows = [[_ONLY, 0.0, 1.0]]
    if decades > 0:
        places, weights = band_elements(decades * np.log(10), ELEMENT_ERROR)
        rows = [[_BAND, *row] for row in zip(places.tolist(), weights.tolist(), strict=True)]
    if not all(is_fixed_at(own["peak_strength"], 0.0) for own in priors):
        width = max(_largest(own["peak_width"]) for own in priors)
        places, weights = peak_elements(width, ELEMENT_ERROR)
        rows += [[_PEAK, *row] for row in zip(places.tolist(), weights.tolist(), strict=True)]
    return {"n_elements": len(rows), "element": rows}


def _largest(prior: Prior) -> float:
    if prior.is_fixed:
        return prior.location
    if np.isfinite(prior.upper):
        return prior.upper
    return float(prior.distribution().ppf(WIDEST))
