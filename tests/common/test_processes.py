"""Programs beside this process: what they print, time limits, and an end with this process."""

import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import psutil
import pytest
from killing import make_old

from pyburgers.common.processes import side_by_side, start
from pyburgers.common.scratch import PREFIX, clear_abandoned, scratch_folder


def hear_interrupts() -> None:
    """Have a process hear Ctrl-C, also where a shell started the tests in the background."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def test_a_program_that_prints_much_is_waited_for(tmp_path: Path) -> None:
    running = start([sys.executable, "-c", "print('x' * 1_000_000)"], tmp_path / "console.txt")
    running.wait()
    assert not running.failed
    assert running.printed() == "x" * 1_000_000 + "\n"


def test_a_program_is_waited_for_up_to_a_time_limit(tmp_path: Path) -> None:
    running = start(["sleep", "600"], tmp_path / "console.txt")
    running.wait(0.1)
    assert running.failed
    assert running.out_of_time


def test_programs_run_side_by_side_to_their_ends_or_to_a_time_limit(tmp_path: Path) -> None:
    sentences = {"short": "echo one; echo two", "wrong": "echo why; exit 3", "long": "sleep 600"}
    starting = (
        start(["sh", "-c", text], tmp_path / f"{name}.txt") for name, text in sentences.items()
    )
    ended = [one for _, some in side_by_side(starting, at_once=2, limit=1.0) for one in some]
    found = {one.console.stem: (one.failed, one.out_of_time) for one in ended}
    assert found == {"short": (False, False), "wrong": (True, False), "long": (True, True)}
    said = {one.console.stem: one.console_tail() for one in ended}
    assert said == {"short": "one | two", "wrong": "why", "long": "it left no console output."}


STARTING = """
import sys
from pathlib import Path
from pyburgers.common.processes import start
from pyburgers.common.scratch import scratch_folder
with scratch_folder() as folder:
    start(["sh", "-c", sys.argv[1]], folder / "console.txt").wait()
"""


RUNNING = {
    "prints": "while true; do echo x; sleep 0.5; done",
    "is silent": "sleep 600",
    "starts others": "sleep 600 & sh -c 'sleep 600 & sleep 600' & wait",
    "ignores signals": "trap '' HUP INT TERM; sleep 600; sleep 600",
}
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT)


@pytest.mark.parametrize("program", RUNNING.values(), ids=RUNNING)
def test_a_whole_tree_ends_when_the_process_that_started_it_does(
    program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each signal goes to one such process alone, and the next one clears temporary files."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    command = [sys.executable, "-c", STARTING, program]
    with ExitStack() as stack:
        started = {}
        for how in SIGNALS:
            started[how] = subprocess.Popen(
                command, stderr=subprocess.DEVNULL, preexec_fn=hear_interrupts
            )
            stack.callback(started[how].wait)
            stack.callback(started[how].kill)
        deadline = time.monotonic() + 60
        while len(list(tmp_path.glob("*/console.txt"))) < len(started):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        time.sleep(0.3)
        begun = {
            how: psutil.Process(process.pid).children(recursive=True)
            for how, process in started.items()
        }
        assert all(begun.values())
        for how, process in started.items():
            process.send_signal(how)
        for process in started.values():
            process.wait(timeout=60)
    _, alive = psutil.wait_procs([one for some in begun.values() for one in some], timeout=10)
    left = {one for one in alive if one.status() != psutil.STATUS_ZOMBIE}
    assert [how for how, some in begun.items() if left & {*some}] == []
    make_old(*tmp_path.iterdir())
    subprocess.run([sys.executable, "-c", STARTING, "true"], check=True)
    assert not list(tmp_path.iterdir())


def test_a_program_that_ends_leaves_nothing_running(tmp_path: Path) -> None:
    running = start(["sh", "-c", "sleep 600 >/dev/null 2>&1 & echo $!"], tmp_path / "console.txt")
    running.wait()
    assert not running.failed
    left = int(running.printed())
    deadline = time.monotonic() + 10.0  # the system ends a killed process in its own time
    while psutil.pid_exists(left) and psutil.Process(left).status() != psutil.STATUS_ZOMBIE:
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_only_old_folders_of_killed_processes_are_cleared(tmp_path: Path) -> None:
    """Not those of others, of living processes, or of the last minute; nor links, nor files."""
    abandoned, young = (tmp_path / f"{PREFIX}{name}" for name in ("abcdefg_", "01234567"))
    others = [tmp_path / "pyburgers-results", tmp_path / f"{PREFIX}link_abc"]
    others += [tmp_path / f"{PREFIX}{name}" for name in ("abandoned", "abcdefg", "ABCDEFGH", "")]
    others.append(tmp_path / f"x{PREFIX}abcdefgh")
    for folder in (*others, tmp_path / "mine", abandoned / "below", young):
        if folder.name != f"{PREFIX}link_abc":
            folder.mkdir(parents=True)
    (tmp_path / f"{PREFIX}link_abc").symlink_to(tmp_path / "mine")
    (tmp_path / f"{PREFIX}12345678").touch()
    with scratch_folder(tmp_path) as folder:
        here = set(tmp_path.iterdir())
        make_old(*here - {young})
        clear_abandoned(tmp_path)
        assert set(tmp_path.iterdir()) == here - {abandoned}
        assert folder in here
    make_old(young)
    clear_abandoned(tmp_path)
    assert set(tmp_path.iterdir()) == here - {abandoned, young, folder}
