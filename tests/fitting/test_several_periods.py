"""Cycles of several periods as loading histories answer as tables of attenuation say."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from linear_bodies import LAWS, linear_body

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.table import NO_READINGS, CycleConditions, Elasticity
from pyburgers.kinds.experiment import Provenance
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stages import Stage

TEMPERATURE, GRAIN_SIZE = 263.0, 2e-4
PERIODS, AMPLITUDES = (140.0, 35.0), (1e5, 4e4)
CORNERS, CYCLES = 70, 2
"""Corners of the stress in the shorter period; long periods, of which the last is looked at."""
RATIO = 4
"""Of the periods."""

VISCOSITY = 1e11
LINEAR = linear_body(VISCOSITY, 3e10, TEMPERATURE, GRAIN_SIZE)
"""Its longest relaxation time is 30 s."""

ABOUT: Mapping[str, Any] = MappingProxyType(
    {
        "material": "ice",
        "temperature": TEMPERATURE,
        "initial_grain_size": GRAIN_SIZE,
        "provenance": Provenance("synthetic", "a test"),
        "metadata": MappingProxyType({}),
        "notices": (),
        "true_parameters": None,
    }
)


def stress_at(time: FloatArray) -> FloatArray:
    waves = [
        size * np.sin(2 * np.pi * time / period)
        for size, period in zip(AMPLITUDES, PERIODS, strict=True)
    ]
    return np.asarray(sum(waves))


def cycles() -> HistoryExperiment:
    """Stress of two periods at once, without readings."""
    time = np.linspace(0.0, CYCLES * PERIODS[0], RATIO * CYCLES * CORNERS + 1)
    knots = tuple(zip(time.tolist(), stress_at(time).tolist(), strict=True))
    stage = Stage("stress_series", 0.0, float(time[-1]), TEMPERATURE, knots=knots)
    return HistoryExperiment(
        id="cycles",
        **ABOUT,
        stages=(stage,),
        time=np.empty(0),
        reading_stage=np.empty(0, dtype=np.int64),
        reading=np.empty(0),
    )


def table() -> AttenuationExperiment:
    """The same periods as rows of a table."""
    rows = np.ones(2)
    return AttenuationExperiment(
        id="rows",
        **ABOUT,
        conditions=CycleConditions(
            np.sort(PERIODS), TEMPERATURE * rows, np.zeros(2), np.array(AMPLITUDES[::-1])
        ),
        readings=NO_READINGS,
        elasticity=Elasticity("axial"),
    )


@pytest.mark.parametrize("law", [name for name in LAWS if name != "extended"])
def test_each_period_has_the_attenuation_and_modulus_of_a_table(programs: None, law: str) -> None:
    """The extended law with a peak has all elements of the one without."""
    values = {**LINEAR, **LAWS[law]}
    last = (CYCLES - 1) * PERIODS[0] + PERIODS[0] * np.arange(RATIO * CORNERS) / (RATIO * CORNERS)
    strain = simulate(cycles(), values, at=last)["strain"].to_numpy()
    waves = np.exp(2j * np.pi * last / np.array(PERIODS)[:, np.newaxis])
    # Andrade creep remembers that it began at rest: the cycles ride on a drift.
    drift = np.vander(last / last[-1], 4)
    parts = np.column_stack([waves.imag.T, waves.real.T, drift])
    in_phase, out_of_phase, _ = np.split(np.linalg.lstsq(parts, strain)[0], [2, 4])
    compliance = (in_phase + 1j * out_of_phase) / AMPLITUDES
    found = np.log([-compliance.imag / compliance.real, 1 / np.abs(compliance)])
    rows = table()
    place = np.concatenate([rows.conditions.place, rows.conditions.place + 2])
    expected = simulate(rows, values, at=place)["log_reading"].to_numpy().reshape(2, 2)[:, ::-1]
    np.testing.assert_allclose(found, expected, atol=1e-3)
