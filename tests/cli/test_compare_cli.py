"""`pyburgers compare` and `pyburgers fit-peak-stress`: files, exit codes, one sentence each."""

import io
import json
import re
import shutil
from pathlib import Path

import pandas as pd
import pytest
from conftest import ICE, copy_of
from refusals import assert_refused

from pyburgers.cli.main import main
from pyburgers.fitting.fit import Fit
from pyburgers.model.flow_law_prior import FlowLawPrior

pytestmark = pytest.mark.usefixtures("in_this_process")

CURVE_PRIORS = str(ICE.parent / "priors" / "ice.toml")
TABLE = str(ICE / "peak_stress_qi_goldsby_2021.toml")
SHORT = ("--chains", "2", "--warmup", "100", "--draws", "100", "--seed", "2")


def test_a_comparison_is_a_table_points_a_record_and_a_figure(
    small_fit: Fit, long_fit: Fit, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Both run directories are called "run": the folders above tell them apart.
    runs = [str(one.directory.path) for one in (small_fit, long_fit)]
    out = tmp_path / "both"
    code = main(["compare", *runs, "--out", str(out), "--no-refit"])
    names = {f"{Path(run).parent.name}_run" for run in runs}
    printed = capsys.readouterr().out
    assert "Cannot tell which of" in printed
    assert str(out) in printed
    table = pd.read_csv(out / "comparison.csv", index_col="fit")
    assert set(table.index) == names
    assert code == 3
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


def test_a_folder_that_is_no_run_and_a_file_for_a_folder_are_refused(
    small_fit: Fit, long_fit: Fit, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = [str(one.directory.path) for one in (small_fit, long_fit)]
    code = main(["compare", runs[0], str(tmp_path)])
    assert_refused(code, capsys, "not a run directory")
    (tmp_path / "file").write_text("", encoding="utf-8")
    code = main(["compare", *runs, "--out", str(tmp_path / "file"), "--no-refit"])
    assert_refused(code, capsys, "--out", "cannot be written")


@pytest.fixture
def joints(joint: Fit, separate_joint: Fit, tmp_path: Path) -> dict[str, str]:
    """Run directories of two tests with two ways of pooling."""
    runs = {"shared": joint, "separate": separate_joint}
    return {name: str(copy_of(run, tmp_path / name).directory.path) for name, run in runs.items()}


def test_joint_runs_are_compared_by_points(
    joints: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    code = main(["compare", *joints.values(), "--out", str(out)])
    table = pd.read_csv(out / "comparison.csv", index_col="fit")
    assert set(table.index) == set(joints)
    assert code == 3  # few draws
    assert set(pd.read_csv(out / "pointwise.csv")["test"]) == {"PIL40", "other"}
    assert re.search(r"(shared|separate) .*these data", capsys.readouterr().out)


def test_joint_runs_are_compared_by_tests(
    joints: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.rmtree(Path(joints["shared"]) / "leave_out" / "other")
    out = tmp_path / "out"
    assert main(["compare", *joints.values(), "--leave-out", "tests", "--out", str(out)]) == 3
    printed = capsys.readouterr().out
    assert "Cannot tell which of shared and separate predicts left-out tests better" in printed
    assert "because a standard error over 2 tests says nothing and the elpd of" in printed
    # A hundred draws a chain fail the check of their number.
    assert "failed its check of" in printed
    names = {"comparison.csv", "comparison.json", "comparison.png", "comparison.svg"}
    assert {file.name for file in out.iterdir()} == {*names, "left_out_tests.csv"}
    for run in joints.values():
        assert (Path(run) / "leave_out" / "other" / "summary.csv").is_file()


def test_one_joint_run_will_do_to_leave_tests_out(
    joints: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, out = joints["shared"], ("--out", str(tmp_path / "out"))
    assert main(["compare", run, "--leave-out", "tests", *out]) == 3  # few draws
    assert "beside that of another fit" in capsys.readouterr().out
    table = pd.read_csv(tmp_path / "out" / "left_out_tests.csv", index_col="test")
    assert table.index.tolist() == ["PIL40", "other"]


def test_runs_that_cannot_be_compared_are_refused(
    joints: dict[str, str],
    small_fit: Fit,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    run, out = joints["shared"], ("--out", str(tmp_path / "out"))
    single, by_test = str(small_fit.directory.path), ("--leave-out", "tests")
    assert_refused(main(["compare", run, *out]), capsys, "found 1 fit, expected at least two")
    assert_refused(main(["compare", run, single, *out]), capsys, "other data", "PIL40+other")
    assert_refused(main(["compare", run, single, *by_test, *out]), capsys, "is not a joint fit")
    assert_refused(main(["compare", run, *by_test, "--no-refit", *out]), capsys, "--no-refit")
    assert not (tmp_path / "out").exists()
    (tmp_path / "file").write_text("", encoding="utf-8")
    code = main(["compare", run, *by_test, "--out", str(tmp_path / "file")])
    assert_refused(code, capsys, "--out", "cannot be written")


def test_a_table_is_fitted_with_figure_checks_and_a_prior_to_hand_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    own = ("--without", str(ICE / "PIL40.toml"), "--curve-priors", CURVE_PRIORS)
    code = main(["fit-peak-stress", TABLE, "--out", str(out), *own, *SHORT])
    printed, told = capsys.readouterr()
    assert "1 of 23 rows may be" in told
    checks = json.loads((out / "checks.json").read_text(encoding="utf-8"))["checks"]
    failed = {check["kind"] for check in checks if not check["passed"]}
    assert code == (3 if "sampling" in failed else 4 if failed else 0)
    assert {check["kind"] for check in checks} == {"sampling", "description"}
    assert f"run directory: {out}" in printed
    assert "stress exponent" in printed
    for name in ("manifest.json", "posterior.nc", "summary.csv", "flow_law.png", "flow_law.svg"):
        assert (out / name).is_file()
    manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["sampler"]["draws"] == 100
    assert manifest["status"] == "complete"
    law = FlowLawPrior.load(out / "flow_law_prior.json")
    assert law.mean.shape == (4,)
    assert len(law.tests) == 22
    assert main(["check", str(out)]) == code
    assert "bend along the rate" in capsys.readouterr().out
    assert main(["export", str(out), "--format", "csv"]) == 0
    exported = pd.read_csv(io.StringIO(capsys.readouterr().out), index_col="name")
    summary = pd.read_csv(out / "summary.csv", index_col="parameter")
    for name in ("stress_exponent", "stress_scatter"):
        assert exported["mean"][name] == pytest.approx(summary["mean"][name])
    assert "ln_flow_law_factor" in exported.index
    assert main(["report", str(out), "--out", str(tmp_path / "page")]) == 0
    page = (tmp_path / "page" / "index.html").read_text(encoding="utf-8")
    assert "Flow law of ice from peak stresses" in page
    assert page.count('href="#peak_stress_run"') >= 3  # contents, the fit among them, overview
    assert "SYNTHETIC" not in page
    capsys.readouterr()
    code = main(["export", str(out), "--test", "PIL40"])
    assert_refused(code, capsys, "--test: found PIL40, expected none")


def test_bad_tables_priors_and_folders_are_refused(
    small_fit: Fit, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = Path(TABLE).with_suffix(".csv").read_text(encoding="utf-8").splitlines()
    short = tmp_path / Path(TABLE).name
    shutil.copy(TABLE, short)
    short.with_suffix(".csv").write_text("\n".join(rows[:4]), encoding="utf-8")

    def run(table: str, *options: str) -> int:
        return main(["fit-peak-stress", table, "--out", str(tmp_path / "run"), *options])

    assert_refused(run(str(tmp_path / "none.toml")), capsys, "does not exist")
    assert_refused(run(str(ICE / "PIL40.toml")), capsys, "key 'protocol'", "PIL40.toml")
    ice = str(ICE.parent / "priors" / "ice.toml")
    assert_refused(run(str(short), "--priors", ice), capsys, "unknown key")
    assert_refused(run(str(short), "--chains", "0"), capsys, "chains is 0")
    shutil.copytree(small_fit.directory.path, tmp_path / "run")
    assert_refused(run(str(short)), capsys, "holds a run of other inputs")
