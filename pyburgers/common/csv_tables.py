"""Tables as CSV: for spreadsheets, which compute nothing of them, and columns that read back."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pyburgers.common.array_types import FloatArray
from pyburgers.common.atomic_files import write_text
from pyburgers.common.cells import number_in

FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\n")
"""With one of these a spreadsheet takes a cell for a formula, unless the cell is a number."""

_HIDDEN_FORMULA = re.compile(r"(?<=[,;\t])(?=[=+@-])")

WRITTEN_LAYOUT = {"separator": ",", "header": True, "missing": []}
"""Keys of a table [data] that describe what `columns_text` returns."""


def csv_text(table: pd.DataFrame, *, index: bool = False, float_format: str | None = None) -> str:
    """Return a table with a header, in which no text is a formula."""
    shown = table.reset_index() if index else table
    shown = shown.set_axis([_safe(name) for name in shown.columns], axis="columns")
    for place, kind in enumerate(shown.dtypes):
        if not pd.api.types.is_numeric_dtype(kind):
            column = shown.iloc[:, place]
            shown.isetitem(place, np.fromiter(map(_safe, column), dtype=object, count=len(column)))
    return shown.to_csv(index=False, float_format=float_format)


def comment_lines(notes: Iterable[str]) -> str:
    """Return a line of comment for each note, with a blank before formulas behind separators."""
    return "".join(f"# {_HIDDEN_FORMULA.sub(' ', in_one_line(note))}\n" for note in notes)


def in_one_line(note: str) -> str:
    """Return a text for a comment that ends with its line."""
    return " ".join(note.splitlines())


def _safe(cell: Any) -> Any:
    """Return a cell that is no formula: an apostrophe stands before a text that would be."""
    if not isinstance(cell, str):
        return cell
    text = "\n".join(re.split("\r\n?", cell))
    is_formula = text.startswith(FORMULA_STARTS) and number_in(text) is None
    return f"'{text}" if is_formula else text


def data_files(
    data: Mapping[str, Any] | None,
) -> tuple[dict[str, Any] | None, dict[str, str]]:
    """Return a table [data] that names files for columns in memory, and their texts by name."""
    if data is None:
        return None, {}
    named: dict[str, Any] = {**data, **WRITTEN_LAYOUT}
    texts = {}
    for key, columns in data.items():
        if isinstance(columns, Mapping):
            named[key] = f"experiment_{key}".removesuffix("_file") + ".csv"
            texts[named[key]] = columns_text(columns)
    return named, texts


def columns_text(columns: Mapping[str, Sequence[float] | FloatArray]) -> str:
    """Return columns with a header, comma-separated, that read back equal; NaN is an empty cell."""
    rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join(map(_written, row)) for row in rows)]
    return "\n".join(lines) + "\n"


def write_columns(path: Path, columns: Mapping[str, Sequence[float] | FloatArray]) -> None:
    """Write a file of `columns_text`."""
    write_text(path, columns_text(columns))


def _written(number: float) -> str:
    return "" if math.isnan(number) else repr(number)
