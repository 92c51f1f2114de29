"""A discrepancy of the law: what a fit makes of it, says of it, and carries over to other tests."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ICE, SMALL_RUN, Problem, search_little, with_fixed
from history_twins import history_twin
from page import html_of
from test_prediction import creep
from truths import truth_of

from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.cmdstan.program import load_program
from pyburgers.common.array_types import FloatArray
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit, fit
from pyburgers.fitting.prediction import Prediction
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.experiment import of_kind
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.loading_history.stages import Stage
from pyburgers.kinds.problem import one_test, problem_of
from pyburgers.kinds.program_data import given_parameters, program_data
from pyburgers.kinds.stan_data import REFERENCE_SOLVER
from pyburgers.kinds.together import default_priors_for, pooling_for
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import check_variant, variant_of, with_variant

ERROR = 3e4
"""Standard deviation of a reading (Pa)."""

MISSED = 6.0
"""Amplitude of the smooth term that no parameter follows, over `ERROR`."""

RUN = replace(SMALL_RUN, draws=1000)


def twin(problem: Problem, missed: float) -> ConstantRateExperiment:
    """Return the small test with stated errors, noise of that size, and a hump along strain."""
    first = of_kind(problem.experiment, ConstantRateExperiment)
    strain = np.linspace(2e-4, 0.02, 60)
    clean = simulate(first, truth_of(first), at=strain)["stress_Pa"].to_numpy()
    hump = missed * ERROR * np.exp(-(((strain - 0.008) / 0.004) ** 2))
    noise = ERROR * np.random.default_rng(20261128).standard_normal(strain.size)
    return replace(first, strain=strain, stress=clean + hump + noise, stress_uncertainty=ERROR)


@pytest.fixture(scope="module")
def fits(
    small_problem: Problem, tmp_path_factory: pytest.TempPathFactory
) -> Mapping[tuple[str, str], Fit]:
    """Fits of a test with and without a wave, by that and by their residuals."""
    folder = tmp_path_factory.mktemp("discrepancy")
    tests = {"missed": twin(small_problem, MISSED), "right": twin(small_problem, 0.0)}
    options = {"independent": SMALL_RUN, "discrepancy": RUN}
    with pytest.MonkeyPatch.context() as patch:
        search_little(patch)
        return {
            (name, residuals): fit(
                test,
                with_variant(small_problem.priors, test, {"residuals": residuals}),
                out=folder / name / residuals,
                options=of_residuals,
            )
            for name, test in tests.items()
            for residuals, of_residuals in options.items()
        }


def standard_scores(result: Fit) -> dict[str, float]:
    """Distances of the true moduli and enthalpies from their means, in standard deviations."""
    truth = truth_of(result.experiment)
    drawn = result.posterior["posterior"].to_dataset()
    return {
        name: abs(float((drawn[name].mean() - truth[name]) / drawn[name].std()))
        for name in ("maxwell_modulus", "activation_enthalpy")
    }


def test_intervals_hold_the_truth_though_the_law_misses_a_hump(
    fits: Mapping[tuple[str, str], Fit],
) -> None:
    """Those of independent residuals do not, because their number makes them narrow."""
    independent, discrepancy = (
        standard_scores(fits["missed", residuals]) for residuals in ("independent", "discrepancy")
    )
    print(independent, discrepancy)
    assert max(independent.values()) > 2.5
    assert max(discrepancy.values()) < 1.6


def test_the_reading_error_is_the_stated_one_and_the_rest_is_discrepancy(
    fits: Mapping[tuple[str, str], Fit],
) -> None:
    drawn = fits["missed", "discrepancy"].posterior["posterior"].to_dataset()
    assert float(drawn["stress_noise"].mean()) == pytest.approx(ERROR, rel=0.2)
    assert float(fits["missed", "independent"].summary("SI")["mean"]["stress_noise"]) > 2 * ERROR
    assert float(drawn["discrepancy"].quantile(0.05)) > 1.5


def description(result: Fit) -> tuple[Outcome, str]:
    verdict = result.verdicts()[CheckKind.DESCRIPTION]
    return verdict.outcome, verdict.sentence


def test_a_fit_with_a_discrepancy_says_its_size_and_describes_nothing_by_it(
    fits: Mapping[tuple[str, str], Fit],
) -> None:
    outcome, sentence = description(fits["missed", "discrepancy"])
    assert outcome is Outcome.NO
    assert "the law misses the test by a discrepancy of 0.1" in sentence
    assert "reading errors (" in sentence
    assert "calls it noise" not in sentence


def test_a_law_that_describes_the_data_has_a_small_discrepancy(
    fits: Mapping[tuple[str, str], Fit],
) -> None:
    """Readings that share a small error tell less: that widens what many of them tell together."""
    outcome, sentence = description(fits["right", "discrepancy"])
    # The interval of the discrepancy may end at the error of a reading, where draws do not tell.
    assert outcome is Outcome.YES or "the draws do not tell whether it misses" in sentence
    assert outcome is not Outcome.NO
    assert "by a discrepancy of 0.0" in sentence
    one, other = (
        fits["right", residuals].summary("SI") for residuals in ("independent", "discrepancy")
    )
    assert other["mean"]["discrepancy"] < 1.0
    assert max(standard_scores(fits["right", "discrepancy"]).values()) < 2.0
    assert other["sd"]["maxwell_modulus"] < 3.0 * one["sd"]["maxwell_modulus"]


def log_likelihood(test: ConstantRateExperiment, **changed: float) -> FloatArray:
    """Log density of every reading given those before it, at the truth with some changes."""
    values = {**truth_of(test), "residual_correlation_strain": 0.004, **changed}
    problem = one_test(test, given_parameters(test.material, values))
    data = program_data(problem, solver=REFERENCE_SOLVER, grids=[np.array([0.01])])
    return load_program(likelihood_of(test).program).evaluate(data)["log_lik"]


@pytest.mark.parametrize("discrepancy", [1e-6, 0.5, 3.0])
def test_a_discrepancy_is_the_share_of_residuals_that_correlates(
    small_problem: Problem, discrepancy: float
) -> None:
    """A discrepancy of next to nothing leaves independent readings."""
    test = twin(small_problem, MISSED)
    found = log_likelihood(test, stress_noise=ERROR, discrepancy=discrepancy)
    whole = ERROR * np.sqrt(1 + discrepancy**2)
    share = discrepancy**2 / (1 + discrepancy**2)
    same = log_likelihood(test, stress_noise=whole, residual_correlated_share=share)
    np.testing.assert_allclose(found, same, rtol=1e-6)
    if discrepancy < 1e-3:
        none = log_likelihood(test, stress_noise=ERROR, residual_correlation_strain=0.0)
        np.testing.assert_allclose(found, none, rtol=1e-6)


def carried(prediction: Prediction) -> tuple[FloatArray, float]:
    """Draws of the discrepancy (Pa) of a prediction, and root mean square of its solution."""
    drawn = prediction.posterior["posterior"].to_dataset()
    size = all_draws(drawn["discrepancy"] * drawn["stress_noise"])
    solved = all_draws(prediction.posterior["model_response"].to_dataset()["stress"])
    return size, float(np.sqrt(np.mean(solved.mean(axis=0) ** 2)))


def test_other_tests_have_the_same_share_of_discrepancy(
    fits: Mapping[tuple[str, str], Fit],
) -> None:
    result = fits["missed", "discrepancy"]
    fitted = of_kind(result.experiment, ConstantRateExperiment)
    strained = replace(fitted, id="warmer", temperature=fitted.temperature + 8)
    drawn = result.posterior["posterior"].to_dataset()
    itself, other = (result.predict(test) for test in (fitted, strained))
    of_fit = all_draws(drawn["discrepancy"] * drawn["stress_noise"])
    np.testing.assert_allclose(carried(itself)[0], of_fit, rtol=0.01)
    (size, whole), (size_here, whole_here) = carried(other), carried(itself)
    assert whole < 0.9 * whole_here
    np.testing.assert_allclose(size / whole, size_here / whole_here, rtol=0.01)
    # New readings scatter by parameters, discrepancy and reading error together.
    group = other.posterior["predictions"].to_dataset()
    new, solved = (all_draws(group[name]) for name in ("stress_replicated", "stress"))
    error = all_draws(other.posterior["posterior"].to_dataset()["stress_noise"])
    scores = (new - solved) / np.hypot(size, error)[:, np.newaxis]
    assert np.mean(scores**2) == pytest.approx(1.0, abs=0.2)
    note = other.notes[-1]
    assert "carried over as a share of the stress" in note
    parts = np.array([np.mean(size**2), solved.var(axis=0).mean(), np.mean(error**2)])
    share = 100 * parts[0] / parts.sum()
    assert f"It makes {share:.0f} % of the variance" in note


def test_a_discrepancy_goes_with_stresses_of_any_history(
    fits: Mapping[tuple[str, str], Fit], small_problem: Problem
) -> None:
    result = fits["missed", "discrepancy"]
    held = (
        Stage("strain_rate", 0.0, 100.0, 255.0, 1e-4),
        Stage("hold_strain", 100.0, 300.0, 255.0),
    )
    prediction = result.predict(creep(small_problem.experiment, stages=held), draws=40)
    drawn = prediction.posterior["posterior"].to_dataset()
    of_fit = result.posterior["posterior"].to_dataset()
    strain = all_draws(of_fit["residual_correlation_strain"])
    time = all_draws(drawn["residual_correlation_time"])
    assert np.isin(np.round(time / 300.0, 6), np.round(strain / result.experiment.span[1], 6)).all()
    assert "carried over as a share of the stress" in prediction.notes[-1]
    # Nobody knows how a misfit of stresses goes over to strains.
    unknown = result.predict(creep(small_problem.experiment), draws=40)
    assert not unknown.posterior["posterior"]["discrepancy"].any()
    assert any("in readings of stress alone" in note for note in unknown.notes)


@pytest.mark.parametrize("stated", [None, 1e-4])
def test_strain_that_a_fit_does_not_read_leaves_stress_its_discrepancy(
    stated: float | None, fits: Mapping[tuple[str, str], Fit], small_problem: Problem
) -> None:
    """One discrepancy is a multiple of every noise: a stated one of strain would have it too."""
    result = fits["missed", "discrepancy"]
    pressed = Stage("strain_rate", 0.0, 100.0, 255.0, 1e-4)
    crept = Stage("stress", 100.0, 300.0, 255.0, 2e6)
    strained, both = (
        result.predict(creep(small_problem.experiment, stages=stages, **error), draws=40)
        for stages, error in (
            ((pressed,), {}),
            ((pressed, crept), {"strain_uncertainty": stated}),
        )
    )
    sizes = [
        all_draws(one.posterior["posterior"].to_dataset()["discrepancy"])
        for one in (strained, both)
    ]
    if stated is None:
        np.testing.assert_allclose(sizes[1], sizes[0], rtol=0.3)
    else:
        assert not sizes[1].any()
    about = "" if stated else " of strain"
    none = f"in readings of stress alone: new readings{about} have none here"
    assert [none in note for note in both.notes].count(True) == 1
    carried_over = ["carried over as a share" in note for note in both.notes]
    assert carried_over.count(True) == (stated is None)


def test_a_page_says_how_large_the_discrepancy_is(
    fits: Mapping[tuple[str, str], Fit], tmp_path: Path, sketched: None
) -> None:
    text = html_of([fits["missed", "discrepancy"]], tmp_path)
    assert "the law misses the test by a discrepancy of" in text
    assert "discrepancy of the law over the reading error" in text


def test_stated_errors_are_the_priors_of_noise_beside_a_discrepancy_alone(
    small_problem: Problem,
) -> None:
    test = twin(small_problem, 0.0)
    given = {
        residuals: with_variant(small_problem.priors, test, {"residuals": residuals})
        for residuals in ("autocorrelated", "discrepancy")
    }
    of_test = {name: problem_of([test], own).priors[0] for name, own in given.items()}
    assert of_test["discrepancy"]["stress_noise"].location == ERROR
    assert of_test["autocorrelated"]["stress_noise"].location != ERROR
    unstated = replace(test, stress_uncertainty=None)
    own = problem_of([unstated], given["discrepancy"]).priors[0]["stress_noise"]
    assert own == of_test["autocorrelated"]["stress_noise"]


def test_residuals_can_be_chosen_again(small_problem: Problem) -> None:
    test, priors = small_problem.experiment, small_problem.priors
    for first in ("independent", "autocorrelated", "discrepancy"):
        chosen = with_variant(priors, test, {"residuals": first})
        for second in ("independent", "autocorrelated", "discrepancy"):
            again = with_variant(chosen, test, {"residuals": second})
            assert variant_of(again, test).residuals == second
            if second == "independent":
                continue
            directly = with_variant(priors, test, {"residuals": second})
            assert again.free == directly.free
            assert {name: again[name] for name in again.free} == {
                name: directly[name] for name in directly.free
            }


def test_a_discrepancy_needs_a_length(small_problem: Problem) -> None:
    test = small_problem.experiment
    chosen = with_variant(small_problem.priors, test, {"residuals": "discrepancy"})
    fixed = with_fixed(chosen, {"residual_correlation_strain": 0.0})
    with pytest.raises(
        InputError, match="residual_correlation_strain fixed at 0, expected a prior"
    ):
        check_variant(fixed, test)


def test_strain_that_is_read_has_a_discrepancy_too() -> None:
    test = replace(history_twin("creep", 12), strain_uncertainty=1e-5)
    priors = with_variant(default_priors("ice"), test, {"residuals": "discrepancy"})
    resolved = problem_of([test], priors).priors[0]
    assert variant_of(resolved, test).residuals == "discrepancy"
    assert {"residual_correlation_time", "discrepancy", "strain_noise"} <= {*resolved.free}
    assert "residual_correlated_share" not in resolved.free
    assert resolved["strain_noise"].location == 1e-5


def test_a_table_beside_a_history_has_no_discrepancy() -> None:
    tests = [history_twin("creep", 12), load_attenuation(ICE / "attenuation_twin.toml")]
    priors = with_variant(default_priors_for(tests), tests[0], {"residuals": "discrepancy"})
    problem = problem_of(tests, priors, pooling_for(tests, None))
    assert "discrepancy" in problem.free
    laws = [variant_of(*pair).residuals for pair in zip(problem.priors, tests, strict=True)]
    assert laws == ["discrepancy", "independent"]


@pytest.mark.slow
def test_intervals_hold_the_truth_as_often_as_they_say(
    small_problem: Problem, tmp_path: Path
) -> None:
    """Of sixteen tests with smooth misfits of three reading errors, none of which is described."""
    first = twin(small_problem, 0.0)
    truth, strain = truth_of(first), first.strain
    clean = simulate(first, truth, at=strain)["stress_Pa"].to_numpy()
    distance = np.subtract.outer(strain, strain) / 0.003
    smooth = np.linalg.cholesky(np.exp(-0.5 * distance**2) + 1e-8 * np.eye(strain.size))
    inside = {"independent": 0, "discrepancy": 0}
    for seed in range(16):
        rng = np.random.default_rng(seed)
        missed = 3 * smooth @ rng.standard_normal(strain.size)
        test = replace(first, stress=clean + ERROR * (missed + rng.standard_normal(strain.size)))
        for residuals in inside:
            priors = with_variant(small_problem.priors, test, {"residuals": residuals})
            result = fit(test, priors, out=tmp_path / f"{residuals}_{seed}", options=RUN)
            drawn = result.posterior["posterior"].to_dataset()
            for name in ("maxwell_modulus", "activation_enthalpy"):
                low, high = np.quantile(drawn[name], [0.05, 0.95])
                inside[residuals] += int(low <= truth[name] <= high)
        assert result.describes_data is not Outcome.YES
    print(inside)
    assert inside["independent"] < 16
    assert inside["discrepancy"] >= 25  # of 32; fewer by chance: 1 %
