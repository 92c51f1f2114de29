"""What a text file of columns looks like, before anything is known of it: a guess, never an error.

`pyburgers.common.columns` reads such files as an experiment file describes them; this module looks
at a file that nobody has described yet, or that was described wrongly.
"""

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pyburgers.common.columns import COMMENT, names_between_blanks
from pyburgers.common.toml_files import read_text

MINUS_SIGNS = "\u2212\u2013\u2012\ufe63\uff0d"
"""Characters that look like a minus sign and are none to a reader of numbers."""

DECIMAL_COMMA = re.compile(r"^[+-]?\d+,\d+(?:[eE][+-]?\d+)?$")


@dataclass(frozen=True)
class TextTable:
    """A text file as it looks.

    Attributes
    ----------
    path : Path
        The file.
    separator : str
        Semicolon, tab or comma, or a blank for white space.
    names : tuple of str or None
        First row, where it holds no numbers.
    hidden_names : tuple of str or None
        Names in the last line ahead of the rows that is a comment, as many as there are columns.
    rows : tuple of (int, tuple of str)
        Number of the line from 1, and cells, of the rows of numbers.
    """

    path: Path
    separator: str
    names: tuple[str, ...] | None
    hidden_names: tuple[str, ...] | None
    rows: tuple[tuple[int, tuple[str, ...]], ...]

    @property
    def columns(self) -> tuple[str | int, ...]:
        """Names of the columns, or their numbers from 1."""
        n_cells = max((len(cells) for _, cells in self.rows), default=0)
        return self.names or tuple(range(1, n_cells + 1))

    @property
    def is_alike_by_blanks(self) -> bool:
        """Whether white space in place of the separator gives the same columns."""
        cells = [cell for _, row in self.rows for cell in row]
        names = () if self.names is None else self.names
        return (
            all(len(cell.split()) == 1 for cell in cells)
            and tuple(names_between_blanks(" ".join(names), len(names))) == names
        )

    def numbers(self, column: str | int) -> list[float]:
        """Return the numbers in a column, as a person reads them; without cells that hold none."""
        index = self.columns.index(column)
        cells = (cells[index] for _, cells in self.rows if index < len(cells))
        return [value for value in map(as_number, cells) if value is not None]

    def cells_like(self, looks: re.Pattern[str]) -> list[tuple[int, str]]:
        """Return lines and cells that look like something."""
        return [(line, cell) for line, cells in self.rows for cell in cells if looks.search(cell)]


ODD_MINUS = re.compile(rf"^[{MINUS_SIGNS}]\s*[\d.]")


def look_at(path: Path) -> TextTable:
    """Look at a text file.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    InputError
        If it cannot be read at all.
    """
    lines = list(enumerate(read_text(path).splitlines(), start=1))
    content = [(n, line) for n, line in lines if line.strip() and not _is_comment(line)]
    separator = _separator([line for _, line in content])
    rows = [(number, _cells(line, separator)) for number, line in content]
    names = None
    n_columns = len(rows[1 if len(rows) > 1 else 0][1]) if rows else 0
    if rows and not any(as_number(cell) is not None for cell in rows[0][1]):
        names = _header(content[0][1], separator, n_columns)
        rows.pop(0)
    hidden = None
    if names is None and rows:
        before = [line for number, line in lines if number < rows[0][0] and _is_comment(line)]
        found = _header(before[-1].lstrip().lstrip(COMMENT), separator, n_columns) if before else ()
        if len(found) == len(rows[0][1]) and not any(as_number(cell) is not None for cell in found):
            hidden = found
    return TextTable(path, separator, names, hidden, tuple(rows))


def as_number(cell: str) -> float | None:
    """Return the number that a person reads in a cell: also with a decimal comma, or an odd minus.

    None where there is none, or not a finite one.
    """
    text = re.sub(f"[{MINUS_SIGNS}]", "-", cell.strip())
    if DECIMAL_COMMA.fullmatch(text):
        text = text.replace(",", ".")
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _header(line: str, separator: str, n_columns: int) -> tuple[str, ...]:
    """Return the names in a line, as a reader of the file finds them."""
    if separator == " ":
        return tuple(names_between_blanks(line, n_columns))
    return _cells(line, separator)


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENT)


def _separator(lines: Sequence[str]) -> str:
    """Return what stands between cells: the first that every line has equally often."""
    for separator in (";", "\t", ","):
        counts = {len(_cells(line, separator)) - 1 for line in lines[:50]}
        if len(counts) == 1 and counts != {0} and not _all_decimal_commas(lines, separator):
            return separator
    return " "


def _all_decimal_commas(lines: Sequence[str], separator: str) -> bool:
    """Whether the commas of a file are in its numbers: white space stands between them."""
    if separator != ",":
        return False
    cells = [cell for line in lines[1:50] for cell in line.split()]
    return (
        bool(cells)
        and all(DECIMAL_COMMA.fullmatch(cell) for cell in cells)
        and len(lines[-1].split()) > 1
    )


def _cells(line: str, separator: str) -> tuple[str, ...]:
    if separator == " ":
        return tuple(line.split())
    try:
        found = next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    except csv.Error:
        return (line.strip(),)
    return tuple(cell.strip() for cell in found)
