"""Tables of attenuation and modulus in SI units: conditions of every row, what was read there."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from pyburgers.common.array_types import BoolArray, FloatArray, IntArray
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table

Deformation = Literal["axial", "shear"]

Form = Literal["tan_delta", "log10_tan_delta", "loss_angle"]
"""Forms in which tables state tan(delta); 1/Q is the first."""

ATTENUATION, MODULUS = 0, 1
"""Codes of what is read."""

SHARE_OF_SPECTRUM, MARGIN = 0.9, 0.05
"""A spectrum takes this share of a unit of place, and begins after this margin."""


@dataclass(frozen=True, eq=False)
class CycleConditions:
    """Under which cycles, and at which temperatures, rows of a table were read; arrays (n_rows,).

    `period`, `temperature`: s, K.
    `median_stress`, `amplitude`: of the stress (Pa); an amplitude of 0 was not stated.
    """

    period: FloatArray
    temperature: FloatArray
    median_stress: FloatArray
    amplitude: FloatArray

    def ordered(self, rows: IntArray) -> "CycleConditions":
        """Return some rows in their order."""
        return CycleConditions(*(getattr(self, column.name)[rows] for column in fields(self)))

    @property
    def rows_in_order(self) -> IntArray:
        """Rows of one temperature and stress together, as these come first, by their periods."""
        others = np.stack([self.temperature, self.median_stress, self.amplitude])
        _, first, group = np.unique(others, axis=1, return_index=True, return_inverse=True)
        return np.lexsort((self.period, first[group.ravel()]))

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return self.period.size

    @cached_property
    def spectrum(self) -> IntArray:
        """Spectrum of each row, from 0: rows in a row of one temperature and stress."""
        others = np.stack([self.temperature, self.median_stress, self.amplitude])
        return np.cumsum(np.any(np.diff(others, axis=1, prepend=others[:, :1]) != 0, axis=0))

    @property
    def n_spectra(self) -> int:
        """Number of spectra."""
        return int(self.spectrum[-1]) + 1

    @cached_property
    def first_rows(self) -> IntArray:
        """First row of each spectrum."""
        return np.unique(self.spectrum, return_index=True)[1]

    @cached_property
    def place(self) -> FloatArray:
        """Place of each row on the clock: its spectrum, and its share of all ln(period)."""
        low, width = self._range
        share = (np.log(self.period) - low) / width
        return np.asarray(self.spectrum + MARGIN + SHARE_OF_SPECTRUM * share)

    def at(self, place: FloatArray) -> tuple[FloatArray, IntArray, IntArray]:
        """Return period (s), spectrum and what is read at places: attenuation stands first."""
        low, width = self._range
        number = np.floor(place).astype(np.int64)
        share = (place - number - MARGIN) / SHARE_OF_SPECTRUM
        quantity, spectrum = np.divmod(number, self.n_spectra)
        return np.exp(low + width * share), spectrum, quantity

    @property
    def _range(self) -> tuple[float, float]:
        """Least ln(period), and the width of its range; 1 where there is no range."""
        logarithm = np.log(self.period)
        return float(logarithm.min()), float(np.ptp(logarithm)) or 1.0


@dataclass(frozen=True, eq=False)
class Readings:
    """What was read in every row of a table, arrays (n_rows,).

    `tan_delta`, `tan_delta_error`: tan(delta) or 1/Q, and its stated standard deviation or 0.
    `limit`: tan(delta) at or below which a reading says no more than that; 0 for none.
    `modulus`, `modulus_error`: 1/|J| (Pa) and its standard deviation; (0,) if none was read.
    """

    tan_delta: FloatArray
    tan_delta_error: FloatArray
    limit: FloatArray
    modulus: FloatArray
    modulus_error: FloatArray

    def ordered(self, rows: IntArray) -> "Readings":
        """Return some rows in their order."""
        columns = (getattr(self, column.name) for column in fields(self))
        return Readings(*(column[rows] if column.size else column for column in columns))

    @property
    def is_limit(self) -> BoolArray:
        """Whether the attenuation of a row is an upper limit, shape (n_rows,)."""
        return (self.limit > 0) & (self.tan_delta <= self.limit)


NO_READINGS = Readings(*[np.empty(0)] * 5)
"""Of a table that can only be simulated."""


@dataclass(frozen=True)
class Elasticity:
    """How axial compliances become those of a table.

    `deformation`: of the cycles: modulus and stress are Young's and axial, or of shear.
    `poisson_ratio`, `bulk_modulus` (Pa): one of them in shear.
    """

    deformation: Deformation
    poisson_ratio: float | None = None
    bulk_modulus: float | None = None

    @property
    def conversion(self) -> tuple[float, float, float]:
        """c_1, c_2, c_3: 1/modulus = c_1/E_M - c_2, other compliances times c_3."""
        if self.deformation == "axial":
            return 1.0, 0.0, 1.0
        if self.bulk_modulus is not None:
            return 3.0, 1 / (3 * self.bulk_modulus), 3.0
        assert self.poisson_ratio is not None
        return 2 * (1 + self.poisson_ratio), 0.0, 3.0

    def axial_modulus(self, modulus: float) -> float:
        """Return Young's modulus of a modulus (Pa) of the table."""
        of_spring, less, _ = self.conversion
        return of_spring / (1 / modulus + less)

    @property
    def stress_factor(self) -> float:
        """Axial stress that drives creep as a stress of the table does (von Mises), over it."""
        return 1.0 if self.deformation == "axial" else float(np.sqrt(3))


def check_table(
    conditions: CycleConditions,
    readings: Readings,
    order: FloatArray,
    where: str,
    order_name: str,
    advice: str = "",
) -> None:
    """Check rows of a table; `order` (n_rows,) increases in spectra, `advice` is on equal rows."""
    positive = {
        "period or frequency": conditions.period,
        "temperature": conditions.temperature,
        "modulus": readings.modulus,
    }
    not_negative = {
        "median stress": conditions.median_stress,
        "uncertainty of the attenuation": readings.tan_delta_error,
        "limit of the attenuation": readings.limit,
        "uncertainty of the modulus": readings.modulus_error,
    }
    for name, values in positive.items():
        check_sign(values > 0, values, where, name, "a positive number")
    for name, values in not_negative.items():
        check_sign(values >= 0, values, where, name, "a number of at least 0")
    readable = (readings.tan_delta > 0) | readings.is_limit
    or_limit = "or a 'limit' at or below which it is only known to be at most that"
    expected = f"a positive number, {or_limit}"
    check_sign(readable, readings.tan_delta, where, "attenuation", expected)
    rows = conditions.rows_in_order
    ordered = conditions.ordered(rows)
    twice = np.flatnonzero((np.diff(ordered.spectrum) == 0) & (np.diff(ordered.period) <= 0))
    if twice.size:
        row = int(rows[twice[0] + 1])
        raise InputError(
            f"{where}: data row {row + 1}: found the {order_name} {order[row]:g} twice at "
            f"{conditions.temperature[row]:g} K, expected each {order_name} once in rows of one "
            f"temperature and stress{advice}."
        )


def check_sign(good: BoolArray, values: FloatArray, where: str, name: str, expected: str) -> None:
    """Refuse a column with a bad value; the message names the first such row."""
    bad = np.flatnonzero(~good)
    if bad.size:
        raise InputError(
            f"{where}: data row {bad[0] + 1}: found {values[bad[0]]:g} (SI) as {name}, expected "
            f"{expected}."
        )


def tan_delta_of(form: Form, values: FloatArray, radian: float, where: str) -> FloatArray:
    """Return tan(delta) of readings (n_rows,) in a form; `radian` is the unit of a loss angle."""
    if form == "tan_delta":
        return values
    if form == "log10_tan_delta":
        with np.errstate(over="ignore"):
            tan_delta: FloatArray = 10**values
        if np.isinf(tan_delta).any():
            raise InputError(
                f"{where}: found logarithms beyond 308, expected those of tan delta to the base 10."
            )
        return tan_delta
    angle = radian * values
    if np.any(np.abs(angle) >= np.pi / 2):
        raise InputError(
            f"{where}: found an angle of {np.degrees(np.abs(angle).max()):g} degrees, expected "
            "less than 90; check 'attenuation_unit'."
        )
    return np.asarray(np.tan(angle))


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
    """Return the rows of spectra; K, Pa and Pa stand where a spectrum has none of its own."""
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
