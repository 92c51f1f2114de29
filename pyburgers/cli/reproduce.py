"""`pyburgers reproduce`: the study of the paper."""

import argparse
from pathlib import Path

from pyburgers.cli.shared import command_line
from pyburgers.studies.maor.reproduce import PRESETS, reproduce


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument("--preset", choices=sorted(PRESETS), default="quick")
    command.add_argument("--out", type=Path, default=Path("report"), metavar="DIR")


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    outcome = reproduce(options.preset, options.out, command=command_line())
    print(f"The page is {outcome.page}")
    return 0
