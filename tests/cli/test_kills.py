"""A hundred kills of every command that fits: same results, no orphans, nothing left behind."""

import subprocess
from pathlib import Path

import pytest
from conftest import Problem
from killed_commands import KILLS, fit_command, killed_commands
from killing import assert_survives, command_in, results

from pyburgers.fitting.fit import Fit

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", KILLS)
def test_killed_command(name: str, small_problem: Problem, joint: Fit, tmp_path: Path) -> None:
    commands = killed_commands(
        small_problem.experiment_file, small_problem.priors_file, joint.directory.path, tmp_path
    )
    one = commands[name]
    seed = list(KILLS).index(name) + 1
    assert_survives(one.arguments, tmp_path, kills=KILLS[name], seed=seed, prepare=one.prepare)


def start_fit(problem: Problem, out: Path) -> subprocess.Popen[bytes]:
    command = fit_command(problem.experiment_file, problem.priors_file)
    return command_in(command.arguments, out).start()


def test_two_processes_in_one_run_directory(small_problem: Problem, tmp_path: Path) -> None:
    """One does the fit; the other is told, or came so late that it finds all done."""
    alone = start_fit(small_problem, tmp_path / "alone")
    alone.communicate()
    both = [start_fit(small_problem, tmp_path / "both") for _ in range(2)]
    said = [one.communicate()[1].decode() for one in both]
    refused = [text for one, text in zip(both, said, strict=True) if one.returncode == 2]
    assert len(refused) <= 1
    assert all("another process is running a fit here" in text for text in refused)
    assert {one.returncode for one in both} <= {2, alone.returncode}
    assert results(tmp_path / "both") == results(tmp_path / "alone")


def test_two_processes_in_a_fresh_cache(
    small_problem: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One compiles, the other waits for it."""
    monkeypatch.setenv("PYBURGERS_CACHE", str(tmp_path / "cache"))
    outs = [tmp_path / name for name in ("one", "other")]
    both = [start_fit(small_problem, out) for out in outs]
    for one in both:
        one.communicate()
    codes = {one.returncode for one in both}
    assert len(codes) == 1
    assert codes <= {0, 3, 4}
    assert results(outs[0]) == results(outs[1])
    assert len(list((tmp_path / "cache").glob("*/loading_history"))) == 1
    assert not list((tmp_path / "cache").glob("*/.*.partial"))
