"""`pyburgers completion`: a script with which a shell completes commands, options and values."""

import argparse
from pathlib import Path

import shtab

from pyburgers.cli.main import COMMANDS, parser_with
from pyburgers.cli.parser import all_arguments

SHELLS = ("bash", "zsh", "fish", "tcsh")


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument("shell", choices=SHELLS, help="for which the script is")


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    parser = parser_with(COMMANDS)
    for action in all_arguments(parser):
        if action.type is Path:
            vars(action)["complete"] = shtab.FILE
        action.choices = vars(action).get("offered", action.choices)
    print(shtab.complete(parser, options.shell))
    return 0
