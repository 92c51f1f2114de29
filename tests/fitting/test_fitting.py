"""A fit from files to checks: what it writes, repeats, continues and refuses."""

import json
import logging
import pickle
import shutil
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import arviz as az
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import LONG_RUN, SMALL_RUN, Problem, with_fixed
from log_density import Program
from truths import truth_of

from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.cmdstan.compilation import compile_program
from pyburgers.cmdstan.draw_files import read_draws
from pyburgers.common.atomic_files import sha256_of_file
from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.stan_data import (
    REFERENCE_SOLVER,
    REFERENCE_STRESS,
    SolverOptions,
    solver_block,
)
from pyburgers.model.parameters import PARAMETERS
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.run_directory import RunDirectory

FREE = ["maxwell_modulus", "activation_enthalpy", "stress_noise"]


def contents(folder: Path) -> dict[str, bytes]:
    return {
        file.relative_to(folder).as_posix(): file.read_bytes()
        for file in folder.rglob("*")
        if file.is_file()
    }


def group(result: Fit, name: str) -> xr.Dataset:
    return result.posterior[name].to_dataset()


def fitted(
    problem: Problem, out: Path, options: SamplerOptions = SMALL_RUN, *, use_likelihood: bool = True
) -> Fit:
    return fit(
        problem.experiment,
        problem.priors,
        out=out,
        options=options,
        use_likelihood=use_likelihood,
    )


@pytest.fixture
def copy(small_fit: Fit, tmp_path: Path) -> Path:
    """Run directory of the small fit that a test may change."""
    small_fit.save(tmp_path / "copy")
    return tmp_path / "copy"


def test_a_fit_writes_everything_and_its_manifest_says_what_was_run(small_fit: Fit) -> None:
    files = set(contents(small_fit.directory.path)) - {".lock"}
    chain_files = {
        f"chains/chain_{chain}/{name}"
        for chain in (1, 2)
        for name in ("draws.csv", "console.txt", "timing.json")
    }
    assert files == chain_files | {
        "manifest.json",
        "stan_data.json",
        "metric.json",
        "posterior.nc",
        "checks.json",
        "summary.csv",
        "inputs/tests/PIL40/experiment.toml",
        "inputs/tests/PIL40/experiment.csv",
        "inputs/priors.toml",
        "initial_values/chain_1.json",
        "initial_values/chain_2.json",
    }
    manifest = small_fit.manifest
    assert manifest["status"] == "complete"
    assert manifest["sampler"]["seed"] == SMALL_RUN.seed
    assert manifest["solver"]["tolerance"] == SolverOptions().tolerance
    assert manifest["failures"] == manifest["noisy"] == []
    assert {"python", "cmdstan", "compiler", "cmdstanpy", "numpy"} <= set(manifest["versions"])
    assert set(manifest["chains"]) == {"1", "2"}
    assert manifest["chains"]["1"]["wall_seconds"] > 0
    for name, digest in manifest["hashes"].items():
        assert sha256_of_file(small_fit.directory.path / name) == digest
    assert "inputs/tests/PIL40/experiment.toml" in manifest["hashes"]


def test_the_posterior_is_labelled(small_fit: Fit) -> None:
    posterior = group(small_fit, "posterior")
    assert set(posterior.data_vars) == {p.name for p in PARAMETERS} | {REFERENCE_STRESS}
    assert posterior.sizes == {"chain": 2, "draw": SMALL_RUN.draws}
    assert posterior["chain"].to_numpy().tolist() == [1, 2]
    modulus = posterior["maxwell_modulus"]
    assert (modulus.attrs["units"], modulus.attrs["symbol"]) == ("Pa", "E_M")
    experiment = small_fit.experiment
    assert isinstance(experiment, ConstantRateExperiment)
    n_points = experiment.n_points
    assert small_fit.posterior["log_likelihood"].sizes["point"] == n_points
    assert small_fit.posterior["posterior_predictive"].sizes["point"] == n_points
    residual = group(small_fit, "observed_data") - group(small_fit, "model_response")
    noise = posterior["stress_noise"]
    density = -0.5 * (residual / noise) ** 2 - np.log(noise * np.sqrt(2 * np.pi))
    sampled = group(small_fit, "log_likelihood")
    xr.testing.assert_allclose(density.transpose(*sampled.dims), sampled, rtol=1e-6)
    predictions = small_fit.posterior["predictions"]
    assert float(predictions["strain"].max()) == pytest.approx(experiment.final_strain)


def test_fixed_parameters_stay_fixed_and_the_others_find_the_truth(small_fit: Fit) -> None:
    posterior = group(small_fit, "posterior")
    truth = truth_of(small_fit.experiment)
    for parameter in PARAMETERS:
        draws = posterior[parameter.name].to_numpy()
        if parameter.name in FREE:
            assert np.ptp(draws) > 0
            assert abs(draws.mean() - truth[parameter.name]) < 4 * draws.std()
        else:
            np.testing.assert_allclose(draws, truth[parameter.name], rtol=1e-11)


def test_chains_need_not_agree_on_the_reference_of_a_flow_law_that_is_fixed(
    small_problem: Problem, tmp_path: Path
) -> None:
    """It is the same in all draws, which has no R-hat."""
    test = small_problem.experiment
    truth = truth_of(test)
    law = with_fixed(small_problem.priors, {"activation_enthalpy": truth["activation_enthalpy"]})
    result = fit(test, law, out=tmp_path / "run", options=LONG_RUN)
    assert result.summary().index.tolist() == ["maxwell_modulus", "stress_noise"]
    (rhat,) = (one for one in result.checks() if one.name == "R-hat")
    assert rhat.outcome is Outcome.YES
    everything = with_fixed(law, {name: truth[name] for name in law.free})
    with pytest.raises(InputError, match=r"every parameter fixed.*stress_noise"):
        fit(test, everything, out=tmp_path / "all")


def test_any_arviz_reads_the_posterior(small_fit: Fit) -> None:
    data = az.from_netcdf(small_fit.directory.posterior_file)
    expected = small_fit.posterior["posterior"]["maxwell_modulus"]
    np.testing.assert_array_equal(data["posterior"]["maxwell_modulus"], expected)


def test_the_table_has_the_prior_beside_the_posterior(small_fit: Fit) -> None:
    table = small_fit.summary("SI")
    assert set(table.index) == {*FREE, REFERENCE_STRESS}
    assert table["prior_mean"]["activation_enthalpy"] == pytest.approx(65e3)
    assert table["prior_sd"]["activation_enthalpy"] == pytest.approx(2e3)
    assert (table["q5"] < table["mean"]).all()
    assert (table["mean"] < table["q95"]).all()
    assert (table["sd"][FREE] < table["prior_sd"][FREE]).all()
    assert np.isnan(table["prior_mean"][REFERENCE_STRESS])
    written = pd.read_csv(small_fit.directory.summary_file, index_col="parameter")
    np.testing.assert_allclose(written["mean"], table["mean"])


def test_the_checks_are_written_with_their_sentences(small_fit: Fit) -> None:
    written = json.loads(small_fit.directory.checks_file.read_text(encoding="utf-8"))
    checks = small_fit.checks()
    assert [(c["name"], c["outcome"], c["sentence"]) for c in written["checks"]] == [
        (c.name, c.outcome.value, c.sentence) for c in checks
    ]
    assert {c["kind"] for c in written["checks"]} == set(written["verdicts"])
    assert set(written["verdicts"]) == {"sampling", "description"}
    assert written["prior_conflicts"] == list(small_fit.prior_conflicts())
    assert written["prior_decisions"] == list(small_fit.prior_decisions())
    assert (small_fit.summary()["decided_by"] != "").all()
    for kind, verdict in small_fit.verdicts().items():
        told = written["verdicts"][kind.name.lower()]
        assert told == {"outcome": verdict.outcome.value, "sentence": verdict.sentence}
    assert small_fit.sampled_well is small_fit.verdicts()[CheckKind.SAMPLING].outcome
    assert small_fit.describes_data is small_fit.verdicts()[CheckKind.DESCRIPTION].outcome
    assert {c.name: c.passed for c in checks}["chains"]


def test_the_same_call_again_does_nothing_and_is_quick(copy: Path, small_problem: Problem) -> None:
    before = contents(copy)
    started = time.process_time()
    again = fitted(small_problem, copy)
    assert time.process_time() - started < 5
    after = contents(copy)
    for name in set(before) - {"manifest.json"}:
        assert after[name] == before[name], name
    assert again.manifest["status"] == "complete"


def test_more_chains_continue_the_run(copy: Path, small_fit: Fit, small_problem: Problem) -> None:
    before = contents(copy)
    more = fitted(small_problem, copy, replace(SMALL_RUN, chains=3))
    posterior = group(more, "posterior")
    assert posterior["chain"].to_numpy().tolist() == [1, 2, 3]
    assert posterior.sel(chain=[1, 2]).equals(group(small_fit, "posterior"))
    for chain in (1, 2):
        name = f"chains/chain_{chain}/draws.csv"
        assert contents(copy)[name] == before[name]


def test_a_saved_copy_is_a_complete_fit(small_fit: Fit, copy: Path) -> None:
    loaded = Fit.load(copy)
    assert group(loaded, "posterior").equals(group(small_fit, "posterior"))
    assert loaded.priors == small_fit.priors
    assert [check.passed for check in loaded.checks()] == [
        check.passed for check in small_fit.checks()
    ]
    with pytest.raises(InputError, match="exists"):
        small_fit.save(copy)


@pytest.mark.usefixtures("little_search")
def test_draws_without_solution_at_the_reference_tolerance_do_not_end_the_fit(
    small_problem: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    impossible = SolverOptions(tolerance=1e-10, max_num_steps=5, method="bdf")
    monkeypatch.setattr("pyburgers.posterior.build.REFERENCE_SOLVER", impossible)
    monkeypatch.setattr("pyburgers.fitting.problem_run.MAX_REFITS", 0)
    options = replace(SMALL_RUN, warmup=50, draws=5)
    result = fitted(small_problem, tmp_path / "run", options)
    check = next(check for check in result.checks() if check.name == "solver")
    assert not check.passed
    assert "10 of 10 draws have no solution" in check.sentence
    assert np.isnan(group(result, "predictions")["stress"]).all()
    assert np.isfinite(group(result, "log_likelihood")["stress"]).all()


def test_the_solver_check_is_of_the_density_that_was_sampled(
    small_fit: Fit, tmp_path: Path
) -> None:
    """Reference over sampled density, both asked of the program itself at kept draws."""
    run = small_fit.directory
    data = json.loads(run.stan_data_file.read_text(encoding="utf-8"))
    coordinate = read_draws([run.draws_file(1)])["coordinate"][0]
    ratios = group(small_fit, "sample_stats")["solver_log_ratio"].sel(chain=1).to_numpy()

    def log_density(solver: SolverOptions, draw: int) -> float:
        data_file = tmp_path / "data.json"
        data_file.write_text(json.dumps({**data, **solver_block(solver)}), encoding="utf-8")
        program = Program(
            compile_program(likelihood_of(small_fit.experiment).program),
            data_file,
            tmp_path,
            lambda columns: np.empty(0),
            np.ones(data["n_coordinates"]),
        )
        return program.columns_at({"coordinate": coordinate[draw].tolist()})["lp__"]

    for draw in (0, 7, 19):
        change = log_density(REFERENCE_SOLVER, draw) - log_density(SolverOptions(), draw)
        # The reference is that accurate; log_lik of the chains would be wrong by 0.01 to 0.03.
        assert ratios[draw] == pytest.approx(change, abs=1e-3)


@pytest.mark.usefixtures("little_search")
def test_a_tolerance_too_loose_is_tightened_and_the_chains_run_again(
    small_problem: Problem,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO, "pyburgers")
    options = replace(SMALL_RUN, warmup=50, draws=50)
    with monkeypatch.context() as strict:
        # No tolerance is good enough: the run is repeated as often as is allowed.
        strict.setattr("pyburgers.checks.fit_checks.PARETO_K_LIMIT", -np.inf)
        result = fitted(small_problem, tmp_path / "run", options)
        assert not {check.name: check.passed for check in result.checks()}["solver"]
    refits = result.manifest["refits"]
    asked = SolverOptions().tolerance
    assert [refit["tolerance"] for refit in refits] == pytest.approx([asked, asked / 10])
    assert result.manifest["solver"]["tolerance"] == pytest.approx(asked / 100)
    assert sum("Sampling all chains again" in line for line in caplog.messages) == 2
    for refit in refits:
        aside = tmp_path / "run" / refit["chains"]
        assert sorted(folder.name for folder in aside.iterdir()) == ["chain_1", "chain_2"]
        assert np.isfinite(refit["pareto_k"])
    # The same inputs continue the tightened run; nothing is sampled again.
    before = contents(tmp_path / "run")
    again = fitted(small_problem, tmp_path / "run", options)
    assert again.manifest["refits"] == refits
    assert {check.name: check.passed for check in again.checks()}["solver"]
    after = contents(tmp_path / "run")
    changed = {name for name in before if after[name] != before[name]}
    # Who decides a number cannot be told while the solver is too loose.
    assert changed <= {"manifest.json", "checks.json", "summary.csv"}


@pytest.mark.usefixtures("little_search")
def test_few_draws_are_told_as_such_and_not_sampled_again(
    small_problem: Problem, tmp_path: Path
) -> None:
    """Five draws have no tail, so that their Pareto k is infinite whatever the tolerance is."""
    options = replace(SMALL_RUN, warmup=50, draws=5)
    result = fitted(small_problem, tmp_path / "run", options)
    assert result.manifest["refits"] == []
    assert result.sampled_well is Outcome.CANNOT_TELL
    assert result.describes_data is Outcome.CANNOT_TELL
    for verdict in result.verdicts().values():
        assert "10 draws are too few" in verdict.sentence
    assert not any("tolerance is too loose" in check.sentence for check in result.checks())


def test_a_run_stopped_after_its_first_chain_can_be_looked_at(copy: Path) -> None:
    """As a kill leaves it: one chain there, the manifest still from the start of sampling."""
    shutil.rmtree(copy / "chains" / "chain_2")
    for name in ("posterior.nc", "checks.json", "summary.csv"):
        (copy / name).unlink()
    manifest = RunDirectory(copy).read_manifest()
    del manifest["chains"]
    RunDirectory(copy).write_manifest({**manifest, "status": "sampling"})
    loaded = Fit.load(copy)
    chains = loaded.checks()[0]
    assert not chains.passed
    assert "Chain 2 has not run to its end" in chains.sentence
    assert "same command again" in chains.sentence
    assert list(loaded.manifest["chains"]) == ["1"]


def test_a_folder_that_is_no_run_or_has_no_chain_is_refused(copy: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not a run directory"):
        Fit.load(tmp_path / "nowhere")
    shutil.rmtree(copy / "chains")
    with pytest.raises(InputError, match=r"no chain is finished .* command in its manifest again"):
        Fit.load(copy)
    with RunDirectory(tmp_path / "claimed").claimed("0"), pytest.raises(InputError) as caught:
        Fit.load(tmp_path / "claimed")
    assert "(status 'claimed'); run the same command again" in str(caught.value)


@pytest.mark.usefixtures("little_search")
def test_without_likelihood_the_draws_are_the_prior(small_problem: Problem, tmp_path: Path) -> None:
    longer = replace(SMALL_RUN, draws=500)
    prior = fitted(small_problem, tmp_path / "run", longer, use_likelihood=False)
    table = prior.summary("SI")
    for name in FREE:
        mean, sd = table["prior_mean"][name], table["prior_sd"][name]
        assert table["mean"][name] == pytest.approx(mean, abs=0.3 * sd)
        assert table["sd"][name] == pytest.approx(sd, rel=0.2)
    # The solver has no part in the prior, so its tolerance cannot matter.
    assert {check.name: check.passed for check in prior.checks()}["solver"]


@pytest.fixture(autouse=True)
def _close_figures() -> Iterator[None]:
    plt.switch_backend("agg")
    yield
    plt.close("all")


def test_a_summary_is_in_display_units_unless_si_is_asked_for(small_fit: Fit) -> None:
    shown, si = small_fit.summary(), small_fit.summary("SI")
    assert list(shown) == list(si)
    assert shown["unit"]["maxwell_modulus"] == "GPa"
    assert si["unit"]["maxwell_modulus"] == "Pa"
    for column in ("mean", "sd", "q5", "q95", "prior_mean", "prior_sd"):
        ratio = (si[column] / shown[column])["maxwell_modulus"]
        assert ratio == pytest.approx(1e9)
    np.testing.assert_array_equal(shown["rhat"], si["rhat"])


@pytest.mark.parametrize("units", ["si", "x", "", 5])
def test_other_units_of_a_summary_are_refused(units: Any, small_fit: Fit) -> None:
    with pytest.raises(InputError, match=f"units is {units!r}, expected 'display' or 'SI'"):
        small_fit.summary(units)


def test_a_checked_fit_travels_between_processes(small_fit: Fit) -> None:
    found = small_fit.verdicts()
    again = pickle.loads(pickle.dumps(small_fit))
    assert again.verdicts() == found
    assert again.summary().equals(small_fit.summary())


def test_a_fit_is_shown_in_a_line(small_fit: Fit, joint: Fit) -> None:
    where = small_fit.directory.path
    assert repr(small_fit) == f"<Fit of PIL40: 2 chains x 100 draws, {where}>"
    assert repr(joint).startswith("<Fit of PIL40+other: 2 chains x ")
    assert repr(joint["other"]).startswith("<Fit of other in PIL40+other: 2 chains x ")


def test_to_show_a_fit_checks_nothing(small_fit: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise AssertionError("checked")

    monkeypatch.setattr("pyburgers.fitting.sampled_fit.run_checks", fail)
    assert "PIL40" in repr(replace(small_fit))


def test_a_notebook_shows_verdicts_and_table(small_fit: Fit) -> None:
    text = small_fit._repr_html_()
    assert "<b>PIL40</b>" in text
    assert "Was the posterior sampled well?" in text
    assert "maxwell_modulus" in text
    assert "<table" in text


def test_figures_go_into_given_axes(small_fit: Fit) -> None:
    _, axes = plt.subplots()
    assert small_fit.plot.stress_strain(ax=axes) is axes
    assert "stress" in axes.get_ylabel()
    assert small_fit.plot.residuals() is not axes
    drawn = small_fit.plot.posterior("maxwell_modulus")
    assert "GPa" in drawn.get_xlabel()
    low, high = drawn.get_xlim()
    assert low < float(small_fit.summary()["mean"]["maxwell_modulus"]) < high
    with pytest.raises(InputError, match="did you mean 'maxwell_modulus'"):
        small_fit.plot.posterior("maxwel_modulus")
    with pytest.raises(InputError, match="5 was not sampled, expected one of maxwell_modulus"):
        small_fit.plot.posterior(5)  # type: ignore[arg-type]
