"""`pyburgers predict RUN EXPERIMENT.toml`: files that it promises, what it says, exit codes."""

import errno
import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import Problem
from refusals import CommandLine
from same_contents import contents

from pyburgers.fitting.fit import Fit
from pyburgers.kinds.constant_rate.experiment import RateSegment
from pyburgers.kinds.experiment_file import SIGNS_WERE_TURNED
from pyburgers.kinds.kind import save_experiment


@pytest.fixture
def slower(small_problem: Problem, tmp_path: Path) -> Path:
    """The small test at another rate, without data."""
    test = small_problem.experiment.to_be_solved()
    experiment = replace(test, id="slower", segments=(RateSegment(0.0, 1e-5),))
    folder = tmp_path / "inputs"
    folder.mkdir()
    return save_experiment(experiment, folder)


def test_a_test_without_data_gets_bands_draws_and_a_figure(
    small_fit: Fit, slower: Path, tmp_path: Path, cli: CommandLine
) -> None:
    out = tmp_path / "slower.csv"
    printed = cli("predict", small_fit.directory.path, slower, "--out", out, "--draws", "20")
    assert printed.startswith("slower (ice, 260 K) predicted from PIL40\n")
    assert "Beyond what was fitted: strain rate 1e-05 1/s" in printed
    for suffix in (".csv", ".nc", ".png", ".svg"):
        assert f"{out.with_suffix(suffix)}\n" in printed
        assert out.with_suffix(suffix).stat().st_size > 0
    assert not list(tmp_path.glob("*_readings.csv"))
    table = pd.read_csv(out)
    with xr.open_datatree(out.with_suffix(".nc"), engine="h5netcdf") as kept:
        stress = kept["predictions"]["stress"].to_numpy()[0]
        assert kept.attrs["which_draws"] == small_fit.which_draws
    assert stress.shape == (20, len(table))
    np.testing.assert_allclose(table["stress_Pa_q50"], np.median(stress, axis=0), rtol=1e-6)


def test_what_was_converted_in_the_file_is_said(
    small_fit: Fit, slower: Path, tmp_path: Path, cli: CommandLine
) -> None:
    """Bands of a tension test have other signs than its file."""
    text = slower.read_text(encoding="utf-8")
    slower.write_text(text.replace("notices = []", f'notices = ["{SIGNS_WERE_TURNED}"]'))
    run, out = small_fit.directory.path, tmp_path / "slower.csv"
    printed = cli("predict", run, slower, "--out", out, "--draws", "2")
    assert f"{SIGNS_WERE_TURNED}\n" in printed
    cli("simulate", slower, "--from", run, "--out", tmp_path / "solved.csv")
    assert f"note: {SIGNS_WERE_TURNED}\n" in cli.error


@pytest.mark.parametrize("what", ["attenuation", "test"])
def test_a_full_disk_leaves_an_older_set_whole(
    what: str,
    small_fit: Fit,
    slower: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    cli: CommandLine,
) -> None:
    folder = tmp_path / "set"
    folder.mkdir()
    chosen = ["--regimes", "1"] if what == "attenuation" else [str(slower), "--draws", "20"]
    command = ["predict", what, str(small_fit.directory.path), *chosen]
    command += ["--out", str(folder / "new.csv")]
    cli(*command)
    before = contents(folder)

    def refuse(file: Path, _: bytes) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(file))

    monkeypatch.setattr("pyburgers.common.netcdf_files.write_bytes", refuse)
    other = ["--temperature-K", "250"] if what == "attenuation" else ["--seed", "2"]
    cli.refused([*command, *other], "cannot be written (No space left on device)")
    assert contents(folder) == before


def test_a_test_with_data_is_scored(
    joint: Fit, small_problem: Problem, tmp_path: Path, cli: CommandLine
) -> None:
    files = (small_problem.experiment_file, "--out", tmp_path / "again.csv")
    words = ("predict", joint.directory.path, *files)
    printed = cli(*words, "--separate-from", "other", "--draws", "50")
    assert "PIL40 is part of the fit" in printed
    assert re.search(r"Of \d+ points lie \d+ % in the 50 % band", printed)
    scores = pd.read_csv(tmp_path / "again_scores.csv", index_col="score")
    assert len(scores) == 3
    readings = pd.read_csv(tmp_path / "again_readings.csv")
    assert len(readings) == small_problem.experiment.n_points
    assert "predicted from other" in cli(*words, "--test", "other", "--draws", "5")
