"""Tables as CSV that a spreadsheet shows as text and numbers and never computes."""

import re
from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd

from pyburgers.common.cells import number_in

FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\n")
"""With one of these a spreadsheet takes a cell for a formula, unless the cell is a number."""

_HIDDEN_FORMULA = re.compile(r"(?<=[,;\t])(?=[=+@-])")


def csv_text(table: pd.DataFrame, *, index: bool = False, float_format: str | None = None) -> str:
    """Return a table with a header, texts as `cell_of_text` has them."""
    shown = table.reset_index() if index else table
    shown = shown.set_axis([_safe(name) for name in shown.columns], axis="columns")
    for place, kind in enumerate(shown.dtypes):
        if not pd.api.types.is_numeric_dtype(kind):
            column = shown.iloc[:, place]
            shown.isetitem(place, np.fromiter(map(_safe, column), dtype=object, count=len(column)))
    return shown.to_csv(index=False, float_format=float_format)


def comment_lines(notes: Iterable[str]) -> str:
    """Return a line of comment for each note, with a blank before formulas behind separators."""
    lines = (" ".join(note.splitlines()) for note in notes)
    return "".join(f"# {_HIDDEN_FORMULA.sub(' ', line)}\n" for line in lines)


def cell_of_text(text: str) -> str:
    """Return a text that is no formula: an apostrophe stands before one that would be."""
    text = "\n".join(re.split("\r\n?", text))
    is_formula = text.startswith(FORMULA_STARTS) and number_in(text) is None
    return f"'{text}" if is_formula else text


def _safe(cell: Any) -> Any:
    return cell_of_text(cell) if isinstance(cell, str) else cell
