"""Chains as processes: side by side, stopped together, each kept when it is complete."""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cmdstanpy
import psutil

from pyburgers.common.atomic_files import write_json, write_text
from pyburgers.common.errors import SamplingError
from pyburgers.common.processes import cores
from pyburgers.protocols.forward import console_tail
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.progress import ConsoleFile, shown_progress
from pyburgers.sampling.run_directory import RunDirectory

POLL_SECONDS = 0.1
"""Time between two looks at the chains."""

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

    Raises
    ------
    SamplingError
        If the system starts no process.
    """
    executable = Path(str(model.exe_file))
    waiting = list(chains)
    running: list[_Chain] = []
    failures: list[ChainFailure | None] = []
    at_once = options.parallel_chains or cores()
    with shown_progress(chains, options.warmup_iterations + options.draws) as advance:
        try:
            while waiting or running:
                while waiting and len(running) < at_once:
                    running.append(_start_chain(executable, run, waiting.pop(0), options))
                time.sleep(POLL_SECONDS)
                ended = [one for one in running if one.has_ended(options.chain_timeout)]
                for one in running:
                    for iteration, phase in one.console.new_iterations():
                        advance(one.identifier, iteration, phase)
                running = [one for one in running if one not in ended]
                failures += [_keep_chain(run, one) for one in ended]
        except BaseException:
            for one in running:
                one.stop()
            run.update_manifest({"status": "interrupted"})
            raise
    found = (failure for failure in failures if failure is not None)
    return tuple(sorted(found, key=lambda failure: failure.chain))


@contextmanager
def no_process_left(model: cmdstanpy.CmdStanModel) -> Iterator[None]:
    """Kill what runs of the program when an interrupt ends the block.

    At other exceptions nothing of this fit runs any more, but another thread's may.
    """
    try:
        yield
    except BaseException as error:
        if not isinstance(error, Exception):
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


@dataclass(eq=False)
class _Chain:
    """A CmdStan process.

    Attributes
    ----------
    identifier : int
        Of the chain.
    process : Popen
        What samples it.
    scratch : Path
        Folder of its files.
    console : ConsoleFile
        What it prints.
    started : float
        When (s).
    seconds : float
        How long it took, once it has ended.
    out_of_time : bool
        Whether it was stopped at its time limit.
    """

    identifier: int
    process: subprocess.Popen[bytes]
    scratch: Path
    console: ConsoleFile
    started: float
    seconds: float = 0.0
    out_of_time: bool = False

    def has_ended(self, limit: float | None) -> bool:
        """Tell whether the process has ended, which it does at a time limit (s)."""
        running = self.process.poll() is None
        self.seconds = time.monotonic() - self.started
        if running and limit is not None and self.seconds >= limit:
            self.out_of_time = True
            self.stop()
        return self.process.returncode is not None

    def stop(self) -> None:
        """End the process, if it has not ended."""
        self.process.kill()
        self.process.wait()


def _start_chain(
    executable: Path, run: RunDirectory, chain: int, options: SamplerOptions
) -> _Chain:
    """Start a chain in a scratch folder.

    The process is started here and not by cmdstanpy, which keeps what a chain prints to itself
    until the end, or prints it to the standard output of this process.
    """
    scratch = run.new_scratch()
    console = scratch / "stdout.txt"
    started = time.monotonic()
    with console.open("wb") as file:
        try:
            process = subprocess.Popen(
                _command(executable, run, chain, options, scratch),
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
            )
        except OSError as error:
            raise SamplingError(
                f"{executable}: could not be started ({error.strerror}); free memory or end other "
                "programs, then run the same command again: it runs only the missing chains."
            ) from error
    return _Chain(chain, process, scratch, ConsoleFile(console), started)


def _command(
    executable: Path, run: RunDirectory, chain: int, options: SamplerOptions, scratch: Path
) -> list[str]:
    """Return CmdStan's command line; what it does not name is CmdStan's default."""
    total = options.warmup_iterations + options.draws
    first_metric = (
        [f"stepsize={FIRST_STEP}", "metric=dense_e", f"metric_file={run.metric_file}"]
        if run.metric_file.is_file()
        else ["metric=dense_e"]
    )
    return [
        *(str(executable), f"id={chain}", "random", f"seed={options.seed}"),
        *("data", f"file={run.stan_data_file}", f"init={run.initial_values_file(chain)}"),
        *("output", f"file={scratch / 'draws.csv'}"),
        *(f"refresh={max(1, total // 100)}", "sig_figs=12"),
        "method=sample",
        *(f"num_samples={options.draws}", f"num_warmup={options.warmup_iterations}"),
        *("algorithm=hmc", "engine=nuts", f"max_depth={options.max_treedepth}", *first_metric),
        *("adapt", "engaged=1", f"delta={options.adapt_delta}"),
        *(f"{name}={n}" for name, n in _warmup_phases(run, options.warmup_iterations).items()),
    ]


def _keep_chain(run: RunDirectory, one: _Chain) -> ChainFailure | None:
    """Move a chain that has ended into place if it is complete; else say what ended it."""
    draws = one.scratch / "draws.csv"
    if one.out_of_time or one.process.returncode != 0:
        return _explain_failure(run, one)
    try:
        # A full disk can cut a file short though the process ends well.
        cmdstanpy.from_csv(str(draws), method="sample")
    except ValueError as error:
        return _explain_failure(run, one, str(error))
    finished = one.scratch / "finished"
    finished.mkdir()
    draws.rename(finished / "draws.csv")
    (one.scratch / "stdout.txt").rename(finished / "console.txt")
    write_json(finished / "timing.json", {"wall_seconds": one.seconds})
    run.keep_chain(one.identifier, finished)
    shutil.rmtree(one.scratch)
    return None


def _warmup_phases(run: RunDirectory, warmup: int) -> dict[str, int]:
    """Return the iterations of the phases of the warm-up, by CmdStan's names."""
    last = int(STEP_SIZE_SHARE * warmup)
    if run.read_manifest().get("coordinates", {}).get("system") != "valley":
        return {"term_buffer": last}
    first = int(FIRST_PHASE_SHARE * warmup)
    return {
        "init_buffer": first,
        "window": warmup - first - last,
        "term_buffer": last,
    }


def _explain_failure(run: RunDirectory, one: _Chain, defect: str = "") -> ChainFailure:
    """Put into one sentence what ended a chain, where, and what to try; keep its console.

    Parameters
    ----------
    run : RunDirectory
        That the chain is of.
    one : _Chain
        Ended.
    defect : str
        What is wrong with its draws, of a process that ended well.
    """
    chain, code = one.identifier, one.process.returncode
    text = (one.scratch / "stdout.txt").read_text(encoding="utf-8", errors="replace")
    run.failure_file(chain).parent.mkdir(exist_ok=True)
    write_text(run.failure_file(chain), text + f"\nreturn code {code}\n{defect}\n")
    iterations = [line for line in text.splitlines() if line.startswith("Iteration:")]
    place = iterations[-1].strip() if iterations else "before the first iteration"
    values = run.initial_values_file(chain).read_text(encoding="utf-8")
    if one.out_of_time:
        cause = f"ran into its time limit after {one.seconds:.0f} s"
        remedy = "raise the limit or shorten the run"
    elif code < 0:
        cause = f"was killed by the system ({signal.Signals(-code).name})"
        remedy = "free memory, or run fewer programs beside it"
    elif defect:
        cause = f"left incomplete draws ({defect})"
        remedy = "free disk space"
    else:
        cause = "ended with an error"
        remedy = "tighten the prior bounds or raise the solver's step limit"
    return ChainFailure(
        chain,
        f"Chain {chain} {cause} at '{place}', started from {' '.join(values.split())}, last "
        f"console lines: {console_tail(one.scratch)}; {remedy}, then run the same command again: "
        "it repeats only the missing chains (whole console in "
        f"{run.failure_file(chain).relative_to(run.path)}).",
    )
