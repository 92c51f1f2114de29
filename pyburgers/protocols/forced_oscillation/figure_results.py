"""What figures of a forced oscillation show, in a sentence, for those who cannot see them."""

import numpy as np

from pyburgers.common.draws import all_draws
from pyburgers.drawing.panels import band_text
from pyburgers.model.display import LENGTH_FACTOR, LENGTH_UNIT
from pyburgers.protocols.forced_oscillation.response import (
    observed_response,
    oscillation_of,
    replicated_response,
)
from pyburgers.protocols.protocol import FittedTest


def lag_result(fit: FittedTest) -> str:
    """Set the observed phase lag beside those of replicated data."""
    observed = np.degrees(observed_response(oscillation_of(fit)).lag)
    replicated = band_text(np.degrees(replicated_response(fit).lag), "degrees")
    return f"the record lags by {observed:.3g} degrees, replicated data by {replicated}."


def grains_result(fit: FittedTest) -> str:
    """Say how large grains are at the end."""
    size = all_draws(fit.posterior["predictions"].to_dataset()["grain_size"])[:, -1]
    return f"grains end at {band_text(size * LENGTH_FACTOR, LENGTH_UNIT)}."
