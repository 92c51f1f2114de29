"""`pyburgers fit-rates`: a composite flow law from tables of steady rates."""

import argparse
import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from pyburgers.cli.hints import log_hints
from pyburgers.cli.shared import (
    DEFAULT_OPTIONS,
    add_options_of_runs_there,
    add_sampler_options,
    command_line,
    sampler_options,
)
from pyburgers.cli.terminal import print_checks, print_lines, print_table
from pyburgers.common.paths import shown
from pyburgers.common.tables_in_files import read_once
from pyburgers.drawing.style import write_images
from pyburgers.flow_law_tables.fit_rates import TARGET_ACCEPTANCE, WARMUP, fit_rates
from pyburgers.flow_law_tables.laws import load_rate_law, rate_law
from pyburgers.flow_law_tables.table_files import load_rate_table
from pyburgers.flow_law_tables.tables import joined, without_test
from pyburgers.kinds.kind import load_experiment
from pyburgers.model.priors import load_priors, priors
from pyburgers.page.rate_section import held_out_shown, law_figure, law_table

logger = logging.getLogger(__name__)

T = TypeVar("T")

RATE_OPTIONS = ("chains", "warmup", "draws", "seed", "adapt_delta", "max_treedepth")
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
        "material's power law, if there is one)",
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
        metavar="PRIORS",
        help="priors of a curve (a file, or a material such as ice), by which the tests are "
        "softened; the flow law of undeformed material is then a prior for curves (fit "
        "--priors-from)",
    )
    command.add_argument(
        "--without",
        type=Path,
        action="append",
        default=[],
        metavar="EXPERIMENT.toml",
        help="leave out the rows that may be this test, so that its curve can be fitted with the "
        "flow law of the others; may be repeated",
    )
    command.add_argument("--out", type=Path, help="run directory (default: runs/ID)")
    defaults = replace(DEFAULT_OPTIONS, warmup=WARMUP, adapt_delta=TARGET_ACCEPTANCE)
    add_sampler_options(command, RATE_OPTIONS, defaults)
    add_options_of_runs_there(command)


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    with read_once():
        data = joined(
            [load_rate_table(path) for path in options.data],
            options.hold_out,
            softened=options.curve_priors is not None,
        )
        log_hints(options.data)
    for path in options.without:
        before = data.n_rows
        data = without_test(data, load_experiment(path))
        logger.info(f"note: {before - data.n_rows} of {before} rows may be {path}: left out.")
    result = fit_rates(
        data,
        _loaded(options.law, load_rate_law, rate_law),
        held_out=options.hold_out,
        curve=_loaded(options.curve_priors, load_priors, priors),
        out=options.out or Path("runs") / data.id,
        options=sampler_options(options, RATE_OPTIONS),
        command=command_line(),
        more_draws=options.more_draws,
        overwrite=options.overwrite,
    )
    for notice in result.data.notices:
        logger.info(f"note: {notice}")
    folder = result.directory.path
    write_images(law_figure(result), folder / "flow_law.png")
    print_table(law_table(result), ["quantity", "unit"])
    if options.hold_out:
        print_table(held_out_shown(result), ["source"])
    print(shown(f"run directory: {folder}"))
    print_lines(result.origins)
    return print_checks(result.checks(), result.prior_conflicts(), result.prior_decisions())


def _loaded(stated: str | None, load: Callable[[str], T], shipped: Callable[[str], T]) -> T | None:
    """Return what a file holds, or what comes with the package under a name."""
    if stated is None:
        return None
    return load(stated) if Path(stated).suffix == ".toml" else shipped(stated)
