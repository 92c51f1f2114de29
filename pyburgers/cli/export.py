"""`pyburgers export`: flow law and elements of a fit, for use in other codes."""

import argparse
from pathlib import Path

from pyburgers.cli.outputs import check_output
from pyburgers.cli.shared import writing
from pyburgers.common.atomic_files import write_text
from pyburgers.common.errors import InputError
from pyburgers.common.paths import shown
from pyburgers.fitting.fit import Fit
from pyburgers.flow_law_tables.fit import PeakStressFit, is_peak_stress_run
from pyburgers.predictions.exported import (
    FORMATS,
    Exported,
    exported,
    exported_table,
    is_exported,
)


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument(
        "directory", type=Path, metavar="RUN", help="run directory of fit or fit-peak-stress"
    )
    command.add_argument("--format", choices=sorted(FORMATS), default="json", help="of the output")
    command.add_argument("--test", metavar="ID", help="test of a joint fit")
    command.add_argument("--out", type=Path, metavar="FILE", help="default standard output")


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    if options.out is not None:
        check_output(options.out, options.directory)
        _require_own(options.out)
    text = FORMATS[options.format](_exported(options.directory, options.test))
    if options.out is None:
        print(text, end="")
        return 0
    with writing(options.out):
        write_text(options.out, text)
    print(shown(options.out))
    return 0


def _require_own(out: Path) -> None:
    """Refuse to write over what somebody else has written: no input tells which files those are."""
    if out.is_file() and out.stat().st_size and not is_exported(out):
        raise InputError(
            f"--out {out}: holds something else than an export, expected a new file or an earlier "
            "export."
        )


def _exported(directory: Path, test: str | None) -> Exported:
    """Return the numbers of a fit, of a test of a joint one, or of a table of peak stresses."""
    if is_peak_stress_run(directory):
        if test is not None:
            raise InputError(
                f"--test: found {test}, expected none: {directory} is a fit of a table of peak "
                "stresses."
            )
        return exported_table(PeakStressFit.load(directory))
    fit = Fit.load(directory)
    return exported(fit if test is None else fit[test])
