"""Measured grain sizes and fabric factors of a test: their tables in files, data, draws.

Their likelihood is in `stan/statistics/measured_microstructure.stan`.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pydantic import Field

from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table, factor_to_si

NOT_MEASURED = 0.0
"""What the program is given in the place of a fabric factor that was not measured."""


@dataclass(frozen=True)
class MeasuredMicrostructure:
    """Microstructure of a sample at one strain, as measured.

    Attributes
    ----------
    strain : float
        Fraction, above 0.
    grain_size, grain_size_sd : float
        Mean grain size and its standard deviation (m). The error is lognormal, with the standard
        deviation over the size as that of the logarithm.
    fabric_factor, fabric_factor_sd : float or None
        Fabric factor (1 = isotropic) and its standard deviation, where it was measured.
    """

    strain: float
    grain_size: float
    grain_size_sd: float
    fabric_factor: float | None = None
    fabric_factor_sd: float | None = None

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


class MicrostructureTable(Table):
    """One of the tables [[microstructure]]."""

    strain: float = Field(gt=0, description="the strain at which the sample was looked at")
    grain_size_m: float = Field(gt=0, lt=1, description="the mean grain size in metres")
    grain_size_sd_m: float = Field(
        gt=0, description="the standard deviation of the grain size in metres"
    )
    fabric_factor: float | None = Field(None, description="the fabric factor, 1 if isotropic")
    fabric_factor_sd: float | None = Field(
        None, gt=0, description="the standard deviation of the fabric factor"
    )


def measured_microstructure(
    path: Path,
    tables: Sequence[MicrostructureTable],
    strain_unit: str | None,
    final_strain: float | None,
) -> tuple[MeasuredMicrostructure, ...]:
    """Check the tables [[microstructure]] of a file.

    Parameters
    ----------
    path : Path
        The TOML file, for messages.
    tables : sequence of MicrostructureTable
        Its tables.
    strain_unit : str or None
        Of their strains, that of the strains in [data]; None: they are fractions.
    final_strain : float or None
        Fraction at which the test is stated to end.

    Raises
    ------
    InputError
        If strains do not increase or lie beyond the end, an error is as large as the grain size, or
        a fabric factor lacks its own.
    """
    key = f"{path}: key 'strain_unit' in [data]"
    factor = factor_to_si(strain_unit or "fraction", "strain", key)
    for number, (before, after) in enumerate(pairwise(tables), start=2):
        if after.strain <= before.strain:
            raise InputError(
                f"{path}: key 'strain' in [[microstructure]] number {number}: found "
                f"{after.strain:g}, expected more than {before.strain:g}, that of the one before."
            )
    found = []
    for number, table in enumerate(tables, start=1):
        where = f"{path}: [[microstructure]] number {number}"
        if (table.fabric_factor is None) != (table.fabric_factor_sd is None):
            raise InputError(
                f"{where} needs both or neither of the keys 'fabric_factor' and 'fabric_factor_sd'."
            )
        if final_strain is not None and table.strain * factor > final_strain:
            raise InputError(
                f"{where}: key 'strain': found {table.strain:g}, expected at most 'final_strain', "
                f"{final_strain:g} as a fraction."
            )
        if table.grain_size_sd_m >= table.grain_size_m:
            raise InputError(
                f"{where}: key 'grain_size_sd_m': found {table.grain_size_sd_m:g}, expected less "
                f"than the grain size, {table.grain_size_m:g} m."
            )
        found.append(
            MeasuredMicrostructure(
                table.strain * factor,
                table.grain_size_m,
                table.grain_size_sd_m,
                table.fabric_factor,
                table.fabric_factor_sd,
            )
        )
    return tuple(found)


def microstructure_tables(
    measured: Sequence[MeasuredMicrostructure],
) -> list[dict[str, Any]]:
    """Return tables that `measured_microstructure` reads back, with strains as fractions."""
    keys = {"grain_size": "grain_size_m", "grain_size_sd": "grain_size_sd_m"}
    return [
        {keys.get(name, name): value for name, value in asdict(one).items() if value is not None}
        for one in measured
    ]


def with_drawn_microstructure(
    measured: Sequence[MeasuredMicrostructure], solution: pd.DataFrame, rng: np.random.Generator
) -> tuple[MeasuredMicrostructure, ...]:
    """Measure the microstructure of a solution in the place of what was measured.

    Parameters
    ----------
    measured : sequence of MeasuredMicrostructure
        Strains and uncertainties.
    solution : DataFrame
        Columns strain, increasing, those of `measured` among them; grain_size_m, fabric_factor.
    rng : Generator
        Gives the errors.
    """
    drawn = []
    for one in measured:
        size, fabric = (
            float(np.interp(one.strain, solution["strain"], solution[name]))
            for name in ("grain_size_m", "fabric_factor")
        )
        drawn.append(one.drawn(size, fabric, rng))
    return tuple(drawn)
