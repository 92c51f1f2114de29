"""`pyburgers simulate`: a forward solution at given parameters, or at those of a fit."""

import argparse
import logging
from pathlib import Path

import numpy as np

from pyburgers.cli.outputs import check_output
from pyburgers.cli.shared import add_variant_option, writing
from pyburgers.common.atomic_files import write_text
from pyburgers.common.csv_tables import csv_text
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError
from pyburgers.common.paths import shown
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.new_test import laws_of_grains, parameters_for_other_test
from pyburgers.kinds.conditions import doubts
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forward import load_parameters, simulate, with_laws
from pyburgers.kinds.kind import load_experiment
from pyburgers.model.hardening import extension_sentences
from pyburgers.model.laws import DISLOCATIONS_SWITCH
from pyburgers.model.unlikely_numbers import unlikely_numbers
from pyburgers.model.variants import parse_choices
from pyburgers.posterior.labelled_draws import response_in

logger = logging.getLogger(__name__)

MEAN = "mean"


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    imagined = "an imagined test needs no [data]"
    command.add_argument("experiment", type=Path, metavar="EXPERIMENT.toml", help=imagined)
    which = command.add_mutually_exclusive_group(required=True)
    which.add_argument("--parameters", type=Path, metavar="P.json", help="SI values by name")
    which.add_argument("--from", dest="run_of", type=Path, metavar="RUN", help="those of a fit")
    command.add_argument(
        "--draw",
        metavar="N",
        help="with --from, a draw from 1, counted through all chains, or mean, that of the "
        "parameters; default the draw with the most central solution",
    )
    command.add_argument("--test", metavar="ID", help="with --from, test of a joint fit")
    add_variant_option(command)
    command.add_argument(
        "--out", type=Path, required=True, metavar="FILE.csv", help="table of the solution"
    )


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    experiment = load_experiment(options.experiment)
    for sentence in (*experiment.notices, *doubts(experiment)):
        logger.info(f"note: {sentence}")
    check_output(options.out, options.experiment, options.parameters, options.run_of)
    laws: dict[str, str] = {}
    if options.run_of is None:
        for option, value in (("--draw", options.draw), ("--test", options.test)):
            if value is not None:
                raise InputError(
                    f"{option} {value}: found it beside --parameters, expected it with --from, the "
                    "run that it chooses from."
                )
        parameters = load_parameters(options.parameters)
        ranges = {name: (value, value) for name, value in parameters.items()}
        for sentence in unlikely_numbers(experiment.material, ranges):
            logger.info(f"warning: {sentence}")
    else:
        parameters, laws = _of_fit(options.run_of, options.test, options.draw, experiment)
    if parameters["beta"] > 0:
        logger.info(
            "warning: beta is positive; in SI units (Pa, m, s) laboratory flow laws have a "
            "negative one, and the +7.29e-4 mol/J printed in the paper's Table 1 is a misprint."
        )
    laws |= parse_choices(options.variant)
    parameters = with_laws(experiment, parameters, laws)
    solved = simulate(experiment, parameters)
    if "stress_Pa" in solved:  # tables have none
        reference = parameters.get(DISLOCATIONS_SWITCH, 0.0)
        for sentence in extension_sentences(reference, solved["stress_Pa"].to_numpy()):
            logger.info(f"warning: {sentence}")
    solution = experiment.solution_table(solved)
    with writing(options.out):
        write_text(options.out, csv_text(solution))
    print(shown(f"{len(solution)} rows in {options.out}"))
    return 0


def _of_fit(
    path: Path, test: str | None, draw: str | None, experiment: Experiment
) -> tuple[dict[str, float], dict[str, str]]:
    """Return the parameters (SI) of a draw of a fit, by default the most central, and its laws."""
    fit = Fit.load(path)
    one = fit if test is None else fit[test]
    draws = one.posterior["posterior"].to_dataset()[list(one.priors.priors)]
    flat = draws.stack(sample=("chain", "draw"))
    if draw == MEAN:
        chosen = flat.mean("sample")
        logger.info(
            "note: the mean of the parameters is no draw of the fit, and its solution may lie far "
            "from those of all draws."
        )
    elif draw is None:
        number = _most_central(one)
        chosen = flat.isel(sample=number)
        logger.info(
            f"note: draw {number + 1} is solved: its solution of the fitted test is nearest to the "
            "median one. `pyburgers predict` gives the band of all draws."
        )
    else:
        number = int(draw) if draw.isdecimal() else 0
        if not 1 <= number <= flat.sizes["sample"]:
            raise InputError(
                f"--draw {draw}: expected {MEAN}, or a number from 1 to {flat.sizes['sample']}."
            )
        chosen = flat.isel(sample=number - 1)
    values = {str(name): float(value) for name, value in chosen.data_vars.items()}
    found, notes = parameters_for_other_test(values, one.experiment, experiment)
    for sentence in (*fit.cautions, *notes):
        logger.info(f"note: {sentence}")
    return found, laws_of_grains(fit.variant)


def _most_central(fit: Fit) -> int:
    """Return the draw, from 0 through all chains, whose solution is nearest to the median one."""
    # Means of parameters along a curved ridge lie off it.
    solved = all_draws(response_in(fit.posterior, "model_response")).astype(np.float64)
    spread = np.nanstd(solved, axis=0)
    away = (solved - np.nanmedian(solved, axis=0))[:, spread > 0] / spread[spread > 0]
    return int(np.nanargmin(np.sum(away**2, axis=1)))
