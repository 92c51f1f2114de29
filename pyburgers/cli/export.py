"""`pyburgers export`: flow law and elements of a fit, for use in other codes."""

import argparse
from pathlib import Path

from pyburgers.cli.shared import writing
from pyburgers.common.atomic_files import write_text
from pyburgers.fitting.fit import Fit
from pyburgers.predictions.exported import FORMATS, exported


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument("directory", type=Path, metavar="RUN")
    command.add_argument("--format", choices=sorted(FORMATS), default="json", help="of the output")
    command.add_argument("--test", metavar="ID", help="test of a joint fit")
    command.add_argument("--out", type=Path, metavar="FILE", help="default standard output")


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    fit = Fit.load(options.directory)
    text = FORMATS[options.format](exported(fit if options.test is None else fit[options.test]))
    if options.out is None:
        print(text, end="")
        return 0
    with writing(options.out):
        write_text(options.out, text)
    print(options.out)
    return 0
