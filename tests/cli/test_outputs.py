"""Files that commands write: none of them is one that is read, or of somebody else."""

import json
import shutil
from pathlib import Path

import pytest
from conftest import ICE, Problem
from refusals import CommandLine
from same_contents import contents
from truths import truth_of

from pyburgers.cli.main import main
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.kind import load_experiment


@pytest.fixture
def folder(
    small_fit: Fit, small_problem: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """Working directory with a run, test.toml whose readings are in test.csv, and other inputs."""
    small_fit.save(tmp_path / "run")
    inputs = small_problem.experiment_file
    text = inputs.read_text(encoding="utf-8")
    assert 'file = "experiment.csv"' in text
    text = text.replace('file = "experiment.csv"', 'file = "test.csv"')
    (tmp_path / "test.toml").write_text(text, encoding="utf-8")
    shutil.copy(inputs.with_name("experiment.csv"), tmp_path / "test.csv")
    truth = truth_of(load_experiment(ICE / "PIL40.toml"))
    (tmp_path / "parameters.json").write_text(json.dumps({**truth}), encoding="utf-8")
    (tmp_path / "points.csv").write_text("frequency_Hz,tan_delta\n0.01,0.1\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


SIMULATE = ("simulate", "test.toml", "--from", "run")
GIVEN = ("simulate", "test.toml", "--parameters", "parameters.json")
PREDICT = ("predict", "run", "test.toml", "--draws", "5")
ATTENUATION = ("predict", "attenuation", "run", "--measured", "points.csv", "--regimes", "1")
EXPORT = ("export", "run")


@pytest.mark.parametrize(
    ("command", "out", "named"),
    [
        (SIMULATE, "test.csv", "it"),
        (SIMULATE, "./run/../test.csv", "it"),
        (SIMULATE, "link.csv", "it"),
        (SIMULATE, "test.toml", "it"),
        (SIMULATE, "run/summary.csv", "it"),
        (SIMULATE, "run/inputs/tests/PIL40/experiment.csv", "it"),
        (GIVEN, "parameters.json", "it"),
        (PREDICT, "test.csv", "it"),
        (PREDICT, "run/posterior.csv", "run/posterior.nc"),
        (ATTENUATION, "points.csv", "it"),
        (ATTENUATION, "run/posterior.csv", "run/posterior.nc"),
        (EXPORT, "run/manifest.json", "it"),
    ],
)
def test_what_is_read_is_not_written_over(
    command: tuple[str, ...], out: str, named: str, folder: Path, cli: CommandLine
) -> None:
    (folder / "link.csv").symlink_to("test.csv")
    before = contents(folder)
    words = f"--out {Path(out)}: {named} would be written over, which the command reads"
    cli.refused([*command, "--out", out], words)
    assert contents(folder) == before


def test_files_beside_the_named_one_are_not_written_over_either(
    folder: Path, cli: CommandLine
) -> None:
    (folder / "test.csv").rename(folder / "other_readings.csv")
    text = (folder / "test.toml").read_text(encoding="utf-8")
    (folder / "test.toml").write_text(text.replace("test.csv", "other_readings.csv"), "utf-8")
    before = contents(folder)
    cli.refused([*PREDICT, "--out", "other.csv"], "other_readings.csv would be written over")
    assert contents(folder) == before


def test_readings_elsewhere_are_found(
    folder: Path, cli: CommandLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = folder / "elsewhere"
    elsewhere.mkdir()
    (folder / "test.csv").rename(elsewhere / "test.csv")
    text = (folder / "test.toml").read_text(encoding="utf-8")
    text = text.replace("[data]\n", '[data]\ndata_root = "nowhere"\n')
    (folder / "test.toml").write_text(text, encoding="utf-8")
    monkeypatch.setenv("PYBURGERS_DATA", str(elsewhere))
    before = contents(folder)
    cli.refused([*SIMULATE, "--out", "elsewhere/test.csv"], "which the command reads")
    assert contents(folder) == before


@pytest.mark.parametrize("out", ["new.csv", "run/curve.csv"])
def test_earlier_outputs_are_written_over(out: str, folder: Path) -> None:
    for draw in ("1", "2"):
        assert main([*SIMULATE, "--draw", draw, "--out", out]) == 0
        text = (folder / out).read_text(encoding="utf-8")
        (folder / draw).write_text(text, encoding="utf-8")
    assert (folder / "1").read_bytes() != (folder / "2").read_bytes()


@pytest.mark.parametrize("command", [SIMULATE, EXPORT])
@pytest.mark.parametrize("out", [".", "/", "..", "run"])
def test_a_folder_is_no_file_to_write(
    command: tuple[str, ...], out: str, folder: Path, cli: CommandLine
) -> None:
    cli.refused([*command, "--out", out], f"--out {out}: it is a folder, expected a file name.")


def test_a_folder_beside_the_named_file_is_told(folder: Path, cli: CommandLine) -> None:
    (folder / "new.nc").mkdir()
    cli.refused([*PREDICT, "--out", "new.csv"], "--out new.csv: new.nc is a folder")


def test_exports_are_written_over_exports_alone(folder: Path, cli: CommandLine) -> None:
    for chosen in ["json", "csv", "csv", "latex", "latex", "json", "latex", "csv", "json", "json"]:
        cli(*EXPORT, "--format", chosen, "--out", "numbers")
    assert json.loads((folder / "numbers").read_text(encoding="utf-8"))["test"] == "PIL40"
    (folder / "empty").touch()
    cli(*EXPORT, "--out", "empty")
    for name in ("test.csv", "parameters.json", "test.toml"):
        before_all = contents(folder)
        cli.refused([*EXPORT, "--out", name], f"--out {name}: holds something else than an export")
        assert contents(folder) == before_all
