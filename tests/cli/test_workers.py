"""Tasks on the workers of a real Dask scheduler: one that is killed costs nothing but its task."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import psutil
import pytest
import xarray as xr
from conftest import SMALL_RUN, Problem
from refusals import CommandLine

from pyburgers.fitting.fit import Fit

SEEDS = (SMALL_RUN.seed, 12)

DEADLINE = 300.0
"""Seconds after which something hangs."""


def wait_until(what: str, is_so: Callable[[], bool]) -> None:
    end = time.monotonic() + DEADLINE
    while not is_so():
        assert time.monotonic() < end, f"no {what} after {DEADLINE} s"
        time.sleep(0.02)


def dask(*arguments: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", "dask", *arguments])


@pytest.fixture
def scheduler(tmp_path: Path) -> Iterator[str]:
    """Address of a scheduler of this machine, ended after the test."""
    file = tmp_path / "scheduler.json"
    address = "tcp://127.0.0.1"
    with ExitStack() as stack:
        process = dask(
            *("scheduler", "--host", address, "--port", "0", "--no-dashboard", "--no-show"),
            *("--scheduler-file", str(file)),
        )
        stack.callback(process.wait)
        stack.callback(process.kill)
        wait_until("scheduler", file.is_file)
        yield str(json_of(file)["address"])


def json_of(file: Path) -> dict[str, object]:
    found: dict[str, object] = json.loads(file.read_text(encoding="utf-8"))
    return found


@pytest.fixture
def workers(scheduler: str, tmp_path: Path) -> Iterator[list[psutil.Process]]:
    """Two workers, in folders of their own, killed after the test.

    A worker that is asked to end waits half a minute for a scheduler that is gone.
    """
    with ExitStack() as stack:
        found = []
        for name in ("first", "second"):
            process = dask(
                *("worker", scheduler, "--no-nanny", "--nthreads", "1", "--no-dashboard"),
                *("--name", name, "--local-directory", str(tmp_path / name)),
            )
            stack.callback(process.wait)
            stack.callback(process.kill)
            found.append(psutil.Process(process.pid))
        yield found


@pytest.fixture
def plan(small_problem: Problem, tmp_path: Path) -> Path:
    file = tmp_path / "plan.toml"
    file.write_text(
        f"""
        id = "small"
        seeds = {list(SEEDS)}
        tests.alone = ["{small_problem.experiment_file}"]
        priors.own = "{small_problem.priors_file}"
        [sampler]
        chains = 2
        warmup = {SMALL_RUN.warmup}
        draws = {SMALL_RUN.draws}
        adapt_delta = {SMALL_RUN.adapt_delta}
        """,
        encoding="utf-8",
    )
    return file


@pytest.mark.slow
def test_a_killed_worker_costs_its_task_and_results_are_those_of_this_machine(
    plan: Path, small_fit: Fit, tmp_path: Path, scheduler: str, workers: list[psutil.Process]
) -> None:
    out = tmp_path / "out"
    first, *others = (f"alone-standard-own-seed{seed}" for seed in SEEDS)
    command = [sys.executable, "-m", "pyburgers", "campaign", str(plan)]
    elsewhere = ("--out", str(out), "--scheduler", scheduler, "--part", "1/1")

    def killed_in_the_middle() -> bool:
        for worker in workers:
            with suppress(psutil.NoSuchProcess):  # a chain that ended in the meantime
                if any(f"{first}/" in " ".join(one.cmdline()) for one in worker.children()):
                    worker.send_signal(signal.SIGKILL)
                    return True
        return False

    with ExitStack() as stack:
        running = subprocess.Popen([*command, *elsewhere])
        stack.callback(running.wait)
        stack.callback(running.kill)
        wait_until("worker that runs chains", killed_in_the_middle)
        assert running.wait(DEADLINE) in (0, 3)
    assert not (out / "report").exists()
    for name in (first, *others):
        one = Fit.load(out / "runs" / name)
        assert one.manifest["status"] == "complete"
        assert not (one.directory.path / ".scratch").exists()
    found = Fit.load(out / "runs" / first).posterior["posterior"].to_dataset()
    here = small_fit.posterior["posterior"].to_dataset()
    xr.testing.assert_identical(found.drop_attrs(), here.drop_attrs())


def test_where_no_scheduler_answers_one_sentence_says_so(
    plan: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    monkeypatch.setattr("pyburgers.cli.workers.ANSWER_SECONDS", 1)
    command = ["campaign", str(plan), "--out", str(tmp_path / "out"), "--scheduler"]
    cli.refused([*command, "tcp://127.0.0.1:9"], "no scheduler of Dask answers")
    cli.refused([*command, "x", "--jobs", "2"], "--jobs: does not go with")


WAITING = """
import argparse, sys, time
from pathlib import Path
import pyburgers.cli.doctor as command
from pyburgers.cli.main import main
from pyburgers.cli.workers import workers_of
from pyburgers.common.tasks import run_tasks

def run(_):
    options = argparse.Namespace(scheduler=sys.argv[1], jobs=None, part=None)
    with workers_of(options) as workers:
        tasks = {seconds: (seconds,) for seconds in (0, 600, 601)}
        with run_tasks(time.sleep, tasks, workers=workers, out=Path("out")) as done:
            for key, _ in done:
                print(key, flush=True)

command.run = run
sys.exit(main(["doctor"]))
"""


@pytest.mark.usefixtures("workers")
def test_a_lost_scheduler_is_one_sentence_and_a_way_to_go_on(scheduler: str) -> None:
    command = [sys.executable, "-c", WAITING, scheduler]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == "0\n"
        for one in psutil.Process().children():
            if "scheduler" in one.cmdline():
                one.kill()
        _, error = running.communicate(timeout=DEADLINE)
    assert running.returncode == 1
    assert error.count("\n") == 1
    assert f"pyburgers: --scheduler {scheduler}: the scheduler was lost; its workers" in error
    assert "run the same command with the new address: it does only what is missing." in error
