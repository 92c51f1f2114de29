"""Where a few trajectories diverge, all chains go on from where they were with shorter steps."""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from conftest import SMALL_RUN, TABLE_RUN, Problem

from pyburgers.cmdstan.draw_files import adaptation_of, read_draws
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import read_json
from pyburgers.fitting.fit import Fit
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.flow_law_tables.fit_rates import fit_rates
from pyburgers.sampling.repetitions import LEAST_SHORTENING, adaptation, shorten_steps, shortening
from pyburgers.sampling.run_directory import RunDirectory

FloatArray = npt.NDArray[np.float64]

LONG_STEPS = replace(SMALL_RUN, warmup=60, draws=30, adapt_delta=0.05)
"""A target with which half of the trajectories diverge, and a few still with steps half as long."""


def again(problem: Problem, out: Path, more_draws: int | None = None) -> Fit:
    return problem.fit(out, LONG_STEPS, more_draws=more_draws)


def all_draws(run: RunDirectory) -> FloatArray:
    return read_draws(run.draws_files()).values


@pytest.fixture(scope="module", autouse=True)
def as_often_as_it_takes() -> Iterator[None]:
    """Whether two halvings are enough is chance, and another one on another machine."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pyburgers.fitting.problem_run.MAX_SHORTENED", 8)
        yield


@pytest.fixture(scope="module")
def mended(small_problem: Problem, tmp_path_factory: pytest.TempPathFactory) -> Fit:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pyburgers.fitting.problem_run.MAX_DIVERGENT_SHARE", 1.0)
        return again(small_problem, tmp_path_factory.mktemp("mended") / "run")


def test_chains_that_diverged_are_put_aside_and_the_others_stay(mended: Fit) -> None:
    done = mended.manifest["shortened"]
    assert done
    stats = mended.posterior["sample_stats"].to_dataset()
    assert stats["diverging"].size == LONG_STEPS.chains * LONG_STEPS.draws
    run = mended.directory
    for one in done:
        files = [
            run.path / one["chains"] / f"chain_{chain}" / "draws.csv" for chain in one["step_sizes"]
        ]
        counts = [int(read_draws([file])["divergent__"].sum()) for file in files]
        assert sum(counts) == one["divergences"]
        assert min(counts) > 0
        assert sorted(path.name for path in (run.path / one["chains"]).iterdir()) == [
            f"chain_{chain}" for chain in one["step_sizes"]
        ]
    check = next(one for one in mended.checks() if one.name == "divergences")
    assert check.passed
    assert f"{done[0]['divergences']}" in check.sentence


def test_steps_of_the_own_or_of_the_middle_chain_are_shortened_as_divergences_ask(
    mended: Fit,
) -> None:
    run = mended.directory
    first = mended.manifest["shortened"][0]
    own = [
        adaptation_of(run.path / first["chains"] / f"chain_{chain}" / "draws.csv").step_size
        for chain in (1, 2)
    ]
    expected = np.minimum(own, np.median(own)) / shortening(first["divergences"])
    assert first["divergences"] > LEAST_SHORTENING**3
    np.testing.assert_allclose(list(first["step_sizes"].values()), expected, rtol=1e-12)
    used = mended.posterior["sample_stats"].to_dataset()["step_size"]
    for chain in (1, 2):
        aside = [one for one in mended.manifest["shortened"] if str(chain) in one["step_sizes"]]
        last = aside[-1]["step_sizes"][str(chain)]
        np.testing.assert_allclose(used.sel(chain=chain), last, rtol=1e-5)
        assert adaptation(run, chain).step_size == last
        # The time of what was put aside counts.
        timing = read_json(run.path / aside[-1]["chains"] / f"chain_{chain}" / "timing.json")
        assert mended.manifest["chains"][str(chain)]["wall_seconds"] > timing["wall_seconds"]


def test_nothing_is_sampled_again_and_a_lost_chain_is_the_same_again(
    mended: Fit, small_problem: Problem, tmp_path: Path
) -> None:
    mended.save(tmp_path / "run")
    kept = all_draws(mended.directory)
    unchanged = again(small_problem, tmp_path / "run")
    assert unchanged.manifest["shortened"] == mended.manifest["shortened"]
    shutil.rmtree(tmp_path / "run" / "chains" / "chain_2")
    (tmp_path / "run" / "posterior.nc").unlink()
    again(small_problem, tmp_path / "run")
    np.testing.assert_array_equal(all_draws(RunDirectory(tmp_path / "run")), kept)


def test_chains_put_aside_by_a_process_that_was_killed_are_sampled_as_before(
    mended: Fit, small_problem: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between moving the chains and noting it, nothing says that they go on."""
    monkeypatch.setattr("pyburgers.fitting.problem_run.MAX_DIVERGENT_SHARE", 1.0)
    mended.save(tmp_path / "run")
    run = RunDirectory(tmp_path / "run")
    shutil.rmtree(run.path / "chains")
    (run.path / "chains").mkdir()
    run.posterior_file.unlink()
    run.update_manifest({"shortened": [], "chains": {}, "hashes": {}})
    resumed = again(small_problem, run.path)
    assert resumed.manifest["shortened"] == mended.manifest["shortened"]
    np.testing.assert_array_equal(all_draws(run), all_draws(mended.directory))


def test_chains_are_extended_with_their_shorter_steps(
    mended: Fit, small_problem: Problem, tmp_path: Path
) -> None:
    mended.save(tmp_path / "run")
    longer = again(small_problem, tmp_path / "run", 20)
    stats = longer.posterior["sample_stats"].to_dataset()
    assert stats.sizes["draw"] == LONG_STEPS.draws + 20
    steps = {k: v for one in mended.manifest["shortened"] for k, v in one["step_sizes"].items()}
    for chain, step in steps.items():
        np.testing.assert_allclose(stats["step_size"].sel(chain=int(chain)), step, rtol=1e-5)


def test_chains_do_not_go_on_from_what_is_gone_or_has_changed(
    mended: Fit, small_problem: Problem, tmp_path: Path
) -> None:
    mended.save(tmp_path / "run")
    aside = tmp_path / "run" / mended.manifest["shortened"][-1]["chains"]
    draws = next(aside.glob("chain_*")) / "draws.csv"
    draws.write_text(draws.read_text(encoding="utf-8").replace("1", "2"), encoding="utf-8")
    with pytest.raises(InputError, match="has changed since the run, expected the chain that"):
        again(small_problem, tmp_path / "run", 20)
    shutil.rmtree(tmp_path / "run" / "superseded")
    assert Fit.load(tmp_path / "run").posterior.equals(mended.posterior)
    with pytest.raises(InputError, match="is missing, expected the chain that another goes on"):
        again(small_problem, tmp_path / "run", 20)


def test_steps_are_not_shortened_without_end(
    small_problem: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pyburgers.fitting.problem_run.MAX_DIVERGENT_SHARE", 1.0)
    monkeypatch.setattr("pyburgers.fitting.problem_run.MAX_SHORTENED", 1)
    result = again(small_problem, tmp_path / "run")
    assert len(result.manifest["shortened"]) == 1
    # Trajectories with shorter steps would all be cut.
    with monkeypatch.context() as patch:
        patch.setattr(
            "pyburgers.fitting.problem_run.shortening", lambda _: 2.0**LONG_STEPS.max_treedepth
        )
        cut = again(small_problem, tmp_path / "cut")
    assert cut.manifest["shortened"] == []
    # Many divergences are no matter of the step.
    monkeypatch.undo()
    many = again(small_problem, tmp_path / "many")
    assert many.manifest["shortened"] == []
    assert not next(one for one in many.checks() if one.name == "divergences").passed


def test_the_metric_is_that_of_all_draws_put_aside(mended: Fit, tmp_path: Path) -> None:
    """Also in a run whose steps were shortened before, for every chain that goes on."""
    mended.save(tmp_path / "run")
    run = RunDirectory(tmp_path / "run")
    before = {chain: adaptation(run, chain) for chain in run.finished_chains()}
    draws = read_draws(run.draws_files())["coordinate"]
    shorten_steps(run, dict.fromkeys(before, 1))
    n = draws.shape[-1]
    own = np.mean([one.metric for one in before.values()], axis=0)
    covariance = np.mean([np.cov(chain, rowvar=False) for chain in draws], axis=0)
    n_draws = draws.shape[0] * draws.shape[1]
    expected = (n * own + n_draws * covariance) / (n + n_draws)
    for chain, one in before.items():
        after = adaptation(run, chain)
        assert after.step_size <= one.step_size / LEAST_SHORTENING
        np.testing.assert_allclose(after.metric, expected, rtol=1e-3)
        assert np.linalg.eigvalsh(after.metric).min() > 0


def test_a_fit_of_rates_goes_on_too(
    creep: RateFit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pyburgers.fitting.problem_run.MAX_DIVERGENT_SHARE", 1.0)
    options = replace(TABLE_RUN, warmup=100, draws=100, adapt_delta=0.05)
    fit = fit_rates(creep.data, out=tmp_path, options=options)
    assert fit.manifest["shortened"]
    assert next(one for one in fit.checks() if one.name == "divergences").passed
    assert (tmp_path / fit.manifest["shortened"][0]["chains"] / "chain_1" / "draws.csv").is_file()
    again = fit_rates(creep.data, out=tmp_path, options=options)
    assert again.manifest["shortened"] == fit.manifest["shortened"]
    assert again.posterior.equals(fit.posterior)
