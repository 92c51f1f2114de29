"""Tests without readings, in the conditions of the twins of ice."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from conftest import ICE
from history_twins import history_twin

from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, RateSegment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stages import Stage

ONE_RATE = ((0.0, 1e-4),)
STEPS = ((0.0, 1e-4), (0.03, 2e-5), (0.0501, 3e-4))
"""Start strain and rate (1/s) of each segment."""


def imagined_curve(
    segments: Sequence[tuple[float, float]], final_strain: float
) -> ConstantRateExperiment:
    """Return a test at constant rates."""
    return replace(
        load_constant_rate(ICE / "PIL40.toml"),
        segments=tuple(RateSegment(start, rate) for start, rate in segments),
        strain=np.empty(0),
        stress=np.empty(0),
        final_strain=final_strain,
    )


def imagined_history(*stages: Stage) -> HistoryExperiment:
    """Return a loading history."""
    return replace(
        history_twin("creep", 2),
        stages=stages,
        time=np.empty(0),
        reading_stage=np.empty(0, dtype=np.int64),
        reading=np.empty(0),
    )
