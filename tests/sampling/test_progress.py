"""Progress of chains: bars on a terminal, a few messages elsewhere."""

import io
import logging
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from pyburgers.common.messages import messages_where_watched
from pyburgers.sampling.chains import ConsoleFile, bars, quarter_messages, shown_progress


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def terminal_as_stderr(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Exchange standard error until the test ends; not a fixture, after which pytest sets it."""
    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    return stream


def test_without_terminal_there_is_a_line_for_each_quarter_of_all_chains_with_the_time_left(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    caplog.set_level(logging.INFO, "pyburgers")
    now = iter(range(0, 1000, 60))
    monkeypatch.setattr(time, "monotonic", lambda: next(now))
    with shown_progress([1, 2], 100) as advance:
        for chain, seen in ((1, range(1, 101)), (2, (60, 100))):
            for iteration in seen:
                advance(chain, iteration, "Warmup" if iteration <= 50 else "Sampling")
    assert caplog.messages == [
        "25% of 2 chains of 100 iterations (warmup), about 3 min left",
        "50% of 2 chains of 100 iterations (sampling), about 2 min left",
        "80% of 2 chains of 100 iterations (sampling), about 45 s left",
        "100% of 2 chains of 100 iterations (sampling)",
    ]


def test_on_a_terminal_every_chain_has_a_bar(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    terminal = terminal_as_stderr(monkeypatch)
    caplog.set_level(logging.INFO, "pyburgers")
    with shown_progress([1, 3], 200) as advance:
        advance(3, 120, "Sampling")
    shown = terminal.getvalue()
    assert "chain 1" in shown
    assert "chain 3" in shown
    assert "120/200 sampling" in shown
    assert caplog.messages == []


def test_processes_beside_each_other_draw_no_bars(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    terminal = terminal_as_stderr(monkeypatch)
    monkeypatch.setattr("pyburgers.common.messages.parent_process", lambda: "a pool")
    caplog.set_level(logging.INFO, "pyburgers")
    with shown_progress([1], 100) as advance:
        advance(1, 50, "Warmup")
    assert terminal.getvalue() == ""
    (message,) = caplog.messages
    assert message.startswith("50% of 1 chain of 100 iterations (warmup), about ")


class Shell:
    """The shell of a notebook, as IPython gives it."""

    kernel = None


class Display:
    """What a cell shows: of each handle the last."""

    def __init__(self) -> None:
        self.shown: list[str] = []

    def HTML(self, text: str) -> str:  # noqa: N802 - IPython's name
        return text

    def display(self, text: str, *, display_id: bool) -> "Display":
        assert display_id
        return self

    def update(self, text: str) -> None:
        self.shown.append(text)


def notebook(monkeypatch: pytest.MonkeyPatch) -> Display:
    """Have the process look like the kernel of a notebook."""
    display = Display()
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=Shell))
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    return display


def test_a_notebook_has_one_bar_of_all_chains(monkeypatch: pytest.MonkeyPatch) -> None:
    display = notebook(monkeypatch)
    with shown_progress([1, 2], 100) as advance:
        for iteration in range(1, 101):
            advance(1, iteration, "Warmup" if iteration <= 50 else "Sampling")
        advance(2, 100, "Sampling")
    assert len(display.shown) == 51
    assert display.shown[0].startswith('<progress style="width: 40ex" value="0.010"></progress> 1%')
    assert display.shown[-1].endswith("100% of 2 chains of 100 iterations (sampling)")


def test_quiet_is_asked_for_by_the_level_of_the_logger(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    display = notebook(monkeypatch)
    with messages_where_watched():
        logging.getLogger("pyburgers.some").info("a message")
    assert capsys.readouterr().err == "a message\n"
    logging.getLogger("pyburgers").setLevel(logging.WARNING)
    with messages_where_watched():
        logging.getLogger("pyburgers.some").info("a message")
    with shown_progress([1], 100) as advance:
        advance(1, 100, "Sampling")
    assert display.shown == []
    assert capsys.readouterr().err == ""


def test_the_streams_of_the_process_stay_in_place(capsys: pytest.CaptureFixture[str]) -> None:
    before = sys.stdout, sys.stderr
    with bars([1], 100, Terminal()):
        assert (sys.stdout, sys.stderr) == before
        print("mine")
    assert capsys.readouterr().out == "mine\n"


def test_nobody_listens_by_default(capfd: pytest.CaptureFixture[str]) -> None:
    quarter_messages([1], 100)(1, 50, "Warmup")
    assert capfd.readouterr() == ("", "")


def test_a_console_is_followed_line_by_line(tmp_path: Path) -> None:
    file = tmp_path / "stdout.txt"
    file.write_text("refresh = 1\n", encoding="utf-8")
    console = ConsoleFile(file)
    assert console.new_iterations() == []
    with file.open("a", encoding="utf-8") as stream:
        print("Gradient evaluation took 0.001 seconds", file=stream)
        print("Iteration:  1 / 100 [  1%]  (Warmup)", file=stream)
        print("Iteration: 40 / 100 [ 40%]  (Warmup)", file=stream)
        stream.write("Iteration: 10")
        stream.flush()
        assert console.new_iterations() == [(1, "Warmup"), (40, "Warmup")]
        assert console.new_iterations() == []
        stream.write("0 / 100 [100%]  (Sampling)\n")
    assert console.new_iterations() == [(100, "Sampling")]
