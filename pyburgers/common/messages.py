"""Where messages about progress go: to the logger of the package, and from there where asked."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

PACKAGE = "pyburgers"
"""The logger above those of all modules."""


class NamedLines(logging.Formatter):
    """Bare messages, with the name of who speaks before each line."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self._name = name

    def format(self, record: logging.LogRecord) -> str:
        """Return the lines of a message."""
        return "\n".join(f"{self._name}: {line}" for line in super().format(record).splitlines())


@contextmanager
def messages_to(stream: TextIO, name: str | None = None) -> Iterator[None]:
    """Write the package's messages to a stream, one below the other, `name` before each line."""
    package = logging.getLogger(PACKAGE)
    handler = logging.StreamHandler(stream)
    if name is not None:
        handler.setFormatter(NamedLines(name))
    before = package.level
    package.addHandler(handler)
    package.setLevel(logging.INFO)
    try:
        yield
    finally:
        package.setLevel(before)
        package.removeHandler(handler)
