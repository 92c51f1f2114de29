"""Programs beside this process, which end with all that they have started when it does.

Every program has a process group of its own. A shell in the group waits for a pipe to end that this
process alone keeps open. So the whole group is killed however this process ends.
"""

import errno
import os
import select
import shutil
import signal
import subprocess
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import IO

from pyburgers.common.errors import InputError, SystemFailureError

FREE_MEMORY = (
    "free memory or run fewer programs side by side, then run the same command again: it does only "
    "what is missing."
)
"""Remedy if the system starts no program, or kills one."""

POLL_SECONDS = 0.03
"""Time between two looks at programs that run side by side."""

PART = 1 << 16
"""Bytes that are read at once of what a program has printed."""


GUARDED = 'exec 3<&0 </dev/null; (read -r _ <&3; kill -9 0) >/dev/null 2>&1 & exec "$@" 3<&-'
"""Becomes a program in the shell, beside a guard that kills the group when standard input ends."""


@cache
def _life_line(process: int) -> int:
    """Return the readable end of a pipe that ends with this process."""
    readable, _ = os.pipe()
    return readable


def cores() -> int:
    """Return how many compilers, chains or fits to run at once: the cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@dataclass(eq=False)
class Running:
    """A program, `started` on `time.monotonic` (s); what it prints goes to `console`."""

    process: subprocess.Popen[bytes]
    console: Path
    started: float = field(default_factory=time.monotonic)
    seconds: float = 0.0
    out_of_time: bool = False

    @property
    def failed(self) -> bool:
        """Whether it was stopped or ended with an error."""
        return self.out_of_time or self.process.returncode != 0

    @property
    def killed_by(self) -> str | None:
        """Name of the signal with which the system ended it, if that is how it ended."""
        code = self.process.returncode
        return None if self.out_of_time or code is None or code >= 0 else signal.Signals(-code).name

    def require_not_killed(self) -> None:
        """Raise SystemFailureError if the system killed the program."""
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

    def wait(self, limit: float | None = None) -> None:
        """Wait for its end, and end it at a time limit (s) or at an interrupt."""
        printed = select.poll()
        printed.register(self._pipe, select.POLLIN)
        try:
            while not self.has_ended(limit):
                printed.poll(1e3 * POLL_SECONDS)
        finally:
            self.stop()

    def stop(self) -> None:
        """End the program, if it has not ended, its guard, and all that it has left running."""
        with suppress(ProcessLookupError, PermissionError):  # nothing is left, nor may be reached
            os.killpg(self.process.pid, signal.SIGKILL)
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
        # An interrupt is heard between two parts, though the program prints without an end.
        while text := self._pipe.read(PART):
            with self.console.open("ab") as file:
                file.write(text)

    def printed(self) -> str:
        """Return all that it has printed."""
        return self.console.read_text(encoding="utf-8", errors="replace")

    def console_tail(self) -> str:
        """Return the last six lines that it has printed, as one."""
        tail = [line.strip() for line in self.printed().strip().splitlines()[-6:]]
        return " | ".join(line for line in tail if line) or "it left no console output."


def start(
    command: Sequence[str],
    console: Path,
    *,
    environment: Mapping[str, str] | None = None,
    folder: Path | None = None,
) -> Running:
    """Start a program that reads nothing, in its own environment and folder if these are given."""
    for part in command:
        if len(part.splitlines()) > 1:
            raise InputError(
                f"{part!r} has a line break, which the files of the programs cannot hold; expected "
                "folders without one, that of TMPDIR too."
            )
    console.touch()
    try:
        if shutil.which(command[0]) is None:
            raise FileNotFoundError(errno.ENOENT, "no such program")
        process = subprocess.Popen(
            ["/bin/sh", "-c", GUARDED, "sh", *command],
            bufsize=0,
            stdin=_life_line(os.getpid()),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            env=environment,
            cwd=folder,
            process_group=0,
        )
    except OSError as error:
        absent = error.errno in (errno.ENOENT, errno.EACCES)
        remedy = "see that it is there and may be run." if absent else FREE_MEMORY
        raise SystemFailureError(
            f"{command[0]}: could not be started ({error.strerror}); {remedy}"
        ) from error
    running = Running(process, console)
    os.set_blocking(running._pipe.fileno(), False)
    return running


def side_by_side(
    starting: Iterator[Running], *, at_once: int, limit: float | None = None
) -> Generator[tuple[list[Running], list[Running]], None, None]:
    """Run programs, `at_once`, each at most `limit` s; yield those that ran and have ended."""
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
