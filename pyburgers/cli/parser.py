"""The parser of the command line: errors in one line, defaults and choices in the help."""

import argparse
from collections.abc import Iterator, Sequence
from difflib import get_close_matches
from importlib.metadata import version
from pathlib import Path
from typing import Any, NoReturn

from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path

_REQUIRED = "the following arguments are required: "
"""How argparse begins what it says of arguments that are missing."""


class ShowVersion(argparse.Action):
    """Print the version, which is looked up only when it is asked for."""

    def __init__(self, option_strings: Sequence[str], dest: str, **_: Any) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, help="the version, and end")

    def __call__(self, parser: argparse.ArgumentParser, *_: object, **__: object) -> None:
        """Print it and end."""
        print(f"pyburgers {version('pyburgers')}")
        parser.exit()


class HelpWithDefaults(argparse.HelpFormatter):
    """Help that ends with the default of an option, if the default says something."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        text, default = action.help or "", action.default
        told = default is None or default is argparse.SUPPRESS or default in ([], False)
        if told or not action.option_strings:
            return text
        shown = " ".join(map(str, default)) if isinstance(default, list | tuple) else default
        ending = f"default {shown}".replace("%", "%%")
        return f"{text}; {ending}" if text else ending


def is_text(text: str) -> bool:
    """Tell whether files can hold a typed text: bytes that are no text cannot be encoded again."""
    return text.encode("utf-8", "ignore").decode("utf-8") == text


def all_arguments(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Return the arguments of a parser and of those below it."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from all_arguments(below)


def _path(text: str) -> Path:
    """Return an absolute path; an empty text, such as of an unset shell variable, is none."""
    if not text:
        raise argparse.ArgumentTypeError("found an empty text, expected a path")
    return given_path(text)


class OneLineParser(argparse.ArgumentParser):
    """Says in one line what is wrong with the arguments of a command."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **{"formatter_class": HelpWithDefaults, **kwargs})
        # Every path of every command: `Path("")` is the working directory.
        self.register("type", Path, _path)

    def error(self, message: str) -> NoReturn:
        """Refuse the arguments with the help of the command."""
        if message.startswith(_REQUIRED):
            message = f"missing: {self._with_help(message.removeprefix(_REQUIRED))}"
        raise InputError(f"{message.rstrip('.')}; see `{self.prog} --help`.")

    def _with_help(self, names: str) -> str:
        """Return names of arguments, those of places on the line with what they are."""
        placed = {action.metavar: action for action in self._actions if not action.option_strings}
        return ", ".join(
            f"{name} ({placed[name].help})" if name in placed and placed[name].help else name
            for name in names.split(", ")
        )

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        """Return the value of an argument; a text that is kept has to be text in files, too."""
        value = super()._get_value(action, arg_string)
        # Names of files may be any bytes. The words of a command are read again, as what they are.
        is_kept = isinstance(value, str) and not isinstance(action, argparse._SubParsersAction)
        if is_kept and not is_text(value):
            raise argparse.ArgumentError(
                action, f"found {value!r} with bytes that are no text, expected text"
            )
        return value

    def require_own(self, option: str) -> None:
        """Refuse an option ahead of the command that is none of the program itself."""
        name = option.split("=")[0]
        own = [text for action in self._actions for text in action.option_strings]
        if any(text.startswith(name) for text in own):  # they may be shortened
            return
        meant = get_close_matches(name, own, n=1)
        end = f"did you mean {meant[0]}?" if meant else f"expected a command first; {self._see()}"
        raise InputError(f"unknown option {name}, {end}")

    def parse_all(self, arguments: Sequence[str]) -> argparse.Namespace:
        """Parse arguments, all of which have to be known."""
        parsed, unknown = self.parse_known_args(arguments)
        if not unknown:
            return parsed
        name = unknown[0].split("=")[0]
        meant = get_close_matches(name, self._long_options(), n=1) if name.startswith("-") else []
        end = self._see(*arguments[:1])
        if meant == [name]:
            end = f"which is another command's; {end}"
        elif meant:
            end = f"did you mean {meant[0]}?"
        kind = "option" if name.startswith("-") else "argument"
        raise InputError(f"unknown {kind} {name}, {end}")

    def _long_options(self) -> list[str]:
        """Return the long options of the parser and of those below it."""
        names = (name for action in all_arguments(self) for name in action.option_strings)
        return [name for name in names if name.startswith("--")]

    def _see(self, *command: str) -> str:
        return f"see `{' '.join([self.prog, *command])} --help`."
