"""Tasks that each write their own results, their workers, and the part that this call does."""

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures import wait as wait_for
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.connection import wait
from pathlib import Path
from typing import TypeVar

import psutil

from pyburgers.common.errors import InputError, SystemFailureError
from pyburgers.common.processes import FREE_MEMORY, cores

Key = TypeVar("Key")
Value = TypeVar("Value")
Outcome = TypeVar("Outcome")


@dataclass(frozen=True)
class Workers:
    """The workers that do tasks.

    Attributes
    ----------
    executor : Executor or None
        Any of `concurrent.futures` whose workers are processes that see the same files as this
        one; None takes processes of this machine.
    jobs : int or None
        How many processes of this machine; None takes one for each core.
    part : tuple of two int, or None
        The part of the tasks that this call does, from 1, and the number of parts. Other calls,
        such as those of a job array, do the other parts. None does all tasks.

    Examples
    --------
    >>> workers = pyburgers.Workers(jobs=2)
    """

    executor: Executor | None = None
    jobs: int | None = None
    part: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        """Raise InputError if there are no processes, or there is no such part."""
        if isinstance(self.executor, ThreadPoolExecutor):
            raise InputError(
                "executor: found threads, expected processes such as those of ProcessPoolExecutor, "
                "because messages name the fit of their process."
            )
        if self.jobs is not None and self.jobs < 1:
            raise InputError(f"jobs is {self.jobs}, expected at least 1.")
        which, number = self.part or (1, 1)
        if not 1 <= which <= number:
            raise InputError(
                f"part is {which}/{number}, expected one from 1/{number} to {number}/{number}."
            )

    def mine(self, tasks: Mapping[Key, Value]) -> dict[Key, Value]:
        """Return the tasks of this part: every so many-th, so that parts take about as long."""
        which, number = self.part or (1, 1)
        return {key: tasks[key] for key in list(tasks)[which - 1 :: number]}

    def processes(self, n_tasks: int) -> int:
        """Return how many processes of this machine do a number of tasks."""
        return min(self.jobs or cores(), max(1, n_tasks))


ALL_HERE = Workers()
"""Processes of this machine, one for each core."""


@contextmanager
def run_tasks(
    work: Callable[..., Outcome],
    tasks: Mapping[Key, Sequence[object]],
    *,
    workers: Workers = ALL_HERE,
    out: Path,
) -> Iterator[Iterator[tuple[Key, Outcome]]]:
    """Do all tasks, each a call of a function of a module in a process of its own, in their order.

    Give key and outcome of each when it ends. If a task or the block of this context raises, no
    further ones begin, and those that run go on to their end; an interrupt ends them, save those of
    an executor that was given. Raise SystemFailureError, naming the folder `out`, if the system
    killed a process, and InputError if the script has none for its main process alone.
    """
    given, processes = workers.executor, workers.processes(len(tasks))
    call = work if given is None else partial(_elsewhere, work)
    with _own_processes(processes) if given is None else nullcontext(given) as pool:
        waiting = {pool.submit(call, *arguments): key for key, arguments in tasks.items()}
        try:
            yield ((waiting[future], future.result()) for future in as_completed(waiting))
        except BrokenProcessPool as error:
            if given is None and (script := _script_without_guard()):
                raise InputError(
                    f'{script}: found no line if __name__ == "__main__":, expected what it calls '
                    "below such a line, because each process of a task runs the file again."
                ) from error
            raise SystemFailureError(
                f"{out}: the system killed a process; {FREE_MEMORY}"
            ) from error
        except BaseException as error:
            begun = [future for future in waiting if not future.cancel()]
            if isinstance(error, Exception):
                wait_for(begun)
            raise


def _script_without_guard() -> str:
    """Return the file of the program where it has no line for its main process alone, else ""."""
    file = getattr(sys.modules["__main__"], "__file__", None)
    # No process runs the __main__.py of a package again.
    if file is None or Path(file).name == "__main__.py":
        return ""
    return "" if "__main__" in Path(file).read_text("utf-8", errors="replace") else str(file)


def _elsewhere(work: Callable[..., Outcome], *arguments: object) -> Outcome:
    """Call on another's executor, without the locks of files that xarray takes through Dask."""
    dask = sys.modules.get("dask")
    with nullcontext() if dask is None else dask.config.set(scheduler="synchronous"):
        return work(*arguments)


@contextmanager
def _own_processes(number: int) -> Iterator[Executor]:
    """Start processes that end with this one, and that an interrupt kills with their programs."""
    with ProcessPoolExecutor(
        number, mp_context=get_context("spawn"), initializer=_end_with_parent
    ) as pool:
        try:
            yield pool
        except BaseException as error:
            if not isinstance(error, Exception):
                _kill(worker.pid for worker in active_children())
            raise


def _kill(identifiers: Iterable[int | None]) -> None:
    """Kill processes and the programs that they run."""
    found = []
    # All are stopped first: a pool ends the others when one is killed.
    for identifier in identifiers:
        with suppress(psutil.NoSuchProcess):  # it ended by itself in the meantime
            found += _stopped(psutil.Process(identifier))
    for process in found:
        with suppress(psutil.NoSuchProcess):
            process.kill()


def _stopped(process: psutil.Process) -> list[psutil.Process]:
    """Stop a process, then what it has started, so that none starts another unseen."""
    process.suspend()
    found = [process]
    for child in process.children():
        with suppress(psutil.NoSuchProcess):  # it ended by itself in the meantime
            found += _stopped(child)
    return found


def _end_with_parent() -> None:
    """Have this process and its programs end with the parent, not at a terminal's interrupt."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    assert parent is not None  # processes of the pool have one

    def watch() -> None:
        wait([parent.sentinel])
        _kill(child.pid for child in psutil.Process().children())
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
