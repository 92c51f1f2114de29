"""Tables in files, each of which is read once by what reads it several times."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from pyburgers.common.text_tables import TextTable, look_at

MAX_KEPT_ROWS = 1_000_000
"""Rows of kept tables, beyond which the oldest go: one of these takes 25 times its file."""

_Key = tuple[Path, str | None, bool | None, tuple[str, ...] | None]

_KEPT: ContextVar[dict[_Key, TextTable] | None] = ContextVar("_KEPT", default=None)


@contextmanager
def read_once() -> Iterator[None]:
    """Have `table_in` read each file once while the block runs, in which no file may change."""
    if _KEPT.get() is not None:
        yield
        return
    token = _KEPT.set({})
    try:
        yield
    finally:
        _KEPT.reset(token)


def table_in(
    path: Path,
    separator: str | None = None,
    *,
    header: bool | None = None,
    missing: Sequence[str] | None = None,
    where: str | None = None,
) -> TextTable:
    """Return the table in a file, as `look_at` does, or that of an earlier look in `read_once`."""
    kept, words = _KEPT.get(), None if missing is None else tuple(missing)
    if kept is None:
        return look_at(path, separator, header=header, missing=missing, where=where)
    as_it_looks = kept.get((path, None, None, words))
    if as_it_looks is not None and _is_as_stated(as_it_looks, separator, header):
        return as_it_looks
    key = path, separator, header, words
    if key not in kept:
        kept[key] = look_at(path, separator, header=header, missing=missing, where=where)
        while len(kept) > 1 and sum(len(one.rows) for one in kept.values()) > MAX_KEPT_ROWS:
            del kept[next(iter(kept))]
    return kept[key]


def _is_as_stated(table: TextTable, separator: str | None, header: bool | None) -> bool:
    """Whether a table was found with the separator and the names that a file states."""
    has_names = header is None or (header and table.names is not None)
    return separator in (None, table.separator) and has_names
