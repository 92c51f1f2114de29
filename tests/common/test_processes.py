"""Programs beside this process: what they print, time limits, and an end with this process."""

import subprocess
import sys
import time
from pathlib import Path

import psutil

from pyburgers.common.processes import side_by_side, start


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


def test_a_program_ends_when_the_process_that_started_it_was_killed(tmp_path: Path) -> None:
    code = (
        "import os, sys; from pathlib import Path; from pyburgers.common.processes import start\n"
        "start(['sh', '-c', 'while true; do echo x; sleep 0.05; done'], Path(sys.argv[1])).wait()"
    )
    process = subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "console.txt")])
    deadline = time.monotonic() + 60
    while not (children := psutil.Process(process.pid).children()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    process.kill()
    process.wait()
    _, alive = psutil.wait_procs(children, timeout=10)
    assert not [one for one in alive if one.status() != psutil.STATUS_ZOMBIE]
