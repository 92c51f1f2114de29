"""Stages of a loading history, the legs that are solved, and the tables [[stages]] of files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table

Control = Literal[
    "strain_rate", "stress", "stress_rate", "strain_series", "stress_series", "hold_strain"
]
"""What is imposed in a stage, as in files."""

Driven = Literal["strain", "stress"]

Measure = Literal["true", "engineering"]

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
    """Part of a test in which one thing is imposed; true strain and stress, compression positive.

    `control`: what is imposed.
    `start_time`, `end_time`, `temperature`: seconds since the start of the test; Kelvin.
    `value`: strain rate (1/s), stress (Pa) or stress rate (Pa/s); 0 for a hold and a series.
    `start_stress`: stress (Pa) from which a stress rate starts; None for the other controls.
    `knots`: times (s) from end to end, and strains, of which differences count, or stresses (Pa) of
        a series, linear in between; empty for the other controls.
    `is_force`: whether stresses are forces over the first area.
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

    `driven`, `stage`: what is imposed; stage to which it belongs, from 0.
    `start_time`, `end_time`, `temperature`: seconds since the start of the test; Kelvin.
    `start_value`, `rate`: stress (Pa) at the start, 0 where strain is imposed; 1/s or Pa/s.
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
        start, rate = stage.start_stress or 0.0, stage.value
        if stage.control == "stress":
            start, rate = stage.value, 0.0
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


OWN_KEYS: Mapping[Control, tuple[str, ...]] = {
    "strain_rate": ("strain_rate_per_s",),
    "stress": ("stress",),
    "stress_rate": ("stress_rate", "start_stress"),
    "strain_series": ("knots", "tolerance"),
    "stress_series": ("knots", "tolerance"),
    "hold_strain": (),
}
"""Keys of a stage that only some controls have; the first is needed, but for knots."""


class StageTable(Table):
    """One of [[stages]]."""

    control: Control = Field(description="what is imposed")
    start_time: float = Field(description="the time at the start in the unit stage_time_unit")
    end_time: float = Field(description="the time at the end in the unit stage_time_unit")
    temperature_K: float | None = Field(  # noqa: N815 - a key with its unit
        None, ge=50, le=3000, description="the temperature in kelvin where it is another"
    )
    strain_rate_per_s: float | None = Field(None, description="the imposed strain rate in 1/s")
    stress: float | None = Field(
        None, description="the imposed stress in the unit stage_stress_unit"
    )
    stress_rate: float | None = Field(None, description="stress over time, in the units of stages")
    start_stress: float | None = Field(
        None, description="the stress at which the rate starts, in the unit stage_stress_unit"
    )
    knots: list[list[float]] | None = Field(
        None, description="pairs of time and strain (fraction) or stress"
    )
    tolerance: float | None = Field(
        None, gt=0, description="how far legs pass from readings of strain (fraction) or stress"
    )


def check_keys(path: Path, number: int, table: StageTable) -> None:
    """Refuse a table, by its number from 0, without the keys of its control or with others."""
    own = OWN_KEYS[table.control]
    where = f"in [[stages]] number {number + 1}"
    for key in sorted({key for keys in OWN_KEYS.values() for key in keys}):
        if getattr(table, key) is not None and key not in own:
            raise InputError(
                f"{path}: key {key!r} {where}: found it with control {table.control!r}, expected "
                f"{' or '.join(map(repr, own)) if own else 'no such key'}."
            )
    if own and own[0] != "knots" and getattr(table, own[0]) is None:
        raise InputError(
            f"{path}: key {own[0]!r} {where} is missing, expected it because the control is "
            f"{table.control!r}."
        )
