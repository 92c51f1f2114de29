"""Work spread over processes, which end when this one does."""

import os
import threading
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.connection import wait
from pathlib import Path
from typing import TypeVar

import psutil

from pyburgers.common.errors import InputError, SamplingError

Key = TypeVar("Key")
Outcome = TypeVar("Outcome")


def cores() -> int:
    """Return how many compilers, chains or fits to run at once."""
    return os.cpu_count() or 1


def number_of_processes(jobs: int | None, n_calls: int) -> int:
    """Return how many processes to start for a number of calls: by default one for each core.

    Raises
    ------
    InputError
        If fewer than one is asked for.
    """
    jobs = cores() if jobs is None else jobs
    if jobs < 1:
        raise InputError(f"jobs is {jobs}, expected at least 1.")
    return min(jobs, max(1, n_calls))


def completed(
    work: Callable[..., Outcome],
    calls: Mapping[Key, Sequence[object]],
    *,
    processes: int,
    folder: Path,
) -> Generator[tuple[Key, Outcome], None, None]:
    """Call a function for each set of arguments in processes of their own.

    When a call raises, no further ones begin, and those that run go on to their end. An interrupt
    ends them all.

    Parameters
    ----------
    work : callable
        A function of a module. What it gets and returns travels between processes.
    calls : mapping of any key to sequence
        Arguments of each call, begun in this order.
    processes : int
        Calls at the same time.
    folder : Path
        Where the work goes, for error messages.

    Yields
    ------
    tuple
        Key and what its call returned, as calls end.

    Raises
    ------
    SamplingError
        If the system killed a process.
    """
    with ProcessPoolExecutor(
        processes, mp_context=get_context("spawn"), initializer=_end_with_parent
    ) as pool:
        waiting = {pool.submit(work, *arguments): key for key, arguments in calls.items()}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        except BrokenProcessPool as error:
            raise SamplingError(
                f"{folder}: the system killed a process; free memory or run fewer of them side by "
                "side, then run the same command again: it does only what is missing."
            ) from error
        except BaseException as error:
            if not isinstance(error, Exception):
                _kill_workers()
            pool.shutdown(cancel_futures=True)
            raise


def _kill_workers() -> None:
    """Kill this process's workers and the chains that they run."""
    for worker in active_children():
        chains = _descendants(worker.pid)
        worker.kill()
        _kill(chains)


def _descendants(process: int | None) -> list[psutil.Process]:
    """Return what a process, by default this one, has started, and what that has."""
    try:
        return psutil.Process(process).children(recursive=True)
    except psutil.NoSuchProcess:
        return []  # it ended by itself in the meantime


def _kill(processes: Sequence[psutil.Process]) -> None:
    for process in processes:
        try:
            process.kill()
        except psutil.NoSuchProcess:
            continue  # it ended by itself in the meantime


def _end_with_parent() -> None:
    """Have this process and its chains end when the parent does, however it does."""
    parent = parent_process()
    assert parent is not None  # processes of the pool have one

    def watch() -> None:
        wait([parent.sentinel])
        _kill(_descendants(None))
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
