"""An oscillation whose background is removed, solved by scipy."""

from collections.abc import Mapping

import oracle

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment


def stress(
    test: OscillationExperiment, values: Mapping[str, float], time: FloatArray
) -> FloatArray:
    """Stress (Pa) at times (s), shape (n,), of parameters by name (SI)."""
    prepared = test.prepared
    imposed = oracle.OscillatingStrain(
        prepared.period,
        prepared.strain_fit.sine.tolist(),
        prepared.strain_fit.cosine.tolist(),
        (0.0,),
        prepared.start,
    )
    found: FloatArray = oracle.oscillation(
        values,
        test.temperature,
        test.initial_grain_size,
        imposed,
        start=imposed.zero_ahead(test.spin_up_cycles),
        start_stress=0.0,
        time=time,
    )[0]
    return found
