"""Finished chains go on: the draws that are there stay, what is added is reproducible."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import SMALL_RUN, Problem

from pyburgers.cmdstan.draw_files import adaptation_of, join_draws, read_draws
from pyburgers.fitting.fit import Fit, fit
from pyburgers.sampling.run_directory import RunDirectory

MORE = 60


def again(problem: Problem, out: Path, more_draws: int = 0) -> Fit:
    return fit(
        problem.experiment, problem.priors, out=out, options=SMALL_RUN, more_draws=more_draws
    )


def contents(run: RunDirectory) -> dict[str, bytes]:
    files = sorted((run.path / "chains").rglob("draws.csv"))
    return {file.relative_to(run.path).as_posix(): file.read_bytes() for file in files}


@pytest.fixture(scope="module")
def extended(
    small_fit: Fit, small_problem: Problem, tmp_path_factory: pytest.TempPathFactory
) -> Fit:
    path = tmp_path_factory.mktemp("more") / "run"
    small_fit.save(path)
    return again(small_problem, path, MORE)


def test_the_draws_that_were_there_stay(small_fit: Fit, extended: Fit) -> None:
    before, after = contents(small_fit.directory), contents(extended.directory)
    assert {name: after[name] for name in before} == before
    assert len(after) == 2 * len(before)
    draws = extended.posterior["posterior"].to_dataset()
    assert draws.sizes["draw"] == SMALL_RUN.draws + MORE
    first = draws.isel(draw=slice(SMALL_RUN.draws))
    assert first.equals(small_fit.posterior["posterior"].to_dataset())
    assert extended.manifest["more_draws"] == [MORE]
    assert not extended.missing_chains()


def test_what_is_added_is_of_the_same_posterior(small_fit: Fit, extended: Fit) -> None:
    """Means agree within what so few draws tell; chains went on from where they were."""
    table = extended.summary("SI")
    added = extended.posterior["posterior"].to_dataset().isel(draw=slice(SMALL_RUN.draws, None))
    for name, row in table.iterrows():
        distance = abs(float(added[str(name)].mean()) - row["mean"]) / row["sd"]
        assert distance < 0.6, name
    stats = extended.posterior["sample_stats"].to_dataset()
    assert stats["step_size"].groupby("chain").std().max() < 1e-6
    assert not stats["diverging"].isel(draw=slice(SMALL_RUN.draws, None)).any()
    assert float(stats["acceptance_rate"].isel(draw=slice(SMALL_RUN.draws, None)).mean()) > 0.8


def test_it_is_reproducible_and_a_run_that_was_killed_is_completed(
    small_fit: Fit, extended: Fit, small_problem: Problem, tmp_path: Path
) -> None:
    run = RunDirectory(tmp_path / "run")
    shutil.copytree(extended.directory.path, run.path)
    shutil.rmtree(run.extended_folder(2, 1))
    halfway = Fit.load(run.path)
    assert halfway.posterior["posterior"].sizes["draw"] == SMALL_RUN.draws
    completed = again(small_problem, run.path)
    assert contents(run) == contents(extended.directory)
    assert (
        completed.posterior["posterior"]
        .to_dataset()
        .equals(extended.posterior["posterior"].to_dataset())
    )


def test_it_goes_on_from_any_extension_and_not_without_being_asked(
    extended: Fit, small_problem: Problem, tmp_path: Path
) -> None:
    path = tmp_path / "run"
    extended.save(path)
    kept = contents(extended.directory)
    assert again(small_problem, path).posterior["posterior"].sizes["draw"] == 160
    assert contents(RunDirectory(path)) == kept
    longer = again(small_problem, path, 20)
    assert longer.posterior["posterior"].sizes["draw"] == 180
    assert longer.manifest["more_draws"] == [MORE, 20]
    assert {name: contents(longer.directory)[name] for name in kept} == kept
    assert longer.checked_draws is not None


def test_changed_draws_of_an_extension_are_noticed(extended: Fit, tmp_path: Path) -> None:
    path = tmp_path / "run"
    extended.save(path)
    file = RunDirectory(path).draws_file(1, 1)
    file.write_text(file.read_text(encoding="utf-8").replace("1", "2"), encoding="utf-8")
    with pytest.raises(Exception, match=r"extended_1/draws\.csv has changed"):
        Fit.load(path)


def test_the_adapted_metric_is_read_as_a_positive_definite_one(small_fit: Fit) -> None:
    adapted = adaptation_of(small_fit.directory.draws_file(1))
    assert adapted.step_size == pytest.approx(
        float(small_fit.posterior["sample_stats"]["step_size"].isel(chain=0, draw=0)), rel=1e-5
    )
    np.testing.assert_array_equal(adapted.metric, adapted.metric.T)
    assert np.linalg.eigvalsh(adapted.metric).min() > 0


def test_files_of_draws_are_joined_with_the_rest_of_the_first(
    small_fit: Fit, tmp_path: Path
) -> None:
    one, two = small_fit.directory.draws_files()
    join_draws(one, two, tmp_path / "joined.csv")
    joined = read_draws([tmp_path / "joined.csv"]).values[0]
    np.testing.assert_array_equal(
        joined, np.concatenate([read_draws([file]).values[0] for file in (one, two)])
    )
    text = (tmp_path / "joined.csv").read_text(encoding="utf-8")
    assert text.startswith(one.read_text(encoding="utf-8").split("\n# \n")[0])
