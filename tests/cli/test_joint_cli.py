"""Joint fits on the command line: what is printed, continued after a kill, and refused."""

import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import Problem

from pyburgers.checks.verdicts import CHECKS
from pyburgers.cli.main import main
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.kind import save_experiment
from pyburgers.sampling.run_directory import RunDirectory


@pytest.fixture
def arguments(small_problem: Problem, tmp_path: Path) -> list[str]:
    """A joint fit of the small test and a copy of it under another name."""
    folder = tmp_path / "other"
    folder.mkdir()
    other = save_experiment(replace(small_problem.experiment, id="other"), folder)
    return [
        *("fit", str(small_problem.experiment_file), str(other)),
        *("--priors", str(small_problem.priors_file), "--out", str(tmp_path / "run")),
        *("--chains", "2", "--warmup", "40", "--draws", "20", "--seed", "3"),
        *("--adapt-delta", "0.8", "--max-treedepth", "5"),
    ]


@pytest.mark.usefixtures("little_search")
def test_a_joint_fit_prints_its_tests_and_check_repeats_the_verdicts(
    programs: None, arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*arguments, "--pool", "maxwell_modulus=partial:0.2"]) == 3  # few draws
    out, _ = capsys.readouterr()
    assert re.search(r"Maxwell modulus .*partial", out)
    assert re.search(r"activation .*shared.* the same", out)
    verdicts = re.findall(r"^(?:FAILED|passed|cannot tell)  .*$", out, re.MULTILINE)
    assert len(verdicts) == len(CHECKS)
    pooling = Fit.load(tmp_path / "run").problem.pooling
    assert pooling.spread_scales["maxwell_modulus"] == 0.2
    assert main(["check", str(tmp_path / "run")]) == 3
    checked = capsys.readouterr().out
    assert out.endswith(checked)
    assert re.findall(r"^(?:FAILED|passed|cannot tell)  .*$", checked, re.MULTILINE) == verdicts


@pytest.mark.slow
def test_a_killed_joint_fit_is_continued(
    programs: None, arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = RunDirectory(tmp_path / "run")
    killed = subprocess.Popen(
        [sys.executable, "-m", "pyburgers", *arguments, "--parallel-chains", "1"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    while not run.finished_chains():
        assert killed.poll() is None
        time.sleep(0.02)
    killed.kill()
    killed.wait()
    kept = run.draws_file(1).read_bytes()
    assert main(arguments) == 3
    assert "of 2 chains are there already" in capsys.readouterr().err
    assert run.finished_chains() == (1, 2)
    assert run.draws_file(1).read_bytes() == kept
    assert run.read_manifest()["status"] == "complete"
