"""`pyburgers report`: one page about runs."""

import argparse
from pathlib import Path

from pyburgers.cli.shared import command_line
from pyburgers.common.paths import shown
from pyburgers.fitting.fit import Fit
from pyburgers.flow_law_tables.fit import PeakStressFit, is_peak_stress_run
from pyburgers.page.names import file_key, names_of_runs
from pyburgers.page.peak_stress_section import PEAK_STRESS_KEY
from pyburgers.page.report import report


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument(
        "directories",
        type=Path,
        nargs="+",
        metavar="RUN",
        help="run directory of fit or fit-peak-stress",
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
    of_tables = [one for one in options.directories if is_peak_stress_run(one)]
    loaded = [Fit.load(one) for one in options.directories if one not in of_tables]
    tables = {
        f"{PEAK_STRESS_KEY}_{file_key(name)}": PeakStressFit.load(directory)
        for name, directory in zip(names_of_runs(of_tables), of_tables, strict=True)
    }
    page = report(loaded, options.out, title=options.title, command=command_line(), tables=tables)
    print(shown(f"The page is {page}"))
    return 0
