"""`pyburgers priors`: a shipped prior file, to be changed for a new material."""

import argparse

from pyburgers.kinds.likelihood import NAMES
from pyburgers.model.priors import shipped_file


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument("material", help="whose priors are printed, such as ice")
    command.add_argument(
        "--protocol", choices=NAMES, help="kind of test, if it has priors of its own"
    )


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    file = shipped_file(options.material, options.protocol)
    print(file.read_text(encoding="utf-8"), end="")
    return 0
