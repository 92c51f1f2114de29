"""Commands and scripts of the documents, run in a folder of each page while the site is built."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

LONGEST_SECONDS = 1200
"""After which a command is given up."""


class ExecutionError(Exception):
    """A command of a page did not end as the page says; the message says how it did."""


@dataclass(frozen=True)
class Result:
    """What a command came to.

    Attributes
    ----------
    output, messages : str
        Standard output, and standard error, where commands tell of their progress.
    exit_code : int
        Of the last command.
    seconds : float
        Wall time.
    """

    output: str
    messages: str
    exit_code: int
    seconds: float


def run(command: list[str], folder: Path, expected: Collection[int] = (0,)) -> Result:
    """Run a command in a folder.

    Parameters
    ----------
    command : list of str
        Program and arguments.
    folder : Path
        Where it runs; made if it is not there.
    expected : collection of int
        Exit codes that the page speaks of.

    Raises
    ------
    ExecutionError
        If it ends with another exit code, or takes longer than `LONGEST_SECONDS`.
    """
    folder.mkdir(parents=True, exist_ok=True)
    # The commands of this interpreter first, and figures without a window.
    beside = f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', os.defpath)}"
    environment = {**os.environ, "PATH": beside, "MPLBACKEND": "agg", "COLUMNS": "100"}
    shown = " ".join(command)
    start = time.monotonic()
    with subprocess.Popen(
        command,
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            output, messages = process.communicate(timeout=LONGEST_SECONDS)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)  # what it has started, too
            raise ExecutionError(f"{shown}: took longer than {LONGEST_SECONDS} s.") from None
    if process.returncode not in expected:
        codes = " or ".join(map(str, expected))
        raise ExecutionError(
            f"{shown}: ended with {process.returncode}, expected {codes}; it printed:\n"
            f"{output}{messages}"
        )
    return Result(output, messages, process.returncode, time.monotonic() - start)


def run_shell(text: str, folder: Path, expected: Collection[int] = (0,)) -> Result:
    """Run lines of a shell, which stop at the first that fails (see `run`)."""
    return run(["bash", "-euo", "pipefail", "-c", text], folder, expected)


def run_python(text: str, folder: Path, expected: Collection[int] = (0,)) -> Result:
    """Run Python statements (see `run`)."""
    return run([sys.executable, "-c", text], folder, expected)


def shortened(output: str, most: int) -> str:
    """Return at most so many lines of an output, the first and the last ones."""
    lines = output.splitlines()
    if len(lines) <= most:
        return "\n".join(lines)
    head = most // 2
    left_out = len(lines) - most
    return "\n".join(
        [*lines[:head], f"... {left_out} lines ...", *lines[len(lines) - most + head :]]
    )
