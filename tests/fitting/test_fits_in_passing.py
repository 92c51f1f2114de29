"""Fits without a folder or priors of their own, and their pages."""

import gc
from pathlib import Path

import pytest
from conftest import SMALL_RUN, Problem

import pyburgers
from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit, fit


def test_a_fit_without_a_folder_has_one_until_nothing_needs_it(
    small_problem: Problem, small_fit: Fit, tmp_path: Path
) -> None:
    found = fit(small_problem.experiment, small_problem.priors, options=SMALL_RUN)
    folder = found.directory.path
    test = found[found.experiment.id]
    draws, known = (one.posterior["posterior"].to_dataset() for one in (found, small_fit))
    assert draws.equals(known)
    found.save(tmp_path / "kept")
    del found
    gc.collect()
    assert folder.is_dir()  # the result for the test is of this run
    del test
    gc.collect()
    assert not folder.exists()
    assert Fit.load(tmp_path / "kept").posterior.attrs["experiment"] == small_problem.experiment.id


def test_a_fit_that_fails_leaves_no_folder(
    small_problem: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(InputError):
        fit(small_problem.experiment, small_problem.priors, pool={"beta": "none"})
    assert not list(tmp_path.iterdir())


def test_the_material_has_priors_if_none_are_given(
    small_problem: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = []
    monkeypatch.setattr(
        "pyburgers.fitting.fit.fit_problem", lambda problem, **_: given.append(problem.given_priors)
    )
    fit(small_problem.experiment, out=tmp_path / "run")
    assert given == [pyburgers.priors("ice")]


def test_a_page_is_a_file_with_its_tables_beside_it(
    small_fit: Fit, tmp_path: Path, sketched: None
) -> None:
    page = small_fit.report(tmp_path / "page.html", title="A title")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["page.html", "page_files"]
    text = page.read_text(encoding="utf-8")
    assert "<h1>A title</h1>" in text
    links = [part.split('"')[0] for part in text.split('href="')[1:]]
    linked = [link for link in links if "tables/" in link or "figures/" in link]
    assert linked
    assert all((tmp_path / link).is_file() for link in linked)
    again = small_fit.report(tmp_path / "folder")
    assert again == tmp_path / "folder" / "index.html"
