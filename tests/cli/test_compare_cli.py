"""`pyburgers compare`: files, exit codes, one sentence each."""

import json
import re
import shutil
from pathlib import Path

import pandas as pd
import pytest
from conftest import copy_of
from refusals import CommandLine

from pyburgers.cli.main import main
from pyburgers.comparison.conclusions import parameter_shifts
from pyburgers.fitting.fit import Fit

pytestmark = pytest.mark.usefixtures("in_this_process")


def test_a_comparison_is_a_table_points_a_record_and_a_figure(
    small_fit: Fit, long_fit: Fit, tmp_path: Path, cli: CommandLine
) -> None:
    # Both run directories are called "run": the folders above tell them apart.
    runs = [str(one.directory.path) for one in (small_fit, long_fit)]
    out = tmp_path / "both"
    printed = cli("compare", *runs, "--out", out, "--no-refit", code=3)
    names = {f"{Path(run).parent.name}_run" for run in runs}
    assert "Cannot tell which of" in printed
    assert str(out) in printed
    assert "How far each parameter moves from" in printed
    assert str(parameter_shifts({"one": small_fit, "other": long_fit}).index[0]) in printed
    table = pd.read_csv(out / "comparison.csv", index_col="fit")
    assert set(table.index) == names
    assert "effective sample size: its elpd may be far off" in printed
    assert len(pd.read_csv(out / "pointwise.csv")) == small_fit.experiment.n_points
    record = json.loads((out / "comparison.json").read_text(encoding="utf-8"))
    assert set(record["fits"]) == names
    assert (out / "comparison.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (out / "comparison.svg").read_text(encoding="utf-8")
    assert len(list(out.iterdir())) == 5


@pytest.mark.slow
def test_points_with_heavy_tails_are_left_out_in_earnest(long_fit: Fit, tmp_path: Path) -> None:
    again = copy_of(long_fit, tmp_path / "again")
    runs = [str(one.directory.path) for one in (long_fit, again)]
    assert main(["compare", *runs, "--out", str(tmp_path / "out")]) == 0
    table = pd.read_csv(tmp_path / "out" / "comparison.csv", index_col="fit")
    assert table["left_out"].tolist() == table["high_k"].tolist()
    refits = list((tmp_path / "out").glob("refits/*/point_*"))
    assert len(refits) == table["left_out"].sum()


@pytest.fixture
def joints(joint: Fit, separate_joint: Fit, tmp_path: Path) -> dict[str, str]:
    """Run directories of two tests with two ways of pooling."""
    runs = {"shared": joint, "separate": separate_joint}
    return {name: str(copy_of(run, tmp_path / name).directory.path) for name, run in runs.items()}


@pytest.mark.usefixtures("sketched", "little_search")
def test_joint_runs_are_compared_by_points(
    joints: dict[str, str], tmp_path: Path, cli: CommandLine
) -> None:
    out = tmp_path / "out"
    printed = cli("compare", *joints.values(), "--out", out, code=3)  # few draws
    table = pd.read_csv(out / "comparison.csv", index_col="fit")
    assert set(table.index) == set(joints)
    assert set(pd.read_csv(out / "pointwise.csv")["test"]) == {"PIL40", "other"}
    assert re.search(r"(shared|separate) .*these data", printed)


@pytest.mark.usefixtures("sketched", "little_search")
def test_joint_runs_are_compared_by_tests(
    joints: dict[str, str], tmp_path: Path, cli: CommandLine
) -> None:
    shutil.rmtree(Path(joints["shared"]) / "leave_out" / "other")
    out = tmp_path / "out"
    printed = cli("compare", *joints.values(), "--leave-out", "tests", "--out", out, code=3)
    assert "Cannot tell which of shared and separate predicts left-out tests better" in printed
    assert "because a standard error over 2 tests says nothing and the elpd of" in printed
    # A hundred draws a chain fail the check of their number.
    assert "failed its check of" in printed
    names = {"comparison.csv", "comparison.json", "comparison.png", "comparison.svg"}
    assert {file.name for file in out.iterdir()} == {*names, "left_out_tests.csv"}
    for run in joints.values():
        assert (Path(run) / "leave_out" / "other" / "summary.csv").is_file()


@pytest.mark.usefixtures("sketched", "little_search")
def test_one_joint_run_will_do_to_leave_tests_out(
    joints: dict[str, str], tmp_path: Path, cli: CommandLine
) -> None:
    run, out = joints["shared"], ("--out", str(tmp_path / "out"))
    assert "beside that of another fit" in cli("compare", run, "--leave-out", "tests", *out, code=3)
    table = pd.read_csv(tmp_path / "out" / "left_out_tests.csv", index_col="test")
    assert table.index.tolist() == ["PIL40", "other"]


def test_runs_that_cannot_be_compared_are_refused(
    joints: dict[str, str], small_fit: Fit, long_fit: Fit, tmp_path: Path, cli: CommandLine
) -> None:
    run, out = joints["shared"], ("--out", str(tmp_path / "out"))
    single_again = str(long_fit.directory.path)
    single, by_test = str(small_fit.directory.path), ("--leave-out", "tests")
    cli.refused(["compare", run, single, *out], "other data", "PIL40+other")
    cli.refused(["compare", run, single, *by_test, *out], "is not a joint fit")
    assert not (tmp_path / "out").exists()
    (tmp_path / "file").write_text("", encoding="utf-8")
    for arguments in ([run, *by_test], [single, single_again, "--no-refit"]):
        cli.refused(
            ["compare", *arguments, "--out", tmp_path / "file"], "--out", "cannot be written"
        )
