"""Exceptions: one class for each exit code of the command line, and words for their sentences."""

from collections.abc import Iterable, Sequence
from difflib import get_close_matches
from typing import TypeVar, cast

T = TypeVar("T")


class PyburgersError(Exception):
    """A run could not be done; the message is one sentence for the user.

    The command line prints the message and exits with `exit_code`.

    Examples
    --------
    >>> issubclass(pyburgers.InputError, pyburgers.PyburgersError)
    True
    """

    exit_code = 1


class InputError(PyburgersError):
    """A file, a key, a column or an option is not what it has to be.

    Parameters
    ----------
    *sentences : str
        Faults, one sentence each. The first is the message.

    Examples
    --------
    >>> try:
    ...     pyburgers.Regime(median_stress=-1.0, amplitude=1e5)
    ... except pyburgers.InputError as error:
    ...     print(error)
    median_stress: found -1 Pa, expected zero or a positive stress.
    """

    exit_code = 2

    def __init__(self, *sentences: str) -> None:
        super().__init__(*sentences)
        self.sentences = sentences

    def __str__(self) -> str:
        """Return the first sentence."""
        return self.sentences[0]


class StructureError(InputError):
    """Keys at fault, a sentence each; `faults` say where they are and whether they are unknown."""

    def __init__(
        self, *sentences: str, faults: Sequence[tuple[tuple[int | str, ...], bool]]
    ) -> None:
        super().__init__(*sentences)
        self.faults = tuple(faults)


class ToolchainError(PyburgersError):
    """CmdStan, the C++ compiler or make is missing or failed.

    Examples
    --------
    >>> issubclass(pyburgers.ToolchainError, pyburgers.PyburgersError)
    True
    """


class SamplingError(PyburgersError):
    """Stan ran but gave nothing usable.

    Examples
    --------
    >>> issubclass(pyburgers.SamplingError, pyburgers.PyburgersError)
    True
    """


class SystemFailureError(PyburgersError):
    """The system did not start a program, or ended it: says nothing about model and data.

    Examples
    --------
    >>> issubclass(pyburgers.SystemFailureError, pyburgers.PyburgersError)
    True
    """


def require_type(name: str, found: object, kind: type | tuple[type, ...], expected: str) -> None:
    """Refuse an argument of another type; `expected` says in words how one is made."""
    if not isinstance(found, kind):
        shown = f"{found!r:.60}" if isinstance(found, str | int | float) else type(found).__name__
        raise InputError(f"{name}: found {shown}, expected {expected}.")


def one_or_several(name: str, given: T | Sequence[T], kind: type, expected: str) -> list[T]:
    """Return an argument that is one of a type or several, at least one, as a list."""
    require_type(name, given, (kind, list, tuple), expected)
    found: list[T] = list(given) if isinstance(given, list | tuple) else [cast("T", given)]
    if not found:
        raise InputError(f"{name}: found none, expected {expected.split(',')[0]} or several.")
    for one in found:
        require_type(name, one, kind, expected)
    return found


def nearest(name: object, valid: Iterable[str]) -> str:
    """Return the end of a sentence: the valid spelling nearest to `name`, or all of them."""
    names = list(valid)
    close = get_close_matches(str(name), names, n=1)
    if close:
        return f"did you mean {close[0]!r}?"
    return f"expected {'one of ' * (len(names) > 1)}{', '.join(names)}."
