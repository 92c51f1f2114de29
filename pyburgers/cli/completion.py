"""What a shell completes; options of commands are kept, because their modules load slowly."""

import argparse
import json
import os
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

COMPLETING = "_ARGCOMPLETE"
"""Environment variable that a shell sets when it asks for completions."""


class _Kept(argparse.Action):
    """An argument of which only is known what may stand on the line."""

    def __call__(self, *_: object, **__: object) -> None:
        """Take a value, and do nothing with it."""


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer a shell that asks what may stand next; ends the process."""
    import argcomplete

    argcomplete.autocomplete(parser, always_complete_options="long")


def words_to_complete() -> list[str]:
    """Return the words that stand on the line of a shell that asks what may stand next."""
    return os.environ.get("COMP_LINE", "").split()[1:]


def complete_with(action: argparse.Action, choices: Sequence[str]) -> None:
    """Give a shell what an argument may be, where others are possible too."""

    def completer(**_: object) -> Sequence[str]:
        return choices

    vars(action)["completer"] = completer


def add_arguments(command: argparse.ArgumentParser, module: str) -> None:
    """Give a parser the arguments of its command: those that were kept, else the module's."""
    # Only here: every command imports this module.
    from pyburgers.cmdstan.compilation import cache_directory
    from pyburgers.common.atomic_files import write_json

    file = cache_directory() / "completion" / f"{module}.json"
    package = _state_of_package()
    with suppress(OSError, ValueError, LookupError, TypeError):
        kept = json.loads(file.read_text(encoding="utf-8"))
        if kept["package"] == package:
            _restore(command, kept["arguments"])
            return
    import_module(module).add_options(command)
    with suppress(OSError):  # it is only slower without
        file.parent.mkdir(parents=True, exist_ok=True)
        write_json(file, {"package": package, "arguments": _kept(command)})


def _state_of_package() -> list[float]:
    """Return the number of modules of the package, and when the last of them was changed."""
    changed = [file.stat().st_mtime for file in Path(__file__).parents[1].rglob("*.py")]
    return [len(changed), max(changed)]


def _kept(parser: argparse.ArgumentParser) -> list[dict[str, Any]]:
    """Return what there is to know of a parser's arguments, as JSON holds it."""
    found = []
    for action in parser._actions:
        if isinstance(action, argparse._HelpAction):
            continue
        below = isinstance(action, argparse._SubParsersAction)
        completer = vars(action).get("completer")
        found.append(
            {
                "names": action.option_strings or [action.dest],
                "nargs": action.nargs,
                "choices": None if below or action.choices is None else [*map(str, action.choices)],
                "completed": None if completer is None else [*completer()],
                "parsers": {name: _kept(one) for name, one in action.choices.items()}
                if isinstance(action, argparse._SubParsersAction)
                else None,
            }
        )
    return found


def _restore(parser: argparse.ArgumentParser, arguments: Sequence[dict[str, Any]]) -> None:
    """Give a parser kept arguments."""
    for one in arguments:
        if one["parsers"] is not None:
            commands = parser.add_subparsers()
            for name, own in one["parsers"].items():
                _restore(commands.add_parser(name), own)
            continue
        action = parser.add_argument(
            *one["names"], action=_Kept, nargs=one["nargs"], choices=one["choices"]
        )
        if one["completed"] is not None:
            complete_with(action, one["completed"])
