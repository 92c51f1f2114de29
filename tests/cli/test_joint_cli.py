"""Joint fits on the command line: what is printed, continued after a kill, and refused."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from conftest import Problem
from refusals import CommandLine

from pyburgers.checks.verdicts import CHECKS
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.kind import save_experiment


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
    arguments: list[str], tmp_path: Path, cli: CommandLine
) -> None:
    out = cli(*arguments, "--pool", "maxwell_modulus=partial:0.2", code=3)  # few draws
    assert re.search(r"Maxwell modulus .*partial", out)
    assert re.search(r"activation .*shared.* the same", out)
    verdicts = re.findall(r"^(?:FAILED|passed|cannot tell)  .*$", out, re.MULTILINE)
    assert len(verdicts) == len(CHECKS)
    pooling = Fit.load(tmp_path / "run").problem.pooling
    assert pooling.spread_scales["maxwell_modulus"] == 0.2
    checked = cli("check", tmp_path / "run", code=3)
    assert out.endswith(checked)
    assert re.findall(r"^(?:FAILED|passed|cannot tell)  .*$", checked, re.MULTILINE) == verdicts
