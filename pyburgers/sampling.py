"""NUTS runs: initial values, chains as processes, resume, manifest."""

import json
import os
import platform
import re
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, redirect_stdout
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self, get_args

import cmdstanpy
import numpy as np
import psutil

from pyburgers.cmdstan import find_cmdstan, load_model, toolchain
from pyburgers.errors import InputError, SamplingError
from pyburgers.experiment import Experiment
from pyburgers.experiment_files import save_experiment
from pyburgers.geometry import Coordinates, Geometry, check_coordinates, choose_geometry
from pyburgers.initial_values import draw_initial_values, draw_start_around
from pyburgers.priors import PriorSet, save_priors
from pyburgers.progress import ChainProgress, IterationLines
from pyburgers.run_directory import (
    RunDirectory,
    sha256_of_file,
    sha256_of_json,
    write_atomically,
    write_json,
    write_text,
)
from pyburgers.simulation import console_tail, program_for, quiet_cmdstanpy
from pyburgers.stan_data import SolverOptions, StanData, program_data
from pyburgers.toolchain import cores
from pyburgers.variants import check_variant, variant_of

_SIGNAL = re.compile(r"retcodes=\[-(\d+)\]")
PACKAGES = ("pyburgers", "cmdstanpy", "arviz", "numpy", "scipy", "pandas", "xarray")

TARGET_ACCEPTANCE: Mapping[str, float] = MappingProxyType(
    {"constant_rate": 0.95, "forced_oscillation": 0.9}
)
WARMUP: Mapping[str, int] = MappingProxyType({"constant_rate": 300, "forced_oscillation": 250})
"""Default target acceptance and warm-up by protocol: as little as leaves (almost) no divergences.
"""

INDECISIVE = frozenset({"chains", "chain_timeout", "parallel_chains"})
"""Options that change no draw of a chain."""

STEP_SIZE_SHARE = 0.2
"""Share of the warm-up, at its end, in which the step size alone adapts.

By default longer than Stan's 50 iterations: a chain that passes the valley's bend there would keep
far too small a step.
"""

FIRST_PHASE_SHARE = 0.1
"""Share of the warm-up, at its start, after which the metric of valley coordinates adapts, once.

Stan adapts it several times, first to a few draws that know one arm of the valley only, and finds a
new step size each time: that took 1.7 times as many leapfrog steps in the warm-up of PIL40 and
PIL72, and 1.25 times as many after it. Oscillations, whose first metric fits less well, are sampled
better Stan's way."""

FIRST_STEP = 0.1
"""First step size where the first metric fits the posterior."""

TIGHTENING = 10.0
"""Factor between the tolerance of a run and of its repetition."""


@dataclass(frozen=True)
class SamplerOptions:
    """How NUTS runs.

    Attributes
    ----------
    chains, draws : int
        Number of chains, and kept iterations of each.
    warmup : int or None
        Iterations before them; None takes what suits the protocol, `WARMUP`.
    seed : int
        Seed of initial values and chains.
    adapt_delta : float or None
        Target acceptance rate; None takes what suits the protocol, `TARGET_ACCEPTANCE`.
    max_treedepth : int
        Trajectories have at most 2**max_treedepth - 1 leapfrog steps.
    coordinates : {"auto", "plain", "valley", "sheared"}
        Coordinates of the sampler (`docs/coordinates.md`); the posterior is the same. "auto"
        takes valley coordinates (constant rate) or sheared ones (oscillation) where the priors
        and the record suit them.
    chain_timeout : float or None
        Seconds after which a chain is stopped and reported as failed.
    parallel_chains : int or None
        Chains that run side by side; None runs one for each core.
    """

    chains: int = 4
    warmup: int | None = None
    draws: int = 1000
    seed: int = 1
    adapt_delta: float | None = None
    max_treedepth: int = 10
    coordinates: Coordinates = "auto"
    chain_timeout: float | None = None
    parallel_chains: int | None = None

    def __post_init__(self) -> None:
        """Check the values.

        Raises
        ------
        InputError
            If one is out of range.
        """
        limits = {
            "chains": (self.chains, 1, 1000),
            "draws": (self.draws, 4, 10**6),
            "seed": (self.seed, 0, 2**31 - 1),
            "max_treedepth": (self.max_treedepth, 1, 20),
        }
        if self.parallel_chains is not None:
            limits["parallel_chains"] = (self.parallel_chains, 1, 1000)
        if self.warmup is not None:
            limits["warmup"] = (self.warmup, 20, 10**6)
        for name, (value, least, most) in limits.items():
            if not least <= value <= most:
                raise InputError(f"{name} is {value}, expected a number from {least} to {most}.")
        if self.adapt_delta is not None and not 0 < self.adapt_delta < 1:
            raise InputError(f"adapt_delta is {self.adapt_delta}, expected between 0 and 1.")
        if self.coordinates not in get_args(Coordinates):
            raise InputError(
                f"coordinates is {self.coordinates!r}, expected one of "
                f"{', '.join(get_args(Coordinates))}."
            )
        if self.chain_timeout is not None and self.chain_timeout <= 0:
            raise InputError(f"chain_timeout is {self.chain_timeout} s, expected more than 0.")

    @property
    def warmup_iterations(self) -> int:
        """Warm-up of settled options (`suited_to`)."""
        assert self.warmup is not None  # only settled options are sampled with
        return self.warmup

    def suited_to(self, experiment: Experiment) -> Self:
        """Fill in what is left to the experiment's protocol."""
        protocol = experiment.protocol
        return replace(
            self,
            warmup=self.warmup or WARMUP[protocol],
            adapt_delta=self.adapt_delta or TARGET_ACCEPTANCE[protocol],
        )


@dataclass(frozen=True)
class ChainFailure:
    """A chain that did not finish.

    Attributes
    ----------
    chain : int
        Identifier.
    reason : str
        What ended it, where, and what to try, as one sentence.
    """

    chain: int
    reason: str


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
    choose_geometry: Callable[[cmdstanpy.CmdStanModel], Geometry]
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
    report: Callable[[str], None],
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
    report : callable
        Receives progress sentences.

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
        program=program_for(experiment),
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
            report=report,
        ),
        draw_start=lambda chain: draw_initial_values(
            experiment, priors, seed=options.seed, chain=chain
        ),
        manifest=priors_record(priors, experiment),
    )
    return run_task(task, directory, solver=solver, command=command, report=report)


def priors_record(priors: PriorSet, experiment: Experiment) -> dict[str, Any]:
    """Note what the priors say besides densities: variant of the model, another source.

    Parameters
    ----------
    priors : PriorSet
        Of the run.
    experiment : Experiment
        Its test, or one of several.
    """
    return {
        "variant": variant_of(priors, experiment).record(),
        "priors_from": None if priors.flow_law is None else priors.flow_law.source,
    }


def run_task(
    task: SamplingTask,
    directory: Path,
    *,
    solver: SolverOptions,
    command: str,
    report: Callable[[str], None],
) -> tuple[ChainFailure, ...]:
    """Run the chains of a task that a run directory lacks and record everything in it.

    Parameters
    ----------
    task : SamplingTask
        What to sample.
    directory, solver, command, report
        As for `run_chains`, which says what is returned and raised.
    """
    run = RunDirectory(directory)
    options = task.options
    model = load_model(task.program, report=report)
    identity = fingerprint(task.data, options, Path(str(model.exe_file)).parent.name)
    with run.claimed(identity), no_process_left(model):
        task.write_inputs(run)
        if not run.stan_data_file.is_file():
            _write_geometry(run, task.data, task.choose_geometry(model), report)
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
            model, run, options, lambda chain: _draw_start(model, run, task, chain), report=report
        )


def complete_chains(
    model: cmdstanpy.CmdStanModel,
    run: RunDirectory,
    options: SamplerOptions,
    draw_start: Callable[[int], dict[str, list[float]]],
    *,
    report: Callable[[str], None],
) -> tuple[ChainFailure, ...]:
    """Run the chains that a claimed run directory lacks and note in its manifest how they ended.

    Parameters
    ----------
    model : CmdStanModel
        The program.
    run : RunDirectory
        With its inputs, Stan data and manifest.
    options : SamplerOptions
        Settled settings.
    draw_start : callable
        Start of a chain, by its identifier; called where the directory has none.
    report : callable
        Receives progress sentences.

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
        report(f"{options.chains - len(missing)} of {options.chains} chains are there already.")
    for chain in missing:
        if not run.initial_values_file(chain).is_file():
            write_json(run.initial_values_file(chain), draw_start(chain))
    failures = _run_missing(model, run, missing, options) if missing else ()
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


def _write_geometry(
    run: RunDirectory, data: StanData, geometry: Geometry, report: Callable[[str], None]
) -> None:
    """Save coordinates, metric and Stan data; the data go last: they tell that all is there."""
    system, reason = geometry.system, geometry.reason
    report(
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
    model: cmdstanpy.CmdStanModel, run: RunDirectory, task: SamplingTask, chain: int
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
    return {
        "fingerprint": identity,
        "experiment": name,
        "data_kind": data_kind,
        "command": command,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "status": "sampling",
        "failures": [],
        "sampler": asdict(options),
        "use_likelihood": use_likelihood,
        "versions": software_versions(),
        "hashes": {
            file.relative_to(run.path).as_posix(): sha256_of_file(file)
            for file in (*_files_in(run.inputs), run.stan_data_file)
        },
    }


def _files_in(folder: Path) -> list[Path]:
    """Return all files below a folder, in order."""
    return sorted(file for file in folder.rglob("*") if file.is_file())


def software_versions() -> dict[str, str | None]:
    """Return the versions of what makes the draws, for manifests."""
    found = find_cmdstan()
    tools = toolchain(found) if found is not None else None
    return {
        "python": platform.python_version(),
        **{package: version(package) for package in PACKAGES},
        "cmdstan": tools.cmdstan_version if tools else None,
        "compiler": tools.compiler if tools else None,
    }


def missing_chains(
    finished: Iterable[int], manifest: Mapping[str, Any]
) -> tuple[ChainFailure, ...]:
    """Return the chains that a run was asked for and does not have, and why.

    Parameters
    ----------
    finished : iterable of int
        Chains that are there.
    manifest : mapping
        Of the run.
    """
    there = set(finished)
    reasons = {failure["chain"]: failure["reason"] for failure in manifest["failures"]}
    return tuple(
        ChainFailure(
            chain,
            reasons.get(
                chain,
                f"Chain {chain} has not run to its end because the run was stopped; run the "
                "same command again: it runs only the missing chains.",
            ),
        )
        for chain in range(1, manifest["sampler"]["chains"] + 1)
        if chain not in there
    )


def _run_missing(
    model: cmdstanpy.CmdStanModel,
    run: RunDirectory,
    chains: Sequence[int],
    options: SamplerOptions,
) -> tuple[ChainFailure, ...]:
    """Run chains side by side, as many as the options say; stop them all on an interrupt."""
    stopping = threading.Event()
    failures: list[ChainFailure] = []
    screen = ChainProgress(chains, options.warmup_iterations + options.draws, sys.stderr)
    lines = IterationLines(screen.advance)
    workers = min(len(chains), options.parallel_chains or cores())
    with quiet_cmdstanpy(), screen, redirect_stdout(lines), ThreadPoolExecutor(workers) as pool:
        pending: set[Future[ChainFailure | None]] = {
            pool.submit(_run_chain, model, run, chain, options, stopping) for chain in chains
        }
        try:
            while pending:
                done, pending = wait(pending, return_when=FIRST_COMPLETED)
                failures += [failure for f in done if (failure := f.result()) is not None]
        except BaseException:
            stopping.set()
            _stop_chains(model, pending)
            run.update_manifest({"status": "interrupted"})
            raise
    return tuple(sorted(failures, key=lambda failure: failure.chain))


def _stop_chains(model: cmdstanpy.CmdStanModel, pending: set[Future[ChainFailure | None]]) -> None:
    """Kill the CmdStan processes that this process started, until no thread waits for one."""
    running = {future for future in pending if not future.cancel()}
    while running:
        _kill_chains(model)
        # Again, since a thread may have been about to start its process.
        running = wait(running, timeout=0.2).not_done


@contextmanager
def no_process_left(model: cmdstanpy.CmdStanModel) -> Iterator[None]:
    """Kill what runs of the program when an exception, such as an interrupt, ends the block."""
    try:
        yield
    except BaseException:
        _kill_chains(model)
        raise


def _kill_chains(model: cmdstanpy.CmdStanModel) -> None:
    """Kill the processes of the program that this process started."""
    executable = os.path.realpath(str(model.exe_file))
    for child in psutil.Process().children(recursive=True):
        try:
            if child.exe() == executable:
                child.kill()
        except psutil.NoSuchProcess:
            continue  # it ended by itself in the meantime


def _run_chain(
    model: cmdstanpy.CmdStanModel,
    run: RunDirectory,
    chain: int,
    options: SamplerOptions,
    stopping: threading.Event,
) -> ChainFailure | None:
    """Run one chain in a scratch folder and move it into place when it is complete."""
    if stopping.is_set():
        return None
    scratch = run.new_scratch()
    first_metric = str(run.metric_file) if run.metric_file.is_file() else None
    total = options.warmup_iterations + options.draws
    started = time.monotonic()
    try:
        model.sample(
            data=str(run.stan_data_file),
            chains=1,
            chain_ids=[chain],
            seed=options.seed,
            inits=str(run.initial_values_file(chain)),
            iter_warmup=options.warmup_iterations,
            iter_sampling=options.draws,
            metric="dense_e",
            inv_metric=first_metric,
            step_size=None if first_metric is None else FIRST_STEP,
            adapt_delta=options.adapt_delta,
            **_warmup_phases(run, options.warmup_iterations),
            max_treedepth=options.max_treedepth,
            output_dir=str(scratch),
            sig_figs=12,
            refresh=max(1, total // 100),
            timeout=options.chain_timeout,
            show_progress=False,
            show_console=True,
            force_one_process_per_chain=True,
        )
    except (RuntimeError, TimeoutError, ValueError) as error:
        if stopping.is_set():
            return None
        seconds = time.monotonic() - started
        return _explain_failure(run, chain, scratch, error, seconds, options.chain_timeout)
    finished = scratch / "finished"
    finished.mkdir()
    (draws,) = scratch.glob("*.csv")
    draws.rename(finished / "draws.csv")
    for console in scratch.glob("*stdout.txt"):
        console.rename(finished / "console.txt")
    write_json(finished / "timing.json", {"wall_seconds": time.monotonic() - started})
    run.keep_chain(chain, finished)
    shutil.rmtree(scratch)
    return None


def _warmup_phases(run: RunDirectory, warmup: int) -> dict[str, Any]:
    """Return the iterations of the phases of the warm-up, by cmdstanpy's names."""
    last = int(STEP_SIZE_SHARE * warmup)
    if run.read_manifest().get("coordinates", {}).get("system") != "valley":
        return {"adapt_step_size": last}
    first = int(FIRST_PHASE_SHARE * warmup)
    return {
        "adapt_init_phase": first,
        "adapt_metric_window": warmup - first - last,
        "adapt_step_size": last,
    }


def _explain_failure(
    run: RunDirectory,
    chain: int,
    scratch: Path,
    error: Exception,
    seconds: float,
    limit: float | None,
) -> ChainFailure:
    """Put into one sentence what ended a chain, where, and what to try; keep its console."""
    consoles = sorted(scratch.glob("*stdout.txt"))
    text = consoles[0].read_text(encoding="utf-8", errors="replace") if consoles else ""
    run.failure_file(chain).parent.mkdir(exist_ok=True)
    write_text(run.failure_file(chain), text + f"\n{error}\n")
    iterations = [line for line in text.splitlines() if line.startswith("Iteration:")]
    place = iterations[-1].strip() if iterations else "before the first iteration"
    values = run.initial_values_file(chain).read_text(encoding="utf-8")
    killed_by = _signal_in(str(error))
    # cmdstanpy may find the chain terminated before its timer has said why.
    stopped = killed_by == "SIGTERM" and limit is not None and seconds >= limit
    if isinstance(error, TimeoutError) or stopped:
        cause = f"ran into its time limit after {seconds:.0f} s"
        remedy = "raise the limit or shorten the run"
    elif killed_by is not None:
        cause = f"was killed by the system ({killed_by})"
        remedy = "free memory, or run fewer programs beside it"
    else:
        cause = "ended with an error"
        remedy = "tighten the prior bounds or raise the solver's step limit"
    return ChainFailure(
        chain,
        f"Chain {chain} {cause} at '{place}', started from {' '.join(values.split())}, last "
        f"console lines: {console_tail(scratch)}; {remedy}, then run the same command again: it "
        "repeats only the missing chains (whole console in "
        f"{run.failure_file(chain).relative_to(run.path)}).",
    )


def _signal_in(message: str) -> str | None:
    """Name of the signal in cmdstanpy's error text, where it gives a negative return code."""
    found = _SIGNAL.search(message)
    return signal.Signals(int(found[1])).name if found else None
