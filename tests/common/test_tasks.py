"""Tasks in processes: parts, outcomes, errors, interrupts, and any executor does them."""

import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from types import MappingProxyType

import psutil
import pytest
from conftest import ICE

from pyburgers.common.errors import InputError, SystemFailureError
from pyburgers.common.processes import cores
from pyburgers.common.tasks import Workers, run_tasks
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.model.priors import default_priors

TWO = Workers(jobs=2)


@pytest.mark.parametrize("number", [1, 2, 3, 7])
def test_parts_are_all_tasks_once_and_about_as_many_each(number: int) -> None:
    tasks = {name: name.upper() for name in "abcde"}
    parts = [Workers(part=(which, number)).mine(tasks) for which in range(1, number + 1)]
    assert sorted(key for part in parts for key in part) == sorted(tasks)
    assert {key: value for part in parts for key, value in part.items()} == tasks
    assert max(map(len, parts)) - min(map(len, parts)) <= 1
    assert Workers().mine(tasks) == tasks


@pytest.mark.parametrize("part", [(0, 2), (3, 2), (1, 0)])
def test_parts_that_there_are_not_are_refused(part: tuple[int, int]) -> None:
    with pytest.raises(InputError, match="part is"):
        Workers(part=part)


def test_an_executor_that_is_given_does_the_calls_and_stays_open() -> None:
    with ProcessPoolExecutor(2) as pool:
        workers = Workers(pool)
        for _ in range(2):
            calls = {n: (n, 2) for n in range(5)}
            with run_tasks(pow, calls, workers=workers, out=Path("out")) as done:
                assert dict(done) == {n: n * n for n in range(5)}


def test_threads_are_refused() -> None:
    with (
        ThreadPoolExecutor(1) as pool,
        pytest.raises(InputError, match=r"^executor: found threads, expected processes"),
    ):
        Workers(pool)


def test_a_call_that_raises_ends_those_that_wait() -> None:
    with ProcessPoolExecutor(1) as pool:
        calls = {0: ("x",), **{n: (n,) for n in range(1, 4)}}
        with (
            pytest.raises(ValueError, match="invalid literal"),
            run_tasks(int, calls, workers=Workers(pool), out=Path("out")) as done,
        ):
            list(done)
        assert pool.submit(int, "7").result() == 7


def test_what_is_fitted_travels_between_processes() -> None:
    problem = problem_of([load_experiment(ICE / "PIL40.toml")], default_priors("ice"))
    again = pickle.loads(pickle.dumps(problem))
    assert again.given_priors == problem.given_priors
    assert isinstance(again.given_priors.priors, MappingProxyType)
    solver = problem.likelihood.solver
    assert program_data(again, solver=solver) == program_data(problem, solver=solver)


def test_processes_are_one_for_each_core_and_no_more_than_tasks() -> None:
    assert Workers().processes(1000) == cores()
    assert Workers(jobs=3).processes(2) == 2
    assert Workers(jobs=3).processes(0) == 1
    with pytest.raises(InputError, match=r"^jobs is 0, expected at least 1.$"):
        Workers(jobs=0)


def test_every_call_is_done_and_keeps_its_key() -> None:
    calls = {number: (number, 3) for number in range(4)}
    with run_tasks(pow, calls, workers=TWO, out=Path("out")) as done:
        assert dict(done) == {number: number**3 for number in range(4)}


def test_an_error_of_a_call_is_raised_as_it_is() -> None:
    with (
        pytest.raises(InputError, match=r"^jobs is 0, expected at least 1.$"),
        run_tasks(Workers, {1: (None, 0)}, out=Path("out")) as done,
    ):
        list(done)


def test_a_killed_process_is_told_with_what_to_do() -> None:
    with (
        pytest.raises(SystemFailureError, match=r"^out: the system killed a process; free memory"),
        run_tasks(os._exit, {1: (1,)}, out=Path("out")) as done,
    ):
        list(done)


UNGUARDED = """
from pathlib import Path
from pyburgers.common.tasks import run_tasks

with run_tasks(pow, {1: (1, 2)}, out=Path("out")) as done:
    list(done)
"""


def test_a_script_that_each_process_would_run_again_is_told(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(UNGUARDED, encoding="utf-8")
    command = [sys.executable, str(script)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert f"InputError: {script}: found no line if __name__ ==" in done.stderr
    assert "killed" not in done.stderr


def test_a_package_that_is_run_needs_no_guard(tmp_path: Path) -> None:
    (tmp_path / "tool").mkdir()
    text = UNGUARDED.replace("pow, {1: (1, 2)}", "__import__('os')._exit, {1: (1,)}")
    (tmp_path / "tool" / "__main__.py").write_text(text, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "tool"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert "SystemFailureError: out: the system killed a process" in done.stderr


def test_an_interrupt_ends_calls_that_run() -> None:
    calls = {"short": (0,), "long": (600,), "waiting": (600,)}
    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        _interrupt_after_one(calls)
    assert time.monotonic() - started < 60
    assert not [
        one for one in psutil.Process().children() if "spawn_main" in " ".join(one.cmdline())
    ]


def _interrupt_after_one(calls: Mapping[str, tuple[int]]) -> None:
    with run_tasks(time.sleep, calls, workers=TWO, out=Path("out")) as done:
        assert next(done) == ("short", None)
        raise KeyboardInterrupt


BETWEEN = """
import time
from pathlib import Path
from pyburgers.common.tasks import Workers, run_tasks

def work():
    calls = {"short": (0,), "long": (600,)}
    with run_tasks(time.sleep, calls, workers=Workers(jobs=2), out=Path("out")) as done:
        for key, _ in done:
            raise KeyboardInterrupt

work()
"""


def test_an_interrupt_between_outcomes_ends_a_script() -> None:
    """The traceback keeps what the script had, until Python has waited for its workers."""
    script = [sys.executable, "-c", BETWEEN]
    done = subprocess.run(script, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == -signal.SIGINT
    assert done.stderr.endswith("KeyboardInterrupt\n")


INTERRUPTED = """
import os, signal, sys
from pathlib import Path
from pyburgers.common.tasks import Workers, run_tasks

signal.signal(signal.SIGINT, signal.default_int_handler)
calls = {k: (f"touch {sys.argv[1]}/{k}; sleep 600",) for k in range(3)}
try:
    with run_tasks(os.system, calls, workers=Workers(jobs=2), out=Path("out")) as done:
        list(done)
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
