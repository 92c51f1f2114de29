"""`pyburgers check`: the checks of a run again."""

import argparse
from pathlib import Path

from pyburgers.cli.terminal import print_checks
from pyburgers.fitting.fit import Fit
from pyburgers.flow_law_tables.fit import PeakStressFit, is_peak_stress_run


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument("directory", type=Path, metavar="RUN")


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    kind = PeakStressFit if is_peak_stress_run(options.directory) else Fit
    fit = kind.load(options.directory)
    return print_checks(fit.checks(), fit.prior_conflicts())
