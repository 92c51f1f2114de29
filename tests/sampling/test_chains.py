"""Chains as processes: side by side, cut short, and the progress that they show."""

import logging
import re
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import xarray as xr
from conftest import SMALL_RUN, Problem
from terminal import Terminal

from pyburgers.cmdstan.program import Program
from pyburgers.common.errors import SystemFailureError
from pyburgers.common.messages import messages_where_watched
from pyburgers.common.processes import start
from pyburgers.fitting.fit import Fit
from pyburgers.sampling import chains
from pyburgers.sampling.chains import (
    ConsoleFile,
    _Chain,
    _keep_chain,
    _start_chain,
    bars,
    quarter_messages,
    shown_progress,
)
from pyburgers.sampling.run_directory import RunDirectory


def test_fits_in_threads_are_like_any_other_and_leave_the_streams_alone(
    small_problem: Problem,
    small_fit: Fit,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO, "pyburgers")
    options = replace(SMALL_RUN, parallel_chains=1)
    with ThreadPoolExecutor(2) as pool:
        waiting = [
            pool.submit(small_problem.fit, tmp_path / name, options) for name in ("one", "other")
        ]
        print("mine")
        found = [one.result() for one in waiting]
    assert capfd.readouterr() == ("mine\n", "")
    assert caplog.messages.count("100% of 2 chains of 250 iterations (sampling)") == 2
    expected = small_fit.posterior["posterior"].to_dataset().drop_attrs()
    for one in found:
        draws = one.posterior["posterior"].to_dataset().drop_attrs()
        xr.testing.assert_identical(draws, expected)


def test_draws_that_were_cut_short_are_not_kept(small_fit: Fit, tmp_path: Path) -> None:
    """A full disk does that, and the process ends well all the same."""
    small_fit.save(tmp_path / "run")
    run = RunDirectory(tmp_path / "run")
    whole = run.draws_file(2).read_text(encoding="utf-8").splitlines(keepends=True)
    scratch = run.new_scratch()
    (scratch / "draws.csv").write_text("".join(whole[:-40]), encoding="utf-8")
    ended = start([sys.executable, "-c", ""], scratch / "draws.txt")
    ended.wait()
    failure = _keep_chain(run, _Chain(2, ended, ConsoleFile(ended.console)), SMALL_RUN.draws)
    assert failure is not None
    assert "Chain 2 left incomplete draws" in failure.reason
    assert "free disk space" in failure.reason
    assert run.failure_file(2).is_file()


def test_a_program_that_does_not_start_is_named(small_fit: Fit, tmp_path: Path) -> None:
    small_fit.save(tmp_path / "run")
    run = RunDirectory(tmp_path / "run")
    with pytest.raises(SystemFailureError, match=r"nowhere: could not be started"):
        _start_chain(Program(tmp_path / "nowhere"), run, 1, SMALL_RUN, None, None)


def test_most_of_a_short_warm_up_is_left_to_the_metric(small_fit: Fit) -> None:
    """Stan's own first phase takes 75 iterations however few there are."""
    text = small_fit.directory.draws_file(1).read_text(encoding="utf-8")
    first, last = (
        int(found[1])
        for name in ("init_buffer", "term_buffer")
        if (found := re.search(rf"{name} = (\d+)", text))
    )
    assert 0 < first < last
    assert first + last <= SMALL_RUN.warmup_iterations / 2


def test_there_are_at_most_as_many_chains_as_cores(
    joint: Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[int] = []

    @contextmanager
    def no_looks(*_: Any, at_once: int, **__: Any) -> Iterator[tuple[()]]:
        seen.append(at_once)
        yield ()

    monkeypatch.setattr(chains, "cores", lambda: 8)
    monkeypatch.setattr(chains, "closing", lambda looks: looks)
    monkeypatch.setattr(chains, "side_by_side", no_looks)
    for number in (20, 3):
        asked = replace(SMALL_RUN, chains=number, warmup=50)
        chains.run_side_by_side(Program(Path("program")), joint.directory, [1, 2], asked)
    assert seen == [8, 3]


def test_without_terminal_there_is_a_line_for_each_quarter_of_all_chains_with_the_time_left(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    caplog.set_level(logging.INFO, "pyburgers")
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    with shown_progress([1, 2], 100) as advance:
        for chain, seen, start in ((1, range(1, 101), 0), (2, (60, 100), 90)):
            for iteration in seen:
                now[0] = 1.2 * (start + iteration)
                advance(chain, iteration, "Warmup" if iteration <= 50 else "Sampling")
    assert caplog.messages == [
        "25% of 2 chains of 100 iterations (warmup), about 3 min left",
        "50% of 2 chains of 100 iterations (sampling), about 2 min left",
        "80% of 2 chains of 100 iterations (sampling), about 45 s left",
        "100% of 2 chains of 100 iterations (sampling)",
    ]


def test_without_terminal_slow_chains_are_told_after_a_minute(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    caplog.set_level(logging.INFO, "pyburgers")
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    with shown_progress([1], 1000) as advance:
        for iteration in (10, 20, 30, 40):
            now[0] += 36
            advance(1, iteration, "Warmup")
    assert caplog.messages == ["2% of 1 chain of 1000 iterations (warmup), about 59 min left"]


def test_on_a_terminal_every_chain_has_a_bar(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)  # no fixture, after which pytest sets it
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
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)  # no fixture, after which pytest sets it
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
    quarter_messages([1], 100)(1, 50, "Warmup")  # nobody listens by default
    assert capsys.readouterr() == ("", "")


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
