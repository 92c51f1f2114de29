"""`pyburgers reproduce`: the study of the paper."""

import argparse
from pathlib import Path

from pyburgers.cli.shared import command_line
from pyburgers.predictions.measured_attenuation import load_measured_attenuation
from pyburgers.studies.maor.reproduce import PRESETS, reproduce


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument("--preset", choices=sorted(PRESETS), default="quick")
    command.add_argument("--out", type=Path, default=Path("report"), metavar="DIR")
    command.add_argument(
        "--measured",
        type=Path,
        metavar="POINTS.csv",
        help="measured attenuation of ice to draw over the predicted: columns frequency_Hz, "
        "tan_delta and, if you like, tan_delta_sd and series",
    )


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    measured = None if options.measured is None else load_measured_attenuation(options.measured)
    outcome = reproduce(options.preset, options.out, command=command_line(), measured=measured)
    print(f"The page is {outcome.page}")
    return 0
