"""`pyburgers sbc`: simulation-based calibration."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from pyburgers.cli.shared import (
    add_model_options,
    add_sampler_options,
    command_line,
    exit_code,
    sampler_options,
)
from pyburgers.cli.workers import add_worker_options, require_no_worker_options, workers_of
from pyburgers.common.errors import InputError
from pyburgers.common.paths import shown
from pyburgers.common.units import UNITS
from pyburgers.drawing.style import write_images
from pyburgers.kinds.kind import load_experiment
from pyburgers.model.pooling import parse_pooling
from pyburgers.model.priors import load_priors
from pyburgers.model.variants import parse_choices, with_variant
from pyburgers.sbc.data_sets import LONGER, SHORT_RUN, DataSetPlan, Range, calibration_priors
from pyburgers.sbc.results import (
    count_sentences,
    rank_differences,
    save_calibration,
    shown_verdict_table,
)
from pyburgers.sbc.run import Calibration, CalibrationPlan, calibrate, load_calibration

CALIBRATION_OPTIONS = ("chains", "warmup", "draws", "seed", "adapt_delta", "coordinates")
"""Settings of the sampler that a calibration takes."""

RESULTS_OF = "--results-of"
"""Option that shows a calibration, and makes no fits."""


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument(
        "experiments",
        type=Path,
        nargs="*",
        metavar="TEMPLATE.toml",
        help="file of a test whose conditions the simulated ones have",
    )
    add_model_options(command)
    command.add_argument(
        "--priors",
        type=Path,
        help="prior file (default the material's in data/priors/calibration, or its own)",
    )
    command.add_argument("--out", type=Path, help="folder; default calibrations/ID, or ID+ID")
    command.add_argument(
        "--simulations",
        type=int,
        default=CalibrationPlan.simulations,
        help="data sets; fixed with the first one",
    )
    command.add_argument(
        "--ranked-draws", type=int, default=DataSetPlan.n_ranked, help="of each fit"
    )
    command.add_argument(
        "--refits",
        type=int,
        default=DataSetPlan.refits,
        help=f"repetitions, {LONGER} times as long each, of a fit that has not converged; "
        "can be raised later",
    )
    for option, what in (
        ("--stress-range", "stress lies outside these (MPa)"),
        ("--strain-range", "strain, where strain is read, lies outside these (percent)"),
    ):
        text = f"replace data sets whose largest {what}"
        command.add_argument(option, type=float, nargs=2, metavar=("LOW", "HIGH"), help=text)
    command.add_argument(
        RESULTS_OF,
        type=Path,
        metavar="FOLDER",
        help="fit nothing: write the results of a calibration as far as it has come",
    )
    add_worker_options(command)
    add_sampler_options(command, CALIBRATION_OPTIONS, SHORT_RUN)


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    if options.results_of is not None:
        _require_nothing_to_fit(options)
        calibration = load_calibration(options.results_of)
        return _write(calibration, options.out or options.results_of)
    if not options.experiments:
        raise InputError("found no template, expected one (or --results-of FOLDER).")
    templates = [load_experiment(path) for path in options.experiments]
    first = templates[0]
    priors = (
        calibration_priors(first.material, first.protocol)
        if options.priors is None
        else load_priors(options.priors, parse_choices(options.variant))
    )
    out = options.out or Path("calibrations") / "+".join(template.id for template in templates)
    plan = CalibrationPlan(
        simulations=options.simulations,
        seed=options.seed,
        n_ranked=options.ranked_draws,
        sampler=sampler_options(options, CALIBRATION_OPTIONS),
        refits=options.refits,
        stress_range=_in_si(options.stress_range, UNITS["stress"]["MPa"]),
        strain_range=_in_si(options.strain_range, UNITS["strain"]["percent"]),
    )
    with workers_of(options) as workers:
        calibration = calibrate(
            templates,
            with_variant(priors, first, parse_choices(options.variant)),
            out=out,
            plan=plan,
            pool=parse_pooling(options.pool),
            workers=workers,
            command=command_line(),
        )
    if options.part is not None:
        print(f"data sets done: {len(calibration.replications)} of {plan.simulations}")
        return 0
    return _write(calibration, out)


def _require_nothing_to_fit(options: argparse.Namespace) -> None:
    """Refuse what would say which fits to make where none is made."""
    require_no_worker_options(options, f"{RESULTS_OF}, which fits nothing")
    command = argparse.ArgumentParser()  # of which each option has its default
    add_options(command)
    for name, default in vars(command.parse_args([])).items():
        if name not in ("results_of", "out") and getattr(options, name) != default:
            option = "TEMPLATE.toml" if name == "experiments" else f"--{name.replace('_', '-')}"
            raise InputError(f"{option}: expected none beside {RESULTS_OF}, which fits nothing.")


def _in_si(given: Sequence[float] | None, unit: float) -> Range | None:
    """Limits that were given in a unit."""
    if given is None:
        return None
    low, high = (unit * value for value in given)
    return low, high


def _write(calibration: Calibration, out: Path) -> int:
    """Write and print what a calibration found; return the exit code."""
    out.mkdir(parents=True, exist_ok=True)
    save_calibration(calibration, out)
    if calibration.ranks:
        write_images(rank_differences(calibration), out / "ranks.png")
        print(shown_verdict_table(calibration).to_string(index=False))
    for sentence in count_sentences(calibration):
        print(sentence)
    print(shown(f"tables{' and figure' * bool(calibration.ranks)}: {out}"))
    return exit_code(calibration.passed)
