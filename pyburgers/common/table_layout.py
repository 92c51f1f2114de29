"""Files of cells, text or workbooks, and where in them the table is."""

import csv
import datetime
import io
import re
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar
from unicodedata import category

from pyburgers.common.cells import (
    CellKind,
    Row,
    are_mostly_units,
    are_units,
    kind_of,
    names_between_blanks,
)
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import read_bytes

ENCODINGS = (
    (b"\xef\xbb\xbf", "utf-8-sig"),
    (b"\xff\xfe\x00\x00", "utf-32"),
    (b"\x00\x00\xfe\xff", "utf-32"),
    (b"\xff\xfe", "utf-16"),
    (b"\xfe\xff", "utf-16"),
)
"""Marks at the start of a text that tell its encoding."""


WESTERN = "cp1252"
"""Encoding of a text that is no UTF-8: Latin-1 as Windows has it."""


ZIP, OLD_WORKBOOK = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"
"""Starts of workbooks."""


SAVE_AS_CSV = "save the sheet as CSV UTF-8"


LITERAL_SIGNS = re.compile(r'"[^"]*"|\\.')
"""Parts of the format of a cell that stand beside its number as they are."""


@dataclass(frozen=True)
class Sheet:
    """Lines of a text, without a name, or rows of a named sheet of a workbook."""

    name: str
    lines: Sequence[str] = ()
    rows: Sequence[tuple[str, ...]] = ()


ZERO_OF_WORKBOOKS = datetime.datetime(1899, 12, 30)
"""Date of the number 0 from 61 on; below 60 it is a day later. Numbers of 1900 are durations."""


def read_sheets(path: Path, where: str | None = None) -> tuple[list[Sheet], str | None]:
    """Read the single sheet of a text, or those of a workbook that hold something, and a note."""
    content = read_bytes(path, where)
    if content.startswith(ZIP):
        return _workbook(path, content), None
    if content.startswith(OLD_WORKBOOK):
        raise InputError(
            f"{path}: found an Excel workbook of the old form (.xls), expected text or .xlsx: "
            f"{SAVE_AS_CSV}."
        )
    text, encoding = _decoded(path, content)
    return [Sheet("", lines=text.lstrip("\ufeff").rstrip("\x1a").splitlines())], encoding


def _decoded(path: Path, content: bytes) -> tuple[str, str | None]:
    """Return a text, and a note on its encoding where that is not UTF-8."""
    mark = next((name for start, name in ENCODINGS if content.startswith(start)), None)
    if mark is None and b"\x00" in content[:200]:
        mark = "utf-16-le" if content[1:2] == b"\x00" else "utf-16-be"
    encoding = mark or "utf-8"
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:
        if mark is not None:
            raise InputError(
                f"file {path} is not UTF-8 text, nor {mark.upper()}, which its start looks like: "
                "expected text; save it as CSV UTF-8."
            ) from None
        text, encoding = content.decode(WESTERN, errors="replace"), WESTERN
    if any(category(sign) == "Cc" and not sign.isspace() for sign in text[:1000].rstrip("\x1a")):
        raise InputError(f"file {path} is not UTF-8 text: found control characters; expected text.")
    if encoding in ("utf-8", "utf-8-sig"):
        return text, None
    if encoding == WESTERN:
        return text, "the text is not UTF-8 and was read as Latin-1 (Windows-1252)"
    return text, f"the text is {encoding.upper()}"


def _workbook(path: Path, content: bytes) -> list[Sheet]:
    """Return the sheets of a workbook that hold something."""
    try:
        from openpyxl import load_workbook
        from openpyxl.utils.exceptions import InvalidFileException
    except ImportError:
        raise InputError(
            f"{path}: found an Excel workbook, which needs openpyxl: install pyburgers[excel], or "
            f"{SAVE_AS_CSV}."
        ) from None
    try:
        book = load_workbook(io.BytesIO(content), read_only=True, data_only=True)
        sheets = [
            Sheet(name, rows=[tuple(map(_text_of, row)) for row in book[name].iter_rows()])
            for name in book.sheetnames
            if hasattr(book[name], "iter_rows")
        ]
    except (InvalidFileException, zipfile.BadZipFile, KeyError, ValueError, OSError) as error:
        raise InputError(
            f"{path}: found an Excel workbook that cannot be opened ({error}), expected text or a "
            f"whole .xlsx: {SAVE_AS_CSV}."
        ) from None
    return [sheet for sheet in sheets if any(any(row) for row in sheet.rows)]


def _text_of(cell: Any) -> str:
    """Return the text of a cell of a workbook; a number shown in percent keeps its sign."""
    value = cell.value
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if is_number and "%" in LITERAL_SIGNS.sub("", cell.number_format):
        return f"{100 * value:.12g}%"
    if value is None:
        return ""
    if isinstance(value, datetime.datetime) and value.year == ZERO_OF_WORKBOOKS.year + 1:
        value -= ZERO_OF_WORKBOOKS + datetime.timedelta(days=value.month < 3)
    if isinstance(value, datetime.timedelta):
        minutes, seconds = divmod(value.total_seconds(), 60)
        return f"{int(minutes // 60)}:{int(minutes % 60):02}:{seconds:09.6f}"
    if isinstance(value, datetime.datetime | datetime.time):
        return value.isoformat()
    return str(value).strip()


T = TypeVar("T")


COMMENT = "#"
"""Lines that start with this are skipped, like blank ones."""


SEPARATORS = (";", "\t", ",", " ")
"""What may stand between cells; the first of several that suit a file equally well is taken."""


SAMPLE_LINES = 300
"""Lines from either end of a file that tell its separator."""


MAX_SMALL_TABLE_SHARE = 0.1
"""Share of the rows of the largest table of a file below which another one is passed over."""


@dataclass(frozen=True)
class Layout:
    """What the rows of a file are, of which most have `width` cells (`TextTable` says more).

    `first_line`: line of the names, or else of the first row.
    """

    width: int
    names: tuple[str, ...] | None
    rows: tuple[Row, ...]
    hidden_names: tuple[str, ...] | None = None
    units: tuple[str, ...] | None = None
    notes: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()
    first_line: int = 1


def layout_of(
    path: Path,
    separator: str,
    rows: Sequence[Row],
    header: bool | None,
    comments: Sequence[tuple[int, str]],
) -> Layout:
    """Find names, units and the rows of numbers among all rows."""
    _, width, numeric = best_run(cells for _, cells in _sample(rows))
    if not rows or (header is False and not width):
        return Layout(width, None, tuple(rows))
    if not width:
        first = _names(rows[0][1], separator, len(rows[-1][1])) or rows[0][1]
        return Layout(len(first), first, tuple(rows[1:]))
    blocks = _blocks(rows, numeric)
    start, end = max(blocks, key=lambda block: block[1] - block[0])
    problems = _other_tables(path, rows, blocks, (start, end))
    if header is False:  # rows as wide as the others are no titles
        titles = [row for row in rows[:start] if len(row[1]) != width]
        own = [*(row for row in rows[:start] if len(row[1]) == width), *rows[start:end]]
        told = tuple(_layout_notes(rows, titles, (start, end), 0))
        return Layout(width, None, tuple(own), None, None, told, problems, own[0][0])
    before = next((last for first, last in reversed(blocks) if first < start), 0)
    above = list(rows[before:start])
    bad: list[Row] = []
    while (
        above
        and any(kind_of(cell) == "number" for cell in above[-1][1])
        and not are_units(above[-1][1])
    ):
        bad.insert(0, above.pop())
    names, units, used = _head(above, separator, width)
    if names is None and bad and len(bad[-1][1]) == width > 2:  # names such as 263 among others
        above, bad, names, used = [*above, *bad], [], bad[-1][1], 1
    if names is None and header:
        names, used, bad = rows[0][1], 1, list(rows[1:start])
        above = list(rows[:1])
    if names is None:
        above, bad = [*above, *bad], []
    own = [*bad, *rows[start:end]]
    notes = _layout_notes(rows, above[: len(above) - used], (start, end), before)
    if units is not None:
        notes.append(
            f"line {above[-1][0]} is a row of units ({', '.join(unit or '-' for unit in units)})"
        )
    if names is not None and len(names) == width - 1 and _are_numbered(own, separator):
        names, units = ("", *names), None if units is None else ("", *units)
        notes.append("rows have numbers of their own ahead of the first column")
    hidden = None
    if names is None:
        earlier = [line for number, line in comments if number < own[0][0]]
        found = _names(cells_of(earlier[-1], separator), separator, width) if earlier else None
        hidden = found if found is not None and len(found) == len(own[0][1]) else None
    top, _ = own[0] if names is None else above[len(above) - used]
    return Layout(width, names, tuple(own), hidden, units, tuple(notes), problems, top)


def _blocks(rows: Sequence[Row], numeric: frozenset[int]) -> list[tuple[int, int]]:
    """Return first row and end of each run of rows of numbers, between which there is text."""
    blocks: list[tuple[int, int]] = []
    starts_anew = True
    for k, (_, cells) in enumerate(rows):
        present = [kind_of(cells[index]) for index in numeric if index < len(cells)]
        is_row = "number" in present and "text" not in present and 2 * len(present) > len(numeric)
        if starts_anew and is_row:
            blocks.append((k, k + 1))
            starts_anew = False
        elif not starts_anew and (
            "number" in present
            or "text" not in present
            or any(kind_of(cell) == "number" for cell in cells)
        ):
            blocks[-1] = (blocks[-1][0], k + 1)
        else:
            starts_anew = True
    return blocks or [(0, len(rows))]


def _head(
    above: Sequence[Row], separator: str, width: int
) -> tuple[tuple[str, ...] | None, tuple[str, ...] | None, int]:
    """Return the names and units in the rows above the numbers, and how many rows they are."""
    if not above:
        return None, None, 0
    last, before = above[-1][1], above[-2][1] if len(above) > 1 else ()
    # Below a text for each column a row of units may hold some that are not known.
    is_full = [*map(kind_of, before)].count("text") == width
    has_units = are_units(last) or (is_full and are_mostly_units(last))
    if before and has_units and not are_units(before):
        names = _names(before, separator, width)
        if names is not None:
            return names, last, 2
    names = _names(last, separator, width)
    return names, None, int(names is not None)


def _names(cells: Sequence[str], separator: str, width: int) -> tuple[str, ...] | None:
    """Return the names in a row; None where it is a title or the like, of a single cell."""
    if separator == " ":
        between = names_between_blanks(" ".join(cells), width)
        return tuple(cells if len(cells) == width or len(between) != width else between)
    named = list(cells)
    while named and not named[-1]:
        named.pop()
    return tuple(named) if len(named) >= min(2, width) else None


def _are_numbered(rows: Sequence[Row], separator: str) -> bool:
    """Whether the first cells count the rows, as those of a table that R wrote."""
    # Between commas they may be thousands, or have been cut off by decimal commas.
    return separator != "," and all(
        cells[0] == str(number) for number, (_, cells) in enumerate(rows, start=1)
    )


def _layout_notes(
    rows: Sequence[Row], passed: Sequence[Row], block: tuple[int, int], before: int
) -> list[str]:
    """Say which lines were passed over ahead of the names and behind the numbers."""
    notes = []
    ahead, behind = [*rows[:before], *passed], rows[block[1] :]
    for part, where in ((ahead, "ahead of"), (behind, "behind")):
        if part:
            (first, _), (last, _) = part[0], part[-1]
            were = "was" if first == last else "were"
            notes.append(f"{_lines(first, last)} {where} the table {were} passed over")
    return notes


def _lines(first: int, last: int) -> str:
    return f"line {first}" if first == last else f"lines {first} to {last}"


def _other_tables(
    path: Path,
    rows: Sequence[Row],
    blocks: Sequence[tuple[int, int]],
    block: tuple[int, int],
) -> tuple[str, ...]:
    """Say which other tables a file holds that are not much smaller, or may go on with this one."""
    width, size = len(rows[block[0]][1]), block[1] - block[0]

    def is_rival(one: tuple[int, int]) -> bool:
        alike, n_rows = len(rows[one[0]][1]) == width, one[1] - one[0]
        if one[0] > block[0] and alike:
            return True
        return n_rows > 1 and (alike or n_rows >= MAX_SMALL_TABLE_SHARE * size)

    large = [one for one in blocks if one == block or is_rival(one)]
    if len(large) < 2:
        return ()
    listed = ", ".join(_lines(rows[first][0], rows[end - 1][0]) for first, end in large)
    number, cells = rows[large[0][1]]
    return (
        f"{path}: found {len(large)} tables ({listed}) with text between them, such as "
        f"{' '.join(cells)[:60]!r} in line {number}, expected one: keep that of this test, or "
        "remove the text if the readings go on.",
    )


def _sample(lines: Sequence[T]) -> Sequence[T]:
    """Return lines from both ends of a file."""
    if len(lines) <= 2 * SAMPLE_LINES:
        return lines
    return [*lines[:SAMPLE_LINES], *lines[-SAMPLE_LINES:]]


def is_comment(line: str) -> bool:
    """Whether a line is skipped."""
    return line.lstrip().startswith(COMMENT)


def separator_of(lines: Sequence[str]) -> str:
    """Return what stands between cells: that which leaves most numbers in rows that are alike."""
    sample = _sample(lines)

    def score(separator: str) -> tuple[int, bool]:
        rows = [_cells_or_line(line, separator) for line in sample]
        n_numbers, width, _ = best_run(rows)
        return (n_numbers if width > 1 or separator == " " else 0), width > 1

    def is_in_every_line(separator: str) -> bool:
        widths = {len(_cells_or_line(line, separator)) for line in sample}
        return len(widths) == 1 and max(widths) > 1

    # Blanks may separate thousands between these two, which stand in lines for nothing else.
    for separator in (";", "\t"):
        if is_in_every_line(separator) and score(separator)[0] > 0:
            return separator
    best = max(SEPARATORS, key=score)
    if score(best)[0] > 0:
        return best
    return next(
        (one for one in SEPARATORS if lines and len(_cells_or_line(lines[0], one)) > 1), ","
    )


def best_run(rows: Iterable[Sequence[str]]) -> tuple[int, int, frozenset[int]]:
    """Return score (numbers less texts), width and numeric columns of the longest like rows."""
    best: tuple[int, int, frozenset[int]] = (0, 0, frozenset())
    merged: list[CellKind] = []
    score = 0
    for cells in rows:
        kinds = [kind_of(cell) for cell in cells]
        if "number" not in kinds:
            merged = []
            continue
        alike = len(kinds) == len(merged) and all(
            a == b or not a or not b for a, b in zip(kinds, merged, strict=True)
        )
        merged = [a or b for a, b in zip(kinds, merged, strict=True)] if alike else kinds
        score = (score if alike else 0) + kinds.count("number") - kinds.count("text")
        if score >= best[0]:
            numeric = frozenset(k for k, kind in enumerate(merged) if kind == "number")
            best = (score, len(merged), numeric)
    return best


def _cells_or_line(line: str, separator: str) -> tuple[str, ...]:
    try:
        return cells_of(line, separator)
    except csv.Error:
        return (line.strip(),)


def cells_of(line: str, separator: str) -> tuple[str, ...]:
    """Return the cells of a line; raise csv.Error of an open quotation mark."""
    if separator == " ":
        return tuple(cell.strip('"') for cell in re.findall(r'"[^"]*"|\S+', line))
    found = next(csv.reader([line], delimiter=separator, skipinitialspace=True, strict=True))
    return tuple(cell.strip() for cell in found)
