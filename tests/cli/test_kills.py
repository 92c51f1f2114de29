"""A hundred kills of every command that fits: same results, no orphans, nothing left behind."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import Problem
from kills import assert_survives, results

from pyburgers.fitting.fit import Fit

pytestmark = pytest.mark.slow

MAIN = ("-m", "pyburgers.cli.main")
SAMPLER = ("--chains", "2", "--warmup", "150", "--draws", "200")

TINY_STUDY = """
import sys
from pyburgers.cli.main import main
from pyburgers.sampling.options import SamplerOptions
from pyburgers.studies.maor import reproduce

tiny = SamplerOptions(chains=2, warmup=40, draws=20)
reproduce.PRESETS = dict.fromkeys(reproduce.PRESETS, tiny)
sys.exit(main(["reproduce", "--out", sys.argv[1]]))
"""
"""`make report` with chains that are far too short to say anything."""


def inputs_of(problem: Problem) -> tuple[str, ...]:
    return (str(problem.experiment_file), "--priors", str(problem.priors_file))


def test_fit(small_problem: Problem, tmp_path: Path) -> None:
    command = (*MAIN, "fit", *inputs_of(small_problem), *SAMPLER, "--out", "OUT")
    assert_survives(command, tmp_path, kills=40, seed=1)


def test_two_processes_in_one_run_directory(small_problem: Problem, tmp_path: Path) -> None:
    """One does the fit; the other is told, or came so late that it finds all done."""

    def start(out: Path) -> subprocess.Popen[str]:
        command = (*MAIN, "fit", *inputs_of(small_problem), *SAMPLER, "--out", str(out))
        return subprocess.Popen([sys.executable, *command], stderr=subprocess.PIPE, text=True)

    alone = start(tmp_path / "alone")
    alone.communicate()
    both = [start(tmp_path / "both") for _ in range(2)]
    said = [one.communicate()[1] for one in both]
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
    both = [
        subprocess.Popen(
            [sys.executable, *MAIN, "fit", *inputs_of(small_problem), *SAMPLER, "--out", str(out)]
        )
        for out in outs
    ]
    codes = {one.wait() for one in both}
    assert len(codes) == 1
    assert codes <= {0, 3, 4}
    assert results(outs[0]) == results(outs[1])
    assert len(list((tmp_path / "cache").glob("*/constant_rate"))) == 1
    assert not list((tmp_path / "cache").glob("*/.*.partial"))


def test_sbc(small_problem: Problem, tmp_path: Path) -> None:
    numbers = ("--simulations", "4", "--warmup", "60", "--draws", "40", "--ranked-draws", "19")
    command = (*MAIN, "sbc", *inputs_of(small_problem), *numbers, "--out", "OUT")
    assert_survives(command, tmp_path, kills=20, seed=2)


def test_campaign(small_problem: Problem, tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(
        f"""
        id = "killed"
        seeds = [1, 2, 3]
        tests.alone = ["{small_problem.experiment_file}"]
        priors.own = "{small_problem.priors_file}"
        sampler = {{ chains = 2, warmup = 150, draws = 100 }}
        """,
        encoding="utf-8",
    )
    command = (*MAIN, "campaign", str(plan), "--out", "OUT")
    assert_survives(command, tmp_path, kills=20, seed=3)


def test_tests_left_out(joint: Fit, tmp_path: Path) -> None:
    def copy_run(out: Path) -> None:
        hidden = shutil.ignore_patterns(".*", "leave_out")
        shutil.copytree(joint.directory.path, out / "joint", ignore=hidden)

    command = (*MAIN, "compare", "OUT/joint", "--leave-out", "tests", "--out", "OUT/compared")
    assert_survives(command, tmp_path, kills=15, seed=4, prepare=copy_run)


def test_reproduce(programs: None, tmp_path: Path) -> None:
    assert_survives(("-c", TINY_STUDY, "OUT"), tmp_path, kills=5, seed=5)
