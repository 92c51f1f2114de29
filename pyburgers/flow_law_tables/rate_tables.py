"""Tables of steady rates: one row for each test, read from TOML and columns into SI.

In each row stress or strain rate was imposed and the other was read, at the minimum rate, at the
peak stress or in the steady state. Every geometry is turned to the axial equivalent.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from pyburgers.common.array_types import BoolArray, FloatArray
from pyburgers.common.columns import (
    WRITTEN_LAYOUT,
    Cell,
    Column,
    DataFile,
    TextFilesTable,
    read_columns,
    write_columns,
)
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path
from pyburgers.common.toml_files import NAME, Table, all_of, read_toml, write_toml
from pyburgers.common.units import counted
from pyburgers.kinds.conditions import unlikely_stress
from pyburgers.kinds.experiment import Provenance, impossible_conditions
from pyburgers.kinds.experiment_file import ProvenanceTable
from pyburgers.model.flow_law_prior import Conditions
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
strain rate over sqrt(3). Octahedral stress and rate are those of Nye and of the Melbourne tests.
"""

SI_COLUMNS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "temperature": ("temperature", "K"),
        "stress": ("stress", "Pa"),
        "strain_rate": ("strain rate", "1/s"),
        "grain_size": ("length", "m"),
        "reading_error": ("relative error", "1"),
    }
)
"""Columns of a table, with their quantities in `pyburgers.common.units` and SI units."""

MAY_BE_LEFT_OUT = ("grain_size", "reading_error")
"""Columns without which a table is complete."""

NUMBERS = (*SI_COLUMNS, "temperature_error", "grain_size_error")
LABELS = ("imposed", "regime", "geometry", "source")
"""Arrays of a `RateTable`."""


@dataclass(frozen=True, eq=False)
class RateTable:
    """Steady rates of one material, a test each, in SI units and axial equivalents.

    Attributes
    ----------
    id, material : str
        Name of the table; the material names the default laws.
    temperature, stress, strain_rate, grain_size : array, shape (n,)
        K, Pa, 1/s, m; the grain size is NaN if it is unknown.
    reading_error, temperature_error, grain_size_error : array, shape (n,)
        Standard deviations: of what was read, relative; K; relative. 0 if taken as exact.
    imposed, regime, geometry, source : array of str, shape (n,)
        Imposed is ``"stress"`` or ``"strain_rate"``; the regime ``"minimum"``, ``"peak"`` or
        ``"steady"``; the source a paper or a laboratory.
    provenance : Provenance
        Origin of the numbers.
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
    reading_error: FloatArray
    temperature_error: FloatArray
    grain_size_error: FloatArray
    imposed: npt.NDArray[np.str_]
    regime: npt.NDArray[np.str_]
    geometry: npt.NDArray[np.str_]
    source: npt.NDArray[np.str_]
    provenance: Provenance
    notices: tuple[str, ...] = ()

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
    def enhancement_place(self) -> npt.NDArray[np.int64]:
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


def joined(tables: Sequence[RateTable], name: str | None = None) -> RateTable:
    """Put tables of one material under each other; raise InputError if they are of several."""
    first = tables[0]
    if len(tables) == 1:
        return first if name is None else replace(first, id=name)
    for table in tables[1:]:
        if table.material != first.material:
            raise InputError(
                f"{table.id}: is of {table.material}, expected {first.material} like {first.id}."
            )
    names = [table.id for table in tables]
    if len(set(names)) < len(names):
        raise InputError(f"found the tables {', '.join(names)}, expected each of them once.")
    kinds = {table.provenance.kind for table in tables}
    return RateTable(
        id=name or "rates",
        material=first.material,
        **{
            key: np.concatenate([getattr(table, key) for table in tables])
            for key in (*NUMBERS, *LABELS)
        },
        provenance=Provenance(
            kind="synthetic" if "synthetic" in kinds else first.provenance.kind,
            source="; ".join(table.provenance.source for table in tables),
        ),
        notices=tuple(notice for table in tables for notice in table.notices),
    )


class _DataTable(TextFilesTable):
    file: DataFile = Field(description="the data file, or the columns")
    temperature_column: Column
    temperature_unit: str = Field(description="K or C")
    stress_column: Column
    stress_unit: str = Field(description="Pa, MPa or GPa")
    strain_rate_column: Column
    strain_rate_unit: str = Field(description="1/s or 1e-6/s")
    grain_size_column: Column | None = None
    grain_size_unit: str | None = Field(None, description="m, mm or um")
    reading_error_column: Column | None = None
    reading_error_unit: str | None = Field(None, description="1 or percent of the reading")


class _TestsTable(Table):
    rows: dict[str, Cell] = Field(
        default_factory=dict, description="the rows that are meant: cells by column; default all"
    )
    imposed: Imposed = Field(description="stress or strain_rate; the other was read")
    regime: Regime = Field(description="minimum (of the rate), peak (of the stress) or steady")
    geometry: Geometry = Field(description="compression, tension, shear or torsion")
    measure: Measure = Field(
        "applied",
        description="what stress and rate are: applied, octahedral, or axial equivalents",
    )
    source: str | None = Field(
        None, pattern=NAME, description="the paper or laboratory; default the table's id"
    )
    reading_error: float | None = Field(
        None, ge=0, lt=1, description="relative error of what was read"
    )
    temperature_error_K: float = Field(  # noqa: N815 (the key of the file, K for kelvin)
        0.0, ge=0, lt=50, description="the standard deviation of temperatures in kelvin"
    )
    grain_size_error: float = Field(0.0, ge=0, lt=1, description="relative error of grain sizes")


class _RateFile(Table):
    id: str = Field(pattern=NAME, description="the table's name, part of file names")
    material: str = Field(min_length=1, description="the material, such as ice")
    protocol: Literal["rates"] = Field(description="the kind of table")
    data: _DataTable = Field(description="the table that says where the columns are")
    tests: list[_TestsTable] = Field(min_length=1, description="how the tests were made")
    provenance: ProvenanceTable = Field(description="the table that says where data come from")


def load_rate_table(source: str | Path | Mapping[str, Any]) -> RateTable:
    """Read and check a table of steady rates.

    Parameters
    ----------
    source : str, Path or mapping
        A TOML file, or what it holds; key ``file`` of ``data`` may be the columns themselves, such
        as a DataFrame as ``dict(frame)``.

    Raises
    ------
    InputError
        If a file, key, unit or number is wrong, or there are fewer than three rows. Every row
        belongs to exactly one of the tables ``[[tests]]``.

    Examples
    --------
    >>> rates = pyburgers.load_rate_table(data / "ice" / "rates" / "fan_2020.toml")
    """
    given = None if isinstance(source, str | Path) else source
    path = Path("table") if isinstance(source, Mapping) else given_path(source)
    file = read_toml(path, _RateFile, given)
    file.data.check_pairs(path, *MAY_BE_LEFT_OUT)
    for tests in file.tests:
        if tests.reading_error is not None and file.data.reading_error_column is not None:
            raise InputError(
                f"{path}: found 'reading_error' in [[tests]] and 'reading_error_column' in [data], "
                "expected one of them."
            )
    whole, notes = _numbers(path, file.data)
    parts = all_of(*(partial(_part, path, file, tests) for tests in file.tests))
    _check_parts(path, whole, parts)
    values = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    n_rows = values["stress"].size
    if n_rows < LEAST_ROWS:
        raise InputError(f"{path}: found {n_rows} rows, expected at least {LEAST_ROWS}.")
    return RateTable(
        id=file.id,
        material=file.material,
        **values,
        provenance=Provenance(**file.provenance.model_dump()),
        notices=(*notes, *unlikely_stress(file.material, float(values["stress"].max()))),
    )


def _alike(data: RateTable) -> tuple[list[tuple[Any, ...]], npt.NDArray[np.int64]]:
    """Return what rows have in common, each once, and which of these each row has."""
    errors = [data.temperature_error, data.grain_size_error]
    columns = [getattr(data, name).tolist() for name in LABELS] + [one.tolist() for one in errors]
    rows = list(zip(*columns, strict=True))
    kinds = list(dict.fromkeys(rows))
    return kinds, np.array([kinds.index(row) for row in rows])


def in_order_of_tests(data: RateTable) -> RateTable:
    """Return the rows in the order in which a saved table is read back, by their [[tests]]."""
    return data.rows(np.argsort(_alike(data)[1], kind="stable"))


def save_rate_table(data: RateTable, directory: Path) -> Path:
    """Write ``rates.toml``, which is returned, and ``rates.csv``, in axial equivalents."""
    kinds, number = _alike(data)
    columns = {name: getattr(data, name) for name in SI_COLUMNS}
    write_columns(directory / "rates.csv", {**columns, "tests": number.astype(np.float64)})
    table = {
        "id": data.id,
        "material": data.material,
        "protocol": KIND,
        "data": {
            "file": "rates.csv",
            **WRITTEN_LAYOUT,
            **{f"{name}_column": name for name in SI_COLUMNS},
            **{f"{name}_unit": unit for name, (_, unit) in SI_COLUMNS.items()},
        },
        "tests": [
            {
                "rows": {"tests": str(float(k))},
                "measure": "axial",
                **dict(zip(LABELS, one, strict=False)),
                "temperature_error_K": one[-2],
                "grain_size_error": one[-1],
            }
            for k, one in enumerate(kinds)
        ],
        "provenance": asdict(data.provenance),
    }
    target = directory / "rates.toml"
    write_toml(target, table)
    return target


def _numbers(
    path: Path, data: _DataTable, rows: Mapping[str, str] = MappingProxyType({})
) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Read the columns of some rows in SI units, and notes on them; NaN for no grain size."""
    chosen = data.model_copy(update={"rows": {**data.rows, **rows}})
    there = [
        name
        for name in SI_COLUMNS
        if name not in MAY_BE_LEFT_OUT or getattr(data, f"{name}_column") is not None
    ]
    keys = {f"{name}_column": (f"{name}_unit", SI_COLUMNS[name][0]) for name in there}
    read, notes = read_columns(path, chosen, keys, may_be_empty={"grain_size_column"})
    values = dict(zip(there, read.values(), strict=True))
    _check_values(str(data.source(path)), values)
    return values, notes


def _part(path: Path, file: _RateFile, tests: _TestsTable) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of the rows that a table [[tests]] is about."""
    values, _ = _numbers(path, file.data, tests.rows)
    n_rows = values["stress"].size
    by_geometry = "shear" if tests.geometry in IN_SHEAR else "axial"
    stress, rate = AXIAL_EQUIVALENT[by_geometry if tests.measure == "applied" else tests.measure]
    return {
        "grain_size": np.full(n_rows, np.nan),
        "reading_error": np.full(n_rows, tests.reading_error or 0.0),
        **values,
        "stress": stress * values["stress"],
        "strain_rate": rate * values["strain_rate"],
        "temperature_error": np.full(n_rows, tests.temperature_error_K),
        "grain_size_error": np.full(n_rows, tests.grain_size_error),
        "imposed": np.full(n_rows, tests.imposed),
        "regime": np.full(n_rows, tests.regime),
        "geometry": np.full(n_rows, tests.geometry),
        "source": np.full(n_rows, tests.source or file.id),
    }


def _check_parts(
    path: Path, whole: Mapping[str, FloatArray], parts: Sequence[Mapping[str, npt.NDArray[Any]]]
) -> None:
    """Refuse a row that no table [[tests]] is about, or several are, and contradictory ones."""
    found = sum(part["stress"].size for part in parts)
    rows = whole["stress"].size
    temperatures = np.sort(np.concatenate([part["temperature"] for part in parts]))
    if found != rows or not np.array_equal(temperatures, np.sort(whole["temperature"])):
        raise InputError(
            f"{path}: the tables [[tests]] are about {counted(found, 'row')} of {rows}, expected "
            "every row in exactly one of them; check their keys 'rows'."
        )
    for k, part in enumerate(parts, start=1):
        imposed, regime = str(part["imposed"][0]), str(part["regime"][0])
        if (imposed, regime) in (("stress", "peak"), ("strain_rate", "minimum")):
            expected = "minimum or steady" if imposed == "stress" else "peak or steady"
            raise InputError(
                f"{path}: [[tests]] {k}: key 'regime': found {regime!r} of tests at imposed "
                f"{imposed.replace('_', ' ')}, expected {expected}."
            )


def _check_values(source: str, values: Mapping[str, FloatArray]) -> None:
    """Refuse numbers that no test has, in SI units."""
    faults = list(_faults(values))
    if faults:
        raise InputError(*(f"{source}: {fault}" for fault in faults))


def _faults(values: Mapping[str, FloatArray]) -> Iterator[str]:
    for name in ("stress", "strain_rate"):
        wrong = np.flatnonzero(values[name] <= 0)
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
    error = values.get("reading_error", np.zeros(1))
    if not (np.all(error >= 0) and np.all(error < 1)):
        yield f"found a reading error of {error.max():g}, expected a fraction from 0 to 1."
