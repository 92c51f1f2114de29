"""Keys of the tables [[stages]], and which of them go with a control."""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from pydantic import Field

from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table
from pyburgers.protocols.loading_history.stages import Control

OWN_KEYS: Mapping[Control, tuple[str, ...]] = MappingProxyType(
    {
        "strain_rate": ("strain_rate_per_s",),
        "stress": ("stress",),
        "stress_rate": ("stress_rate", "start_stress"),
        "strain_series": ("knots", "tolerance"),
        "stress_series": ("knots", "tolerance"),
        "hold_strain": (),
    }
)
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
    """Check that a table, by its number from 0, has the keys of its control and no others.

    Raise InputError if it does not.
    """
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
