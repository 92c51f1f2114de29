"""Where messages about progress go: to the logger of the package, and from there where asked."""

import logging
import re
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from multiprocessing import parent_process
from typing import Any, TextIO

PACKAGE = "pyburgers"
"""The logger above those of all modules."""

PATIENCE = 60.0
"""Seconds without a message after which there is one about progress."""


logger = logging.getLogger(__name__)

LONGEST_MESSAGE = 4000
"""Letters of a message, which files of others may make as long as they are."""

_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")
"""Characters with which a text can move the cursor, hide itself or turn its order round."""


def printable(text: str) -> str:
    """Return a text whose control characters, but for tabs and ends of lines, are escaped."""
    return _CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def message_text(text: str) -> str:
    """Return a message as it is printed: printable, and the middle cut out if it is too long."""
    if len(text) > LONGEST_MESSAGE:
        part = LONGEST_MESSAGE // 2
        text = f"{text[:part]} [{len(text) - 2 * part} letters left out] {text[-part:]}"
    return printable(text)


def tell_notes(sentences: Iterable[str]) -> None:
    """Note sentences, each once."""
    for sentence in dict.fromkeys(sentences):
        logger.info(f"note: {sentence}")


class PrintableStream:
    """A stream of text that prints nothing but printable text; else as `bare`, the one below."""

    def __init__(self, bare: TextIO) -> None:
        self.bare = bare

    def write(self, text: str) -> int:
        """Write a text."""
        return self.bare.write(printable(text))

    def writelines(self, texts: Iterable[str]) -> None:
        """Write texts."""
        self.write("".join(texts))

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the stream below."""
        return getattr(self.bare, name)


class Lines(logging.Formatter):
    """Messages as they are printed, each line behind the name of who speaks, if there is one."""

    def __init__(self, name: str | None) -> None:
        super().__init__()
        self._start = "" if name is None else f"{name}: "

    def format(self, record: logging.LogRecord) -> str:
        """Return the lines of a message."""
        lines = message_text(super().format(record)).splitlines()
        return "\n".join(self._start + line for line in lines)


def in_notebook() -> bool:
    """Whether the process is the kernel of a notebook."""
    module = sys.modules.get("IPython")
    return module is not None and hasattr(module.get_ipython(), "kernel")


def is_watched() -> bool:
    """Whether a person watches this process, on a terminal or in a notebook, and wants messages."""
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
    handler.setFormatter(Lines(name))
    before = package.level
    package.addHandler(handler)
    package.setLevel(logging.INFO)
    try:
        yield
    finally:
        package.setLevel(before)
        package.removeHandler(handler)
