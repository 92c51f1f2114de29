"""Run a command and note what it costs."""

import subprocess
import time
from collections.abc import Sequence
from dataclasses import dataclass

import psutil

POLLING_SECONDS = 0.1
MIB = 2**20


@dataclass(frozen=True)
class Cost:
    """What commands cost: their time, and the largest sum of resident memory of all processes.

    The memory is looked at every `POLLING_SECONDS`.
    """

    wall_seconds: float
    peak_bytes: int


def run_together(commands: Sequence[Sequence[str]], *, limit_seconds: float | None = None) -> Cost:
    """Run commands side by side until all have ended or the time is up; their output is dropped."""
    started = time.monotonic()
    peak = 0
    running = [
        subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        for command in commands
    ]
    try:
        while any(process.poll() is None for process in running):
            peak = max(peak, sum(_resident_bytes(process.pid) for process in running))
            if limit_seconds is not None and time.monotonic() - started > limit_seconds:
                break
            time.sleep(POLLING_SECONDS)
    finally:
        for process in running:
            process.kill()
            process.wait()
    return Cost(time.monotonic() - started, peak)


def _resident_bytes(identifier: int) -> int:
    total = 0
    try:
        top = psutil.Process(identifier)
        for process in (top, *top.children(recursive=True)):
            total += process.memory_info().rss
    except psutil.NoSuchProcess:
        pass  # it ended while it was looked at; the next look sees the others
    return total
