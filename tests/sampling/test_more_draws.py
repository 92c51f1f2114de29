"""Finished chains go on: the draws that are there stay, what is added is reproducible."""

import logging
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import SMALL_RUN, Problem
from same_contents import contents

from pyburgers.cmdstan.draw_files import adaptation_of, join_draws, read_draws
from pyburgers.cmdstan.program import Program
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.fitting.fit import Fit
from pyburgers.sampling import run as runs
from pyburgers.sampling.chains import run_side_by_side
from pyburgers.sampling.manifest import ChainFailure
from pyburgers.sampling.run_directory import RunDirectory

MORE = 60
FIRST = "pyburgers.fit(...)"
"""Command of a record unless another one is given."""


def again(problem: Problem, out: Path, more_draws: int | None = None) -> Fit:
    return problem.fit(out, more_draws=more_draws)


def test_a_repeated_command_leaves_the_record_of_draws_that_stay(
    extended: Fit, small_problem: Problem, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The options of a record are those of its draws, and its command makes as many chains."""
    path, command = tmp_path / "run", extended.manifest["command"]
    extended.save(path)

    def repeated(chains: int) -> Fit:
        options = replace(SMALL_RUN, chains=chains)
        return small_problem.fit(path, options, command=f"{chains} chains")

    caplog.set_level(logging.INFO, "pyburgers.sampling.run")
    for chains in (SMALL_RUN.chains, 1):
        same = repeated(chains)
        assert same.manifest["sampler"]["chains"] == SMALL_RUN.chains
        assert same.manifest["command"] == command
        assert draws_in(same.directory) == draws_in(extended.directory)
    assert "The run keeps its 2 chains, although chains is 1." in caplog.messages
    # Chain 1 is sampled again, as one of both.
    shutil.rmtree(same.directory.chain_folder(1))
    assert repeated(1).manifest["sampler"]["chains"] == SMALL_RUN.chains
    more = repeated(3)
    assert (more.manifest["sampler"]["chains"], more.manifest["command"]) == (3, "3 chains")


def test_versions_of_a_run_are_those_that_made_its_draws(
    small_fit: Fit, small_problem: Problem, tmp_path: Path
) -> None:
    run = RunDirectory(tmp_path / "run")
    small_fit.save(run.path)
    old = {**small_fit.manifest["versions"], "numpy": "of another year"}
    run.update_manifest({"versions": old})
    assert again(small_problem, run.path).manifest["versions"] == old
    shutil.rmtree(run.chain_folder(1))
    new = again(small_problem, run.path).manifest["versions"]
    assert new == small_fit.manifest["versions"]


def test_the_command_of_a_run_stays_that_of_its_first_draws(extended: Fit, small_fit: Fit) -> None:
    assert small_fit.manifest["command"] == FIRST
    assert extended.manifest["command"] == FIRST


def test_an_interrupted_command_is_completed_by_the_same_one(
    small_fit: Fit,
    small_problem: Problem,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    """Draws that a command has added are not added again, and nothing of the old ones is left."""
    path = tmp_path / "run"
    small_fit.save(path)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("pyburgers.fitting.fit.build_posterior", interrupt)
        with pytest.raises(KeyboardInterrupt):
            again(small_problem, path, MORE)
    results = {"posterior.nc", "summary.csv", "checks.json"}
    assert results.isdisjoint(file.name for file in path.iterdir())
    caplog.set_level(logging.INFO, "pyburgers.sampling.run")
    for added in ([MORE], [MORE, MORE]):
        found = again(small_problem, path, MORE)
        assert found.manifest["more_draws"] == added
        assert found.manifest["status"] == "complete"
        assert results < {file.name for file in path.iterdir()}
    assert caplog.messages == [
        "Adding 60 draws was asked for before and interrupted: the command completes that, and "
        "adds no others.",
        "2 of 2 chains are there already.",
        "2 of 2 chains are there already.",
        "Extending 2 chains by 60 draws.",
    ]


def draws_in(run: RunDirectory) -> dict[str, bytes]:
    files = sorted((run.path / "chains").rglob("draws.csv"))
    return {file.relative_to(run.path).as_posix(): file.read_bytes() for file in files}


@pytest.fixture(scope="module")
def extended(
    small_fit: Fit, small_problem: Problem, tmp_path_factory: pytest.TempPathFactory
) -> Fit:
    path = tmp_path_factory.mktemp("more") / "run"
    small_fit.save(path)
    return small_problem.fit(path, more_draws=MORE, command="with more draws")


def test_the_draws_that_were_there_stay(small_fit: Fit, extended: Fit) -> None:
    before, after = draws_in(small_fit.directory), draws_in(extended.directory)
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


def test_it_goes_on_from_any_extension_and_not_without_being_asked(
    extended: Fit, small_problem: Problem, tmp_path: Path
) -> None:
    path = tmp_path / "run"
    extended.save(path)
    kept = draws_in(extended.directory)
    assert again(small_problem, path).posterior["posterior"].sizes["draw"] == 160
    assert draws_in(RunDirectory(path)) == kept
    longer = again(small_problem, path, 20)
    assert longer.posterior["posterior"].sizes["draw"] == 180
    assert longer.manifest["more_draws"] == [MORE, 20]
    assert {name: draws_in(longer.directory)[name] for name in kept} == kept
    assert longer.checked_draws is not None


@pytest.mark.parametrize("more", [None, MORE, 20])
def test_a_run_that_was_killed_is_completed_before_another_number_is_added(
    more: int | None,
    extended: Fit,
    small_problem: Problem,
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:
    run = RunDirectory(tmp_path / "run")
    shutil.copytree(extended.directory.path, run.path)
    shutil.rmtree(run.extended_folder(2, 1))
    assert Fit.load(run.path).posterior["posterior"].sizes["draw"] == SMALL_RUN.draws
    caplog.set_level(logging.INFO, "pyburgers.sampling.run")
    completed = again(small_problem, run.path, more)
    added = [20] if more == 20 else []
    assert completed.manifest["more_draws"] == [MORE, *added]
    kept = draws_in(extended.directory)
    assert {name: draws_in(run)[name] for name in kept} == kept
    draws = completed.posterior["posterior"].to_dataset()
    first = draws.isel(draw=slice(SMALL_RUN.draws + MORE))
    assert first.equals(extended.posterior["posterior"].to_dataset())
    assert draws.sizes["draw"] == SMALL_RUN.draws + MORE + sum(added)
    if added:
        assert caplog.messages == [
            "2 of 2 chains are there already.",
            "Adding 60 draws was asked for before and is completed first.",
            "Extending 1 chain by 60 draws.",
            "Extending 2 chains by 20 draws.",
        ]
    else:
        assert draws_in(run) == kept


@pytest.mark.parametrize("more", [-5, 0, 10**6 + 1, 10**20])
def test_a_number_that_cannot_be_drawn_changes_nothing(
    more: int, small_fit: Fit, small_problem: Problem, tmp_path: Path
) -> None:
    path = tmp_path / "run"
    small_fit.save(path)
    before = contents(path)
    with pytest.raises(InputError, match=f"^--more-draws {more}: expected a number from 1 to"):
        again(small_problem, path, more)
    assert contents(path) == before


def test_draws_are_added_to_a_run_that_is_there_and_stays(
    small_fit: Fit, small_problem: Problem, tmp_path: Path
) -> None:
    path = tmp_path / "run"
    with pytest.raises(InputError, match=r"--more-draws 10: found no run in .*run, expected one"):
        again(small_problem, path, 10)
    assert not path.exists()
    small_fit.save(path)
    before = contents(path)
    with pytest.raises(InputError, match="--more-draws 10: found it beside --overwrite"):
        small_problem.fit(path, replace(SMALL_RUN, seed=12), more_draws=10, overwrite=True)
    assert contents(path) == before


@pytest.mark.parametrize("failing", [(1, 2), (2,)])
def test_an_extension_that_fails_leaves_the_draws_that_were_there(
    failing: tuple[int, ...],
    small_fit: Fit,
    small_problem: Problem,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path = tmp_path / "run"
    small_fit.save(path)
    run = RunDirectory(path)

    def sample(model: Program, run: RunDirectory, chains: Sequence[int], *more: Any) -> Any:
        kept = [chain for chain in chains if chain not in failing]
        assert run_side_by_side(model, run, kept, *more) == ()
        return tuple(
            ChainFailure(chain=chain, reason=f"Chain {chain} stopped.") for chain in failing
        )

    with monkeypatch.context() as patched:
        patched.setattr(runs, "run_side_by_side", sample)
        with pytest.raises(SamplingError, match=rf"run: .*extended: Chain {failing[0]} stopped\."):
            again(small_problem, path, MORE)
    assert run.read_manifest()["status"] == "extension failed"
    assert Fit.load(path).posterior["posterior"].sizes["draw"] == SMALL_RUN.draws
    # What no chain has is forgotten, so that the run can go on; what one has is completed.
    completed = again(small_problem, path)
    wanted = [] if len(failing) == 2 else [MORE]
    assert completed.manifest["more_draws"] == wanted
    assert completed.posterior["posterior"].sizes["draw"] == SMALL_RUN.draws + sum(wanted)
    assert completed.manifest["status"] == "complete"


def test_changed_draws_of_an_extension_are_noticed(extended: Fit, tmp_path: Path) -> None:
    path = tmp_path / "run"
    extended.save(path)
    file = RunDirectory(path).draws_file(1, 1)
    file.write_text(file.read_text(encoding="utf-8").replace("1", "2"), encoding="utf-8")
    with pytest.raises(InputError, match=r"extended_1/draws\.csv has changed"):
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
