"""`pyburgers fit-rates`: a composite flow law from tables of steady rates."""

import argparse
import logging
from dataclasses import replace
from pathlib import Path

from pyburgers.cli.shared import (
    DEFAULT_OPTIONS,
    add_sampler_options,
    command_line,
    sampler_options,
)
from pyburgers.cli.terminal import print_checks, print_table
from pyburgers.common.paths import shown
from pyburgers.drawing.style import write_images
from pyburgers.flow_law_tables.rate_fit import WARMUP, fit_rates
from pyburgers.flow_law_tables.rate_laws import load_rate_law, rate_law
from pyburgers.flow_law_tables.rate_tables import load_rate_table
from pyburgers.model.priors import load_priors
from pyburgers.page.rate_section import held_out_shown, law_figure, law_table

logger = logging.getLogger(__name__)

RATE_OPTIONS = ("chains", "warmup", "draws", "seed")
"""Settings of the sampler that suit these fits."""


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument(
        "data", type=Path, nargs="+", metavar="TABLE.toml", help="tables of rates of one material"
    )
    command.add_argument(
        "--law",
        metavar="LAW",
        help="a file, or a law that comes with the package, such as ice_composite (default: the "
        "material's power law)",
    )
    command.add_argument(
        "--hold-out",
        action="append",
        default=[],
        metavar="SOURCE",
        help="predict the tests of a source (by default a table's id) in place of fitting them; "
        "may be repeated",
    )
    command.add_argument(
        "--curve-priors",
        type=Path,
        metavar="PRIORS.toml",
        help="priors of a curve, by which the tests are softened; the flow law of undeformed "
        "material is then a prior for curves (fit --priors-from)",
    )
    command.add_argument("--out", type=Path, help="run directory (default: runs/ID)")
    add_sampler_options(command, RATE_OPTIONS, replace(DEFAULT_OPTIONS, warmup=WARMUP))


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    tables = [load_rate_table(path) for path in options.data]
    law = None
    if options.law is not None:
        is_file = Path(options.law).suffix == ".toml"
        law = load_rate_law(options.law) if is_file else rate_law(options.law)
    name = tables[0].id if len(tables) == 1 else "rates"
    result = fit_rates(
        tables,
        law,
        held_out=options.hold_out,
        curve=None if options.curve_priors is None else load_priors(options.curve_priors),
        out=options.out or Path("runs") / name,
        options=sampler_options(options, RATE_OPTIONS),
        command=command_line(),
    )
    for notice in result.data.notices:
        logger.info(f"note: {notice}")
    folder = result.directory.path
    write_images(law_figure(result), folder / "flow_law.png")
    print_table(law_table(result), ["quantity", "unit"])
    if options.hold_out:
        print_table(held_out_shown(result), ["source"])
    print(shown(f"run directory: {folder}"))
    return print_checks(result.checks(), result.prior_conflicts(), result.prior_decisions())
