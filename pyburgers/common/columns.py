"""Columns of numbers in text files: read in SI units as a TOML file describes them."""

import math
import os
import re
from collections.abc import Container, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, LiteralString

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, Field, PlainValidator
from pydantic_core import PydanticCustomError

from pyburgers.common.array_types import BoolArray, FloatArray
from pyburgers.common.cells import number_in
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path
from pyburgers.common.tables_in_files import table_in
from pyburgers.common.text_tables import TextTable, table_of_columns
from pyburgers.common.toml_files import Table, all_of, factor_to_si, is_file_of_user, unit_of
from pyburgers.common.units import Unit, counted

Separator = Literal[",", ";", "tab", "whitespace"]

SEPARATORS = {"tab": "\t", "whitespace": " "}
"""What separators are that files name by words."""

DATA_ROOT_VARIABLE = "PYBURGERS_DATA"
"""Environment variable that takes the place of the key `data_root`."""

TABLE_ENDINGS = (".csv", ".tsv", ".txt", ".dat", ".asc", ".xlsx", ".xls")
"""Endings of files of tables."""

MAX_SI_NUMBER = 1e100
"""Size of a number in SI from which on squares and products of readings may not be numbers."""

MIN_SI_NUMBER = 1e-50
"""The largest number of a column is at least this, or 0: squares of less vanish."""

INFINITE = re.compile(r"[+-]?(?:inf(?:inity)?|[0-9.]+e[+-]?[0-9]+|nan)", re.IGNORECASE)
"""Cells that are numbers to Python, but not finite ones."""

MARKED = re.compile(r"[+-]?[0-9]+(?:[.,'_ \u00a0\u202f][0-9]+)+")
"""Cells of digits with more marks between them than a decimal point."""

LIMIT = re.compile(r"[<>≤≥].*")
"""Cells that limit a quantity."""

MAX_NAMED_CELLS = 3
"""Cells of a column that are named where they hold no numbers."""


def _text_or(kind: type, name: LiteralString, expected: LiteralString) -> PlainValidator:
    """Return what refuses all but texts and things of another kind."""

    def checked(found: object) -> object:
        if isinstance(found, bool) or not isinstance(found, (str, kind)):
            raise PydanticCustomError(name, expected)
        return found

    return PlainValidator(checked)


Column = Annotated[
    str | int,
    _text_or(int, "column", "a column name, or a number from 1 for files without header"),
    Field(description="a column name, or number without header"),
]
"""Name in the header, or 1-based number in a file without header."""

DataFile = Annotated[
    str | Mapping[str, Any], _text_or(Mapping, "file", "a valid string, or a table of columns")
]
"""Name of a data file, or the columns themselves: arrays by name, all of one length."""

Cell = Annotated[
    str,
    _text_or(int, "cell", "text, or a whole number"),
    AfterValidator(str),
    Field(description="what the column holds"),
]
"""Contents of a cell as they stand in the text file; a whole number stands for its digits."""


class TextFilesTable(Table):
    """What a table [data] says about its text files; a derived one has the keys of columns."""

    data_root: str | None = Field(
        None, description="the folder, relative to this file, in which data files lie"
    )
    separator: Separator | None = Field(
        None, description="what stands between the columns; default as the file looks"
    )
    header: bool | None = Field(
        None, description="whether a data file has names above its rows; default as it looks"
    )
    missing: list[Cell] | None = Field(
        None, description="cells that stand for no reading; default such as NaN and -9999"
    )
    rows: dict[str, Cell] = Field(
        default_factory=dict, description="the rows to take: what they hold in columns of this name"
    )

    def folder(self, path: Path) -> Path:
        """Return the folder from which names of data files start; `path` is the TOML file's."""
        if self.data_root is None:
            return path.parent
        override = os.environ.get(DATA_ROOT_VARIABLE)
        if not override:
            return path.parent / self.data_root
        return given_path(override)

    def source(self, path: Path, key: str = "file") -> Path:
        """Return what messages name as the source of columns: a data file, or `path` itself."""
        file = getattr(self, key)
        return self.folder(path) / file if isinstance(file, str) else path

    def in_si(self, key: str, unit_key: str, quantity: str, path: Path) -> float | None:
        """Return a number of the table in SI, None where none is given; `path` is the TOML file."""
        number = getattr(self, key)
        if number is None:
            return None
        where = f"{path}: key {unit_key!r} in [data]"
        return float(number) * factor_to_si(getattr(self, unit_key), quantity, where)

    def check_pairs(self, path: Path, *quantities: str) -> None:
        """Refuse a column of a quantity without its unit, and a unit without its column."""
        for quantity in quantities:
            column, unit = f"{quantity}_column", f"{quantity}_unit"
            if (getattr(self, column) is None) != (getattr(self, unit) is None):
                raise InputError(
                    f"{path}: [data] needs both or neither of the keys {column!r} and {unit!r}."
                )

    @property
    def selection(self) -> str:
        """Words about the rows that are taken, to follow the name of a file; empty for all."""
        return "".join(f", {name} {value}" for name, value in self.rows.items())


def read_columns(
    path: Path,
    data: TextFilesTable,
    columns: Mapping[str, tuple[str, str] | None],
    *,
    key: str = "file",
    named_in: str = "[data]",
    may_be_empty: Container[str] = (),
    has_own_clock: bool = True,
) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Read columns of a text file, of a workbook, or of a table in memory.

    `key`, `named_in`: of `data`, which names the data file; the table of the TOML file with that
        key. `columns`: keys of `data` that name the columns, each with the key of its unit and its
        quantity, or None. A row without a reading in a column that may not be empty is left out
        with a note. Return `columns` (n_rows,) in SI, finite but for NaN in empty cells, and
        `notes`. Raise InputError, which names file, line and column, of anything else.
    """
    with _kept_to_itself(path, data, key):
        units, (found, notes) = all_of(
            lambda: all_of(*(partial(_unit, data, unit, path) for unit in columns.values())),
            lambda: _numbers(path, data, columns, key, named_in, may_be_empty, has_own_clock),
        )
    with np.errstate(over="ignore"):
        scaled = {
            column: unit.zero + unit.factor * values
            for column, values, unit in zip(columns, found, units, strict=True)
        }
    for column, values in scaled.items():
        if (np.abs(values) > MAX_SI_NUMBER).any():
            raise InputError(
                f"{data.source(path, key)}: column {getattr(data, column)!r} holds a number that "
                f"is too large, expected at most {MAX_SI_NUMBER:g} in SI."
            )
        largest = float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))
        if 0.0 < largest < MIN_SI_NUMBER:
            raise InputError(
                f"{data.source(path, key)}: column {getattr(data, column)!r} holds no number above "
                f"{largest:g} in SI, expected one of at least {MIN_SI_NUMBER:g}; check its unit."
            )
    return scaled, notes


def may_be_quoted(file: Path, path: Path) -> bool:
    """Tell whether `file` lies beside the TOML file `path`, or below, or is named as a table is."""
    inside = file.resolve().is_relative_to(path.resolve().parent)
    return inside or file.suffix.lower() in TABLE_ENDINGS


@contextmanager
def _kept_to_itself(path: Path, data: TextFilesTable, key: str) -> Iterator[None]:
    """Quote no content of a file that may be no table, which an experiment file of others names."""
    try:
        yield
    except InputError:
        file = data.source(path, key)
        if may_be_quoted(file, path) or not is_file_of_user(file):
            raise
        raise InputError(
            f"{path}: key {key!r}: {file} has no such table; its content is not shown, because it "
            f"lies outside the folder of {path.name}: expected a file there, or one that ends in "
            f"{', '.join(TABLE_ENDINGS)}."
        ) from None


def _table(path: Path, data: TextFilesTable, key: str, named_in: str) -> TextTable:
    """Return the table that holds the columns, from a file or from memory."""
    file = getattr(data, key)
    if not isinstance(file, str):
        return table_of_columns(path, file, data.missing)
    return table_in(
        data.source(path, key),
        None if data.separator is None else SEPARATORS.get(data.separator, data.separator),
        header=data.header,
        missing=data.missing,
        where=f"{path}: key {key!r} in {named_in}",
    )


def _numbers(
    where: Path,
    data: TextFilesTable,
    columns: Mapping[str, tuple[str, str] | None],
    file_key: str,
    named_in: str,
    may_be_empty: Container[str],
    has_own_clock: bool,
) -> tuple[list[FloatArray], tuple[str, ...]]:
    """Read columns of the rows that are wanted, in the units of the file."""
    table, source = _table(where, data, file_key, named_in), data.source(where, file_key)
    if table.problems:
        raise InputError(*table.problems)
    if not table.rows:
        raise InputError(f"{source}: no data rows; expected at least one row of numbers.")
    wanted = np.ones(len(table.rows), dtype=np.bool_)
    for name, value in data.rows.items():
        wanted &= _selected(table, wanted, name, value, f"{where}: key 'rows'")
    chosen = np.flatnonzero(wanted)

    def numbers(key: str) -> FloatArray:
        column = getattr(data, key)
        place = f"{where}: key {key!r} in [data]"
        index = _index(column, table, place)
        unit = columns[key]
        is_stamps = table.is_time_stamps(table.columns[index])
        if unit is not None and (is_stamps or column in table.elapsed):
            what = "time stamps" if is_stamps else "elapsed times"
            _check_seconds(table, f"{column!r}, which holds {what}", unit, data, where)
            if is_stamps and not has_own_clock:
                raise InputError(
                    f"{source}: column {column!r} holds time stamps, expected times in seconds, "
                    "because another file counts from the same moment."
                )
        return _column(table, index, chosen, column, key in may_be_empty)

    found = all_of(*(partial(numbers, key) for key in columns))
    needed = [values for key, values in zip(columns, found, strict=True) if key not in may_be_empty]
    without = np.isnan(needed).any(axis=0) if needed else np.zeros(chosen.size, dtype=np.bool_)
    if without.all():
        raise InputError(
            f"{source}: found no row with a number in each of the columns "
            f"{', '.join(repr(getattr(data, key)) for key in columns)}, expected at least one."
        )
    notes = table.notes_on({_index(getattr(data, key), table, "") for key in columns})
    if without.any():
        lines = [str(table.rows[k][0]) for k in chosen[without]]
        more = f" and {len(lines) - MAX_NAMED_CELLS} more" if len(lines) > MAX_NAMED_CELLS else ""
        notes = (
            *notes,
            f"{source.name}: {counted(len(lines), 'row')} left out, where a column that is read "
            f"holds no reading ({table.row_name} {', '.join(lines[:MAX_NAMED_CELLS])}{more}).",
        )
    return [values[~without] for values in found], notes


def _check_seconds(
    table: TextTable, found: str, unit: tuple[str, str], data: TextFilesTable, where: Path
) -> None:
    """Refuse another unit than s of time stamps and of elapsed times, which have their own."""
    key, quantity = unit
    stated = getattr(data, key)
    if quantity != "time" or stated != "s":
        raise InputError(
            f"{where}: key {key!r} in [data]: found {stated!r} for column {found}, expected 's' of "
            f"a time: they are read as seconds ({table.path})."
        )


def _unit(data: TextFilesTable, unit: tuple[str, str] | None, where: Path) -> Unit:
    """Return the unit of a column."""
    if unit is None:
        return Unit()
    key, quantity = unit
    return unit_of(getattr(data, key), quantity, f"{where}: key {key!r} in [data]")


def _selected(table: TextTable, wanted: BoolArray, name: str, value: str, where: str) -> BoolArray:
    """Return which rows hold `value` in the column `name`; one of those that are wanted has to."""
    if table.names is None:
        raise InputError(
            f"{where}: found column {name!r}, expected none: {table.path} has no header."
        )
    index = _index(name, table, where)
    found = [row[index] if index < len(row) else "" for _, row in table.rows]
    chosen = np.array([cell == value for cell in found])
    if not (chosen & wanted).any():
        there = dict.fromkeys(
            cell for cell, is_wanted in zip(found, wanted, strict=True) if is_wanted
        )
        raise InputError(
            f"{where}: found {value!r} for column {name!r}, expected one that {table.path} holds: "
            f"{', '.join(there)}."
        )
    return chosen


def _index(column: str | int, table: TextTable, where: str) -> int:
    """Position of a column, from 0."""
    names, path = table.names, table.path
    if names is not None:
        if names.count(str(column)) == 1:
            return names.index(str(column))
        problem, remedy = "is not in", ""
        if str(column) in names:
            problem, remedy = "occurs more than once in", "; rename all of them but one"
        raise InputError(
            f"{where}: column {column!r} {problem} {path}, whose columns are {', '.join(names)}"
            f"{remedy}."
        )
    n_cells = len(table.columns)
    if isinstance(column, str) or not 1 <= column <= n_cells:
        raise InputError(
            f"{where}: found {column!r}, expected a column number from 1 to {n_cells}, "
            f"because {path} has no header."
        )
    return column - 1


def _column(
    table: TextTable,
    index: int,
    chosen: npt.NDArray[np.intp],
    column: str | int,
    may_be_empty: bool,
) -> FloatArray:
    """Return the numbers in a column, NaN for no reading; raise InputError of bad cells."""
    cells = table.cleaned(index)
    words = [*filter(None, ("NaN",) if table.missing is None else table.missing)]
    instead = "".join(f", or {word} to leave the row out" for word in words[:1])
    values, sentences = [], list[str]()
    for k in chosen:
        line, row = table.rows[k]
        value = math.nan if not cells[k] else number_in(cells[k])
        fault = None
        if index >= len(row):
            fault = "the row ends before this column"
        elif not row[index] and not may_be_empty and not table.is_in_memory:
            fault = f"found an empty cell, expected a number{instead}"
        elif value is None:
            finite = "finite " if INFINITE.fullmatch(cells[k]) else ""
            marks = " without thousands separators" if MARKED.fullmatch(cells[k]) else ""
            limit = ": a limit is no reading, leave its row out" * bool(LIMIT.match(cells[k]))
            fault = f"found {cells[k]!r}, expected a {finite}number{marks}{limit}"
        if fault is not None:
            sentences.append(f"{table.path}: {table.row_name} {line}, column {column!r}: {fault}.")
        values.append(math.nan if value is None else value)
    if len(sentences) > MAX_NAMED_CELLS:
        more = len(sentences) - MAX_NAMED_CELLS
        sentences = [
            *sentences[:MAX_NAMED_CELLS],
            f"{table.path}: column {column!r}: {more} more cells are not numbers either.",
        ]
    if sentences:
        raise InputError(*sentences)
    return np.array(values)
