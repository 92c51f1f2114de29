"""How far chains are: a bar for each on a terminal, a few messages elsewhere."""

import logging
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import parent_process
from pathlib import Path
from typing import TextIO

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

logger = logging.getLogger(__name__)

Advance = Callable[[int, int, str], None]
"""Takes a chain, how many iterations it has done, and their phase."""

_ITERATION = re.compile(rb"^Iteration:\s*(\d+) /.*\((\w+)\)\s*$", re.MULTILINE)


@contextmanager
def shown_progress(chains: Sequence[int], total: int) -> Iterator[Advance]:
    """Show how far each chain is while the block runs.

    Bars are drawn on standard error if that is a terminal, save by processes beside each other,
    which would draw over each other's bars.

    Parameters
    ----------
    chains : sequence of int
        Chains to show.
    total : int
        Iterations of each chain, warm-up included.
    """
    if sys.stderr.isatty() and parent_process() is None:
        with bars(chains, total, sys.stderr) as advance:
            yield advance
    else:
        yield quarter_messages(total)


@contextmanager
def bars(chains: Sequence[int], total: int, stream: TextIO) -> Iterator[Advance]:
    """Draw a bar for each chain; the last state stays on the screen.

    Parameters
    ----------
    chains, total
        As for `shown_progress`.
    stream : file object
        A terminal.
    """
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


def quarter_messages(total: int) -> Advance:
    """Return what logs a line for each quarter of a chain.

    Parameters
    ----------
    total : int
        Iterations of each chain, warm-up included.
    """
    quarters: dict[int, int] = {}

    def advance(chain: int, iteration: int, phase: str) -> None:
        quarter = 4 * iteration // total
        if quarter > quarters.get(chain, 0):
            quarters[chain] = quarter
            logger.info(f"chain {chain}: {iteration} of {total} iterations ({phase.lower()})")

    return advance


class ConsoleFile:
    """The console of a chain, read while CmdStan writes it.

    Parameters
    ----------
    path : Path
        The file.
    """

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
