"""`pyburgers sbc`: simulation-based calibration."""

import argparse
from pathlib import Path

from pyburgers.cli.shared import add_sampler_options, command_line, exit_code, sampler_options
from pyburgers.drawing.style import write_images
from pyburgers.model.priors import load_priors
from pyburgers.protocols.protocol import load_experiment
from pyburgers.sbc.data_sets import calibration_priors
from pyburgers.sbc.results import (
    count_sentences,
    rank_differences,
    save_calibration,
    shown_verdict_table,
)
from pyburgers.sbc.run import N_RANKED, SHORT_RUN, CalibrationPlan, calibrate

CALIBRATION_OPTIONS = ("chains", "warmup", "draws", "seed", "adapt_delta", "coordinates")
"""Settings of the sampler that a calibration takes."""


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument("experiment", type=Path, metavar="TEMPLATE.toml")
    command.add_argument(
        "--priors",
        type=Path,
        help="prior file (default: the material's in data/priors/calibration, or its own)",
    )
    command.add_argument("--out", type=Path, help="default: calibrations/ID")
    command.add_argument("--simulations", type=int, default=200, help="data sets, default 200")
    command.add_argument(
        "--ranked-draws", type=int, default=N_RANKED, help=f"of each fit, default {N_RANKED}"
    )
    command.add_argument("--jobs", type=int, help="processes, default one for each core")
    add_sampler_options(command, CALIBRATION_OPTIONS, SHORT_RUN)


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    template = load_experiment(options.experiment)
    priors = (
        calibration_priors(template.material)
        if options.priors is None
        else load_priors(options.priors)
    )
    sampler = sampler_options(options, CALIBRATION_OPTIONS)
    out = options.out or Path("calibrations") / template.id
    command = command_line()
    calibration = calibrate(
        template,
        priors,
        out=out,
        plan=CalibrationPlan(options.simulations, options.seed, options.ranked_draws, sampler),
        jobs=options.jobs,
        command=command,
    )
    save_calibration(calibration, out, command=command)
    if calibration.ranks:
        write_images(rank_differences(calibration), out / "ranks.png")
        print(shown_verdict_table(calibration).to_string(index=False))
    for sentence in count_sentences(calibration):
        print(sentence)
    print(f"tables and figure: {out}")
    return exit_code(calibration.passed)
