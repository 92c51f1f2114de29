"""Programs beside this process: what they print, time limits, and an end with this process."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from pyburgers.common.processes import side_by_side, start
from pyburgers.common.scratch import clear_abandoned, scratch_folder


def hear_interrupts() -> None:
    """Have a process hear Ctrl-C, also where a shell started the tests in the background."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def test_a_program_that_prints_much_is_waited_for(tmp_path: Path) -> None:
    running = start([sys.executable, "-c", "print('x' * 1_000_000)"], tmp_path / "console.txt")
    running.wait()
    assert not running.failed
    assert running.printed() == "x" * 1_000_000 + "\n"


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


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
@pytest.mark.parametrize(
    "program",
    [
        "while true; do echo x; sleep 0.05; done",
        "sleep 600",
        "sleep 600 & sh -c 'sleep 600 & sleep 600' & wait",
        "trap '' HUP INT TERM; sleep 600; sleep 600",
    ],
    ids=["prints", "is silent", "starts others", "ignores signals"],
)
def test_a_whole_tree_ends_when_the_process_that_started_it_does(
    how: signal.Signals, program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The signal goes to that process alone, and the next one clears its temporary files."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    command = [sys.executable, "-c", STARTING, program]
    process = subprocess.Popen(command, stderr=subprocess.DEVNULL, preexec_fn=hear_interrupts)
    deadline = time.monotonic() + 60
    while not list(tmp_path.glob("*/console.txt")):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(0.3)
    begun = psutil.Process(process.pid).children(recursive=True)
    assert begun
    process.send_signal(how)
    process.wait()
    _, alive = psutil.wait_procs(begun, timeout=10)
    assert not [one for one in alive if one.status() != psutil.STATUS_ZOMBIE]
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


def test_folders_of_others_and_of_living_processes_are_not_cleared(tmp_path: Path) -> None:
    """Nor links, nor files."""
    names = ("pyburgers-results", "pyburgers-scratch-notes", "mine", "pyburgers-scratch-link")
    (tmp_path / "pyburgers-results").mkdir()
    (tmp_path / "pyburgers-scratch-notes").touch()
    (tmp_path / "mine").mkdir()
    (tmp_path / "pyburgers-scratch-link").symlink_to(tmp_path / "mine")
    (tmp_path / "pyburgers-scratch-abandoned" / "below").mkdir(parents=True)
    with scratch_folder(tmp_path) as folder:
        clear_abandoned(tmp_path)
        left = {file.name for file in tmp_path.iterdir()}
        assert left == {*names, folder.name}
