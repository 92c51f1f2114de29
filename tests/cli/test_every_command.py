"""What holds for every command and each of its arguments, taken from the parser itself."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from refusals import CommandLine

from pyburgers.cli.main import COMMANDS, main, parser_with
from pyburgers.cli.parser import HelpWithDefaults, all_arguments

NO_TEXT = "a\udcffb"


def commands_below(
    parser: argparse.ArgumentParser, *words: str
) -> Iterator[tuple[tuple[str, ...], argparse.ArgumentParser]]:
    """Words of each command that has arguments of its own, with its parser."""
    below = [one for one in parser._actions if isinstance(one, argparse._SubParsersAction)]
    if not below:
        yield words, parser
    for action in below:
        for name, choice in action.choices.items():
            yield from commands_below(choice, *words, name)


PARSERS = dict(commands_below(parser_with(COMMANDS)))
TAKING_VALUES = [
    pytest.param(words, action, id=" ".join([*words, (action.option_strings or [action.dest])[-1]]))
    for words, parser in PARSERS.items()
    for action in parser._actions
    if action.nargs != 0
]


def value_of(action: argparse.Action) -> str:
    """A value that the parser takes."""
    if action.choices is not None:
        return str(next(iter(action.choices)))
    return "1" if action.type in (int, float) else "some.toml"


def wrong_value_of(action: argparse.Action) -> str:
    """A value that no argument of its type takes: an empty path, a word, bytes that are no text."""
    if action.type is Path:
        return ""
    return NO_TEXT if action.type in (None, str) and action.choices is None else "wrong"


def with_value(action: argparse.Action, value: str) -> list[str]:
    """Words of an argument, its value as often as it wants several; an option begins with `--`."""
    number = action.nargs if isinstance(action.nargs, int) else 1
    if action.option_strings and number == 1 and value:
        return [f"{action.option_strings[-1]}={value}"]
    return [*action.option_strings[-1:], *[value] * number]


def command_with(words: tuple[str, ...], wrong: argparse.Action | None = None) -> list[str]:
    """A command with all that it requires, the value of one argument wrong."""
    parser, command = PARSERS[words], [*words]
    for group in parser._mutually_exclusive_groups:
        if group.required and wrong not in group._group_actions:
            command += with_value(group._group_actions[0], value_of(group._group_actions[0]))
    for action in parser._actions:
        if action is wrong:
            command += with_value(action, wrong_value_of(action))
        elif is_required(action):
            command += with_value(action, value_of(action))
    return command


def is_required(action: argparse.Action) -> bool:
    return action.required and action.nargs not in ("*", "?")


def test_every_command_is_there() -> None:
    assert {words[0] for words in PARSERS} == set(COMMANDS)


@pytest.mark.parametrize(("words", "action"), TAKING_VALUES)
def test_a_wrong_value_is_refused_by_the_name_of_its_argument(
    words: tuple[str, ...],
    action: argparse.Action,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    cli: CommandLine,
) -> None:
    monkeypatch.chdir(tmp_path)
    name = [*action.option_strings, action.metavar or action.dest][0]
    cli.refused(command_with(words, action), f"argument {name}: ")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", PARSERS, ids=" ".join)
def test_help_and_what_is_missing_or_unknown(
    words: tuple[str, ...], cli: CommandLine, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        main([*words, "--help"])
    assert stopped.value.code == 0
    out = capsys.readouterr().out
    assert out.startswith(f"usage: pyburgers {words[0]}")
    assert len(words) > 1 or "4 it was sampled well, but" in " ".join(out.split())
    required = [one for one in PARSERS[words]._actions if is_required(one)]
    if required:
        names = [str([*one.option_strings, one.metavar or one.dest][0]) for one in required]
        cli.refused(words, "missing: ", *names)
    for name in PARSERS[words]._option_string_actions:
        said = f"unknown option {name}q, did you mean --"
        if name.startswith("--"):
            cli.refused([*command_with(words), f"{name}q"], said)


@pytest.mark.parametrize(
    "argument",
    [*all_arguments(parser_with(COMMANDS))],
    ids=lambda one: "/".join(one.option_strings) or one.dest,
)
def test_every_argument_has_help_that_ends_with_its_default(argument: argparse.Action) -> None:
    if isinstance(argument, argparse._SubParsersAction):
        return
    assert argument.help
    default: Any = argument.default
    if argument.option_strings and default not in (None, False, [], argparse.SUPPRESS):
        text = HelpWithDefaults("command")._get_help_string(argument)
        shown = " ".join(map(str, default)) if isinstance(default, tuple) else default
        assert text == f"{argument.help}; default {shown}".replace("%", "%%")
