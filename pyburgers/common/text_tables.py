"""How a file of cells is laid out: where its table is, what separates cells, names and units.

One reader serves whoever describes a file (`pyburgers new`, hints) and whoever reads its numbers
(`pyburgers.common.columns`). It tells what it did in notes, and doubts as problems.
"""

import csv
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from pyburgers.common.cells import (
    DECIMAL_COMMA,
    HUNDREDS,
    NOTHING,
    NUMBER,
    THOUSANDS,
    THOUSANDS_POINTS,
    Row,
    as_number,
    has_clock,
    has_date,
    kind_of,
    missing_numbers,
    names_between_blanks,
    seconds_of,
)
from pyburgers.common.errors import InputError
from pyburgers.common.table_layout import (
    COMMENT,
    MAX_SMALL_TABLE_SHARE,
    Sheet,
    cells_of,
    is_comment,
    layout_of,
    read_sheets,
    separator_of,
)

FROM_ZERO = re.compile(r"elaps|durat|since|run(?:ning)?.?time|test.?time", re.IGNORECASE)
"""What the name of a clock has that counts from the start of a test."""


@dataclass(frozen=True)
class TextTable:
    """The table in a file.

    `path`, `separator`: the file; what stands between cells: a comma of a workbook.
    `names`, `hidden_names`: above the columns; or in the last comment line ahead of the rows.
    `rows`: number of the line from 1, and cells as they stand in the file.
    `units`: cells of a row of units under the names.
    `missing`: cells that are said to stand for no reading; None where they are to be found.
    `comments`: number and text of each line that is skipped, and of words ahead of the table.
    `layout_notes`, `problems`: what was done to find the table; what keeps rows from being read.
    `is_in_memory`: whether the columns were arrays; rows are then numbered from 1.
    `elapsed`: columns of elapsed times in memory, which became seconds.
    """

    path: Path
    separator: str
    names: tuple[str, ...] | None
    hidden_names: tuple[str, ...] | None
    rows: tuple[Row, ...]
    units: tuple[str, ...] | None = None
    missing: tuple[str, ...] | None = None
    comments: tuple[tuple[int, str], ...] = ()
    layout_notes: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()
    is_in_memory: bool = False
    elapsed: frozenset[str] = frozenset()

    @property
    def row_name(self) -> str:
        """What messages call a row by its number."""
        return "row" if self.is_in_memory else "line"

    @cached_property
    def columns(self) -> tuple[str | int, ...]:
        """Names of the columns, or their numbers from 1."""
        if self.names is not None:
            return self.names
        return tuple(range(1, max((len(cells) for _, cells in self.rows), default=0) + 1))

    @property
    def is_alike_by_blanks(self) -> bool:
        """Whether white space in place of the separator gives the same columns."""
        cells = [cell for _, row in self.rows for cell in row]
        names = () if self.names is None else self.names
        return (
            all(len(cell.split()) == 1 for cell in cells)
            and tuple(names_between_blanks(" ".join(names), len(names))) == names
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about what was done to read the file, each with its name."""
        return self.notes_on(range(len(self.columns)))

    def notes_on(self, indices: Iterable[int]) -> tuple[str, ...]:
        """Return the notes on the file as a whole and on some columns, from 0."""
        own = [note for index in sorted(indices) for note in self._notes_on(index)]
        if self.has_decimal_commas:
            own.append("numbers have decimal commas")
        return tuple(f"{self.path.name}: {note}." for note in (*self.layout_notes, *own))

    def described(self, column: str | int) -> str:
        """Return the name of a column, followed by the unit under it: ``Time [min]``."""
        index = self.columns.index(column)
        names = self.names or self.hidden_names
        # Names in a comment do not reach the cells of a row that is too long.
        name = str(column) if names is None or index >= len(names) else names[index]
        unit = "" if self.units is None or index >= len(self.units) else self.units[index]
        if not unit:
            return name
        return f"{name} {unit}" if unit[0] in "([" else f"{name} [{unit}]"

    def is_time_stamps(self, column: str | int) -> bool:
        """Whether a column holds time stamps, of which `numbers` are seconds."""
        return self.columns.index(column) in self._stamps

    def is_date_of(self, column: str | int, read: Iterable[str | int]) -> bool:
        """Whether a column holds the dates of times of day in one of the columns that are read."""
        is_date = self.columns.index(column) == self._clocks[1]
        return is_date and any(one in self.columns and self.is_time_stamps(one) for one in read)

    def numbers(self, column: str | int) -> list[float]:
        """Return the numbers in a column, as a person reads them; without cells that hold none."""
        return [value for value in self.values(column) if value is not None]

    def values(self, column: str | int) -> list[float | None]:
        """Return what `numbers` does for each row, None for a cell that holds none."""
        index = self.columns.index(column)
        if index not in self._values:
            self._values[index] = [*map(as_number, self.cleaned(index))]
        return self._values[index]

    @cached_property
    def _values(self) -> dict[int, list[float | None]]:
        """Columns of `values` that were asked for."""
        return {}

    def cleaned(self, index: int) -> list[str]:
        """Return cells as numbers, time stamps as seconds; empty without a reading."""
        if index in self._stamps:
            return self._stamps[index][0]
        missing = self._missing[index]
        cells = ["" if cell in missing else cell for cell in self.cells(index)]
        if self.has_decimal_commas:
            cells = [
                cell.replace(".", "") if THOUSANDS_POINTS.fullmatch(cell) else cell
                for cell in cells
            ]
            return [
                cell.replace(",", ".") if DECIMAL_COMMA.fullmatch(cell) else cell for cell in cells
            ]
        return cells

    def cells_like(self, looks: re.Pattern[str]) -> list[tuple[int, str]]:
        """Return lines and cells that look like something."""
        return [(line, cell) for line, cells in self.rows for cell in cells if looks.search(cell)]

    def cells(self, index: int) -> list[str]:
        """Return the cells of a column, as they stand in the file."""
        return [cells[index] if index < len(cells) else "" for _, cells in self.rows]

    @cached_property
    def has_decimal_commas(self) -> bool:
        """Whether commas stand for points: they separate no cells, and no number has a point.

        A point that may separate thousands counts for none beside a comma that does not.
        """
        if self.separator == ",":
            return False
        cells = [cell for _, row in self.rows for cell in row]
        commas = [cell for cell in cells if "," in cell and DECIMAL_COMMA.fullmatch(cell)]
        points = [cell for cell in cells if "." in cell and NUMBER.fullmatch(cell)]
        are_decimal = not points or not all(map(THOUSANDS.fullmatch, commas))
        return bool(commas) and are_decimal and all(map(THOUSANDS_POINTS.fullmatch, points))

    @cached_property
    def _missing(self) -> list[set[str]]:
        """Cells of each column that stand for no reading."""
        return [
            missing_numbers(self.cells(index), self.missing) for index in range(len(self.columns))
        ]

    @cached_property
    def _clocks(self) -> tuple[dict[int, str], int | None]:
        """Columns of time stamps with their kinds, and that of dates that goes with a clock.

        A clock that shows the time since the start of the test is of the kind "elapsed".
        """
        kinds: dict[int, str] = {}
        for index in range(len(self.columns)):
            cells = [cell for cell in self.cells(index) if cell and not NOTHING.fullmatch(cell)]
            if cells and all(has_clock(cell) or has_date(cell) for cell in cells):
                dated, timed = has_date(cells[0]), has_clock(cells[0])
                clock = "elapsed" if FROM_ZERO.search(str(self.columns[index])) else "clock"
                kinds[index] = "both" if dated and timed else "date" if dated else clock
        dates = [index for index, kind in kinds.items() if kind == "date"]
        has_one_of_each = len(dates) == 1 and [*kinds.values()].count("clock") == 1
        return kinds, dates[0] if has_one_of_each else None

    @cached_property
    def _stamps(self) -> dict[int, tuple[list[str], bool]]:
        """Seconds, as text, of columns of time stamps, and whether 12 AM was read as noon."""
        kinds, date = self._clocks
        found = {}
        for index, kind in kinds.items():
            if index == date:
                continue
            cells = self.cells(index)
            if date is not None and kind == "clock":
                cells = [
                    f"{day} {clock}" for day, clock in zip(self.cells(date), cells, strict=True)
                ]
            read = seconds_of(cells)
            if read is not None:
                times, is_noon_am = read
                start = 0.0 if kind == "elapsed" else next(t for t in times if t == t)
                text = [repr(round(t - start, 9)) if t == t else "" for t in times]
                found[index] = (text, is_noon_am)
        return found

    def _notes_on(self, index: int) -> list[str]:
        """Say how the cells of a column were read."""
        (kinds, date), name = self._clocks, self.columns[index]
        kind, missing, notes = kinds.get(index), self._missing[index], []
        if index in self._stamps:
            dates = f" with {self.columns[date]!r}" if date is not None and kind == "clock" else ""
            start = "0:00" if kind == "elapsed" else "the first row"
            notes.append(f"column {name!r}{dates} holds time stamps, read as seconds since {start}")
            if self._stamps[index][1]:
                notes.append(f"column {name!r}: 12 AM was read as noon, because times go back else")
        elif kind is not None and index != date:
            cell = next(cell for cell in self.cells(index) if cell)
            notes.append(
                f"column {name!r} holds time stamps such as {cell!r}, which can be read in more "
                "than one way: write them as 2024-03-01 09:00:00, or hh:mm:ss"
            )
        if missing:
            many = sum(cell in missing for cell in self.cells(index))
            notes.append(
                f"column {name!r}: {', '.join(sorted(missing))} (in {many} of {len(self.rows)} "
                "rows) stands for no reading"
            )
        return notes


def table_of_columns(
    path: Path, columns: Mapping[str, ArrayLike], missing: Sequence[str] | None = None
) -> TextTable:
    """Return a table whose columns are arrays of numbers, texts or times; NaN is no reading."""
    cells = {name: _cells_in(path, name, values) for name, values in columns.items()}
    lengths = {name: len(own) for name, own in cells.items()}
    if len(set(lengths.values())) > 1:
        found = ", ".join(f"{length} in {name!r}" for name, length in lengths.items())
        raise InputError(f"{path}: found columns of different lengths, {found}; expected one.")
    rows = tuple(enumerate(zip(*cells.values(), strict=True), start=1))
    words = None if missing is None else tuple(missing)
    elapsed = frozenset(name for name, values in columns.items() if _is_elapsed(values))
    return TextTable(
        path, ",", tuple(cells), None, rows, missing=words, is_in_memory=True, elapsed=elapsed
    )


def _cells_in(path: Path, name: str, values: ArrayLike) -> list[str]:
    """Return the values of a column as cells; an empty one for no reading, or a masked one."""
    array = np.asarray(values)
    if array.ndim != 1:
        raise InputError(
            f"{path}: column {name!r}: found {array.ndim} dimensions, expected a list of numbers."
        )
    if np.issubdtype(array.dtype, np.datetime64):
        cells = [
            "" if np.isnat(time) else str(time.astype("datetime64[us]")).replace("T", " ")
            for time in array
        ]
    elif _is_elapsed(array):
        cells = ["" if pd.isna(one) else str(one.total_seconds()) for one in pd.to_timedelta(array)]
    else:
        cells = ["" if _is_nothing(value) else str(value) for value in array.tolist()]
    hidden = np.broadcast_to(np.ma.getmask(values), array.shape)
    return ["" if is_hidden else cell for cell, is_hidden in zip(cells, hidden, strict=True)]


def _is_elapsed(values: ArrayLike) -> bool:
    """Whether all readings of a column are elapsed times of Python, NumPy or pandas."""
    return bool(pd.api.types.infer_dtype(np.asarray(values)).startswith("timedelta"))


def _is_nothing(value: object) -> bool:
    """Whether a value of a list stands for no reading: None, or not equal to itself as NaN is."""
    return value is None or str(value) in ("nan", "NaT", "<NA>")


def look_at(
    path: Path,
    separator: str | None = None,
    *,
    header: bool | None = None,
    missing: Sequence[str] | None = None,
    where: str | None = None,
) -> TextTable:
    """Find the table in a file; raise InputError if it cannot be read at all."""
    sheets, encoding = read_sheets(path, where)
    tables = [(sheet.name, _table_in(path, sheet, separator, header, missing)) for sheet in sheets]
    if not tables:
        return TextTable(path, ",", None, None, ())
    name, table = max(tables, key=lambda one: len(one[1].rows))
    notes = [] if encoding is None else [encoding]
    if name:
        notes.append(f"the sheet {name!r} of the workbook is read")
    least = max(2, MAX_SMALL_TABLE_SHARE * len(table.rows))
    large = [one for one, own in tables if len(own.rows) >= least]
    problems = list(table.problems)
    if len(large) > 1:
        problems.append(
            f"{path}: found readings in {len(large)} sheets ({', '.join(large)}), expected one: "
            "save the sheet of this test as a file of its own."
        )
    return replace(table, layout_notes=(*notes, *table.layout_notes), problems=tuple(problems))


def _table_in(
    path: Path,
    sheet: Sheet,
    separator: str | None,
    header: bool | None,
    missing: Sequence[str] | None,
) -> TextTable:
    """Find the table in the lines of a text, or in a sheet of a workbook."""
    lines = list(enumerate(sheet.lines, start=1))
    content = [(n, line) for n, line in lines if line.strip() and not is_comment(line)]
    between = separator or separator_of([line for _, line in content])
    rows = list(enumerate(sheet.rows, start=1))
    broken = []
    for number, line in content:
        try:
            rows.append((number, cells_of(line, between)))
        except csv.Error:
            rows.append((number, (line.strip(),)))
            broken.append(number)
    comments = [(n, line.lstrip().lstrip(COMMENT)) for n, line in lines if is_comment(line)]
    filled = [(number, cells) for number, cells in rows if any(cells)]
    layout = layout_of(path, "," if sheet.rows else between, filled, header, comments)
    table = TextTable(
        path=path,
        separator="," if sheet.rows else between,
        names=layout.names,
        hidden_names=layout.hidden_names,
        rows=layout.rows,
        units=layout.units,
        missing=None if missing is None else tuple(missing),
        comments=(*comments, *_ahead(filled, between, layout.first_line)),
        layout_notes=layout.notes,
    )
    problems = (
        *layout.problems,
        *_open_quotes(path, [n for n in broken if n >= layout.first_line]),
        *(() if layout.problems else _long_rows(table, layout.width)),
        *_doubtful_marks(table),
    )
    return replace(table, problems=problems)


def _ahead(rows: Sequence[Row], between: str, first_line: int) -> Iterator[tuple[int, str]]:
    """Return rows without numbers that were passed over ahead of the table."""
    for number, cells in rows:
        if number < first_line and all(kind_of(cell) != "number" for cell in cells):
            said = [cell for cell in cells if cell]
            # Two cells say one thing.
            yield number, (" " if len(said) == 2 else between).join(said)


def _open_quotes(path: Path, lines: Sequence[int]) -> Iterator[str]:
    """Name the lines of the table whose quotation marks are not closed."""
    if lines:
        yield (
            f"{path}: line {lines[0]}: found a quotation mark that is not closed"
            f"{_and_more(len(lines) - 1)}, expected pairs of them."
        )


def _long_rows(table: TextTable, width: int) -> Iterator[str]:
    """Name rows that are longer than the names, or than most rows, or names that are too many."""
    names, path = table.names, table.path
    n_cells = width if names is None else len(names)
    if names is not None and table.separator == " " and n_cells != width:
        yield (
            f"{path}: found {n_cells} words for names ({' '.join(names)}) above {width} columns, "
            "expected a name for each: join the words of a name, or start the line with '#'."
        )
        return
    rows = [(number, cells) for number, cells in table.rows if any(cells[n_cells:])]
    if rows:
        number, cells = rows[0]
        hint = ": write numbers without thousands separators and with decimal points"
        yield (
            f"{path}: line {number}: found {len(cells)} cells "
            f"({table.separator.join(cells)[:60]}){_and_more(len(rows) - 1)}, expected at most "
            f"{n_cells}, as many as there are {'columns' if names is None else 'names'}"
            f"{hint if table.separator == ',' else ''}."
        )


def _doubtful_marks(table: TextTable) -> Iterator[str]:
    """Name a point beside decimal commas, and a comma that may separate thousands or decimals.

    Between semicolons such commas are of decimals, unless whole hundreds stand in their column.
    """
    if not table.has_decimal_commas:
        return
    if points := table.cells_like(THOUSANDS_POINTS):
        line, cell = points[0]
        more = _and_more(len({number for number, _ in points}) - 1)
        yield (
            f"{table.path}: line {line}: found {cell!r}{more} beside decimal commas, expected no "
            "points in numbers: remove a point that separates thousands, write a comma for a "
            "decimal one."
        )
        return
    commas = table.cells_like(DECIMAL_COMMA)
    columns = (table.cells(index) for index in range(len(table.columns)))
    if table.separator == ";" and not any(
        any(map(HUNDREDS.fullmatch, cells)) and any(map(DECIMAL_COMMA.fullmatch, cells))
        for cells in columns
    ):
        return
    if all(THOUSANDS.fullmatch(cell) for _, cell in commas):
        line, cell = commas[0]
        yield (
            f"{table.path}: line {line}: found {cell!r}{_and_more(len(commas) - 1)}, whose comma "
            "may separate thousands or decimals, expected numbers without commas."
        )


def _and_more(number: int) -> str:
    return f" (and in {number} more lines)" if number > 0 else ""
