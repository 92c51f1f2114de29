"""NUTS runs: inputs, coordinates, starts, the chains that a folder lacks, manifest."""

import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pyburgers.cmdstan.program import Program, load_program
from pyburgers.common.atomic_files import sha256_of_json, write_atomically, write_json
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.model.priors import PriorSet, save_priors
from pyburgers.model.variants import check_variant
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.registry import protocol_of, save_experiment
from pyburgers.protocols.stan_data import SolverOptions, StanData, program_data
from pyburgers.sampling.chains import ChainFailure, run_side_by_side
from pyburgers.sampling.charts import Geometry, check_coordinates, choose_geometry
from pyburgers.sampling.initial_values import draw_initial_values, draw_start_around
from pyburgers.sampling.options import INDECISIVE, SamplerOptions
from pyburgers.sampling.run_directory import RunDirectory
from pyburgers.sampling.run_record import priors_record, run_record

logger = logging.getLogger(__name__)

TIGHTENING = 10.0
"""Factor between the tolerance of a run and of its repetition."""


def fingerprint(data: StanData, options: SamplerOptions, program_key: str) -> str:
    """Hash of everything that decides the draws of a chain (not how many chains there are).

    Parameters
    ----------
    data : dict
        Stan data in plain coordinates; other coordinates follow from them and the seed.
    options : SamplerOptions
        Settings of the sampler.
    program_key : str
        Hash of the program, its compiler and its flags.
    """
    decisive = {k: v for k, v in asdict(options).items() if k not in INDECISIVE}
    return sha256_of_json({"data": data, "options": decisive, "program": program_key})


@dataclass(frozen=True, eq=False)
class SamplingTask:
    """What a run samples, settled but for the coordinates.

    Attributes
    ----------
    name, data_kind : str
        Of the data, and the kind of their provenance.
    program : Path
        Stan program.
    data : dict
        Its data in plain coordinates.
    options : SamplerOptions
        Settled settings.
    write_inputs : callable
        Saves copies of the inputs in a run directory, once.
    choose_geometry : callable
        Sets the coordinates of the compiled program up.
    draw_start : callable
        Start of a chain, by its identifier, from the prior.
    manifest : mapping
        Entries of the manifest that only this kind of run has.
    """

    name: str
    data_kind: str
    program: Path
    data: StanData
    options: SamplerOptions
    write_inputs: Callable[[RunDirectory], None]
    choose_geometry: Callable[[Program], Geometry]
    draw_start: Callable[[int], dict[str, list[float]]]
    manifest: Mapping[str, Any]


def run_chains(
    experiment: Experiment,
    priors: PriorSet,
    directory: Path,
    *,
    options: SamplerOptions,
    solver: SolverOptions,
    use_likelihood: bool,
    command: str,
) -> tuple[ChainFailure, ...]:
    """Run the chains that a run directory lacks and record everything in it.

    Parameters
    ----------
    experiment : Experiment
        A test with data.
    priors : PriorSet
        Priors; relative noise scales are resolved here.
    directory : Path
        Run directory, new or of an earlier run with the same inputs.
    options, solver
        Sampler and solver.
    use_likelihood : bool
        False samples the prior.
    command : str
        What regenerates the run, for the manifest.

    Returns
    -------
    tuple of ChainFailure
        Chains that did not finish; the others are in the directory.

    Raises
    ------
    InputError
        If the directory holds a different run or cannot be written.
    SamplingError
        If no chain finished.
    KeyboardInterrupt
        Passed on after the chains were stopped; the same call continues the run.
    """
    if experiment.n_points == 0:
        raise InputError(f"{experiment.id}: the experiment has no data, expected a [data] table.")
    check_coordinates(experiment, options.coordinates)
    check_variant(priors, experiment)
    options = options.suited_to(experiment)
    priors = priors.resolved(experiment.largest_stress)
    data = program_data(experiment, priors, solver=solver, use_likelihood=use_likelihood)
    task = SamplingTask(
        name=experiment.id,
        data_kind=experiment.provenance.kind,
        program=protocol_of(experiment).program,
        data=data,
        options=options,
        write_inputs=lambda run: _write_inputs(run, experiment, priors),
        choose_geometry=lambda model: choose_geometry(
            model,
            data,
            experiment,
            priors,
            wanted=options.coordinates,
            seed=options.seed,
            solver=solver,
        ),
        draw_start=lambda chain: draw_initial_values(
            experiment, priors, seed=options.seed, chain=chain
        ),
        manifest=priors_record(priors, experiment),
    )
    return run_task(task, directory, solver=solver, command=command)


def run_task(
    task: SamplingTask, directory: Path, *, solver: SolverOptions, command: str
) -> tuple[ChainFailure, ...]:
    """Run the chains of a task that a run directory lacks and record everything in it.

    Parameters
    ----------
    task : SamplingTask
        What to sample.
    directory, solver, command
        As for `run_chains`, which says what is returned and raised.
    """
    run = RunDirectory(directory)
    options = task.options
    model = load_program(task.program)
    identity = fingerprint(task.data, options, model.key)
    with run.claimed(identity):
        task.write_inputs(run)
        if not run.stan_data_file.is_file():
            _write_geometry(run, task.data, task.choose_geometry(model))
        record = run_record(
            run,
            name=task.name,
            data_kind=task.data_kind,
            options=options,
            identity=identity,
            use_likelihood=bool(task.data["use_likelihood"]),
            command=command,
        )
        run.update_manifest(
            {
                **record,
                **task.manifest,
                "refits": run.read_manifest().get("refits", []),
                "solver": {**asdict(solver), "tolerance": _tolerance_in(run)},
            }
        )
        return complete_chains(
            model, run, options, lambda chain: _draw_start(model, run, task, chain)
        )


def complete_chains(
    model: Program,
    run: RunDirectory,
    options: SamplerOptions,
    draw_start: Callable[[int], dict[str, list[float]]],
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

    Returns
    -------
    tuple of ChainFailure
        Chains that did not finish.

    Raises
    ------
    SamplingError
        If no chain finished, now or before.
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
    run.update_manifest(
        {
            "status": "chains missing" if failures else "sampled",
            "failures": [asdict(failure) for failure in failures],
            "chains": run.chain_records(),
        }
    )
    if not run.finished_chains():
        raise SamplingError(f"No chain finished: {failures[0].reason}")
    return failures


def tighten_solver(run: RunDirectory, pareto_k: float) -> float:
    """Put a run's chains aside and have them sampled again at a tighter tolerance.

    Coordinates, metric and initial values stay; `run_chains` with the same inputs then runs all
    chains. The manifest's list ``refits`` notes what was put aside and why.

    Parameters
    ----------
    run : RunDirectory
        A run with finished chains.
    pareto_k : float
        Its diagnostic of the solver's tolerance.

    Returns
    -------
    float
        The new tolerance.
    """
    loose = _tolerance_in(run)
    manifest = run.read_manifest()
    with run.claimed(manifest["fingerprint"]):
        aside = run.supersede_chains(f"tolerance_{loose:.0e}")
        refit = {"tolerance": loose, "pareto_k": pareto_k, "chains": aside}
        run.update_manifest({"refits": [*manifest["refits"], refit]})
        data: StanData = json.loads(run.stan_data_file.read_text(encoding="utf-8"))
        tight = loose / TIGHTENING
        write_json(
            run.stan_data_file,
            {**data, "relative_tolerance": tight, "absolute_tolerance": tight},
        )
    return tight


def _tolerance_in(run: RunDirectory) -> float:
    """Tolerance with which the run's chains are sampled, tightened or as asked for."""
    data: StanData = json.loads(run.stan_data_file.read_text(encoding="utf-8"))
    return float(data["relative_tolerance"])


def _write_geometry(run: RunDirectory, data: StanData, geometry: Geometry) -> None:
    """Save coordinates, metric and Stan data; the data go last: they tell that all is there."""
    system, reason = geometry.system, geometry.reason
    logger.info(
        f"Coordinates: {system}, as asked for."
        if reason == "asked for"
        else f"Coordinates: {system}, because {reason}."
    )
    run.update_manifest({"coordinates": {"system": system, "reason": reason}})
    if geometry.centre is not None and geometry.covariance is not None:
        write_json(
            run.metric_file,
            {
                "inv_metric": geometry.covariance.tolist(),
                "centre": geometry.centre.tolist(),
            },
        )
    write_json(run.stan_data_file, {**data, **geometry.block})


def _draw_start(
    model: Program, run: RunDirectory, task: SamplingTask, chain: int
) -> dict[str, list[float]]:
    """Start of one chain: around the mode, or from the prior where none was found."""
    if not run.metric_file.is_file():
        return task.draw_start(chain)
    data: StanData = json.loads(run.stan_data_file.read_text(encoding="utf-8"))
    laplace = json.loads(run.metric_file.read_text(encoding="utf-8"))
    centre, covariance = (np.array(laplace[key]) for key in ("centre", "inv_metric"))
    return draw_start_around(model, data, centre, covariance, seed=task.options.seed, chain=chain)


def _write_inputs(run: RunDirectory, experiment: Experiment, priors: PriorSet) -> None:
    """Save what the run needs to be trusted and repeated; written once, before sampling."""
    keep_experiment(run, experiment, run.experiment_file)
    write_atomically(run.priors_file, lambda path: save_priors(priors, path))


def keep_experiment(run: RunDirectory, experiment: Experiment, file: Path) -> None:
    """Save a self-contained copy of a test, unless it is there.

    Parameters
    ----------
    run : RunDirectory
        That the file is in.
    experiment : Experiment
        The test.
    file : Path
        Its TOML file, with its table beside it.
    """
    if file.is_file():
        return
    scratch = run.new_scratch()
    save_experiment(experiment, scratch)
    file.parent.mkdir(parents=True, exist_ok=True)
    # The table goes first: the TOML file is what tells that the copy is complete.
    for written in sorted(scratch.iterdir()):
        written.replace(file.parent / written.name)
