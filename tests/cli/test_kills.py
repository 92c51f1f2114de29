"""A hundred kills of every command that fits: same results, no orphans, nothing left behind."""

import shutil
from pathlib import Path

import pytest
from conftest import Problem
from kills import assert_survives

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
