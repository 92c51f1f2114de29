"""Columns of numbers in text files, as a TOML file beside them describes them; in SI units."""

import csv
import math
import os
import re
from collections.abc import Container, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field, PlainValidator
from pydantic_core import PydanticCustomError

from pyburgers.common.atomic_files import write_text
from pyburgers.common.errors import InputError, all_of
from pyburgers.common.paths import given_path
from pyburgers.common.toml_files import Table, factor_to_si, read_text

FloatArray = npt.NDArray[np.float64]
Separator = Literal[",", "tab", "whitespace"]

DATA_ROOT_VARIABLE = "PYBURGERS_DATA"
"""Environment variable that takes the place of the key `data_root`."""

LARGEST = 1e100
"""Size of a number in SI from which on squares and products of readings may not be numbers."""

NAMED_CELLS = 3
"""Cells of a column that are named where they hold no numbers."""

COMMENT = "#"
"""Lines that start with this are skipped, like blank ones."""


def _checked_column(found: object) -> str | int:
    if isinstance(found, bool) or not isinstance(found, str | int):
        raise PydanticCustomError(
            "column", "a column name, or a number from 1 for files without header"
        )
    return found


Column = Annotated[
    str | int,
    PlainValidator(_checked_column),
    Field(description="a column name, or number without header"),
]
"""Name in the header, or 1-based number in a file without header."""


def _checked_cell(found: object) -> str:
    if isinstance(found, bool) or not isinstance(found, str | int):
        raise PydanticCustomError("cell", "text, or a whole number")
    return str(found)


Cell = Annotated[str, PlainValidator(_checked_cell), Field(description="what the column holds")]
"""Contents of a cell as they stand in the text file; a whole number stands for its digits."""


class TextFilesTable(Table):
    """What a table [data] says about its text files; a derived one has the keys of columns."""

    data_root: str | None = Field(
        None, description="the folder, relative to this file, in which data files lie"
    )
    separator: Separator = Field(",", description="what stands between the columns")
    header: bool = Field(True, description="whether the first row of a data file holds names")
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

    @property
    def selection(self) -> str:
        """Words about the rows that are taken, to follow the name of a file; empty for all."""
        return "".join(f", {name} {value}" for name, value in self.rows.items())


def read_columns(
    source: Path,
    data: TextFilesTable,
    columns: Mapping[str, tuple[str, str] | None],
    *,
    where: Path,
    file_key: str,
    may_be_empty: Container[str] = (),
) -> list[FloatArray]:
    """Read columns of a delimited text file.

    Parameters
    ----------
    source : Path
        Text file, one row a line.
    data : TextFilesTable
        The table [data] that describes it and says which of its rows are wanted.
    columns : mapping
        Keys of `data` that name the wanted columns, each with the key that names its unit and the
        quantity (a key of `pyburgers.common.units.UNITS`), or with None where it has no unit.
    where : Path
        The TOML file, for messages.
    file_key : str
        The key in it that names `source`, for messages.
    may_be_empty : container of str
        Those of `columns` whose cells may be empty.

    Returns
    -------
    list of array, shape (n_rows,)
        The columns in the order asked for, in SI, finite but for NaN in empty cells.

    Raises
    ------
    InputError
        If a unit is not one of its quantity, the file is missing or has no data rows, a column is
        missing, no row is one of those wanted, or a cell is empty, not a number, not finite or
        larger than `LARGEST`; the message names file, line and column.
    """
    factors, found = all_of(
        lambda: all_of(*(partial(_factor, data, unit, where) for unit in columns.values())),
        lambda: _numbers(source, data, columns, where, file_key, may_be_empty),
    )
    with np.errstate(over="ignore"):
        scaled = [values * factor for values, factor in zip(found, factors, strict=True)]
    for key, values in zip(columns, scaled, strict=True):
        if (np.abs(values) > LARGEST).any():
            raise InputError(
                f"{source}: column {getattr(data, key)!r} holds a number that is too large, "
                f"expected at most {LARGEST:g} in SI."
            )
    return scaled


def _numbers(
    source: Path,
    data: TextFilesTable,
    columns: Iterable[str],
    where: Path,
    file_key: str,
    may_be_empty: Container[str],
) -> list[FloatArray]:
    """Read columns of the rows that are wanted, in the units of the file."""
    rows = _rows(source, read_text(source, f"{where}: key {file_key}"), data.separator)
    names = rows.pop(0)[1] if data.header and rows else None
    if not rows:
        raise InputError(f"{source}: no data rows; expected at least one row of numbers.")
    if names is not None and data.separator == "whitespace":
        names = names_between_blanks(" ".join(names), len(rows[0][1]))
    for name, value in data.rows.items():
        rows = _selected(rows, names, name, value, f"{where}: key 'rows'", source)

    def numbers(key: str) -> FloatArray:
        column = getattr(data, key)
        index = _index(column, names, len(rows[0][1]), f"{where}: key {key!r} in [data]", source)
        return _column(source, rows, index, column, key in may_be_empty)

    return all_of(*(partial(numbers, key) for key in columns))


def _factor(data: TextFilesTable, unit: tuple[str, str] | None, where: Path) -> float:
    """Return what turns a column into SI."""
    if unit is None:
        return 1.0
    key, quantity = unit
    return factor_to_si(getattr(data, key), quantity, f"{where}: key {key!r} in [data]")


def write_columns(path: Path, columns: Mapping[str, Sequence[float] | FloatArray]) -> None:
    """Write columns with a header, separated by commas, that read back to the same numbers.

    The cells of NaN are empty.
    """
    rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join(map(_written, row)) for row in rows)]
    write_text(path, "\n".join(lines) + "\n")


def _written(number: float) -> str:
    return "" if math.isnan(number) else repr(number)


def _rows(path: Path, text: str, separator: Separator) -> list[tuple[int, list[str]]]:
    """Line number (from 1) and cells of every row that is neither blank nor a comment."""
    found = []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith(COMMENT):
            try:
                found.append((number, _cells(line, separator)))
            except csv.Error as error:
                raise InputError(f"{path}: line {number}: is no row of cells ({error}).") from None
    return found


def _cells(line: str, separator: Separator) -> list[str]:
    if separator == "whitespace":
        return line.split()
    delimiter = "\t" if separator == "tab" else separator
    row = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    return [cell.strip() for cell in row]


def names_between_blanks(line: str, n_columns: int) -> list[str]:
    """Return the names in a line with white space between them.

    A unit in brackets belongs to the name before it where there are as many columns only then:
    ``Strain (%)  Stress (MPa)`` are two names.

    Parameters
    ----------
    line : str
        The line.
    n_columns : int
        How many columns the rows below have.
    """
    words = line.split()
    if len(words) == n_columns:
        return words
    names = re.findall(r"\S+(?: [(\[][^)\]]*[)\]])?", " ".join(words))
    return names if len(names) == n_columns else words


def _selected(
    rows: list[tuple[int, list[str]]],
    names: list[str] | None,
    name: str,
    value: str,
    where: str,
    path: Path,
) -> list[tuple[int, list[str]]]:
    """Rows whose cell in the column `name` is `value`."""
    if names is None:
        raise InputError(f"{where}: found column {name!r}, expected none: {path} has no header.")
    index = _index(name, names, len(names), where, path)
    found = [row[index] if index < len(row) else "" for _, row in rows]
    chosen = [row for row, cell in zip(rows, found, strict=True) if cell == value]
    if not chosen:
        raise InputError(
            f"{where}: found {value!r} for column {name!r}, expected one that {path} holds: "
            f"{', '.join(dict.fromkeys(found))}."
        )
    return chosen


def _index(column: str | int, names: list[str] | None, n_cells: int, where: str, path: Path) -> int:
    """Position of a column, from 0."""
    if names is not None:
        if names.count(str(column)) == 1:
            return names.index(str(column))
        problem = "is not in" if str(column) not in names else "occurs more than once in"
        raise InputError(
            f"{where}: column {column!r} {problem} {path}, whose columns are {', '.join(names)}."
        )
    if isinstance(column, str) or not 1 <= column <= n_cells:
        raise InputError(
            f"{where}: found {column!r}, expected a column number from 1 to {n_cells}, "
            f"because {path} has no header."
        )
    return column - 1


def _column(
    path: Path,
    rows: Sequence[tuple[int, list[str]]],
    index: int,
    column: str | int,
    may_be_empty: bool,
) -> FloatArray:
    """Return the numbers in one column; of many bad cells the first ones are named."""
    values, sentences = [], list[str]()
    for line, row in rows:
        try:
            values.append(_cell(path, line, row, index, column, may_be_empty))
        except InputError as error:
            sentences += error.sentences
    if len(sentences) > NAMED_CELLS:
        more = len(sentences) - NAMED_CELLS
        sentences = [
            *sentences[:NAMED_CELLS],
            f"{path}: column {column!r}: {more} more cells are not numbers either.",
        ]
    if sentences:
        raise InputError(*sentences)
    return np.array(values)


def _cell(
    path: Path, line: int, row: list[str], index: int, column: str | int, may_be_empty: bool
) -> float:
    """Return the number in one cell, NaN for one that is empty and may be."""
    place = f"{path}: line {line}, column {column!r}"
    if index >= len(row):
        raise InputError(f"{place}: the row ends before this column.")
    if may_be_empty and not row[index]:
        return math.nan
    try:
        value = float(row[index])
    except ValueError:
        found = repr(row[index]) if row[index] else "an empty cell"
        raise InputError(f"{place}: found {found}, expected a number.") from None
    if not math.isfinite(value):
        raise InputError(f"{place}: found {row[index]!r}, expected a finite number.")
    return value
