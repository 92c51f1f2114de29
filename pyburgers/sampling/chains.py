"""Chains as processes: side by side, stopped together, each kept when it is complete."""

import logging
import re
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TextIO

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from pyburgers.cmdstan.draw_files import join_draws, read_draws
from pyburgers.cmdstan.program import Program
from pyburgers.common.atomic_files import write_json, write_text
from pyburgers.common.messages import PATIENCE, in_notebook, is_watched
from pyburgers.common.processes import Running, cores, side_by_side
from pyburgers.common.toml_files import read_json
from pyburgers.common.units import counted, duration_text
from pyburgers.sampling.manifest import ChainFailure
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.repetitions import Resumption, adaptation, resumption
from pyburgers.sampling.run_directory import RunDirectory

logger = logging.getLogger(__name__)

Advance = Callable[[int, int, str], None]
"""Takes a chain, how many iterations it has done, and their phase."""

_ITERATION = re.compile(rb"^Iteration:\s*(\d+) /.*\((\w+)\)\s*$", re.MULTILINE)


@contextmanager
def shown_progress(chains: Sequence[int], total: int) -> Iterator[Advance]:
    """Show how far each chain, of `total` iterations with warm-up, is while the block runs.

    A notebook has one bar for all chains, a terminal one for each; elsewhere there are messages.
    """
    if not is_watched():
        yield quarter_messages(chains, total)
    elif in_notebook():
        yield notebook_bar(chains, total)
    else:
        with bars(chains, total, sys.stderr) as advance:
            yield advance


@contextmanager
def bars(chains: Sequence[int], total: int, stream: TextIO) -> Iterator[Advance]:
    """Draw a bar for each chain on a terminal; the last state stays on the screen."""
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed}/{task.total} {task.fields[phase]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=Console(file=stream),
        # The streams of the process stay as they are: others may be writing to them.
        redirect_stdout=False,
        redirect_stderr=False,
    ) as progress:
        tasks = {
            chain: progress.add_task(f"chain {chain}", total=total, phase="waiting")
            for chain in chains
        }
        yield lambda chain, iteration, phase: progress.update(
            tasks[chain], completed=iteration, phase=phase.lower()
        )


def quarter_messages(chains: Sequence[int], total: int) -> Advance:
    """Return what logs a line for each quarter of all chains together, with the time left."""
    return _in_steps(chains, total, 4, lambda _, text: logger.info(text), PATIENCE)


def notebook_bar(chains: Sequence[int], total: int) -> Advance:
    """Return what moves a bar for all chains together below the cell that runs."""
    shown = import_module("IPython.display")
    handle = shown.display(shown.HTML(""), display_id=True)

    def show(share: float, text: str) -> None:
        bar = f'<progress style="width: 40ex" value="{share:.3f}"></progress>'
        handle.update(shown.HTML(f"{bar} {text}"))

    return _in_steps(chains, total, 100, show)


def _in_steps(
    chains: Sequence[int],
    total: int,
    steps: int,
    show: Callable[[float, str], None],
    patience: float = np.inf,
) -> Advance:
    """Return what shows the share that all chains have done, first after `patience` (s) at most."""
    done = dict.fromkeys(chains, 0)
    started, last = time.monotonic(), 0
    is_shown = False

    def advance(chain: int, iteration: int, phase: str) -> None:
        nonlocal last, is_shown
        done[chain] = iteration
        share = sum(done.values()) / (len(done) * total)
        elapsed = time.monotonic() - started
        if int(steps * share) > last or (elapsed >= patience and not is_shown):
            last, is_shown = int(steps * share), True
            seconds = elapsed * (1 / share - 1)
            left = f", about {duration_text(seconds)} left" if share < 1 else ""
            of_all = f"{counted(len(done), 'chain')} of {total} iterations"
            show(share, f"{share:.0%} of {of_all} ({phase.lower()}){left}")

    return advance


class ConsoleFile:
    """The console of a chain, read while CmdStan writes it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._n_read = 0

    def new_iterations(self) -> list[tuple[int, str]]:
        """Return iterations and phases of the lines that were completed since the last call."""
        with self._path.open("rb") as file:
            file.seek(self._n_read)
            text = file.read()
        whole = text[: text.rfind(b"\n") + 1]
        self._n_read += len(whole)
        return [(int(iteration), phase.decode()) for iteration, phase in _ITERATION.findall(whole)]


STEP_SIZE_SHARE = 1 / 3
"""Share of the warm-up, at its end, in which the step size alone adapts.

By default longer than Stan's 50 iterations: a chain that passes the valley's bend there would keep
far too small a step.
"""

STEP_SIZE_DAMPING = 0.1
"""CmdStan's `gamma`, twice its own default.

That one suits a target acceptance of 0.8. Near 1 it is a rare bad trajectory that throws the step
size, by so much that those of one fit's chains came out a factor of 2.7 apart. With both numbers
here PIL72 took 0.69 of the leapfrog steps in each draw, at the same acceptance.
"""

FIRST_PHASE_SHARE = 0.15
"""Share of the warm-up, at its start, after which the metric of plain coordinates first adapts.

Stan waits 75 iterations however short the warm-up is, which leaves the metric few draws.
"""

FIRST_PHASE_SHARE_OF_VALLEY = 0.1
"""Share of the warm-up, at its start, after which the metric of valley coordinates adapts, once.

Stan adapts it several times, first to a few draws that know one arm of the valley only, and finds a
new step size each time: that took 1.7 times as many leapfrog steps in the warm-up of PIL40 and
PIL72, and 1.25 times as many after it. Oscillations, whose first metric fits less well, are sampled
better Stan's way."""

FIRST_STEP = 0.1
"""First step size where the first metric fits the posterior."""


DIGITS = 12
"""Of the numbers in the files of chains."""


@dataclass(frozen=True)
class Extension:
    """Draws that finished chains are extended by: which extension it is, from 1, and how many."""

    number: int
    draws: int


def chains_at_once(options: SamplerOptions) -> int:
    """Return how many chains run side by side on this machine."""
    return options.parallel_chains or min(options.chains, cores())


def run_side_by_side(
    model: Program,
    run: RunDirectory,
    chains: Sequence[int],
    options: SamplerOptions,
    extension: Extension | None = None,
) -> tuple[ChainFailure, ...]:
    """Run chains side by side, as many as the options say, and return those that did not finish.

    The run directory is claimed, with Stan data and initial values. With an extension finished
    chains go on, without one they start. All are stopped on an interrupt.
    """
    active: dict[Running, _Chain] = {}
    before = {chain: _before(run, chain, extension) for chain in chains}

    def starting() -> Iterator[Running]:
        for chain in chains:
            one = _start_chain(model, run, chain, options, before[chain], extension)
            active[one.running] = one
            yield one.running

    failures: list[ChainFailure] = []
    warmup = options.warmup_iterations if None in before.values() else 0
    total = warmup + (extension.draws if extension else options.draws)
    at_once, limit = chains_at_once(options), options.chain_timeout
    try:
        with (
            shown_progress(chains, total) as advance,
            closing(side_by_side(starting(), at_once=at_once, limit=limit)) as looks,
        ):
            for running, ended in looks:
                for one in (active[process] for process in running):
                    for iteration, phase in one.console.new_iterations():
                        advance(one.identifier, iteration, phase)
                kept = (_keep_chain(run, active[one], options.draws, extension) for one in ended)
                failures += [failure for failure in kept if failure is not None]
    except BaseException:
        run.update_manifest({"status": "interrupted"})
        raise
    return tuple(sorted(failures, key=lambda failure: failure.chain))


@dataclass(frozen=True, eq=False)
class _Chain:
    """A chain that runs or has run: its identifier, its process, and what that prints.

    It goes on from one that has taken `seconds_before` (s), or starts. The folder of the console is
    a scratch folder for all files of the chain.
    """

    identifier: int
    running: Running
    console: ConsoleFile
    seconds_before: float = 0.0


def _before(run: RunDirectory, chain: int, extension: Extension | None) -> Resumption | None:
    """Return what a chain goes on from: its own draws, those put aside, or None at a warm-up."""
    if extension is None:
        return resumption(run, chain)
    last = extension.number - 1
    seconds = float(read_json(run.timing_file(chain, last))["wall_seconds"])
    adapted = adaptation(run, chain)
    return Resumption(run.draws_file(chain, last), adapted, extension.number, seconds)


def _start_chain(
    program: Program,
    run: RunDirectory,
    chain: int,
    options: SamplerOptions,
    before: Resumption | None,
    extension: Extension | None,
) -> _Chain:
    """Start a chain in a scratch folder: with a warm-up, or where its draws before ended."""
    scratch, seed = run.new_scratch(), options.seed
    draws = extension.draws if extension else options.draws
    if before is None:
        start, warmup = run.initial_values_file(chain), options.warmup_iterations
        steps = _arguments_of_warmup(run, options)
    else:
        start, warmup, metric = scratch / "start.json", 0, scratch / "metric.json"
        write_json(metric, {"inv_metric": before.adapted.metric.tolist()})
        steps = [f"stepsize={before.adapted.step_size!r}", "metric=dense_e"]
        steps += [f"metric_file={metric}", "adapt", "engaged=0"]
        last = read_draws([before.draws_file])
        # The file of draws has no column of a vector without elements.
        first = read_json(run.initial_values_file(chain))
        place = {name: last[name][0, -1].tolist() for name in first if name in last}
        write_json(start, {**first, **place})
        # Extensions and repetitions with shorter steps have random numbers of their own.
        number = [before.number] if extension else [0, before.number]
        seed = int(np.random.SeedSequence([seed, *number]).generate_state(1)[0] >> 1)
    running = program.start(
        [
            "method=sample",
            *(f"num_samples={draws}", f"num_warmup={warmup}"),
            *("algorithm=hmc", "engine=nuts", f"max_depth={options.max_treedepth}"),
            *steps,
        ],
        data=run.stan_data_file,
        init=start,
        output=scratch / "draws.csv",
        seed=seed,
        chain=chain,
        digits=DIGITS,
        output_options=[f"refresh={max(1, (warmup + draws) // 100)}"],
    )
    seconds_before = 0.0 if before is None else before.seconds
    return _Chain(chain, running, ConsoleFile(running.console), seconds_before)


def _arguments_of_warmup(run: RunDirectory, options: SamplerOptions) -> list[str]:
    """Return the first step and metric of a chain, and how they adapt."""
    warmup = options.warmup_iterations
    first_metric = ["metric=dense_e"]
    if run.metric_file.is_file():
        first_metric += [f"stepsize={FIRST_STEP}", f"metric_file={run.metric_file}"]
    first, last = int(FIRST_PHASE_SHARE_OF_VALLEY * warmup), int(STEP_SIZE_SHARE * warmup)
    phases = {"init_buffer": int(FIRST_PHASE_SHARE * warmup), "term_buffer": last}
    manifest = run.read_manifest()
    if "first_window" in manifest:
        phases |= {"init_buffer": first, "window": min(manifest["first_window"], warmup // 2)}
    if manifest.get("coordinates", {}).get("system") == "valley":
        phases |= {"init_buffer": first, "window": warmup - first - last}
    return [
        *first_metric,
        *("adapt", "engaged=1", f"delta={options.adapt_delta}", f"gamma={STEP_SIZE_DAMPING}"),
        *(f"{name}={n}" for name, n in phases.items()),
    ]


def _keep_chain(
    run: RunDirectory, one: _Chain, n_draws: int, extension: Extension | None = None
) -> ChainFailure | None:
    """Move a chain that has ended into place if it is complete; else say what ended it."""
    n_draws = extension.draws if extension else n_draws
    running = one.running
    scratch = running.console.parent
    draws, finished = scratch / "draws.csv", scratch / "finished"
    if running.failed:
        return _explain_failure(run, one)
    try:
        # A full disk can cut a file short though the process ends well.
        (_, found, _) = read_draws([draws]).values.shape
    except ValueError as error:
        return _explain_failure(run, one, str(error))
    if found != n_draws:
        return _explain_failure(run, one, f"found {found}, expected {n_draws}")
    finished.mkdir()
    seconds, number = one.seconds_before + running.seconds, 0
    if extension is None:
        draws.rename(finished / "draws.csv")
    else:
        number = extension.number
        join_draws(run.draws_file(one.identifier, number - 1), draws, finished / "draws.csv")
    running.console.rename(finished / "console.txt")
    run.keep_chain(one.identifier, finished, wall_seconds=seconds, extension=number)
    shutil.rmtree(scratch)
    return None


def _explain_failure(run: RunDirectory, one: _Chain, defect: str = "") -> ChainFailure:
    """Put into one sentence what ended a chain, or is wrong with its draws, and what to try."""
    chain, running = one.identifier, one.running
    code, text = running.process.returncode, running.printed()
    run.failure_file(chain).parent.mkdir(exist_ok=True)
    write_text(run.failure_file(chain), text + f"\nreturn code {code}\n{defect}\n")
    iterations = [line for line in text.splitlines() if line.startswith("Iteration:")]
    place = iterations[-1].strip() if iterations else "before the first iteration"
    values = run.initial_values_file(chain).read_text(encoding="utf-8")
    if running.out_of_time:
        cause = f"ran into its time limit after {running.seconds:.0f} s"
        remedy = "raise the limit or shorten the run"
    elif running.killed_by is not None:
        cause = f"was killed by the system ({running.killed_by})"
        remedy = "free memory, or run fewer programs beside it"
    elif defect:
        cause = f"left incomplete draws ({defect})"
        remedy = "free disk space"
    else:
        cause = "ended with an error"
        remedy = "tighten the prior bounds or raise the solver's step limit"
    return ChainFailure(
        chain=chain,
        reason=f"Chain {chain} {cause} at '{place}', started from {' '.join(values.split())}, last "
        f"console lines: {running.console_tail()}; {remedy}, then run the same command again: "
        "it repeats only the missing chains (whole console in "
        f"{run.failure_file(chain).relative_to(run.path)}).",
        by_system=bool(defect) or running.killed_by is not None,
    )
