"""Spectra that a file lists: the rows of an imagined table, which can only be simulated."""

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table
from pyburgers.kinds.attenuation.table import (
    NO_READINGS,
    CycleConditions,
    FloatArray,
    check_table,
)


class SpectrumTable(Table):
    """A table of [[spectra]]."""

    periods_s: list[Annotated[float, Field(gt=0)]] = Field(
        min_length=1, description="the periods in s, increasing"
    )
    temperature_K: float | None = Field(  # noqa: N815
        None, gt=0, description="its temperature in kelvin, if it is not that of the file's head"
    )
    median_stress_Pa: float | None = Field(  # noqa: N815
        None, ge=0, description="its median stress in Pa, if it is not that in [attenuation]"
    )
    amplitude_Pa: float | None = Field(  # noqa: N815
        None, gt=0, description="its stress amplitude in Pa, if it is not that in [attenuation]"
    )


def conditions_of(
    spectra: Sequence[SpectrumTable],
    temperature: float,
    median_stress: float | None,
    amplitude: float | None,
    *,
    where: str,
) -> CycleConditions:
    """Return the rows of listed spectra.

    `temperature`, `median_stress`, `amplitude`: of spectra that have none of their own (K, Pa, Pa).
    Raise InputError if some spectra have an amplitude and others have none, periods do not
    increase, or a spectrum stands twice.
    """
    sizes = [len(spectrum.periods_s) for spectrum in spectra]

    def rows(own: Sequence[float | None], common: float | None) -> FloatArray:
        return np.repeat([(common or 0.0) if one is None else one for one in own], sizes)

    conditions = CycleConditions(
        period=np.concatenate([spectrum.periods_s for spectrum in spectra]),
        temperature=rows([one.temperature_K for one in spectra], temperature),
        median_stress=rows([one.median_stress_Pa for one in spectra], median_stress),
        amplitude=rows([one.amplitude_Pa for one in spectra], amplitude),
    )
    if 0 < np.count_nonzero(conditions.amplitude) < conditions.n_rows:
        raise InputError(
            f"{where}: key 'amplitude_Pa' is given in some of them, expected it in all or none, or "
            "in [attenuation]."
        )
    check_table(conditions, NO_READINGS, conditions.period, where, "period")
    return conditions


def spectra_of(conditions: CycleConditions) -> list[dict[str, Any]]:
    """Return tables [[spectra]] from which `conditions_of` makes the rows again."""
    periods = np.split(conditions.period, conditions.first_rows[1:])
    spectra = []
    for first, own in zip(conditions.first_rows, periods, strict=True):
        table = {
            "periods_s": own.tolist(),
            "temperature_K": float(conditions.temperature[first]),
            "median_stress_Pa": float(conditions.median_stress[first]),
        }
        if conditions.amplitude[first] > 0:
            table["amplitude_Pa"] = float(conditions.amplitude[first])
        spectra.append(table)
    return spectra
