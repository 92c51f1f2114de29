"""NUTS runs: inputs, coordinates, starts, the chains that a folder lacks, manifest."""

import logging
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from pyburgers.cmdstan.program import Program, load_program, shares_work
from pyburgers.cmdstan.toolchain import cmdstan_version, compiler_version, find_cmdstan
from pyburgers.common.atomic_files import sha256_of_json, write_json
from pyburgers.common.errors import (
    InputError,
    PyburgersError,
    SamplingError,
    SystemFailureError,
    ToolchainError,
)
from pyburgers.common.toml_files import read_json
from pyburgers.kinds.problem import Problem
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import SolverOptions, StanData, decisive
from pyburgers.sampling.chains import run_side_by_side
from pyburgers.sampling.changes import refusal, wanted_record, write_inputs
from pyburgers.sampling.charts import ChosenChart, choose_chart
from pyburgers.sampling.extensions import extend_chains
from pyburgers.sampling.manifest import ChainFailure
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

    The data are in plain coordinates: others follow from them and the seed. `recipe` is the hash of
    the program, its compiler and its flags.
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
    """Run the chains that a run directory lacks, record everything in it, return what failed.

    The directory is new, or of an earlier run with the same inputs; if a run of others is there,
    `overwrite` has it removed. Every chain is extended by `more_draws`. `command` regenerates the
    run, for its manifest. Raises `InputError` if the directory holds a different run or cannot be
    written, `SamplingError` if no chain finished, or one could not be extended. On a
    `KeyboardInterrupt` the chains are stopped; the same call continues the run.
    """
    options = options.suited_to(problem.likelihood, problem.name)
    data = program_data(problem, solver=solver, use_likelihood=use_likelihood)
    run = RunDirectory(directory)
    model = _program_for(problem, options)
    identity = fingerprint(data, options, model.recipe)
    wanted = wanted_record(problem, options, solver, use_likelihood=use_likelihood)
    if run.manifest_file.is_file() and run.read_manifest().get("fingerprint") != identity:
        if not overwrite:
            raise InputError(refusal(run, wanted, problem))
        run.clear(identity)
    with run.claimed(identity):
        write_inputs(run, problem)
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
        known = run.read_manifest()
        run.update_manifest(
            {
                **run_record(
                    run,
                    wanted,
                    name=problem.name,
                    data_kind=problem.data_kind,
                    identity=identity,
                    command=command,
                ),
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

    Raises `InputError` if threads cannot share the tests.
    """
    program, threads = problem.likelihood.program, options.threads_for(len(problem.experiments))
    if threads > 1 and not shares_work(program):
        raise InputError(
            f"{problem.name}: threads_per_chain is {options.threads_per_chain}, expected 1: "
            f"threads cannot share tests of the protocol {problem.likelihood.name}."
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
    """Run the chains that a claimed run directory lacks, note how they ended, return what failed.

    The directory has its inputs, Stan data and manifest; `draw_start` is called for the start of a
    chain, by its identifier, if the directory has none. After an earlier extension that was
    interrupted every chain is extended by `more_draws`: it goes on where it ended, with its step
    size and metric, and the draws that are there stay. Raises `SamplingError` if no chain finished,
    now or before, or one could not be extended, `SystemFailureError` if the system ended them.
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
        model = load_program(problem.likelihood.program)
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


def run_record(
    run: RunDirectory,
    wanted: Mapping[str, Any],
    *,
    name: str,
    data_kind: str,
    identity: str,
    command: str,
) -> dict[str, Any]:
    """Note in one record what will run: what is asked for, command, versions, hashes of the inputs.

    The directory has inputs and Stan data; `name` and `data_kind` are those of experiment or table,
    `identity` is the `fingerprint`, `command` regenerates the run.
    """
    read_by_chains = [file for file in (run.stan_data_file, run.metric_file) if file.is_file()]
    return {
        **wanted,
        "fingerprint": identity,
        "experiment": name,
        "data_kind": data_kind,
        **origin_record(run, command, [*files_in(run.inputs), *read_by_chains]),
        "failures": [],
    }


def origin_record(run: RunDirectory, command: str, inputs: Sequence[Path]) -> dict[str, Any]:
    """Note what regenerates a folder: command, versions, hashes of the inputs; and that it runs.

    If the folder holds a part of the same already, it was begun when that says.
    """
    known = run.read_manifest() if run.manifest_file.is_file() else {}
    return {
        "command": command,
        "started": known.get("started", datetime.now(UTC).isoformat(timespec="seconds")),
        "status": "sampling",
        "versions": software_versions(),
        "hashes": run.hashes(inputs),
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
