"""Measured grain sizes and fabric factors of a test: their tables in files, data, draws.

Their likelihood is in `stan/statistics/measured_microstructure.stan`.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import Field

from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table, factor_to_si

FloatArray = npt.NDArray[np.float64]

NOT_MEASURED = 0.0
"""What the program is given in the place of a fabric factor that was not measured."""

PATH_STRAIN_ROUNDING = 1e-9
"""Share of a path strain by which it may lie beyond the end: units were converted."""


@dataclass(frozen=True)
class MeasuredMicrostructure:
    """Microstructure of a sample at one strain or time, as measured.

    `strain`: path strain (fraction, above 0), where that is what is known.
    `grain_size`, `grain_size_sd`: mean grain size and its standard deviation (m). The error is
        lognormal, with the standard deviation over the size as that of the logarithm.
    `fabric_factor`, `fabric_factor_sd`: fabric factor (1 = isotropic) and its standard deviation,
        where it was measured.
    `time`: seconds since the start of a loading history, in the place of the strain.
    """

    strain: float | None
    grain_size: float
    grain_size_sd: float
    fabric_factor: float | None = None
    fabric_factor_sd: float | None = None
    time: float | None = None

    @property
    def numbers(self) -> list[float]:
        """Row of `measured` in `stan/statistics/measured_microstructure.stan`."""
        return [
            self.grain_size,
            self.grain_size_sd / self.grain_size,
            NOT_MEASURED if self.fabric_factor is None else self.fabric_factor,
            NOT_MEASURED if self.fabric_factor_sd is None else self.fabric_factor_sd,
        ]

    def drawn(
        self, grain_size: float, fabric_factor: float, rng: np.random.Generator
    ) -> "MeasuredMicrostructure":
        """Measure a microstructure (m; 1 = isotropic) in the place of this one, as uncertain."""
        _, log_sd, _, fabric_sd = self.numbers
        size = float(grain_size * np.exp(log_sd * rng.standard_normal()))
        drawn = replace(self, grain_size=size, grain_size_sd=log_sd * size)
        if self.fabric_factor is None:
            return drawn
        return replace(
            drawn, fabric_factor=float(fabric_factor + fabric_sd * rng.standard_normal())
        )


class MeasuredTable(Table):
    """What was measured, of the tables [[microstructure]]."""

    grain_size_m: float = Field(gt=0, lt=1, description="the mean grain size in metres")
    grain_size_sd_m: float = Field(
        gt=0, description="the standard deviation of the grain size in metres"
    )
    fabric_factor: float | None = Field(None, description="the fabric factor, 1 if isotropic")
    fabric_factor_sd: float | None = Field(
        None, gt=0, description="the standard deviation of the fabric factor"
    )


class StrainTable(Table):
    """Where it was measured in a test along strain."""

    strain: float = Field(gt=0, description="the strain at which the sample was looked at")


class MicrostructureTable(MeasuredTable, StrainTable):
    """One of the tables [[microstructure]] of a test along strain."""


def measured_microstructure(
    path: Path,
    tables: Sequence[MicrostructureTable],
    strain_unit: str | None,
    final_strain: float | None,
) -> tuple[MeasuredMicrostructure, ...]:
    """Check the tables [[microstructure]] of a test along strain.

    `strain_unit`: of their strains, that of the strains in [data]; None: they are fractions. Raise
    InputError if strains do not increase or lie beyond the end, an error is as large as the grain
    size, or a fabric factor lacks its own.
    """
    factor = strain_factor(path, strain_unit)
    check_increasing(path, "strain", [table.strain for table in tables])
    for number, table in enumerate(tables, start=1):
        if final_strain is not None and table.strain * factor > final_strain:
            raise InputError(
                f"{row_text(path, number)}: key 'strain': found {table.strain:g}, expected at most "
                f"'final_strain', {final_strain:g} as a fraction."
            )
    return tuple(
        measured_row(path, number, table, strain=table.strain * factor)
        for number, table in enumerate(tables, start=1)
    )


def row_text(path: Path, number: int) -> str:
    """Return file and table, for messages."""
    return f"{path}: [[microstructure]] number {number}"


def strain_factor(path: Path, strain_unit: str | None) -> float:
    """Return the factor to a fraction, of strains in the unit of [data] if there is one."""
    return factor_to_si(strain_unit or "fraction", "strain", f"{path}: key 'strain_unit' in [data]")


def check_increasing(path: Path, key: str, values: Sequence[float | None]) -> None:
    """Check that values of a key of the tables increase, of those that have it.

    Raise InputError if they do not.
    """
    given = [(number, one) for number, one in enumerate(values, start=1) if one is not None]
    for (_, before), (number, after) in pairwise(given):
        if after <= before:
            raise InputError(
                f"{path}: key {key!r} in [[microstructure]] number {number}: found {after:g}, "
                f"expected more than {before:g}, that of the one before."
            )


def measured_row(
    path: Path,
    number: int,
    table: MeasuredTable,
    *,
    strain: float | None = None,
    time: float | None = None,
) -> MeasuredMicrostructure:
    """Check what was measured at a strain (fraction) or time (s).

    Raise InputError if an error is as large as the grain size, or a fabric factor lacks its own.
    """
    where = row_text(path, number)
    if (table.fabric_factor is None) != (table.fabric_factor_sd is None):
        raise InputError(
            f"{where} needs both or neither of the keys 'fabric_factor' and 'fabric_factor_sd'."
        )
    if table.grain_size_sd_m >= table.grain_size_m:
        raise InputError(
            f"{where}: key 'grain_size_sd_m': found {table.grain_size_sd_m:g}, expected less "
            f"than the grain size, {table.grain_size_m:g} m."
        )
    return MeasuredMicrostructure(
        strain,
        table.grain_size_m,
        table.grain_size_sd_m,
        table.fabric_factor,
        table.fabric_factor_sd,
        time,
    )


def microstructure_tables(
    measured: Sequence[MeasuredMicrostructure],
) -> list[dict[str, Any]]:
    """Return tables that files read back, with strains as fractions and times in s."""
    keys = {"grain_size": "grain_size_m", "grain_size_sd": "grain_size_sd_m"}
    return [
        {keys.get(name, name): value for name, value in asdict(one).items() if value is not None}
        for one in measured
    ]


def strains_of(measured: Sequence[MeasuredMicrostructure]) -> FloatArray:
    """Return the strains (fraction) that were measured at, NaN where a time stands for one."""
    return np.array([one.strain for one in measured], dtype=np.float64)


def times_of(measured: Sequence[MeasuredMicrostructure]) -> FloatArray:
    """Return the times (s) that were measured at, NaN where a strain stands for one."""
    return np.array([one.time for one in measured], dtype=np.float64)


def measured_block(of_tests: Sequence[Sequence[MeasuredMicrostructure]]) -> list[list[float]]:
    """Return the rows of `stan/statistics/measured_microstructure.stan`, of tests in turn."""
    rows = [one.numbers for measured in of_tests for one in measured]
    found: list[list[float]] = np.array(rows).reshape(-1, 4).tolist()
    return found
