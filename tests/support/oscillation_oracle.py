"""An oscillation solved by scipy; background and series are those of the prepared record."""

from collections.abc import Mapping

import numpy as np
import oracle
from numpy.polynomial import Polynomial

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.forced_oscillation.likelihood import START_MARGIN


def solution(
    test: OscillationExperiment, values: Mapping[str, float], time: FloatArray
) -> FloatArray:
    """Stress (Pa), Kelvin strain and grain size (m) at times (s), shape (3, n)."""
    prepared = test.prepared
    start = prepared.start - START_MARGIN * prepared.period
    background, start_stress = [0.0], 0.0
    if prepared.background == "kept":
        since = np.linspace(0.0, 1000.0, 20)
        rate = prepared.strain_fit.trend_rate(start + since)
        degree = max(prepared.strain_fit.degree - 1, 0)
        background = Polynomial.fit(since, rate, degree).convert().coef.tolist()
        start_stress = float(prepared.stress_fit.trend(np.array([prepared.start]))[0])
    imposed = oracle.OscillatingStrain(
        prepared.period,
        prepared.strain_fit.sine.tolist(),
        prepared.strain_fit.cosine.tolist(),
        background,
        start,
    )
    return oracle.oscillation(
        values,
        test.temperature,
        test.initial_grain_size,
        imposed,
        start=imposed.zero_ahead(test.spin_up_cycles),
        start_stress=start_stress,
        time=time,
    )
