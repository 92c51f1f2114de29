"""`pyburgers check`: the checks of a run again, also in the files that hold them."""

import argparse
import logging
from pathlib import Path

from pyburgers.cli.terminal import print_checks, print_lines
from pyburgers.comparison.conclusions import what_a_yes_leaves_open
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import DIFFERENT, MISSING, renew_tables
from pyburgers.flow_law_tables.fit import fit_of_run

logger = logging.getLogger(__name__)


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    what = "run directory of fit or fit-rates"
    command.add_argument("directory", type=Path, metavar="RUN", help=what)


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    fit = fit_of_run(options.directory)
    try:
        for name, why in renew_tables(fit).items():
            logger.info(f"{fit.directory.path}: {name} {why}; the command has written it again.")
    except OSError as error:
        is_there = Path(error.filename).is_file()
        logger.info(
            f"{error.filename}: {error.strerror}; the file "
            f"{f'stays as it is, which {DIFFERENT}' if is_there else MISSING}."
        )
    print_lines(fit.origins)
    code = print_checks(fit.checks(), fit.prior_conflicts(), fit.prior_decisions())
    if isinstance(fit, Fit):
        print_lines(what_a_yes_leaves_open(fit))
    return code
