"""Columns of numbers in delimited text files."""

import csv
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import read_text

FloatArray = npt.NDArray[np.float64]
Separator = Literal[",", "whitespace"]
Column = str | int
"""Name in the header, or 1-based number in a file without header."""

COMMENT = "#"
"""Lines that start with this are skipped, like blank ones."""


def read_columns(
    path: Path,
    columns: Mapping[str, Column],
    *,
    separator: Separator,
    header: bool,
    where: str,
    file_key: str,
) -> list[FloatArray]:
    """Read columns of a delimited text file.

    Parameters
    ----------
    path : Path
        Text file, one row a line.
    columns : mapping of str to str or int
        Wanted columns by the key that names them in the experiment file.
    separator : {",", "whitespace"}
        What stands between cells.
    header : bool
        Whether the first row holds names.
    where, file_key : str
        The experiment file, and the key in it that names `path`, for messages.

    Returns
    -------
    list of array, shape (n_rows,)
        The columns in the order asked for, finite, in the file's unit.

    Raises
    ------
    InputError
        If the file is missing or has no data rows, a column is missing, or a cell is empty, not a
        number or not finite; the message names file, line and column.
    """
    rows = _rows(read_text(path, f"{where}: key {file_key}"), separator)
    names = rows.pop(0)[1] if header and rows else None
    if not rows:
        raise InputError(f"{path}: no data rows; expected at least one row of numbers.")
    found = []
    for key, column in columns.items():
        index = _index(column, names, len(rows[0][1]), f"{where}: key {key!r} in [data]", path)
        found.append(np.array([_cell(path, line, row, index, column) for line, row in rows]))
    return found


def _rows(text: str, separator: Separator) -> list[tuple[int, list[str]]]:
    """Line number (from 1) and cells of every row that is neither blank nor a comment."""
    return [
        (number, _cells(line, separator))
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith(COMMENT)
    ]


def _cells(line: str, separator: Separator) -> list[str]:
    if separator == "whitespace":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], skipinitialspace=True))]


def _index(column: Column, names: list[str] | None, n_cells: int, where: str, path: Path) -> int:
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


def _cell(path: Path, line: int, row: list[str], index: int, column: Column) -> float:
    """Return the number in one cell."""
    place = f"{path}: line {line}, column {column!r}"
    if index >= len(row):
        raise InputError(f"{place}: the row ends before this column.")
    try:
        value = float(row[index])
    except ValueError:
        found = repr(row[index]) if row[index] else "an empty cell"
        raise InputError(f"{place}: found {found}, expected a number.") from None
    if not math.isfinite(value):
        raise InputError(f"{place}: found {row[index]!r}, expected a finite number.")
    return value
