"""Labelled draws on the disk: whole or not at all."""

import subprocess
import sys
from pathlib import Path

from synthetic_fit import make_fit

from pyburgers.posterior.labelled_draws import keep_posterior, load_posterior

KEEPING = """
import resource, sys
from pathlib import Path
from synthetic_fit import make_fit
from pyburgers.posterior.labelled_draws import keep_posterior

fit = make_fit(Path(sys.argv[1]), draws=50)
groups = {name: group.to_dataset() for name, group in fit.posterior.children.items()}
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
try:
    keep_posterior(fit.directory, groups, experiment="a", data_kind="synthetic")
except OSError as error:
    print(error.strerror, Path(error.filename).name)
"""


def test_a_disk_that_fills_up_leaves_no_draws_and_no_crash(tmp_path: Path) -> None:
    """HDF5 brings a process down that cannot write to its file."""
    done = subprocess.run(
        [sys.executable, "-c", KEEPING, str(tmp_path / "run")],
        env={"PYTHONPATH": ":".join(sys.path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, "File too large posterior.nc\n"), done.stderr
    assert [file.name for file in (tmp_path / "run").iterdir()] == ["manifest.json"]


def test_draws_are_read_back_when_they_are_noted(tmp_path: Path) -> None:
    fit = make_fit(tmp_path / "run", draws=20)
    run = fit.directory
    groups = {name: group.to_dataset() for name, group in fit.posterior.children.items()}
    kept = keep_posterior(run, groups, experiment="a", data_kind="synthetic")
    assert run.read_manifest()["posterior_sha256"]
    assert kept.attrs["chains"] == "[]"
    loaded = load_posterior(run, run.read_manifest())
    assert loaded is not None
    assert loaded["posterior"].to_dataset().equals(kept["posterior"].to_dataset())
    run.update_manifest({"posterior_sha256": None})
    assert load_posterior(run, run.read_manifest()) is None
