"""What may lie behind the errors of an experiment file."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from pyburgers.cli.column_hints import hints_of_names
from pyburgers.common.cells import DECIMAL_COMMA, ODD_MINUS
from pyburgers.common.columns import may_be_quoted
from pyburgers.common.errors import InputError
from pyburgers.common.text_tables import TextTable, look_at
from pyburgers.kinds.column_names import unit_in_name
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.new_file import NAMED_SEPARATORS, new_files

SEPARATORS = {";": "semicolons", "\t": "tabs", " ": "white space", ",": "commas"}

FILE_KEYS = ("file", "strain_file", "stress_file")


def text_files(content: Mapping[str, Any]) -> Iterator[tuple[dict[str, Any], str]]:
    """Return the tables of a file that name text files, with the keys that do."""
    segments = content.get("segments")
    for table in (content.get("data"), *(segments if isinstance(segments, list) else ())):
        if isinstance(table, dict):
            for key in FILE_KEYS:
                if isinstance(table.get(key), str):
                    yield table, key


def looks(path: Path, content: Mapping[str, Any]) -> Iterator[TextTable]:
    """Return how the text files that an experiment file names look."""
    data = content.get("data")
    if not isinstance(data, dict):
        return
    for table, key in text_files(content):
        with suppress(InputError):  # the error itself is told
            file = path.parent / str(data.get("data_root", "")) / table[key]
            if may_be_quoted(file, path):
                yield look_at(file)


def hints(tables: Sequence[TextTable], content: Mapping[str, Any]) -> list[str]:
    """Say what may be behind errors: how the text files look beside what the file says of them."""
    data = content.get("data")
    if not isinstance(data, dict):
        return []
    kind = new_files().get(str(content.get("protocol")))
    small_strain = (Experiment if kind is None else kind.experiment).small_strain
    found = [
        f"{look.path}: {hint}"
        for look in tables
        for hint in (*_hints_of(look, data, small_strain), *hints_of_names(look, content))
    ]
    if content.get("compression") != "negative":
        found += [f"{look.path}: {hint}" for look in tables for hint in _hints_of_signs(look, data)]
    return list(dict.fromkeys(found))


def _hints_of(look: TextTable, data: Mapping[str, Any], small_strain: float) -> Iterator[str]:
    named = any(key.endswith("_column") and isinstance(data[key], str) for key in data)
    header = data.get("header")
    if look.hidden_names is not None and named:
        names = ", ".join(look.hidden_names)
        yield (
            f"the names ({names}) stand in a line that starts with '#', which is passed over: "
            "remove that '#', or write the numbers of the columns from 1."
        )
    elif look.names is None and look.rows and (named or header):
        yield (
            "there are no names above the numbers: write the numbers of the columns from 1, such "
            "as strain_column = 1, and no header = true."
        )
    elif look.names is not None and header is False:
        yield f"the first row holds names ({', '.join(look.names)}): remove header = false."
    said = data.get("separator")
    fits = [NAMED_SEPARATORS.get(look.separator, look.separator)]
    if look.separator == "\t" and look.is_alike_by_blanks:
        fits.append("whitespace")
    if len(look.columns) > 1 and said is not None and said not in fits:
        yield (
            f"columns look as if {SEPARATORS[look.separator]} stood between them: remove the key "
            "separator from [data]."
        )
    found = [(ODD_MINUS, "starts with a character that is no minus sign", "write '-'")]
    if not look.has_decimal_commas:
        what = "has a comma that separates thousands or decimals"
        found.append((DECIMAL_COMMA, what, "write a decimal point and no other mark"))
    for looks_like, what, remedy in found:
        cells = look.cells_like(looks_like)
        if cells:
            line, cell = cells[0]
            more = f" (and {len(cells) - 1} more)" if len(cells) > 1 else ""
            yield f"line {line}: {cell!r}{more} {what}: {remedy}."
    yield from _hints_of_strain(look, data, small_strain)


def _hints_of_strain(
    look: TextTable, data: Mapping[str, Any], small_strain: float
) -> Iterator[str]:
    column, unit = data.get("strain_column"), data.get("strain_unit")
    if column not in look.columns:
        return
    strain = np.array(look.numbers(column))
    if not strain.size:
        return
    largest = float(np.max(np.abs(strain)))
    if unit == "fraction" and largest > 1:
        yield f"{column!r} reaches {largest:g}: is it in percent rather than a fraction?"
    is_named = unit_in_name(look.described(column), "strain") == unit
    if unit == "percent" and not is_named and 0 < largest < 100 * small_strain:
        yield f"{column!r} reaches {largest:g} only: is it a fraction rather than percent?"


def _hints_of_signs(look: TextTable, data: Mapping[str, Any]) -> Iterator[str]:
    column = data.get("strain_column")
    strain = look.numbers(column) if column in look.columns else []
    if sum(value < 0 for value in strain) > len(strain) / 2:
        yield (
            f"strains in {column!r} are negative, but compression is positive in this model: if it "
            'is negative in this file, write compression = "negative".'
        )
