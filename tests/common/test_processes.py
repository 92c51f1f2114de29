"""Work in processes: outcomes, errors, and an end with the one who asked for it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from pyburgers.common.errors import InputError, SystemFailureError
from pyburgers.common.processes import completed, number_of_processes, side_by_side, start


def refuse(word: str) -> None:
    raise InputError(f"{word}: refused.")


def test_every_call_is_done_and_keeps_its_key() -> None:
    calls = {number: (number, 3) for number in range(4)}
    done = dict(completed(pow, calls, processes=2, folder=Path("out")))
    assert done == {number: number**3 for number in range(4)}


def test_an_error_of_a_call_is_raised_as_it_is() -> None:
    with pytest.raises(InputError, match=r"^ice: refused.$"):
        list(completed(refuse, {1: ("ice",)}, processes=1, folder=Path("out")))


def test_a_killed_process_is_told_with_what_to_do() -> None:
    with pytest.raises(SystemFailureError, match=r"^out: the system killed a process; free memory"):
        list(completed(os._exit, {1: (1,)}, processes=1, folder=Path("out")))


def test_an_interrupt_ends_calls_that_run() -> None:
    calls = {"short": (0,), "long": (600,), "waiting": (600,)}
    done = completed(time.sleep, calls, processes=2, folder=Path("out"))
    assert next(done) == ("short", None)
    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        done.throw(KeyboardInterrupt())
    assert time.monotonic() - started < 60
    assert not [
        one for one in psutil.Process().children() if "spawn_main" in " ".join(one.cmdline())
    ]


INTERRUPTED = """
import os, signal, sys
from pathlib import Path
from pyburgers.common.processes import completed

signal.signal(signal.SIGINT, signal.default_int_handler)
calls = {k: (f"touch {sys.argv[1]}/{k}; sleep 600",) for k in range(3)}
try:
    list(completed(os.system, calls, processes=2, folder=Path("out")))
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.mark.parametrize("inherited", [signal.SIG_DFL, signal.SIG_IGN], ids=["heard", "ignored"])
def test_an_interrupt_of_the_whole_group_ends_workers_and_their_programs(
    inherited: signal.Handlers, tmp_path: Path
) -> None:
    """A terminal sends it to all; a shell has it ignored by what it runs in the background."""
    before = signal.signal(signal.SIGINT, inherited)
    try:
        process = subprocess.Popen(
            [sys.executable, "-c", INTERRUPTED, str(tmp_path)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
    finally:
        signal.signal(signal.SIGINT, before)
    deadline = time.monotonic() + 60
    while len(list(tmp_path.iterdir())) < 2 and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    assert process.communicate(timeout=60) == ("interrupted\n", "")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["0", "1"]
    # Python's resource tracker, which multiprocessing starts, ends a moment after the program.
    while left := [one for one in psutil.process_iter() if runs_in_session(one, process.pid)]:
        assert time.monotonic() < deadline, left
        time.sleep(0.05)


def runs_in_session(process: psutil.Process, session: int) -> bool:
    try:
        return os.getsid(process.pid) == session and process.status() != psutil.STATUS_ZOMBIE
    except (ProcessLookupError, psutil.NoSuchProcess):
        return False  # it ended in the meantime


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


def test_processes_are_one_for_each_core_and_no_more_than_calls() -> None:
    cores = os.cpu_count() or 1
    assert number_of_processes(None, 1000) == cores
    assert number_of_processes(3, 2) == 2
    assert number_of_processes(3, 0) == 1
    with pytest.raises(InputError, match=r"^jobs is 0, expected at least 1.$"):
        number_of_processes(0, 2)
