"""Chains as processes: side by side, stopped together, each kept when it is complete."""

import os
import re
import shutil
import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cmdstanpy
import psutil

from pyburgers.progress import ChainProgress, IterationLines
from pyburgers.run_directory import RunDirectory, write_json, write_text
from pyburgers.sampler_options import SamplerOptions
from pyburgers.simulation import console_tail, quiet_cmdstanpy
from pyburgers.toolchain import cores

_SIGNAL = re.compile(r"retcodes=\[-(\d+)\]")

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


def run_side_by_side(
    model: cmdstanpy.CmdStanModel,
    run: RunDirectory,
    chains: Sequence[int],
    options: SamplerOptions,
) -> tuple[ChainFailure, ...]:
    """Run chains side by side, as many as the options say; stop them all on an interrupt.

    Parameters
    ----------
    model : CmdStanModel
        The program.
    run : RunDirectory
        Claimed, with Stan data and initial values.
    chains : sequence of int
        Their identifiers.
    options : SamplerOptions
        Settled settings.

    Returns
    -------
    tuple of ChainFailure
        Those that did not finish.
    """
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
