"""`pyburgers report`: one page about runs."""

import argparse
from pathlib import Path

from pyburgers.cli.shared import command_line
from pyburgers.fitting.fit import Fit
from pyburgers.report.comparison_sections import comparison_sections
from pyburgers.report.joint_section import joint_sections
from pyburgers.report.page import write_report


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument("directories", type=Path, nargs="+", metavar="RUN")
    command.add_argument("--out", type=Path, required=True, metavar="DIR")
    command.add_argument("--title", default="Nonlinear Burgers fits")


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    loaded = [Fit.load(directory) for directory in options.directories]
    joints = [fit for fit in loaded if fit.is_joint]
    fits = [fit for fit in loaded if not fit.is_joint]
    sections = joint_sections(joints, fits)
    fits = [*(fit for joint in joints for fit in joint.tests().values()), *fits]
    page = write_report(
        fits,
        options.out,
        title=options.title,
        command=command_line(),
        joints=joints,
        extras=(*sections, *comparison_sections([*joints, *fits])),
    )
    print(f"The page is {page}")
    return 0
