"""`pyburgers simulate`: a forward solution at given parameters."""

import argparse
import logging
from pathlib import Path

from pyburgers.cli.shared import writing
from pyburgers.common.atomic_files import write_text
from pyburgers.common.errors import InputError
from pyburgers.protocols.forward import load_parameters, simulate
from pyburgers.protocols.protocol import load_experiment

logger = logging.getLogger(__name__)


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument("experiment", type=Path, metavar="EXPERIMENT.toml")
    command.add_argument("--parameters", type=Path, required=True, metavar="P.json")
    command.add_argument("--out", type=Path, required=True, metavar="FILE.csv")


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    experiment = load_experiment(options.experiment)
    parameters = load_parameters(options.parameters)
    if parameters["beta"] > 0:
        logger.info(
            "warning: beta is positive; in SI units (Pa, m, s) laboratory flow laws have a "
            "negative one, and the +7.29e-4 mol/J printed in the paper's Table 1 is a misprint."
        )
    if options.out.is_dir():
        raise InputError(f"--out {options.out}: is a folder, expected a file name.")
    solution = simulate(experiment, parameters)
    with writing(options.out):
        write_text(options.out, solution.to_csv(index=False))
    print(f"{len(solution)} rows in {options.out}")
    return 0
