"""Exceptions: one class for each exit code of the command line, and words for their sentences."""

from collections.abc import Iterable
from difflib import get_close_matches


class PyburgersError(Exception):
    """A run could not be done; the message is one sentence for the user.

    The command line prints the message and exits with `exit_code`.
    """

    exit_code = 1


class InputError(PyburgersError):
    """A file, a key, a column or an option is not what it has to be."""

    exit_code = 2


class ToolchainError(PyburgersError):
    """CmdStan, the C++ compiler or make is missing or failed."""


class SamplingError(PyburgersError):
    """Stan ran but gave nothing usable."""


class SystemFailureError(PyburgersError):
    """The system did not start a program, or ended it: says nothing about model and data."""


def nearest(name: str, valid: Iterable[str]) -> str:
    """Return the end of a sentence: the valid spelling nearest to `name`, or all of them."""
    names = list(valid)
    close = get_close_matches(name, names, n=1)
    return f"did you mean {close[0]!r}?" if close else f"expected one of {', '.join(names)}."
