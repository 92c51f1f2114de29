"""Progress of chains: bars on a terminal, a few lines elsewhere."""

import io
import sys

import pytest

from pyburgers.progress import ChainProgress, IterationLines


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def test_without_terminal_there_is_a_line_for_each_quarter() -> None:
    stream = io.StringIO()
    with ChainProgress([1, 2], 100, stream) as progress:
        for iteration in range(1, 101):
            progress.advance(1, iteration, "Warmup" if iteration <= 50 else "Sampling")
        progress.advance(2, 60, "Sampling")
    lines = stream.getvalue().splitlines()
    assert lines == [
        "chain 1: 25 of 100 iterations (warmup)",
        "chain 1: 50 of 100 iterations (warmup)",
        "chain 1: 75 of 100 iterations (sampling)",
        "chain 1: 100 of 100 iterations (sampling)",
        "chain 2: 60 of 100 iterations (sampling)",
    ]


def test_on_a_terminal_every_chain_has_a_bar() -> None:
    stream = Terminal()
    with ChainProgress([1, 3], 200, stream) as progress:
        progress.advance(3, 120, "Sampling")
    shown = stream.getvalue()
    assert "chain 1" in shown
    assert "chain 3" in shown
    assert "120/200 sampling" in shown


def test_iteration_lines_become_calls_and_the_rest_passes_through(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls: list[tuple[int, int, str]] = []
    screen = io.StringIO()
    monkeypatch.setattr(sys, "__stdout__", screen)
    lines = IterationLines(lambda *call: calls.append(call))
    print("Chain [2] Iteration:  40 / 100 [ 40%]  (Warmup)", file=lines)
    print("Chain [2] Gradient evaluation took 0.001 seconds", file=lines)
    print("Chain [11] Iteration: 100 / 100 [100%]  (Sampling)", file=lines)
    print("something else", file=lines)
    assert calls == [(2, 40, "Warmup"), (11, 100, "Sampling")]
    assert screen.getvalue().strip() == "something else"
