"""`pyburgers design RUN --candidates PLAN.toml`: which test would decide a quantity."""

import argparse
from pathlib import Path

import pandas as pd

from pyburgers.cli.outputs import check_output
from pyburgers.cli.shared import writing
from pyburgers.common.atomic_files import write_text
from pyburgers.common.csv_tables import csv_text
from pyburgers.common.errors import InputError
from pyburgers.common.paths import shown
from pyburgers.fitting.fit import Fit
from pyburgers.predictions.design_plans import load_design_plan
from pyburgers.predictions.designs import design


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument("directory", type=Path, metavar="RUN", help="run directory of fit")
    command.add_argument(
        "--candidates",
        type=Path,
        required=True,
        metavar="PLAN.toml",
        help="tests that may be done, and the parameters that they are to narrow",
    )
    command.add_argument(
        "--against",
        type=Path,
        metavar="RUN",
        help="fit of the same data with another law: which test tells the laws apart",
    )
    command.add_argument(
        "--choose", type=int, default=3, metavar="N", help="tests chosen one after the other"
    )
    command.add_argument(
        "--draws", type=int, default=1000, metavar="N", help="draws that are solved (1000)"
    )
    command.add_argument("--seed", type=int, default=1, help="seed of the noise of new readings")
    command.add_argument(
        "--out", type=Path, required=True, metavar="FILE.csv", help="table of the candidates"
    )


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    out: Path = options.out
    if out.suffix != ".csv":
        raise InputError(f"--out {out}: expected a file name that ends in .csv.")
    if options.choose < 1:
        raise InputError(f"--choose: found {options.choose}, expected at least 1.")
    together = out.with_name(f"{out.stem}_together.csv")
    check_output(out, options.directory, options.candidates, beside=("_together.csv",))
    plan = load_design_plan(options.candidates)
    found = design(
        Fit.load(options.directory),
        plan,
        against=None if options.against is None else Fit.load(options.against),
        choose=options.choose,
        draws=options.draws,
        seed=options.seed,
    )
    with writing(out):
        write_text(out, csv_text(found.table.reset_index()))
        write_text(together, csv_text(found.together))
    for sentence in found.cautions:
        print(sentence)
    print("Expected width of each quantity after a test, over its width now (1: nothing learned):")
    print(_shown(found.table.reset_index()))
    print("\nOne after the other:")
    if found.together.empty:
        print("No candidate lies within the limits of the apparatus, so that none is chosen.")
    else:
        print(_shown(found.together))
    for file in (out, together):
        print(shown(file))
    return 0


def _shown(table: pd.DataFrame) -> str:
    """Table for people: three digits, nothing for what is unknown."""
    return str(table.to_string(index=False, float_format="{:.3g}".format, na_rep=""))
