"""Tables of rates in files: a TOML file beside a text file of columns, read into SI and written."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from pyburgers.common.array_types import FloatArray
from pyburgers.common.columns import Cell, Column, DataFile, TextFilesTable, read_columns
from pyburgers.common.csv_tables import WRITTEN_LAYOUT, write_columns
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path
from pyburgers.common.toml_files import (
    NAME,
    Material,
    Table,
    all_of,
    checked,
    read_tables,
    write_toml,
)
from pyburgers.common.units import counted, units_text
from pyburgers.flow_law_tables.tables import (
    AXIAL_EQUIVALENT,
    IN_SHEAR,
    KIND,
    LABELS,
    LEAST_ROWS,
    MAY_BE_EMPTY,
    MAY_BE_LEFT_OUT,
    SI_COLUMNS,
    Geometry,
    Imposed,
    Measure,
    PeakStrain,
    RateTable,
    Regime,
    check_values,
    number_of_copies,
    rows_alike,
)
from pyburgers.kinds.column_names import plain
from pyburgers.kinds.conditions import (
    unlikely_grain_size,
    unlikely_pressure,
    unlikely_stress,
    unlikely_temperature,
)
from pyburgers.kinds.contradicted_names import contradicted_unit
from pyburgers.kinds.experiment import Provenance
from pyburgers.kinds.experiment_file import ProvenanceTable
from pyburgers.kinds.limits import unlikely_strain_rate
from pyburgers.model.parameters import ENVIRONMENT


class _DataTable(TextFilesTable):
    file: DataFile = Field(description="the data file, or the columns")
    temperature_column: Column
    temperature_unit: str = Field(description=units_text("temperature"))
    stress_column: Column
    stress_unit: str = Field(description=units_text("stress"))
    strain_rate_column: Column
    strain_rate_unit: str = Field(description=units_text("strain rate"))
    grain_size_column: Column | None = None
    grain_size_unit: str | None = Field(None, description=units_text("length"))
    pressure_column: Column | None = None
    pressure_unit: str | None = Field(None, description=units_text("stress"))
    water_fugacity_column: Column | None = None
    water_fugacity_unit: str | None = Field(None, description=units_text("stress"))
    melt_fraction_column: Column | None = None
    melt_fraction_unit: str | None = Field(None, description=units_text("strain"))
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
        description="what stress and rate are: applied (in shear and torsion the shear stress, at "
        "the outer radius (3 + 1/n) M/(2 pi R^3), and the engineering rate, twice that of a "
        "tensor), octahedral, or axial equivalents",
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


class _PeakStrainTable(Table):
    mean: float = Field(gt=0, lt=1, description="mean strain of the peaks, a fraction")
    sd: float = Field(gt=0, lt=1, description="standard deviation of what is known of the mean")


class _RateFile(Table):
    id: str = Field(pattern=NAME, description="the table's name, part of file names")
    material: Material
    protocol: Literal["rates"] = Field(description="the kind of table")
    data: _DataTable = Field(description="the table that says where the columns are")
    tests: list[_TestsTable] = Field(min_length=1, description="how the tests were made")
    peak_strain: _PeakStrainTable | None = Field(
        None, description="at which strain the tests peak, where it was read"
    )
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
    path = Path("table") if isinstance(source, Mapping) else given_path(source)
    content = source if isinstance(source, Mapping) else read_tables(path)
    # Of a file of another kind none of the keys that it lacks is worth a word.
    if content.get("protocol", KIND) != KIND:
        raise InputError(
            f"{path}: key 'protocol': found {content['protocol']!r}, expected {KIND!r}. In a "
            'table of peak stresses each of [[tests]] has imposed = "strain_rate" and '
            'regime = "peak".'
        )
    file = checked(path, content, _RateFile)
    file.data.check_pairs(path, *MAY_BE_LEFT_OUT)
    for k, tests in enumerate(file.tests, start=1):
        for column in tests.rows.keys() & file.data.rows.keys():
            taken, found = file.data.rows[column], tests.rows[column]
            if found != taken:
                raise InputError(
                    f"{path}: [[tests]] {k}: key 'rows': found {found!r} for column {column!r}, "
                    f"expected {taken!r}, the rows that [data] takes by its own key 'rows'; remove "
                    f"{column!r} from one of both keys."
                )
        if tests.reading_error is not None and file.data.reading_error_column is not None:
            raise InputError(
                f"{path}: found 'reading_error' in [[tests]] and 'reading_error_column' in [data], "
                "expected one of them."
            )
    whole, notes = _numbers(path, file.data)
    read = all_of(*(partial(_numbers, path, file.data, tests.rows) for tests in file.tests))
    _check_parts(path, whole, [values for values, _ in read], file.tests)
    parts = [
        _part(file, tests, values) for tests, (values, _) in zip(file.tests, read, strict=True)
    ]
    values = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    n_rows = values["stress"].size
    if n_rows < LEAST_ROWS:
        raise InputError(f"{path}: found {n_rows} rows, expected at least {LEAST_ROWS}.")
    peak = file.peak_strain
    return RateTable(
        id=file.id,
        material=file.material,
        **values,
        provenance=Provenance(**file.provenance.model_dump()),
        peak_strain=None if peak is None else PeakStrain(peak.mean, peak.sd),
        notices=(
            *notes,
            *_contradicted_names(file.data),
            *(f"{file.id}: {one}" for one in _doubts(file.material, values)),
        ),
    )


def _contradicted_names(data: _DataTable) -> Iterator[str]:
    """Say where names of columns in memory say other units; of files, commands say so."""
    for name, (kind, _) in SI_COLUMNS.items():
        column = getattr(data, f"{name}_column")
        if isinstance(data.file, Mapping) and column is not None:
            unit = getattr(data, f"{name}_unit")
            yield from contradicted_unit(column, plain(str(column)), kind, unit)


def _doubts(material: str, values: Mapping[str, FloatArray]) -> Iterator[str]:
    """Say which numbers are unlikely."""
    warmth = values["temperature"]
    yield from unlikely_grain_size(values["grain_size"])
    yield from unlikely_temperature(material, float(warmth.min()), float(warmth.max()))
    yield from unlikely_pressure(values["pressure"])
    yield from unlikely_stress(material, float(values["stress"].max()))
    yield from unlikely_strain_rate(float(values["strain_rate"].max()))
    copies = number_of_copies(values)
    if copies:
        yield (
            f"{counted(copies, 'row')} with the numbers of a row before, each counted as a test of "
            "its own; remove what is a copy."
        )


def save_rate_table(data: RateTable, directory: Path) -> Path:
    """Write ``rates.toml``, which is returned, and ``rates.csv``, in axial equivalents."""
    kinds, number = rows_alike(data)
    columns = {
        name: getattr(data, name)
        for name in SI_COLUMNS
        if name not in ENVIRONMENT or np.isfinite(getattr(data, name)).any()
    }
    write_columns(directory / "rates.csv", {**columns, "tests": number.astype(np.float64)})
    table: dict[str, Any] = {
        "id": data.id,
        "material": data.material,
        "protocol": KIND,
        "data": {
            "file": "rates.csv",
            **WRITTEN_LAYOUT,
            **{f"{name}_column": name for name in columns},
            **{f"{name}_unit": SI_COLUMNS[name][1] for name in columns},
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
        **({} if data.peak_strain is None else {"peak_strain": asdict(data.peak_strain)}),
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
    read, notes = read_columns(
        path, chosen, keys, may_be_empty={f"{name}_column" for name in MAY_BE_EMPTY}
    )
    values = dict(zip(there, read.values(), strict=True))
    check_values(str(data.source(path)), values)
    return values, notes


def _part(
    file: _RateFile, tests: _TestsTable, values: Mapping[str, FloatArray]
) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of the rows that a table [[tests]] is about."""
    n_rows = values["stress"].size
    by_geometry = "shear" if tests.geometry in IN_SHEAR else "axial"
    stress, rate = AXIAL_EQUIVALENT[by_geometry if tests.measure == "applied" else tests.measure]
    return {
        **{name: np.full(n_rows, np.nan) for name in MAY_BE_EMPTY},
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
    path: Path,
    whole: Mapping[str, FloatArray],
    parts: Sequence[Mapping[str, FloatArray]],
    tests: Sequence[_TestsTable],
) -> None:
    """Refuse a row that no table [[tests]] is about, or several are, and contradictory ones."""
    there, *taken = (
        Counter(map(tuple, np.nan_to_num([*one.values()]).T.tolist())) for one in (whole, *parts)
    )
    of_tests = sum(taken, Counter[tuple[float, ...]]())
    if of_tests != there:
        left, again = (there - of_tests).total(), sum(there[row] for row in of_tests - there)
        raise InputError(
            f"{path}: the tables [[tests]] leave out {left} of {counted(there.total(), 'row')} and "
            f"take {again} more than once, expected every row in exactly one of them; check their "
            "keys 'rows'."
        )
    for k, one in enumerate(tests, start=1):
        imposed, regime = one.imposed, one.regime
        if (imposed, regime) in (("stress", "peak"), ("strain_rate", "minimum")):
            expected = "minimum or steady" if imposed == "stress" else "peak or steady"
            raise InputError(
                f"{path}: [[tests]] {k}: key 'regime': found {regime!r} of tests at imposed "
                f"{imposed.replace('_', ' ')}, expected {expected}."
            )
