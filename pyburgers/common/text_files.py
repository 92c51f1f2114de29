"""Files of cells as instruments and spreadsheets write them: encodings of text, workbooks."""

import datetime
import io
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from unicodedata import category

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


@dataclass(frozen=True)
class Sheet:
    """Lines of a text, or rows of a sheet of a workbook.

    `name`: of the sheet of a workbook; empty for a text.
    `lines`: the lines of a text; empty for a workbook.
    `rows`: the cells of a workbook; empty for a text.
    """

    name: str
    lines: Sequence[str] = ()
    rows: Sequence[tuple[str, ...]] = ()


def read_sheets(path: Path, where: str | None = None) -> tuple[list[Sheet], str | None]:
    """Read a text, or the sheets of a workbook that hold something.

    Return `sheets`: a single one of a text. Return `note`: encoding of a text that is not UTF-8.
    Raise InputError if the file cannot be read, or holds neither text nor a workbook.
    """
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
            Sheet(name, rows=[tuple(map(_as_text, row)) for row in book[name].values])
            for name in book.sheetnames
            if hasattr(book[name], "values")
        ]
    except (InvalidFileException, zipfile.BadZipFile, KeyError, ValueError, OSError) as error:
        raise InputError(
            f"{path}: found an Excel workbook that cannot be opened ({error}), expected text or a "
            f"whole .xlsx: {SAVE_AS_CSV}."
        ) from None
    return [sheet for sheet in sheets if any(any(row) for row in sheet.rows)]


def _as_text(value: object) -> str:
    """Return the text of a cell of a workbook."""
    if value is None:
        return ""
    if isinstance(value, datetime.timedelta):
        minutes, seconds = divmod(value.total_seconds(), 60)
        return f"{int(minutes // 60)}:{int(minutes % 60):02}:{seconds:09.6f}"
    if isinstance(value, datetime.datetime | datetime.time):
        return value.isoformat()
    return str(value).strip()
