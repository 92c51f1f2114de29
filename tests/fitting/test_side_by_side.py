"""Fits in processes of their own are the fits that one process makes."""

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from conftest import SMALL_RUN, Problem

from pyburgers.common.errors import InputError
from pyburgers.common.tasks import Workers
from pyburgers.fitting.campaign import Task, fit_side_by_side, task_of
from pyburgers.fitting.fit import Fit, fit
from pyburgers.posterior.labelled_draws import convergence_table


@pytest.fixture
def tasks(small_problem: Problem) -> dict[str, Task]:
    experiment, priors = small_problem.experiment, small_problem.priors
    return {
        name: task_of(replace(experiment, id=name), priors, replace(SMALL_RUN, seed=seed))
        for name, seed in (("first", SMALL_RUN.seed), ("second", SMALL_RUN.seed + 1))
    }


def test_draws_and_runs_are_those_of_a_single_fit(
    tasks: dict[str, Task],
    small_fit: Fit,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO, "pyburgers.fitting.campaign")
    done: list[tuple[str, str]] = []
    found = fit_side_by_side(
        tasks,
        tmp_path,
        workers=Workers(jobs=2),
        command="make it",
        after=lambda name, one: done.append((name, one.experiment.id)),
    )
    assert sorted(done) == [("first", "first"), ("second", "second")]
    assert list(found) == ["first", "second"]
    assert sorted(sentence.split()[1] for sentence in caplog.messages) == ["first", "second"]
    error = capfd.readouterr().err
    for name, one in found.items():
        assert f"{name}: 100% of " in error
        assert one.experiment.id == name
        assert one.manifest["status"] == "complete"
        assert one.manifest["command"] == "make it"
    for name in ("posterior", "posterior_predictive", "predictions", "sample_stats"):
        single, same, other = (
            one.posterior[name].to_dataset() for one in (small_fit, *found.values())
        )
        xr.testing.assert_identical(single.drop_attrs(), same.drop_attrs())
        assert not same.equals(other)
    moduli = [one.posterior["posterior"]["maxwell_modulus"].to_numpy() for one in found.values()]
    assert not np.any(moduli[0] == moduli[1])
    # The same inputs in this process continue the run, which lacks nothing.
    before = found["first"].manifest["chains"]
    first = tasks["first"].problem
    again = fit(first.experiments, first.given_priors, out=tmp_path / "first", options=SMALL_RUN)
    assert again.manifest["chains"] == before


@pytest.mark.usefixtures("little_search")
def test_a_refused_fit_is_told_and_leaves_the_others_alone(
    in_this_process: None, tasks: dict[str, Task], tmp_path: Path
) -> None:
    (tmp_path / "second").mkdir()
    (tmp_path / "second" / "notes.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(InputError, match=r"second: has files \(notes.txt\) but no manifest.json"):
        fit_side_by_side(tasks, tmp_path, workers=Workers(jobs=2), command="x")
    assert Fit.load(tmp_path / "first").manifest["status"] == "complete"


@pytest.mark.usefixtures("little_search")
def test_a_name_may_hold_a_folder(
    in_this_process: None, tasks: dict[str, Task], tmp_path: Path
) -> None:
    options = replace(tasks["first"].options, chains=1, warmup=60, draws=20)
    task = replace(tasks["first"], options=options)
    found = fit_side_by_side({"ice/first": task}, str(tmp_path), command="x")
    assert found["ice/first"].directory.path == tmp_path / "ice" / "first"


@pytest.mark.usefixtures("little_search")
def test_a_fit_goes_on_until_its_draws_are_enough(
    in_this_process: None, tasks: dict[str, Task], tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "pyburgers.fitting.problem_run")
    # 160 draws in all can be judged, and can never be 400 independent ones.
    options = replace(tasks["first"].options, chains=2, draws=80)

    def done(name: str, max_minutes: float | None) -> Fit:
        task = replace(tasks["first"], options=replace(options, max_minutes=max_minutes))
        return fit_side_by_side({name: task}, tmp_path, command="x")[name]

    once = done("once", None)
    assert "more_draws" not in once.manifest
    assert "more draw" not in caplog.text
    # A tenth of a second does for none, and says how long it would take.
    short = done("once", 1e-3)
    assert "more_draws" not in short.manifest
    assert "which --max-minutes 0.001 does not allow" in caplog.text
    found = done("once", 100.0)
    assert found.manifest["more_draws"]
    assert all(more >= 40 for more in found.manifest["more_draws"])
    assert convergence_table(found.posterior)[["ess_bulk", "ess_tail"]].to_numpy().min() >= 400
    assert found.posterior["posterior"].sizes["draw"] == 80 + sum(found.manifest["more_draws"])
    # The first draws are those of a fit that is left as it is.
    draws = found.posterior["posterior"].to_dataset().isel(draw=slice(80))
    xr.testing.assert_equal(draws, once.posterior["posterior"].to_dataset())
    again = done("once", 100.0)
    xr.testing.assert_identical(again.posterior["posterior"], found.posterior["posterior"])


@pytest.mark.usefixtures("little_search")
def test_more_draws_of_a_single_chain_would_not_tell_whether_chains_agree(
    in_this_process: None, tasks: dict[str, Task], tmp_path: Path
) -> None:
    alone = replace(tasks["first"].options, chains=1, draws=120, max_minutes=100.0)
    task = replace(tasks["first"], options=alone)
    assert "more_draws" not in fit_side_by_side({"a": task}, tmp_path, command="x")["a"].manifest
