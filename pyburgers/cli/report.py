"""`pyburgers report`: one page about runs."""

import argparse
import logging
from pathlib import Path

from pyburgers.cli.shared import command_line
from pyburgers.common.errors import InputError
from pyburgers.common.paths import shown
from pyburgers.fitting.fit import Fit
from pyburgers.flow_law_tables.fit import RateFit, fit_of_run
from pyburgers.page.names import file_key, names_of_runs
from pyburgers.page.page import report
from pyburgers.page.rate_section import RATE_KEY

logger = logging.getLogger(__name__)


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument(
        "directories",
        type=Path,
        nargs="+",
        metavar="RUN",
        help="run directory of fit or fit-rates",
    )
    command.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder of the page, new or that of an earlier page",
    )
    command.add_argument("--title", help="of the page")


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    found, damaged = list[Fit | RateFit](), list[InputError]()
    for one in options.directories:
        try:
            found.append(fit_of_run(one))
        except InputError as error:
            damaged.append(error)
    if damaged and not found:
        raise damaged[0]
    loaded = [fit for fit in found if isinstance(fit, Fit)]
    of_tables = [fit for fit in found if isinstance(fit, RateFit)]
    names = names_of_runs([fit.directory.path for fit in of_tables])
    tables = {
        f"{RATE_KEY}_{file_key(name)}": fit for name, fit in zip(names, of_tables, strict=True)
    }
    page = report(loaded, options.out, title=options.title, command=command_line(), tables=tables)
    for one in damaged:
        logger.info(f"{one} The page is about the other runs.")
    print(shown(f"The page is {page}"))
    return InputError.exit_code if damaged else 0
