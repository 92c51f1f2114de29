"""`pyburgers reproduce`: the study of the paper."""

import argparse
from pathlib import Path

from pyburgers.cli.shared import command_line
from pyburgers.cli.workers import add_worker_options, workers_of
from pyburgers.common.errors import InputError
from pyburgers.common.paths import shown
from pyburgers.predictions.measured_attenuation import load_measured_attenuation
from pyburgers.studies.maor.reproduce import PRESETS, fit_part, reproduce


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument(
        "--preset", choices=sorted(PRESETS), default="quick", help="how long chains are"
    )
    command.add_argument(
        "--out", type=Path, default="report", metavar="DIR", help="folder of page and runs"
    )
    command.add_argument(
        "--main",
        action="store_true",
        help="only the main part: a test of measured dunite, one curve of ice, the olivine "
        "oscillation, and the attenuation of ice",
    )
    command.add_argument(
        "--measured",
        type=Path,
        metavar="POINTS.csv",
        help="measured attenuation of ice to draw over the predicted: columns frequency_Hz, "
        "tan_delta and, if you like, tan_delta_sd and series",
    )
    add_worker_options(command)


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    measured = None if options.measured is None else load_measured_attenuation(options.measured)
    if options.main and options.part is not None:
        raise InputError(
            "--part: is of the whole study, which --main is not; leave one of them out."
        )
    preset, out, command = options.preset, options.out, command_line()
    with workers_of(options) as workers:
        if options.part is not None:
            fit_part(preset, out, workers=workers, command=command)
            print("fits of part {}/{} are done".format(*options.part))
            return 0
        outcome = reproduce(
            preset,
            out,
            main=options.main,
            workers=workers,
            command=command,
            measured=measured,
        )
    print(shown(f"The page is {outcome.page}"))
    return 0
