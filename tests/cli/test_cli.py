"""The command line: exit codes, one sentence for bad input, files that it promises."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import ICE, Problem
from refusals import CommandLine
from small_inputs import CURVE, EXPERIMENT, PRIORS
from truths import truth_of

import pyburgers
from pyburgers.checks.verdicts import CHECKS
from pyburgers.cli.main import COMMANDS, main
from pyburgers.cli.shared import command_line
from pyburgers.cmdstan.installation import PYPI_VERSION
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.likelihood import likelihoods
from pyburgers.kinds.stan_data import REFERENCE_SOLVER
from pyburgers.model.priors import default_priors, load_priors

COLUMNS = ["time_s", "strain", "stress_Pa", "kelvin_strain", "grain_size_m", "fabric_factor"]

Write = Callable[..., list[str]]
Parameters = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write the input files, and return the arguments of a fit."""

    def write() -> list[str]:
        for file, text in {"test.toml": EXPERIMENT, "curve.csv": CURVE, "p.toml": PRIORS}.items():
            (tmp_path / file).write_text(text, encoding="utf-8")
        files = [str(tmp_path / "test.toml"), "--priors", str(tmp_path / "p.toml")]
        return ["fit", *files, "--out", str(tmp_path / "run")]

    return write


@pytest.fixture
def parameters(tmp_path: Path) -> Parameters:
    """Write the parameters of a twin, some changed, and return the file."""

    def parameters(**changes: object) -> Path:
        truth = truth_of(load_constant_rate(ICE / "PIL40.toml"))
        path = tmp_path / "parameters.json"
        path.write_text(json.dumps({**truth, **changes}), encoding="utf-8")
        return path

    return parameters


def test_an_unwritable_directory_is_refused(
    programs: None, write: Write, tmp_path: Path, cli: CommandLine
) -> None:
    file = tmp_path / "file"
    file.touch()
    locked = Path("/proc")
    if os.geteuid() != 0:  # root may write wherever there is a disk
        locked = tmp_path / "locked"
        locked.mkdir(mode=0o555)
    for folder in (file / "run", locked / "pyburgers-run"):
        assert cli(*write(), "--out", folder, code=2) == ""
        assert f"{folder}: cannot be written" in cli.error.splitlines()[-1]


def test_without_cmdstan_a_fit_could_not_run(
    write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    monkeypatch.setenv("CMDSTAN", str(tmp_path / "nothing"))
    cli(*write(), code=1)
    assert "nothing" in cli.error
    cli("doctor", code=1)


@pytest.mark.usefixtures("little_search")
def test_a_fit_prints_table_and_checks_and_check_repeats_the_verdicts(
    small_problem: Problem, tmp_path: Path, cli: CommandLine
) -> None:
    run = tmp_path / "run"
    arguments = [
        *("fit", str(small_problem.experiment_file)),
        *("--priors", str(small_problem.priors_file), "--out", str(run)),
        *("--chains", "2", "--warmup", "150", "--draws", "50", "--seed", "3"),
        *("--adapt-delta", "0.8"),
    ]
    out, error = cli(*arguments, code=3), cli.error  # 100 draws are too few
    assert "Maxwell modulus" in out
    assert f"run directory: {run}" in out
    assert re.search(r"^FAILED +effective sample size: .*--more-draws \d+", out, re.MULTILINE)
    assert re.search(r"^passed +chains: ", out, re.MULTILINE)
    assert "Coordinates: " in error
    assert re.search(
        r"^Sampling with \d+ readings; the run takes about 1 MB\.$", error, re.MULTILINE
    )
    assert error.count("100% of 2 chains of 200 iterations (sampling)\n") == 1
    assert "iterations" not in out

    verdicts = re.findall(r"^(?:FAILED|passed) .*$", out, re.MULTILINE)
    assert len(verdicts) == len(CHECKS)
    checked = cli("check", run, code=3)
    assert re.findall(r"^(?:FAILED|passed) .*$", checked, re.MULTILINE) == verdicts
    assert out.endswith(checked)
    assert "Was the posterior sampled well? NO\n" in checked
    assert "Does the model describe the data? " in checked

    # Once more: nothing to do, the same answer.
    cli(*arguments, code=3)
    assert (cli.out, cli.error) == (out, "2 of 2 chains are there already.\n")


def test_all_checks_passed_is_exit_code_0(long_fit: Fit, cli: CommandLine) -> None:
    assert "FAILED" not in cli("check", long_fit.directory.path)


def test_the_prior_alone_in_the_default_directory(
    small_problem: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    monkeypatch.chdir(tmp_path)
    files = (small_problem.experiment_file, "--priors", small_problem.priors_file)
    chains = ("--chains", "2", "--warmup", "100", "--draws", "100", "--seed", "3")
    out = cli("fit", *files, "--prior-only", *chains, code=None)
    assert cli.code in (0, 3)
    assert re.search(r"^passed +solver: ", out, re.MULTILINE)
    fit = Fit.load(tmp_path / "runs" / "PIL40")
    assert fit.manifest["use_likelihood"] is False
    table = fit.summary("SI")
    ratio = table["sd"] / table["prior_sd"]
    assert (ratio.dropna() > 0.6).all()


def test_simulate_writes_the_promised_columns(
    programs: None, parameters: Parameters, tmp_path: Path, cli: CommandLine
) -> None:
    out = tmp_path / "curve.csv"
    files = ["--parameters", str(parameters()), "--out", str(out)]
    cli("simulate", ICE / "PIL40.toml", *files)
    table = pd.read_csv(out)
    assert list(table) == COLUMNS
    np.testing.assert_allclose(table["time_s"] * 1.69e-4, table["strain"])
    assert table["stress_Pa"].max() == pytest.approx(8.03e6, rel=2e-3)
    assert table["strain"].iloc[-1] == pytest.approx(0.2)
    assert "warning" not in cli.error


def test_the_printed_beta_is_warned_about(
    programs: None,
    parameters: Parameters,
    tmp_path: Path,
    cli: CommandLine,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Solved or not: the solver gives up after a hundredth of its steps here."""
    hasty = partial(simulate, solver=replace(REFERENCE_SOLVER, max_num_steps=10_000))
    monkeypatch.setattr("pyburgers.cli.simulate.simulate", hasty)
    files = ["--parameters", parameters(beta=7.29e-4), "--out", tmp_path / "curve.csv"]
    cli("simulate", ICE / "PIL40.toml", *files, code=None)
    assert cli.code in (0, 1)
    assert "beta is positive" in cli.error
    assert "misprint" in cli.error


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["--version"])
    assert stopped.value.code == 0
    assert capsys.readouterr().out == f"pyburgers {version('pyburgers')}\n"
    assert pyburgers.__version__ == version("pyburgers")


def test_a_manifest_names_the_program_however_it_was_run(monkeypatch: pytest.MonkeyPatch) -> None:
    for script, program in (
        ("/venv/bin/pyburgers", "pyburgers"),
        ("/venv/site-packages/pyburgers/__main__.py", "pyburgers"),
        ("drivers/my_study.py", "my_study.py"),
    ):
        monkeypatch.setattr("sys.argv", [script, "fit", "a b.toml"])
        assert command_line() == f"{program} fit 'a b.toml'"


def test_help_shows_defaults_and_choices(capsys: pytest.CaptureFixture[str]) -> None:
    def shown(*arguments: str) -> str:
        with pytest.raises(SystemExit):
            main([*arguments, "--help"])
        return " ".join(capsys.readouterr().out.split())

    text = shown("fit")
    assert "draws of each chain; default 1000" in text
    assert "--coordinates {auto,plain,valley,sheared,stretched}" in text
    for name, likelihood in likelihoods().items():
        assert f"{likelihood.warmup} {name}" in text
    assert "iterations ahead of the draws; default 300 --draws" in shown("sbc")
    assert "--microstructure {initial,steady-state}" in shown("predict", "attenuation")
    assert f"pypi: {PYPI_VERSION} from the package index" in shown("install-cmdstan")
    # Only tests that are left out are handed out to workers.
    assert shown("compare").count("with --leave-out tests: ") == 3
    assert "with --leave-out tests: " not in shown("sbc")


def test_the_module_is_the_command_whose_help_answers_at_once(tmp_path: Path) -> None:
    """Processor time, which other programs that run do not lengthen much."""
    seconds, shown = [], tmp_path / "help.txt"
    for _ in range(3):
        with (
            shown.open("wb") as file,
            subprocess.Popen([sys.executable, "-m", "pyburgers", "--help"], stdout=file) as process,
        ):
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        assert process.returncode == 0
        seconds.append(usage.ru_utime + usage.ru_stime)
    assert min(seconds) < 0.3
    assert all(command in shown.read_text(encoding="utf-8") for command in COMMANDS)


def test_priors_prints_the_file_of_a_material(cli: CommandLine, tmp_path: Path) -> None:
    copy = tmp_path / "ice.toml"
    copy.write_text(cli("priors", "ice"), encoding="utf-8")
    assert load_priors(copy) == default_priors("ice")
