"""Run a command and note what it costs."""

import subprocess
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import psutil

POLLING_SECONDS = 0.1


@dataclass(frozen=True)
class Cost:
    """What a command cost.

    Attributes
    ----------
    exit_code : int or None
        None where it was stopped at its time limit.
    wall_seconds : float
        From start to end.
    peak_bytes : int
        Largest sum of the resident memory of the command and its descendants, sampled every
        `POLLING_SECONDS`.
    """

    exit_code: int | None
    wall_seconds: float
    peak_bytes: int


def run_together(
    commands: Sequence[Sequence[str]],
    *,
    environment: Mapping[str, str] | None = None,
    limit_seconds: float | None = None,
) -> Cost:
    """Run commands side by side until all have ended or the time is up; their output is dropped.

    Returns
    -------
    Cost
        Of all of them together; the exit code is the largest.
    """
    started = time.monotonic()
    peak = 0
    running = [
        subprocess.Popen(
            command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        for command in commands
    ]
    stopped = False
    try:
        while any(process.poll() is None for process in running):
            peak = max(peak, sum(_resident_bytes(process.pid) for process in running))
            stopped = limit_seconds is not None and time.monotonic() - started > limit_seconds
            if stopped:
                break
            time.sleep(POLLING_SECONDS)
    finally:
        for process in running:
            process.kill()
            process.wait()
    code = None if stopped else max(process.returncode for process in running)
    return Cost(code, time.monotonic() - started, peak)


def _resident_bytes(identifier: int) -> int:
    total = 0
    try:
        top = psutil.Process(identifier)
        for process in (top, *top.children(recursive=True)):
            total += process.memory_info().rss
    except psutil.NoSuchProcess:
        pass  # it ended while it was looked at; the next look sees the others
    return total
