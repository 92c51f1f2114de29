"""A progress bar for each chain, or a few plain lines where there is no terminal."""

import io
import re
import sys
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Self, TextIO

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

_ITERATION = re.compile(r"^Chain \[(\d+)\] Iteration:\s*(\d+) /\s*(\d+).*\((\w+)\)")


class ChainProgress:
    """Shows how far each chain is; use it as a context manager.

    Parameters
    ----------
    chains : sequence of int
        Chains to show.
    total : int
        Iterations of each chain, warm-up included.
    stream : file object
        Where to write: bars on a terminal, a line for each quarter otherwise.
    """

    def __init__(self, chains: Sequence[int], total: int, stream: TextIO) -> None:
        self._stream = stream
        self._quarter = dict.fromkeys(chains, 0)
        self._total = total
        self._bars: Progress | None = None
        self._task = {}
        if stream.isatty():
            self._bars = Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.completed}/{task.total} {task.fields[phase]}"),
                TimeElapsedColumn(),
                TimeRemainingColumn(),
                console=Console(file=stream),
            )
            self._task = {
                chain: self._bars.add_task(f"chain {chain}", total=total, phase="waiting")
                for chain in chains
            }

    def __enter__(self) -> Self:
        """Start drawing."""
        if self._bars is not None:
            self._bars.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop drawing and leave the last state on the screen."""
        if self._bars is not None:
            self._bars.stop()

    def advance(self, chain: int, iteration: int, phase: str) -> None:
        """Note that `chain` has done `iteration` iterations."""
        if self._bars is not None:
            self._bars.update(self._task[chain], completed=iteration, phase=phase.lower())
            return
        quarter = 4 * iteration // self._total
        if quarter > self._quarter[chain]:
            self._quarter[chain] = quarter
            self._stream.write(
                f"chain {chain}: {iteration} of {self._total} iterations ({phase.lower()})\n"
            )
            self._stream.flush()


class IterationLines(io.TextIOBase):
    """A text stream that turns CmdStan's iteration lines into calls and passes on the rest.

    cmdstanpy prints the consoles of its chains to standard output; redirected here, the lines
    drive the progress bars.

    Parameters
    ----------
    advance : callable
        Receives chain, iteration and phase.
    """

    def __init__(self, advance: Callable[[int, int, str], None]) -> None:
        super().__init__()
        self._advance = advance

    def writable(self) -> bool:
        """Tell that the stream takes text."""
        return True

    def write(self, text: str) -> int:
        """Take a piece of console output."""
        match = _ITERATION.match(text)
        if match:
            chain, iteration, _, phase = match.groups()
            self._advance(int(chain), int(iteration), phase)
        elif text.strip() and not text.startswith("Chain ["):
            sys.__stdout__.write(text) if sys.__stdout__ is not None else None
        return len(text)
