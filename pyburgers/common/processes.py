"""Programs and workers beside this process, which end when it does or is interrupted."""

import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from concurrent.futures import wait as wait_for
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.connection import wait
from pathlib import Path
from typing import IO, TypeVar

import psutil

from pyburgers.common.errors import InputError, SystemFailureError

Key = TypeVar("Key")
Outcome = TypeVar("Outcome")

FREE_MEMORY = (
    "free memory or run fewer programs side by side, then run the same command again: it does only "
    "what is missing."
)
"""What to do where the system starts no program, or kills one."""

POLL_SECONDS = 0.03
"""Time between two looks at programs that run side by side."""


def cores() -> int:
    """Return how many compilers, chains or fits to run at once: the cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
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


@dataclass(eq=False)
class Running:
    """A program that runs, or has run, beside this process.

    Attributes
    ----------
    process : Popen
        The program.
    console : Path
        What it prints.
    started : float
        When, by the clock of `time.monotonic` (s).
    seconds : float
        How long it took, once it has ended.
    out_of_time : bool
        Whether it was stopped at a time limit.
    """

    process: subprocess.Popen[bytes]
    console: Path
    started: float = field(default_factory=time.monotonic)
    seconds: float = 0.0
    out_of_time: bool = False

    @property
    def failed(self) -> bool:
        """Whether it ended otherwise than well."""
        return self.out_of_time or self.process.returncode != 0

    @property
    def killed_by(self) -> str | None:
        """Name of the signal with which the system ended it, if that is how it ended."""
        code = self.process.returncode
        return None if self.out_of_time or code is None or code >= 0 else signal.Signals(-code).name

    def require_not_killed(self) -> None:
        """Check that the program has ended by itself.

        Raises
        ------
        SystemFailureError
            If the system killed it.
        """
        if self.killed_by is not None:
            raise SystemFailureError(
                f"A program was killed by the system ({self.killed_by}); {FREE_MEMORY}"
            )

    def has_ended(self, limit: float | None = None) -> bool:
        """Tell whether the program has ended, which it does at a time limit (s)."""
        runs = self.process.poll() is None
        self.seconds = time.monotonic() - self.started
        if runs and limit is not None and self.seconds >= limit:
            self.out_of_time = True
        if runs and not self.out_of_time:
            self._copy_printed()
            return False
        self.stop()
        return True

    def wait(self) -> None:
        """Wait for its end, and end it at an interrupt."""
        try:
            os.set_blocking(self._pipe.fileno(), True)
            self._copy_printed()
            self.process.wait()
        finally:
            self.stop()

    def stop(self) -> None:
        """End the program, if it has not ended."""
        self.process.kill()
        self.process.wait()
        if not self._pipe.closed:
            self._copy_printed()
            self._pipe.close()

    @property
    def _pipe(self) -> IO[bytes]:
        assert self.process.stdout is not None  # as `start` makes it
        return self.process.stdout

    def _copy_printed(self) -> None:
        """Copy what the program has printed since the last call to its file."""
        if text := self._pipe.read():
            with self.console.open("ab") as file:
                file.write(text)

    def printed(self) -> str:
        """Return all that it has printed."""
        return self.console.read_text(encoding="utf-8", errors="replace")

    def console_tail(self, lines: int = 6) -> str:
        """Return the last lines that it has printed, as one."""
        tail = [line.strip() for line in self.printed().strip().splitlines()[-lines:]]
        return " | ".join(line for line in tail if line) or "it left no console output."


def start(
    command: Sequence[str], console: Path, *, environment: Mapping[str, str] | None = None
) -> Running:
    """Start a program that reads nothing and whose console goes to a file.

    It prints into a pipe, so that it ends when it next prints if this process was killed.

    Parameters
    ----------
    command : sequence of str
        The program and its arguments.
    console : Path
        What it prints.
    environment : mapping of str to str, optional
        Variables of its environment beside those of this process.

    Raises
    ------
    InputError
        If a path among the arguments has a line break.
    SystemFailureError
        If the system does not start it.
    """
    for part in command:
        if len(part.splitlines()) > 1:
            raise InputError(
                f"{part!r} has a line break, which the files of the programs cannot hold; expected "
                "folders without one, that of TMPDIR too."
            )
    console.touch()
    try:
        process = subprocess.Popen(
            command,
            bufsize=0,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env={**os.environ, **(environment or {})},
        )
    except OSError as error:
        raise SystemFailureError(
            f"{command[0]}: could not be started ({error.strerror}); {FREE_MEMORY}"
        ) from error
    running = Running(process, console)
    os.set_blocking(running._pipe.fileno(), False)
    return running


def side_by_side(
    starting: Iterator[Running], *, at_once: int, limit: float | None = None
) -> Generator[tuple[list[Running], list[Running]], None, None]:
    """Run programs side by side to their ends; stop all that run when the generator is closed.

    Parameters
    ----------
    starting : iterator of Running
        Starts the next program when asked for it.
    at_once : int
        How many may run.
    limit : float, optional
        Time of each (s), at which it is stopped.

    Yields
    ------
    tuple of two lists
        At every look: those that ran at the look before, and which of them have ended since.
    """
    running: list[Running] = []
    try:
        while True:
            while len(running) < at_once and (one := next(starting, None)) is not None:
                running.append(one)
            if not running:
                return
            time.sleep(POLL_SECONDS)
            ended = [one for one in running if one.has_ended(limit)]
            yield running, ended
            running = [one for one in running if one not in ended]
    finally:
        for one in running:
            one.stop()


def completed(
    work: Callable[..., Outcome],
    calls: Mapping[Key, Sequence[object]],
    *,
    processes: int,
    folder: Path,
    executor: Executor | None = None,
) -> Generator[tuple[Key, Outcome], None, None]:
    """Call a function for each set of arguments in processes of their own.

    When a call raises, no further ones begin, and those that run go on to their end. An interrupt
    ends them all, save those of an executor that was given.

    Parameters
    ----------
    work : callable
        A function of a module. What it gets and returns travels between processes.
    calls : mapping of any key to sequence
        Arguments of each call, begun in this order.
    processes : int
        Calls at the same time, where no executor is given.
    folder : Path
        Where the work goes, for error messages.
    executor : Executor, optional
        What does the calls; default processes of this machine, which end with this one.

    Yields
    ------
    tuple
        Key and what its call returned, as calls end.

    Raises
    ------
    SystemFailureError
        If the system killed a process.
    """
    with _own_processes(processes) if executor is None else nullcontext(executor) as pool:
        waiting = {pool.submit(work, *arguments): key for key, arguments in calls.items()}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        except BrokenProcessPool as error:
            raise SystemFailureError(
                f"{folder}: the system killed a process; {FREE_MEMORY}"
            ) from error
        except BaseException as error:
            begun = [future for future in waiting if not future.cancel()]
            if isinstance(error, Exception):
                wait_for(begun)
            raise


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
                _kill_workers()
            raise


def _kill_workers() -> None:
    """Kill this process's workers and the programs that they run."""
    found = []
    # All are stopped first: the pool ends the others when one is killed.
    for worker in active_children():
        with suppress(psutil.NoSuchProcess):
            found += _stopped(psutil.Process(worker.pid))
    _kill(found)


def _stopped(process: psutil.Process) -> list[psutil.Process]:
    """Stop a process, then what it has started, so that none starts another unseen."""
    process.suspend()
    found = [process]
    for child in process.children():
        with suppress(psutil.NoSuchProcess):  # it ended by itself in the meantime
            found += _stopped(child)
    return found


def _kill(processes: Iterable[psutil.Process]) -> None:
    for process in processes:
        with suppress(psutil.NoSuchProcess):  # it ended by itself in the meantime
            process.kill()


def _end_with_parent() -> None:
    """Have this process and its programs end when the parent does, however it does.

    An interrupt that the terminal sends to all of them is the parent's business.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    assert parent is not None  # processes of the pool have one

    def watch() -> None:
        wait([parent.sentinel])
        for child in psutil.Process().children():
            with suppress(psutil.NoSuchProcess):
                _kill(_stopped(child))
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
