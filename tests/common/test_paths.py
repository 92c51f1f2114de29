"""Paths that users give: ``~`` is the home folder once, and one path is one place."""

import json
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from conftest import ICE, SMALL_RUN, Problem
from refusals import CommandLine

import pyburgers
from pyburgers.cli.main import main
from pyburgers.cli.parser import OneLineParser
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path, shown
from pyburgers.fitting.fit import Fit
from pyburgers.flow_law_tables.fit import RateFit, is_rate_run
from pyburgers.model.flow_law_prior import FlowLawPrior
from pyburgers.model.priors import shipped_prior_file


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The home folder; the working folder is another one, with a folder named ``~``."""
    folder, here = tmp_path / "home", tmp_path / "here"
    folder.mkdir()
    (here / "~").mkdir(parents=True)
    monkeypatch.setenv("HOME", str(folder))
    monkeypatch.chdir(here)
    return folder


def test_a_tilde_is_the_home_folder_at_the_start_alone(home: Path) -> None:
    here = Path.cwd()
    assert given_path("~/runs/x") == given_path(Path("~/runs/x")) == home / "runs" / "x"
    assert given_path("~") == home
    assert given_path("./~/runs") == here / "~" / "runs"
    assert given_path("runs/~") == here / "runs" / "~"
    assert given_path("~nobody_of_that_name/x") == here / "~nobody_of_that_name" / "x"
    assert given_path(given_path("./~/runs")) == here / "~" / "runs"


def test_messages_show_paths_from_the_working_folder(home: Path) -> None:
    here = Path.cwd()
    assert (
        shown(f"{here}/runs/x: is no run, see {here}/a.toml.") == "runs/x: is no run, see a.toml."
    )
    for text in (f"{here}/~/x", f"{home}/x", f"/other{here}/x", f"{here}s"):
        assert shown(text) == text
    assert shown(f"{here}/-x: found") == "./-x: found"
    assert shown(f"--out {here}: it is a folder") == "--out .: it is a folder"


@pytest.mark.parametrize(
    ("command", "arguments", "name"),
    [
        ("export", ("RUN", "--out", "PATH"), "out"),
        ("fit", ("RUN", "--priors", "PATH"), "priors"),
        ("check-file", ("PATH",), "files"),
        ("compare", ("RUN", "PATH"), "directories"),
    ],
)
def test_paths_of_the_command_line_are_expanded_where_they_come_in(
    command: str, arguments: tuple[str, ...], name: str, home: Path
) -> None:
    parser = OneLineParser(prog=command)
    import_module(f"pyburgers.cli.{command.replace('-', '_')}").add_options(parser)
    for given, wanted in (("~/x", home / "x"), ("./~/x", Path.cwd() / "~" / "x")):
        words = [given if word == "PATH" else word for word in arguments]
        found = getattr(parser.parse_all(words), name)
        assert (found[-1] if isinstance(found, list) else found) == wanted


LOADERS: dict[str, tuple[Callable[[str], object], Path]] = {
    "load_experiment": (pyburgers.load_experiment, ICE / "PIL40.toml"),
    "load_priors": (pyburgers.load_priors, shipped_prior_file("ice")),
    "load_rate_table": (pyburgers.load_rate_table, ICE / "rates" / "qi_goldsby_2021.toml"),
}


@pytest.mark.parametrize("name", LOADERS)
def test_what_reads_a_file_takes_the_home_folder(name: str, home: Path) -> None:
    load, file = LOADERS[name]
    shutil.copytree(file.parent, home / "inputs")
    assert load(f"~/inputs/{file.name}") is not None
    with pytest.raises(InputError, match=r"here/~/inputs"):
        load(f"./~/inputs/{file.name}")


def test_parameters_are_read_from_the_home_folder(home: Path) -> None:
    known = pyburgers.load_experiment(ICE / "PIL40.toml").true_parameters
    assert known is not None
    (home / "known.json").write_text(json.dumps(dict(known)), encoding="utf-8")
    assert pyburgers.load_parameters("~/known.json") == dict(known)


@pytest.mark.parametrize(
    "load",
    [Fit.load, RateFit.load, FlowLawPrior.load, pyburgers.load_rate_law],
    ids=["Fit", "RateFit", "FlowLawPrior", "load_rate_law"],
)
def test_what_is_not_there_is_named_in_the_home_folder(
    load: Callable[[str], object], home: Path
) -> None:
    with pytest.raises(InputError, match=f"{home}/absent"):
        load("~/absent")
    assert not is_rate_run("~/absent")


def test_fits_are_written_into_the_home_folder(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each is stopped where it takes its folder, ahead of all that takes time."""

    def stopped(path: Path) -> None:
        raise InputError(f"in {path}")

    for module in ("fitting.fit", "flow_law_tables.fit_rates"):
        monkeypatch.setattr(f"pyburgers.{module}.RunDirectory", stopped)
    test, priors = pyburgers.load_experiment(ICE / "PIL40.toml"), pyburgers.priors("ice")
    table = pyburgers.load_rate_table(ICE / "rates" / "qi_goldsby_2021.toml")
    for run in (
        lambda: pyburgers.fit(test, priors, out="~/x"),
        lambda: pyburgers.fit([test, replace(test, id="b")], priors, out="~/x"),
        lambda: pyburgers.fit_rates(table, out="~/x"),
    ):
        with pytest.raises(InputError, match=f"in {home}/x"):
            run()


def values(fit: Fit) -> np.ndarray:
    return np.asarray(fit.posterior["posterior"]["maxwell_modulus"])


def test_one_run_never_speaks_for_another(
    small_fit: Fit, other_fit: Fit, home: Path, cli: CommandLine
) -> None:
    """A run in a folder named ``~``, and one of another test in the home folder."""
    shutil.copytree(small_fit.directory.path, Path("~/run"))
    other_fit.save("~/run")
    assert (home / "run" / "manifest.json").is_file()
    here, there = Fit.load("./~/run"), Fit.load("~/run")
    np.testing.assert_array_equal(values(here), values(small_fit))
    np.testing.assert_array_equal(values(there), values(other_fit))
    assert here.experiment.id == small_fit.experiment.id
    written = {}
    for name in ("~/run", "./~/run"):
        cli("export", name, "--out", "~/export.json")
        written[name] = json.loads((home / "export.json").read_text(encoding="utf-8"))["test"]
    assert written == {"~/run": other_fit.experiment.id, "./~/run": small_fit.experiment.id}


def test_a_run_stays_where_it_is_when_the_process_goes_elsewhere(
    small_fit: Fit, home: Path
) -> None:
    shutil.copytree(small_fit.directory.path, Path("run"))
    fit = Fit.load("run")
    here = Path.cwd()
    os.chdir(home)
    assert fit.directory.path == here / "run"


@pytest.mark.usefixtures("little_search")
@pytest.mark.parametrize(
    "name",
    [b"-x=1/back\\slash/[a]*?/'\"$(x) %s {y}/\xc3\xa9\xe2\x80\xae", b"bad\xff\xfe"],
    ids=["text", "no text"],
)
def test_a_run_is_read_back_wherever_it_was_fitted(
    name: bytes, small_problem: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Experiment, priors, temporary files and output have names that few think of."""
    folder = tmp_path / os.fsdecode(name)
    (folder / "tmp").mkdir(parents=True)
    shutil.copytree(small_problem.experiment_file.parent, folder / "inputs")
    monkeypatch.setattr("tempfile.tempdir", str(folder / "tmp"))
    monkeypatch.chdir(tmp_path)
    inputs = folder.relative_to(tmp_path) / "inputs"
    problem = replace(
        small_problem,
        experiment_file=inputs / small_problem.experiment_file.name,
        priors_file=inputs / small_problem.priors_file.name,
    )
    options = replace(SMALL_RUN, warmup=50, draws=40)
    made = pyburgers.fit(problem.experiment, problem.priors, out=folder / "run", options=options)
    again = Fit.load(folder / "run")
    np.testing.assert_array_equal(values(again), values(made))
    assert main(["check", str(folder / "run")]) in (0, 3, 4)
    assert not list((folder / "tmp").iterdir())
