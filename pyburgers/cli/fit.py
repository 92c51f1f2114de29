"""`pyburgers fit`: one test, or several in a joint fit."""

import argparse
from dataclasses import replace
from pathlib import Path

from pyburgers.cli.hints import log_hints
from pyburgers.cli.shared import (
    add_model_options,
    add_options_of_runs_there,
    add_sampler_options,
    by_protocol,
    command_line,
    sampler_options,
)
from pyburgers.cli.terminal import print_checks, print_lines, print_table
from pyburgers.common.errors import InputError
from pyburgers.common.paths import shown
from pyburgers.common.tables_in_files import read_once
from pyburgers.comparison.conclusions import what_a_yes_leaves_open
from pyburgers.fitting.fit import fit
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import of_one_program
from pyburgers.kinds.program_data import fixed_in_effect
from pyburgers.kinds.stan_data import FAST, SOLVERS
from pyburgers.kinds.together import priors_for
from pyburgers.model.flow_law_prior import FLOW_LAW_PRIOR_FILE, FlowLawPrior, load_flow_law_of_run
from pyburgers.model.pooling import parse_pooling
from pyburgers.model.priors import with_flow_law
from pyburgers.model.variants import parse_choices, with_variant
from pyburgers.page.joint_section import pooling_table, shown_pooling_table
from pyburgers.page.tables import parameter_table
from pyburgers.sampling.run_directory import RunDirectory


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument(
        "experiments",
        type=Path,
        nargs="+",
        metavar="EXPERIMENT.toml",
        help="file of a test; several are fitted together",
    )
    add_model_options(command)
    command.add_argument("--priors", type=Path, help="prior file (default the material's)")
    command.add_argument(
        "--priors-from",
        type=Path,
        metavar="RUN",
        help="a run of fit-rates --curve-priors whose flow law replaces the priors of n, p, Q_M "
        "and beta",
    )
    command.add_argument(
        "--out", type=Path, help="run directory (default runs/ID, of a joint fit runs/ID+ID)"
    )
    add_sampler_options(command)
    add_options_of_runs_there(command)
    command.add_argument(
        "--tolerance",
        type=float,
        help=f"tolerance of the ODE solver{by_protocol(lambda one: one.solver.tolerance)}",
    )
    command.add_argument(
        "--solver", choices=SOLVERS, default=FAST, help="how the equations are solved"
    )
    command.add_argument(
        "--prior-only", action="store_true", help="switch the likelihood off: sample the prior"
    )


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    choices = parse_choices(options.variant)
    pool = parse_pooling(options.pool)
    with read_once():
        experiments = of_one_program([load_experiment(path) for path in options.experiments])
        if pool and len(experiments) == 1:
            raise InputError(f"--pool {options.pool[0]}: found one experiment, expected several.")
        log_hints(options.experiments)
    priors = with_variant(priors_for(experiments, options.priors, choices), experiments[0], choices)
    source: Path | None = options.priors_from
    if source is not None:
        priors = with_flow_law(priors, _flow_law_of(source), f"--priors-from {source}")
    usual = likelihood_of(experiments[0]).solver
    tolerance = usual.tolerance if options.tolerance is None else options.tolerance
    result = fit(
        experiments,
        priors,
        pool=pool,
        out=options.out or Path("runs") / "+".join(experiment.id for experiment in experiments),
        options=sampler_options(options),
        solver=replace(usual, tolerance=tolerance, method=options.solver),
        use_likelihood=not options.prior_only,
        command=command_line(),
        more_draws=options.more_draws,
        overwrite=options.overwrite,
    )
    if result.is_joint:
        table = shown_pooling_table(pooling_table(result))
    else:
        table = parameter_table(result.summary("SI"), result.priors, fixed_in_effect(result))
    print_table(table, ["quantity", "unit", "pooling", "fit"])
    print(shown(f"run directory: {result.directory.path}"))
    print_lines(result.origins)
    code = print_checks(result.checks(), result.prior_conflicts(), result.prior_decisions())
    print_lines(what_a_yes_leaves_open(result))
    return code


def _flow_law_of(source: Path) -> FlowLawPrior:
    """Return the flow law in a run directory, or in a folder with nothing else of a run."""
    run = RunDirectory(source)
    if run.manifest_file.is_file():
        with run.unchanged_copy(run.read_manifest()) as copy:
            if (copy.path / FLOW_LAW_PRIOR_FILE).is_file():
                return load_flow_law_of_run(copy.path)
    return load_flow_law_of_run(source)
