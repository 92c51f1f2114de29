"""Stages of a loading history, and the legs over which what drives it is linear in time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from pyburgers.protocols.experiment import FloatArray

Control = Literal[
    "strain_rate", "stress", "stress_rate", "strain_series", "stress_series", "hold_strain"
]
"""What is imposed in a stage, as in files."""

Driven = Literal["strain", "stress"]

DRIVEN: dict[Control, Driven] = {
    "strain_rate": "strain",
    "strain_series": "strain",
    "hold_strain": "strain",
    "stress": "stress",
    "stress_rate": "stress",
    "stress_series": "stress",
}


@dataclass(frozen=True)
class Stage:
    """Part of a test in which one thing is imposed.

    Strain and stress are true ones, positive in compression.

    `control`: what is imposed.
    `start_time`, `end_time`: seconds since the start of the test.
    `temperature`: Kelvin.
    `value`: the strain rate (1/s), the stress (Pa) or the stress rate (Pa/s); 0 for a hold and a
        series.
    `start_stress`: stress (Pa) from which a stress rate starts; None for the other controls.
    `knots`: times (s, the first and the last are those of the stage) and strains (fraction) or
        stresses (Pa) of a series, linear in between; empty for the other controls. Only differences
        of strains count.
    `is_force`: whether stresses are forces over the first area: the true stress follows from the
        strain.
    """

    control: Control
    start_time: float
    end_time: float
    temperature: float
    value: float = 0.0
    start_stress: float | None = None
    knots: tuple[tuple[float, float], ...] = ()
    is_force: bool = False

    @property
    def driven(self) -> Driven:
        """Whether strain or stress is imposed; the other one is the response."""
        return DRIVEN[self.control]


@dataclass(frozen=True)
class Leg:
    """Part of a stage over which what is imposed is linear in time.

    `driven`: what is imposed.
    `start_time`, `end_time`: seconds since the start of the test.
    `start_value`: stress (Pa) at the start where stress is imposed, with a jump where it differs
        from that at the end of the leg before; 0 where strain is imposed, which goes on from where
        it is.
    `rate`: of what is imposed: 1/s or Pa/s.
    `temperature`: Kelvin.
    `stage`: to which it belongs, from 0.
    `is_force`: whether its stresses are forces over the first area.
    """

    driven: Driven
    start_time: float
    end_time: float
    start_value: float
    rate: float
    temperature: float
    stage: int
    is_force: bool = False

    @property
    def end_value(self) -> float:
        """Stress (Pa) at the end where stress is imposed, else the strain imposed in this leg."""
        return self.start_value + self.rate * (self.end_time - self.start_time)


def legs_of(stages: Sequence[Stage]) -> tuple[Leg, ...]:
    """Return the legs of stages, in the order of time."""
    return tuple(leg for number, stage in enumerate(stages) for leg in _legs(stage, number))


def imposed_stresses(legs: Sequence[Leg]) -> FloatArray:
    """Return the stresses (Pa) at both ends of the legs that impose one; empty for none."""
    loads = [leg for leg in legs if leg.driven == "stress"]
    return np.array([value for leg in loads for value in (leg.start_value, leg.end_value)])


def imposed_strains(legs: Sequence[Leg]) -> FloatArray:
    """Return the sums of imposed strain at the ends of the legs that impose one; empty for none."""
    return np.cumsum([leg.end_value for leg in legs if leg.driven == "strain"])


def _legs(stage: Stage, number: int) -> list[Leg]:
    if not stage.knots:
        start, rate = _start_and_rate(stage)
        span = stage.start_time, stage.end_time
        return [Leg(stage.driven, *span, start, rate, stage.temperature, number, stage.is_force)]
    times, values = np.transpose(stage.knots)
    rates = np.diff(values) / np.diff(times)
    starts = values if stage.driven == "stress" else np.zeros_like(values)
    return [
        Leg(
            driven=stage.driven,
            start_time=float(times[k]),
            end_time=float(times[k + 1]),
            start_value=float(starts[k]),
            rate=float(rates[k]),
            temperature=stage.temperature,
            stage=number,
        )
        for k in range(rates.size)
    ]


def _start_and_rate(stage: Stage) -> tuple[float, float]:
    """Value at the start and rate of a stage that is one leg."""
    if stage.control == "stress":
        return stage.value, 0.0
    return stage.start_stress or 0.0, stage.value
