"""Somebody who answers questions at a terminal."""

import io
import sys
from collections.abc import Callable

import pytest


class Terminal(io.StringIO):
    """A stream of a terminal."""

    def isatty(self) -> bool:
        return True


def answer_with(patch: pytest.MonkeyPatch, answer: Callable[[str], str]) -> None:
    """Have each question of a command answered by a function of the question."""
    patch.setattr(sys, "stdin", Terminal())
    patch.setattr("builtins.input", answer)
