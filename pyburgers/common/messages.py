"""Where messages about progress go: to the logger of the package, and from there where asked."""

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import parent_process
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


def in_notebook() -> bool:
    """Whether the process is the kernel of a notebook."""
    module = sys.modules.get("IPython")
    return module is not None and hasattr(module.get_ipython(), "kernel")


def is_watched() -> bool:
    """Whether a person looks at what this process says: in a notebook, or on a terminal.

    Processes beside each other would write over each other. A level of the logger ``pyburgers``
    above INFO asks for quiet.
    """
    is_quiet = logging.getLogger(PACKAGE).level > logging.INFO
    return not is_quiet and parent_process() is None and (in_notebook() or sys.stderr.isatty())


@contextmanager
def messages_where_watched() -> Iterator[None]:
    """Write messages to standard error if a person looks and nobody has asked for any level."""
    if is_watched() and logging.getLogger(PACKAGE).level == logging.NOTSET:
        with messages_to(sys.stderr):
            yield
    else:
        yield


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
