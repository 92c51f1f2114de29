"""`pyburgers simulate`: a forward solution at given parameters, or at those of a fit."""

import argparse
import logging
from pathlib import Path

from pyburgers.cli.shared import writing
from pyburgers.common.atomic_files import write_text
from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit
from pyburgers.protocols.forward import load_parameters, simulate
from pyburgers.protocols.protocol import load_experiment

logger = logging.getLogger(__name__)

MEAN = "mean"


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument(
        "experiment",
        type=Path,
        metavar="EXPERIMENT.toml",
        help="an imagined test needs no [data]",
    )
    which = command.add_mutually_exclusive_group(required=True)
    which.add_argument("--parameters", type=Path, metavar="P.json", help="SI values by name")
    which.add_argument("--from", dest="run_of", type=Path, metavar="RUN", help="those of a fit")
    command.add_argument(
        "--draw",
        default=MEAN,
        metavar="N",
        help="with --from, a draw from 1, counted through all chains, or their mean",
    )
    command.add_argument("--test", metavar="ID", help="with --from, test of a joint fit")
    command.add_argument("--out", type=Path, required=True, metavar="FILE.csv")


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    experiment = load_experiment(options.experiment)
    if options.run_of is None:
        parameters = load_parameters(options.parameters)
    else:
        parameters = _of_fit(options.run_of, options.test, options.draw)
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


def _of_fit(path: Path, test: str | None, draw: str) -> dict[str, float]:
    """Return the parameters (SI) of a draw of a fit, or their mean over the draws."""
    fit = Fit.load(path)
    one = fit if test is None else fit[test]
    draws = one.posterior["posterior"].to_dataset()[list(one.priors.priors)]
    flat = draws.stack(sample=("chain", "draw"))
    if draw == MEAN:
        return {str(name): float(values.mean()) for name, values in flat.data_vars.items()}
    number = int(draw) if draw.isdecimal() else 0
    if not 1 <= number <= flat.sizes["sample"]:
        raise InputError(
            f"--draw {draw}: expected {MEAN}, or a number from 1 to {flat.sizes['sample']}."
        )
    return {str(name): float(values[number - 1]) for name, values in flat.data_vars.items()}
