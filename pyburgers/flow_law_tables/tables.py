"""Tables of steady rates: one row for each test, read from TOML and columns into SI.

In each row stress or strain rate was imposed and the other was read, at the minimum rate, at the
peak stress or in the steady state. Every geometry is turned to the axial equivalent.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.common.array_types import BoolArray, FloatArray, IntArray
from pyburgers.common.errors import InputError
from pyburgers.common.units import counted
from pyburgers.kinds.experiment import DataKind, Experiment, Provenance
from pyburgers.kinds.limits import impossible_conditions
from pyburgers.model.environment import environment_faults
from pyburgers.model.flow_law_prior import Conditions
from pyburgers.model.parameters import ENVIRONMENT
from pyburgers.model.peak_test import PeakTest

KIND = "rates"
"""Key `protocol` of such tables."""

LEAST_ROWS = 3
"""Rows below which not even rate, stress exponent and scatter can be told."""

Imposed = Literal["stress", "strain_rate"]
Regime = Literal["minimum", "peak", "steady"]
Geometry = Literal["compression", "tension", "shear", "torsion"]
Measure = Literal["applied", "octahedral", "axial"]

IN_SHEAR = ("shear", "torsion")
"""Geometries in which stress and rate of a table are those of shear."""

AXIAL_EQUIVALENT: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "axial": (1.0, 1.0),
        "shear": (3**0.5, 3**-0.5),
        "octahedral": (3 / 2**0.5, 2**0.5),
    }
)
"""Factors of stress and rate to those of an axial test with the same second invariants.

Of shear they are the von Mises stress, sqrt(3) times the shear stress, and the engineering shear
strain rate over sqrt(3), in torsion at the outer radius: (3 + 1/n) M/(2 pi R^3) of a torque M.
Octahedral stress and rate are those of Nye and of the Melbourne tests.
"""

SI_COLUMNS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "temperature": ("temperature", "K"),
        "stress": ("stress", "Pa"),
        "strain_rate": ("strain rate", "1/s"),
        "grain_size": ("length", "m"),
        "pressure": ("stress", "Pa"),
        "water_fugacity": ("stress", "Pa"),
        "melt_fraction": ("strain", "fraction"),
        "reading_error": ("relative error", "1"),
    }
)
"""Columns of a table, with their quantities in `pyburgers.common.units` and SI units."""

MAY_BE_EMPTY = ("grain_size", *ENVIRONMENT)
"""Columns of conditions that may be unknown, NaN."""

MAY_BE_LEFT_OUT = (*MAY_BE_EMPTY, "reading_error")
"""Columns without which a table is complete."""

NUMBERS = (*SI_COLUMNS, "temperature_error", "grain_size_error")
LABELS = ("imposed", "regime", "geometry", "source")
"""Arrays of a `RateTable`."""


@dataclass(frozen=True)
class PeakStrain:
    """Strain (fraction) at which tests peak: mean over the tests, and its standard deviation."""

    mean: float
    sd: float


@dataclass(frozen=True, eq=False)
class RateTable:
    """Steady rates of one material, a test each, in SI units and axial equivalents.

    Attributes
    ----------
    id, material : str
        Name of the table; the material names the default laws.
    temperature, stress, strain_rate, grain_size : array, shape (n,)
        K, Pa, 1/s, m; the grain size is NaN if it is unknown.
    pressure, water_fugacity, melt_fraction : array, shape (n,)
        Pa, Pa, fraction; NaN if unknown.
    reading_error, temperature_error, grain_size_error : array, shape (n,)
        Standard deviations: of what was read, relative; K; relative. 0 if taken as exact.
    imposed, regime, geometry, source : array of str, shape (n,)
        Imposed is ``"stress"`` or ``"strain_rate"``; the regime ``"minimum"``, ``"peak"`` or
        ``"steady"``; the source a paper or a laboratory.
    provenance : Provenance
        Origin of the numbers.
    peak_strain : PeakStrain or None
        Strain of the peaks, if it is stated.
    notices : tuple of str
        Sentences about changes during reading.

    Examples
    --------
    >>> rates.n_rows == len(rates.stress)
    True
    """

    id: str
    material: str
    temperature: FloatArray
    stress: FloatArray
    strain_rate: FloatArray
    grain_size: FloatArray
    pressure: FloatArray
    water_fugacity: FloatArray
    melt_fraction: FloatArray
    reading_error: FloatArray
    temperature_error: FloatArray
    grain_size_error: FloatArray
    imposed: npt.NDArray[np.str_]
    regime: npt.NDArray[np.str_]
    geometry: npt.NDArray[np.str_]
    source: npt.NDArray[np.str_]
    provenance: Provenance
    peak_strain: PeakStrain | None = None
    notices: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse numbers that no test has, wherever they come from."""
        if self.n_rows:
            check_values(self.id, {name: getattr(self, name) for name in SI_COLUMNS})

    @property
    def n_rows(self) -> int:
        """Number of tests."""
        return self.stress.size

    @property
    def sources(self) -> tuple[str, ...]:
        """Names of the sources in the order of the table."""
        return tuple(dict.fromkeys(self.source.tolist()))

    @property
    def stress_is_imposed(self) -> BoolArray:
        """Whether the rate was read, shape (n,)."""
        return np.asarray(self.imposed == "stress")

    @property
    def log_read(self) -> FloatArray:
        """Return ln(1/s) or ln(Pa) of what was read, shape (n,)."""
        return np.log(np.where(self.stress_is_imposed, self.strain_rate, self.stress))

    @property
    def enhancement_place(self) -> IntArray:
        """Which steady rate exceeds the least one: 0 none, 1 axial, 2 in shear; shape (n,)."""
        in_shear = np.isin(self.geometry, IN_SHEAR)
        return np.where(self.regime == "steady", 1 + in_shear, 0).astype(np.int64)

    @property
    def mean_conditions(self) -> Conditions:
        """Means in which a power law is linear: of 1/T, ln(stress) and ln(grain size)."""
        known = self.grain_size[np.isfinite(self.grain_size)]
        return Conditions(
            temperature=float(1 / np.mean(1 / self.temperature)),
            stress=float(np.exp(np.mean(np.log(self.stress)))),
            grain_size=float(np.exp(np.mean(np.log(known)))) if known.size else float("nan"),
        )

    @property
    def mean_strain_rate(self) -> float:
        """Geometric mean (1/s)."""
        return float(np.exp(np.mean(np.log(self.strain_rate))))

    @property
    def tests(self) -> tuple[PeakTest, ...]:
        """The tests one by one."""
        columns = (self.strain_rate, self.stress, self.temperature, self.grain_size)
        return tuple(PeakTest(*map(float, row)) for row in zip(*columns, strict=True))

    def rows(self, chosen: npt.ArrayLike) -> "RateTable":
        """Return the table of some rows, by mask or position.

        Examples
        --------
        >>> cold = rates.rows(rates.temperature < 250)
        """
        return replace(
            self, **{name: getattr(self, name)[np.asarray(chosen)] for name in (*NUMBERS, *LABELS)}
        )


def number_of_copies(numbers: Mapping[str, FloatArray]) -> int:
    """Return how many rows have all numbers, each (n,), of a row before; unknown ones are alike."""
    return int(pd.DataFrame(numbers).duplicated().sum())


def joined(
    tables: Sequence[RateTable], held_out: Collection[str] = (), *, softened: bool = False
) -> RateTable:
    """Put tables of one material under each other; raise InputError if they are of several.

    Peaks of sources that are held out do not count. If the tests are to be softened, a notice says
    where the strain of peaks that is stated is not that of all.
    """
    first = tables[0]
    if len(tables) == 1:
        return first
    for table in tables[1:]:
        if table.material != first.material:
            raise InputError(
                f"{table.id}: is of {table.material}, expected {first.material} like {first.id}."
            )
    names = [table.id for table in tables]
    if len(set(names)) < len(names):
        raise InputError(f"found the tables {', '.join(names)}, expected each of them once.")
    kinds = {table.provenance.kind for table in tables}
    notices = [notice for table in tables for notice in table.notices]
    fitted = [table for table in tables if {*table.sources} - {*held_out}]
    peak_strains = {table.peak_strain for table in fitted}
    if softened and len(peak_strains) > 1:
        stated = ", ".join(table.id for table in fitted if table.peak_strain is not None)
        notices.append(
            f"[peak_strain] of {stated} does not restrict the softening, because not all tables "
            "state the same; state one that holds for all in each of them."
        )
    arrays = {
        key: np.concatenate([getattr(table, key) for table in tables])
        for key in (*NUMBERS, *LABELS)
    }
    alone = (number_of_copies({key: getattr(one, key) for key in SI_COLUMNS}) for one in tables)
    between = number_of_copies({key: arrays[key] for key in SI_COLUMNS}) - sum(alone)
    if between:
        notices.append(
            f"{', '.join(names)}: {counted(between, 'row')} in common, each counted as often as it "
            "stands there; keep one of each."
        )
    return RateTable(
        id="rates",
        material=first.material,
        **arrays,
        provenance=Provenance(
            kind=next(kind for kind in get_args(DataKind) if kind in kinds),
            source="; ".join(table.provenance.source for table in tables),
        ),
        # Statements about the peaks of different tests say nothing about all of them.
        peak_strain=peak_strains.pop() if len(peak_strains) == 1 else None,
        notices=tuple(notices),
    )


def without_test(data: RateTable, experiment: Experiment) -> RateTable:
    """Leave out rows that may be a test, so that the table can be the prior of its curve.

    Parameters
    ----------
    data : RateTable
        The table.
    experiment : Experiment
        The test.

    Raises
    ------
    InputError
        If the test has no peak, none of the rows may be it, or fewer than three rows are left.

    Examples
    --------
    >>> peaks = pyburgers.load_rate_table(data / "ice" / "rates" / "qi_goldsby_2021.toml")
    >>> test = pyburgers.load_experiment(data / "ice" / "PIL40.toml")
    >>> pyburgers.without_test(peaks, test).n_rows
    22
    """
    test = experiment.peak
    if test is None:
        raise InputError(
            f"{experiment.id}: has no stress at a constant rate, expected a test that a table of "
            "rates can have."
        )
    kept = np.flatnonzero([not row.may_be(test) for row in data.tests])
    if kept.size == data.n_rows:
        raise InputError(f"{data.id}: no row may be {experiment.id} with {test}, expected one.")
    if kept.size < LEAST_ROWS:
        raise InputError(
            f"{data.id}: without {experiment.id} {counted(kept.size, 'row')} are left, expected "
            f"at least {LEAST_ROWS}."
        )
    return data.rows(kept)


def rows_alike(data: RateTable) -> tuple[list[tuple[Any, ...]], IntArray]:
    """Return what rows have in common, each once, and which of these each row has."""
    errors = [data.temperature_error, data.grain_size_error]
    columns = [getattr(data, name).tolist() for name in LABELS] + [one.tolist() for one in errors]
    rows = list(zip(*columns, strict=True))
    kinds = list(dict.fromkeys(rows))
    return kinds, np.array([kinds.index(row) for row in rows])


def in_order_of_tests(data: RateTable) -> RateTable:
    """Return the rows in the order in which a saved table is read back, by their [[tests]]."""
    return data.rows(np.argsort(rows_alike(data)[1], kind="stable"))


def check_values(source: str, values: Mapping[str, FloatArray]) -> None:
    """Refuse numbers that no test has, in SI units."""
    faults = list(_faults(values))
    if faults:
        raise InputError(*(f"{source}: {fault}" for fault in faults))


def _faults(values: Mapping[str, FloatArray]) -> Iterator[str]:
    for name in ("stress", "strain_rate"):
        wrong = np.flatnonzero(~(values[name] > 0))
        if wrong.size:
            yield (
                f"data row {wrong[0] + 1}: the {name.replace('_', ' ')} is "
                f"{values[name][wrong[0]]:g} in SI units, expected more than 0."
            )
    temperature, grain_size = values["temperature"], values.get("grain_size", np.full(1, np.nan))
    known = grain_size[np.isfinite(grain_size)]
    for extreme in (min, max):
        yield from impossible_conditions(
            float(extreme(temperature)),
            float(extreme(known)) if known.size else 1e-3,
            ("temperature (key 'temperature_unit' in [data] may be K or C)", "grain size"),
        )
    yield from environment_faults(values)
    error = values.get("reading_error", np.zeros(1))
    if not (np.all(error >= 0) and np.all(error < 1)):
        yield f"found a reading error of {error.max():g}, expected a fraction from 0 to 1."
