"""NUTS runs: inputs, coordinates, starts, the chains that a folder lacks, manifest."""

import logging
import platform
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from pyburgers.cmdstan.program import Program, load_program, shares_work
from pyburgers.cmdstan.toolchain import cmdstan_version, compiler_version, find_cmdstan
from pyburgers.common.atomic_files import (
    sha256_of_file,
    sha256_of_json,
    write_atomically,
    write_json,
)
from pyburgers.common.errors import (
    InputError,
    PyburgersError,
    SamplingError,
    SystemFailureError,
    ToolchainError,
)
from pyburgers.common.toml_files import read_json
from pyburgers.model.priors import save_priors
from pyburgers.model.variants import variant_of
from pyburgers.protocols.problem import Problem
from pyburgers.protocols.program_data import program_data
from pyburgers.protocols.protocol import save_experiment
from pyburgers.protocols.stan_data import SolverOptions, StanData, decisive
from pyburgers.sampling.chains import run_side_by_side
from pyburgers.sampling.changes import Wanted, refusal
from pyburgers.sampling.charts import ChosenChart, check_coordinates, choose_chart
from pyburgers.sampling.extensions import extend_chains
from pyburgers.sampling.failures import ChainFailure
from pyburgers.sampling.options import INDECISIVE, SamplerOptions
from pyburgers.sampling.other_modes import modes_record
from pyburgers.sampling.repetitions import TIGHTENING, shortened, tolerance_in
from pyburgers.sampling.run_directory import RunDirectory
from pyburgers.sampling.solver_noise import Noisy, noisy_tolerances
from pyburgers.sampling.starts import (
    draw_initial_values,
    draw_start_around,
    find_mode,
    programs_of_tests,
)

logger = logging.getLogger(__name__)

PACKAGES = ("pyburgers", "cmdstanpy", "arviz", "numpy", "scipy", "pandas", "xarray")


def fingerprint(data: StanData, options: SamplerOptions, recipe: str) -> str:
    """Hash of everything that decides the draws of a chain (not how many chains there are).

    Parameters
    ----------
    data : dict
        Stan data in plain coordinates; other coordinates follow from them and the seed.
    options : SamplerOptions
        Settings of the sampler.
    recipe : str
        Hash of the program, its compiler and its flags.
    """
    chosen = {k: v for k, v in asdict(options).items() if k not in INDECISIVE}
    return sha256_of_json({"data": decisive(data), "options": chosen, "program": recipe})


def run_chains(
    problem: Problem,
    directory: Path,
    *,
    options: SamplerOptions,
    solver: SolverOptions,
    use_likelihood: bool,
    command: str,
    more_draws: int | None = None,
    overwrite: bool = False,
) -> tuple[ChainFailure, ...]:
    """Run the chains that a run directory lacks and record everything in it.

    Parameters
    ----------
    problem : Problem
        Tests, priors, pooling.
    directory : Path
        Run directory, new or of an earlier run with the same inputs.
    options, solver
        Sampler and solver.
    use_likelihood : bool
        False samples the prior.
    command : str
        What regenerates the run, for the manifest.
    more_draws : int, optional
        Draws by which every chain is extended, see `complete_chains`.
    overwrite : bool
        Whether a run of other inputs in the directory is removed.

    Returns
    -------
    tuple of ChainFailure
        Chains that did not finish; the others are in the directory.

    Raises
    ------
    InputError
        If the directory holds a different run or cannot be written.
    SamplingError
        If no chain finished, or one could not be extended.
    KeyboardInterrupt
        Passed on after the chains were stopped; the same call continues the run.
    """
    check_coordinates(problem, options.coordinates)
    options = options.suited_to(problem.protocol)
    data = program_data(problem, solver=solver, use_likelihood=use_likelihood)
    run = RunDirectory(directory)
    model = _program_for(problem, options)
    identity = fingerprint(data, options, model.recipe)
    wanted = Wanted(problem, options, solver, use_likelihood)
    if run.manifest_file.is_file() and run.read_manifest().get("fingerprint") != identity:
        if not overwrite:
            raise InputError(refusal(run, wanted))
        run.clear(identity)
    with run.claimed(identity):
        _write_inputs(run, problem)
        if not run.stan_data_file.is_file():
            chosen = choose_chart(
                problem,
                data,
                lambda: find_mode(problem, seed=options.seed, solver=solver),
                wanted=options.coordinates,
                seed=options.seed,
                solver=solver,
            )
            _write_chart(run, chosen)
            settled = _settle_tolerance(run, problem, data, chosen, seed=options.seed)
            # Last: it tells that all is there.
            write_json(run.stan_data_file, settled)
        record = run_record(
            run,
            name=problem.name,
            data_kind=problem.data_kind,
            options=options,
            identity=identity,
            use_likelihood=use_likelihood,
            command=command,
        )
        known = run.read_manifest()
        run.update_manifest(
            {
                **record,
                **problem_record(problem),
                "refits": known.get("refits", []),
                "shortened": shortened(known),
                "solver": {**asdict(solver), "tolerance": tolerance_in(run)},
            }
        )
        return complete_chains(
            model,
            run,
            options,
            lambda chain: _draw_start(model, run, problem, options.seed, chain),
            more_draws=more_draws,
        )


def _program_for(problem: Problem, options: SamplerOptions) -> Program:
    """Return the program that samples, in as many threads as were asked for and have tests.

    Raises
    ------
    InputError
        If threads cannot share the tests.
    """
    program, threads = problem.protocol.program, options.threads_for(len(problem.experiments))
    if threads > 1 and not shares_work(program):
        raise InputError(
            f"{problem.name}: threads_per_chain is {options.threads_per_chain}, expected 1: "
            f"threads cannot share tests of the protocol {problem.protocol.name}."
        )
    return load_program(program, threads=threads)


def complete_chains(
    model: Program,
    run: RunDirectory,
    options: SamplerOptions,
    draw_start: Callable[[int], dict[str, list[float]]],
    *,
    more_draws: int | None = None,
) -> tuple[ChainFailure, ...]:
    """Run the chains that a claimed run directory lacks and note in its manifest how they ended.

    Parameters
    ----------
    model : Program
        The program.
    run : RunDirectory
        With its inputs, Stan data and manifest.
    options : SamplerOptions
        Settled settings.
    draw_start : callable
        Start of a chain, by its identifier; called where the directory has none.
    more_draws : int, optional
        Draws by which every chain is extended, after an earlier extension by another number that
        was interrupted. An extension goes on where the chains ended, with their step size and
        metric; the draws that are there stay as they are.

    Returns
    -------
    tuple of ChainFailure
        Chains that did not finish.

    Raises
    ------
    SamplingError
        If no chain finished, now or before, or one could not be extended.
    SystemFailureError
        If it was the system that ended them.
    """
    wanted = range(1, options.chains + 1)
    missing = [chain for chain in wanted if chain not in run.finished_chains()]
    if len(missing) < options.chains:
        logger.info(
            f"{options.chains - len(missing)} of {options.chains} chains are there already."
        )
    for chain in missing:
        if not run.initial_values_file(chain).is_file():
            write_json(run.initial_values_file(chain), draw_start(chain))
    failures = run_side_by_side(model, run, missing, options) if missing else ()
    not_extended = extend_chains(model, run, options, more_draws)
    status = "chains missing" if failures else "sampled"
    run.update_manifest(
        {
            "status": "extension failed" if not_extended else status,
            "failures": [asdict(failure) for failure in (*failures, *not_extended)],
            "chains": run.chain_records(),
        }
    )
    if not run.finished_chains():
        raise _error_of(failures, "No chain finished")
    if not_extended:
        raise _error_of(not_extended, f"{run.path}: not all chains could be extended")
    return failures


def _error_of(failures: Sequence[ChainFailure], what: str) -> PyburgersError:
    kind = SystemFailureError if all(one.by_system for one in failures) else SamplingError
    return kind(f"{what}: {failures[0].reason}")


def _write_chart(run: RunDirectory, chart: ChosenChart) -> None:
    """Save coordinates and metric."""
    logger.info(
        f"Coordinates: {chart.name}, as asked for."
        if chart.reason == "asked for"
        else f"Coordinates: {chart.name}, because {chart.reason}."
    )
    run.update_manifest(
        {
            "coordinates": {"system": chart.name, "reason": chart.reason},
            "other_modes": modes_record(chart.other_modes),
        }
    )
    metric = chart.first_metric
    if chart.centre is not None and chart.covariance is not None and metric is not None:
        write_json(
            run.metric_file,
            {
                "inv_metric": metric.tolist(),
                "centre": chart.centre.tolist(),
                "covariance": chart.covariance.tolist(),
            },
        )


def _settle_tolerance(
    run: RunDirectory, problem: Problem, data: StanData, chart: ChosenChart, *, seed: int
) -> StanData:
    """Return the data in the chart's coordinates, at a tolerance that is good to sample with."""
    data, noisy = {**data, **chart.block}, list[Noisy]()
    if chart.centre is not None and chart.covariance is not None:
        model = load_program(problem.protocol.program)
        noisy = noisy_tolerances(model, data, chart.centre, chart.covariance, seed=seed)
    run.update_manifest({"noisy": [asdict(one) for one in noisy]})
    if not noisy:
        return data
    tolerance = noisy[-1].tolerance / TIGHTENING
    logger.info(
        f"At a tolerance of {noisy[-1].tolerance:g} of the solver the log density jumps by "
        f"{noisy[-1].noise:.1g} from point to point: sampling at {tolerance:g}."
    )
    return {**data, "tolerance": tolerance}


def _draw_start(
    model: Program, run: RunDirectory, problem: Problem, seed: int, chain: int
) -> dict[str, list[float]]:
    """Start of one chain: around the mode, or from the prior where none was found."""
    if not run.metric_file.is_file():
        return draw_initial_values(problem, programs_of_tests(problem), seed=seed, chain=chain)
    data = run.read_stan_data()
    laplace = read_json(run.metric_file)
    centre, covariance = (np.array(laplace[key]) for key in ("centre", "covariance"))
    return draw_start_around(model, data, centre, covariance, seed=seed, chain=chain)


def _write_inputs(run: RunDirectory, problem: Problem) -> None:
    """Save what the run needs to be trusted and repeated; written once, before sampling."""
    for experiment in problem.experiments:
        file = run.test_file(experiment.id)
        if file.is_file():
            continue
        scratch = run.new_scratch()
        save_experiment(experiment, scratch)
        file.parent.mkdir(parents=True, exist_ok=True)
        # The TOML file goes last: it is what tells that the copy is complete.
        for written in sorted(scratch.iterdir(), key=lambda file: file.suffix == ".toml"):
            written.replace(file.parent / written.name)
    # As given: they are resolved for each test by itself.
    write_atomically(run.priors_file, lambda path: save_priors(problem.given_priors, path))


def problem_record(problem: Problem) -> dict[str, Any]:
    """Note what is fitted: tests, pooling, variant of the model, another source of the flow law."""
    priors = problem.given_priors
    return {
        "experiments": [experiment.id for experiment in problem.experiments],
        "pooling": problem.pooling.record(),
        "variant": variant_of(problem.priors[0], problem.experiments[0]).record(),
        "priors_from": None if priors.flow_law is None else priors.flow_law.source,
    }


def run_record(
    run: RunDirectory,
    *,
    name: str,
    data_kind: str,
    options: SamplerOptions,
    identity: str,
    use_likelihood: bool,
    command: str,
) -> dict[str, Any]:
    """Note what will run: command, settings, versions, hashes of the inputs.

    Parameters
    ----------
    run : RunDirectory
        With its inputs and Stan data.
    name, data_kind : str
        Experiment or table, and the kind of its provenance.
    options : SamplerOptions
        Settled settings.
    identity : str
        `fingerprint` of the run.
    use_likelihood : bool
        Whether data take part.
    command : str
        What regenerates the run.

    Returns
    -------
    dict
        Entries of the manifest.
    """
    read_by_chains = [file for file in (run.stan_data_file, run.metric_file) if file.is_file()]
    return {
        "fingerprint": identity,
        "experiment": name,
        "data_kind": data_kind,
        **origin_record(run, command, [*files_in(run.inputs), *read_by_chains]),
        "failures": [],
        "sampler": asdict(options),
        "use_likelihood": use_likelihood,
    }


def origin_record(run: RunDirectory, command: str, inputs: Iterable[Path]) -> dict[str, Any]:
    """Note what regenerates a folder: command, versions, hashes of the inputs; and that it runs.

    Parameters
    ----------
    run : RunDirectory
        The folder; where it holds a part of the same already, it was begun when that says.
    command : str
        What regenerates it.
    inputs : iterable of Path
        Files in it.
    """
    known = run.read_manifest() if run.manifest_file.is_file() else {}
    return {
        "command": command,
        "started": known.get("started", datetime.now(UTC).isoformat(timespec="seconds")),
        "status": "sampling",
        "versions": software_versions(),
        "hashes": {file.relative_to(run.path).as_posix(): sha256_of_file(file) for file in inputs},
    }


def files_in(folder: Path) -> list[Path]:
    """Return all files below a folder, in order."""
    return sorted(file for file in folder.rglob("*") if file.is_file())


def software_versions() -> dict[str, str | None]:
    """Return the versions of what makes the draws, for manifests."""
    found = find_cmdstan()
    try:
        compiler = compiler_version()
    except ToolchainError:
        compiler = None  # compiled programs run without it
    return {
        "python": platform.python_version(),
        **{package: version(package) for package in PACKAGES},
        "cmdstan": None if found is None else cmdstan_version(found),
        "compiler": compiler,
    }
