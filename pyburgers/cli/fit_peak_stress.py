"""`pyburgers fit-peak-stress`: a flow law from a table of peak stresses."""

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
from pyburgers.flow_law_tables.fit import WARMUP, fit_peak_stress
from pyburgers.flow_law_tables.inputs import (
    default_peak_stress_priors,
    load_peak_stress,
    load_peak_stress_priors,
    without_test,
)
from pyburgers.kinds.kind import load_experiment
from pyburgers.model.priors import load_priors
from pyburgers.page.peak_stress_section import flow_law, flow_law_table

logger = logging.getLogger(__name__)

PEAK_STRESS_OPTIONS = ("chains", "warmup", "draws", "seed")
"""Settings of the sampler that suit these fits."""


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument("data", type=Path, metavar="DATA.toml", help="table of peak stresses")
    command.add_argument(
        "--priors", type=Path, help="prior file (default: the material's weak ones)"
    )
    command.add_argument(
        "--curve-priors",
        type=Path,
        metavar="PRIORS.toml",
        help="priors of a curve, from which the softening at the peaks is simulated (default: the "
        "material's)",
    )
    command.add_argument(
        "--without",
        type=Path,
        action="append",
        default=[],
        metavar="EXPERIMENT.toml",
        help="leave out the rows that may be this test, so that its curve can be fitted with the "
        "flow law of the others (fit --priors-from); may be repeated",
    )
    command.add_argument("--out", type=Path, help="run directory (default: runs/ID)")
    add_sampler_options(command, PEAK_STRESS_OPTIONS, replace(DEFAULT_OPTIONS, warmup=WARMUP))


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    data = load_peak_stress(options.data)
    for path in options.without:
        before = data.n_points
        data = without_test(data, load_experiment(path))
        logger.info(f"note: {before - data.n_points} of {before} rows may be {path}: left out.")
    priors = (
        default_peak_stress_priors(data.material)
        if options.priors is None
        else load_peak_stress_priors(options.priors)
    )
    result = fit_peak_stress(
        data,
        priors,
        curve=None if options.curve_priors is None else load_priors(options.curve_priors),
        out=options.out or Path("runs") / data.id,
        options=sampler_options(options, PEAK_STRESS_OPTIONS),
        command=command_line(),
    )
    folder = result.directory.path
    write_images(flow_law(result), folder / "flow_law.png")
    print_table(flow_law_table(result), ["quantity", "unit"])
    print(shown(f"run directory: {folder}"))
    return print_checks(result.checks(), result.prior_conflicts(), result.prior_decisions())
