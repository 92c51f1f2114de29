"""Leaving out whole tests, and temperatures of a table: against single fits and quadrature."""

import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import attenuation_oracle
import numpy as np
import pandas as pd
import pytest
from conftest import ICE, SMALL_RUN, Problem, copy_of, pair_of, with_fixed
from kind_examples import AttenuationExample
from scipy.integrate import trapezoid
from scipy.special import logsumexp
from truths import truth_of

from pyburgers.cli.compare import save_comparison_by_test
from pyburgers.cli.main import main
from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.comparison.by_points import compare
from pyburgers.comparison.by_tests import compare_by_test, compare_kept_by_test
from pyburgers.comparison.conclusions import (
    pointwise_table,
    sentences_by_test,
    table_of_fits,
    table_of_tests,
)
from pyburgers.comparison.figures import left_out_tests, pointwise_differences
from pyburgers.comparison.marginal_likelihood import log_marginal_likelihood
from pyburgers.comparison.results import ComparisonByTest, LeaveOneOut, LeaveOneTestOut, LogIntegral
from pyburgers.drawing.style import image
from pyburgers.fitting.fit import Fit, fit
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.problem import problem_of
from pyburgers.model.pooling import pooling_of
from pyburgers.model.priors import default_priors
from pyburgers.page.comparison_sections import comparison_sections
from pyburgers.sampling.options import SamplerOptions

pytestmark = pytest.mark.usefixtures("in_this_process")


@pytest.fixture(scope="module")
def compared(joint: Fit, separate_joint: Fit) -> ComparisonByTest:
    """Comparison of fits that share the material, or nothing, of which nothing is fitted again."""
    return compare_by_test({"apart": separate_joint, "together": joint}, command="test")


def test_tests_that_share_nothing_are_predicted_from_their_priors(
    compared: ComparisonByTest, small_fit: Fit, other_fit: Fit
) -> None:
    """Each has the marginal likelihood of a fit of it alone."""
    found = compared.results["apart"]
    assert found.tests == ("PIL40", "other")
    for test, alone in zip(found.tests, (small_fit, other_fit), strict=True):
        exact = log_marginal_likelihood(alone)
        place = found.tests.index(test)
        error = float(np.hypot(found.error[place], exact.error))
        assert error < 0.2
        assert found.elpd[place] == pytest.approx(exact.value, abs=4 * error)


def test_a_test_like_the_others_is_predicted_better_where_the_material_is_shared(
    compared: ComparisonByTest,
) -> None:
    assert list(compared.results) == ["together", "apart"]
    table = table_of_fits(compared)
    assert table["difference"]["apart"] < -2
    assert table["difference_monte_carlo_error"]["together"] == 0
    assert compared.weights.sum() == pytest.approx(1.0)


def test_fits_without_a_test_are_kept_and_say_how_they_came_about(
    joint: Fit, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    shared = copy_of(joint, tmp_path / "shared")
    shutil.rmtree(shared.directory.path / "leave_out" / "other")
    (first,) = compare_by_test({"fit": shared}, command="pyburgers compare X").results.values()
    run = Fit.load(shared.directory.path / "leave_out" / "other")
    assert [experiment.id for experiment in run.problem.experiments] == ["PIL40"]
    assert run.manifest["command"] == "pyburgers compare X (other left out)"
    assert run.problem.pooling == shared.problem.pooling
    capfd.readouterr()
    (again,) = compare_by_test({"fit": shared}, command="pyburgers compare X").results.values()
    said = capfd.readouterr().err.splitlines()
    for test in again.tests:
        assert said.count(f"{test}: 2 of 2 chains are there already.") == 1
    np.testing.assert_array_equal(again.elpd, first.elpd)


def test_priors_stay_those_of_all_tests() -> None:
    """A noise that all share has a prior that goes with the largest stress of all."""
    strong, weak = (load_constant_rate(ICE / f"{name}.toml") for name in ("PIL40", "PIL105"))
    assert strong.stress.max() > 1.2 * weak.stress.max()
    priors = default_priors("ice")
    for kind in ("shared", "separate"):
        problem = problem_of([strong, weak], priors, pooling_of({"stress_noise": kind}))
        left = problem.without(strong.id)
        assert left.experiments == (weak,)
        assert left.priors[0].priors == problem.priors[1].priors
        # What a run keeps gives the same priors again.
        again = problem_of([weak], left.given_priors, problem.pooling)
        assert again.priors[0].priors == problem.priors[1].priors


def test_partially_pooled_noise_has_one_prior_on_the_real_line_in_all_tests() -> None:
    """So the centre's prior does not depend on which test comes first."""
    tests = [load_constant_rate(ICE / f"{name}.toml") for name in ("PIL40", "PIL105")]
    problem = problem_of(tests, default_priors("ice"), pooling_of({"stress_noise": "partial"}))
    place = problem.free.index("stress_noise")
    ratio = [
        own.scale[place] / priors["stress_noise"].scale
        for own, priors in zip(problem.coordinates, problem.priors, strict=True)
    ]
    assert ratio[0] == pytest.approx(ratio[1], rel=1e-12)


def result(
    elpd: FloatArray, *, error: float = 0.1, doubts: tuple[str, ...] = ()
) -> LeaveOneTestOut:
    """Made-up numbers of tests A, B, ..., with the same error in all marginal likelihoods."""
    return LeaveOneTestOut(
        tuple("ABCDEF"[: elpd.size]),
        np.full(elpd.size, 50),
        LogIntegral(-1000.0, error),
        tuple(LogIntegral(-1000.0 - value, error) for value in elpd),
        doubts,
    )


def comparison_of(**results: LeaveOneTestOut) -> ComparisonByTest:
    ordered = dict(sorted(results.items(), key=lambda item: -item[1].total))
    weights = np.full(len(ordered), 1 / len(ordered))
    return ComparisonByTest(ordered, weights, dict.fromkeys(ordered, "standard"))


def test_a_sentence_for_each_pair_and_for_what_is_doubtful() -> None:
    base = np.array([-700.0, -710.0, -690.0])
    spread = np.array([-40.0, 40.0, -20.0])
    comparison = comparison_of(
        good=result(base),
        alike=result(base - 0.5),
        unclear=result(base + spread),
        bad=result(base - 30.0, error=2.0),
    )
    found = sentences_by_test(comparison)
    assert "good and alike predict left-out tests alike" in found[0]
    assert "Cannot tell which of good and unclear predicts left-out tests better" in found[1]
    assert "good predicts left-out tests clearly better than bad" in found[2]
    flags = found[6:]
    assert len(flags) == 3
    assert "bad: the log density of A has a Monte Carlo error of 2.8, more than 1" in flags[0]
    assert not comparison.reliable
    doubtful = comparison_of(only=result(base, doubts=("The fit failed.",)))
    assert not doubtful.reliable
    assert sentences_by_test(doubtful)[1] == "only: The fit failed."
    assert comparison_of(only=result(base)).reliable
    # Differences 20, 10 and 5 have an error of 13, which three tests do not know well.
    few = sentences_by_test(comparison_of(one=result(base), other=result(base - [20, 10, 5])))
    assert few[0].startswith("Cannot tell which of one and other predicts left-out tests better")
    assert "this uncertain counts 4.5 times" in few[0]
    # Two tests and fits that failed a check do not tell which is better.
    two = comparison_of(good=result(base[:2]), bad=result(base[:2] - 30.0))
    first, second = sentences_by_test(two)[:2]
    assert first.startswith("Cannot tell which of good and bad predicts left-out tests better")
    assert first.endswith("because a standard error over 2 tests says nothing.")
    assert "Of two tests the standard error says nothing" in second
    failed = comparison_of(good=result(base), bad=result(base - 30.0, doubts=("The fit failed.",)))
    assert sentences_by_test(failed)[0].endswith("because the elpd of bad may be far off.")
    # The error of the joint fit counts for every test.
    one = result(base, error=0.1)
    np.testing.assert_allclose(one.elpd, base)
    np.testing.assert_allclose(one.error, 0.1 * np.sqrt(2))
    assert one.total_error == pytest.approx(0.1 * np.sqrt(9 + 3))


def test_figures_are_drawn_of_one_fit_and_of_several() -> None:
    base = np.array([-700.0, -710.0, -690.0])
    several = comparison_of(a=result(base), b=result(base - 5), c=result(base - 9))
    figure = left_out_tests(several)
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["b less a", "c less a"]
    alone = left_out_tests(comparison_of(a=result(base)))
    assert "per reading" in alone.axes[0].get_xlabel()
    for drawn in (figure, alone):
        assert image(drawn, "png").startswith(b"\x89PNG")


def test_what_is_saved_holds_every_marginal_likelihood(
    compared: ComparisonByTest, joint: Fit, separate_joint: Fit, tmp_path: Path
) -> None:
    fits = {"apart": separate_joint, "together": joint}
    save_comparison_by_test(compared, fits, tmp_path, command="pyburgers compare one")
    tests = pd.read_csv(tmp_path / "left_out_tests.csv", index_col="test")
    assert tests.equals(table_of_tests(compared).astype(tests.dtypes))
    record = json.loads((tmp_path / "comparison.json").read_text(encoding="utf-8"))
    assert record["command"] == "pyburgers compare one"
    for name, own in fits.items():
        likelihoods = record["marginal_likelihoods"][name]
        without = likelihoods["without"]["other"]["log"]
        assert likelihoods["all"]["log"] - without == pytest.approx(tests[f"{name} elpd"]["other"])
        assert record["fits"][name]["pooling"] == own.problem.pooling.record()


def test_points_of_joint_fits_are_those_of_all_their_tests(joint: Fit, separate_joint: Fit) -> None:
    comparison = compare({"together": joint, "apart": separate_joint})
    sizes = [experiment.n_points for experiment in joint.problem.experiments]
    points = pointwise_table(comparison)
    assert points["test"].value_counts().tolist() == sizes
    assert points["together elpd"].sum() == pytest.approx(comparison.results["together"].total)
    figure = pointwise_differences(comparison)
    assert [axes.get_title(loc="left") for axes in figure.axes[:2]] == ["PIL40", "other"]
    assert image(figure, "png").startswith(b"\x89PNG")


def test_points_of_a_part_of_a_joint_fit_stay_flagged(
    joint: Fit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(LeaveOneOut, "unreliable", property(lambda one: ~one.exact))
    part = joint["other"]
    comparison = compare({"one": part, "same": part}, refits=tmp_path / "refits")
    assert not comparison.results["one"].exact.any()
    assert not (tmp_path / "refits").exists()


def test_a_part_of_a_joint_fit_has_no_marginal_likelihood(joint: Fit, creep: RateFit) -> None:
    for refused in (log_marginal_likelihood, lambda one: compare_by_test({"one": one})):
        with pytest.raises(InputError, match=r"says of other, expected the whole joint fit\.$"):
            refused(joint["other"])
    with pytest.raises(InputError, match=r"^fit: found RateFit, expected a fit, as of"):
        log_marginal_likelihood(creep)  # type: ignore[arg-type]  # as untyped scripts may


@pytest.mark.slow
def test_the_order_of_the_tests_does_not_matter(small_problem: Problem, tmp_path: Path) -> None:
    first, other = pair_of(small_problem)
    smooth = (first.stress + other.stress) / 2
    # Without outliers, whose densities given all other points take many draws.
    residual = first.stress - smooth
    residual = np.clip(residual, -0.5 * residual.std(), 0.5 * residual.std())
    tests = [
        replace(first, stress=smooth + residual),
        replace(other, stress=smooth - residual),
    ]
    longer = replace(SMALL_RUN, draws=2 * SMALL_RUN.draws)
    fits = {
        name: fit(order, small_problem.priors, out=tmp_path / name, options=longer)
        for name, order in (("one", tests), ("turned", tests[::-1]))
    }
    comparison = compare(fits)
    one, turned = (comparison.results[name] for name in fits)
    # The last readings are leverage points: weights without a variance, at any number of draws.
    settled = (one.pareto_k < 0.5) & (turned.pareto_k < 0.5)
    assert settled.sum() >= 20
    np.testing.assert_allclose(one.elpd[settled], turned.elpd[settled], atol=0.2)


def test_a_page_sets_joint_fits_of_the_same_tests_side_by_side(
    compared: ComparisonByTest, joint: Fit, separate_joint: Fit, tmp_path: Path
) -> None:
    """By points; by tests as soon as they were left out, without fitting anything."""
    joints = [
        copy_of(joint, tmp_path / "together", without="leave_out"),
        copy_of(separate_joint, tmp_path / "apart", without="leave_out"),
    ]
    (by_points,) = comparison_sections(joints)
    assert by_points.key == "comparison_together"
    run = joints[0].directory.path
    shutil.copytree(joint.directory.path / "leave_out", run / "leave_out")
    *_, by_tests = comparison_sections(joints)
    assert by_tests.key == "left_out_together"
    exact = compared.results["together"].elpd.tolist()
    assert by_tests.tables[1].saved["together elpd"].tolist() == exact
    run = joints[1].directory.path
    assert not (run / "leave_out").exists()
    shutil.copytree(separate_joint.directory.path / "leave_out", run / "leave_out")
    both = comparison_sections(joints)[1]
    assert set(both.tables[0].saved["fit"]) == {"together", "apart"}


def test_joint_fits_of_the_same_tests_have_sections_of_their_own(
    joint: Fit, separate_joint: Fit, sketched: None, tmp_path: Path
) -> None:
    runs = [str(one.directory.path) for one in (joint, separate_joint)]
    assert main(["report", *runs, "--out", str(tmp_path / "page")]) == 0
    tables = tmp_path / "page" / "tables"
    first, other = (
        pd.read_csv(tables / f"joint_{name}_run_pooling.csv")
        for name in ("joint", "separate_joint")
    )
    assert "shared" in set(first["pooling"])
    assert set(other["pooling"]) == {"separate", "derived"}


def test_a_sampled_prior_and_a_test_alone_are_refused(joint: Fit) -> None:
    prior = replace(joint, manifest={**joint.manifest, "use_likelihood": False})
    with pytest.raises(InputError, match=r"^prior: was sampled without likelihood"):
        compare_by_test({"prior": prior}, command="test")
    alone = Fit.load(joint.directory.path / "leave_out" / "other")
    with pytest.raises(InputError, match=r"is a fit of PIL40 alone, expected at least two tests"):
        compare_by_test({"fit": alone}, command="test")


TWIN = load_attenuation(ICE / "attenuation_twin.toml")


def log_evidence(table: AttenuationExperiment, truth: Mapping[str, float]) -> float:
    """Log marginal likelihood where the activation enthalpy alone is unknown."""
    prior = default_priors("ice", "attenuation")["activation_enthalpy"].distribution()
    enthalpies = truth["activation_enthalpy"] * np.linspace(0.995, 1.005, 61)
    rows = np.arange(table.conditions.n_rows)
    logarithms = []
    for enthalpy in enthalpies:
        values = {**truth, "activation_enthalpy": float(enthalpy)}
        tan_delta, of_modulus = attenuation_oracle.log_readings(
            table, values, table.conditions.period, rows
        )
        centre = np.log(np.hypot(np.exp(tan_delta), table.readings.tan_delta_error))
        response = np.append(
            np.maximum(centre, np.log(np.maximum(table.readings.limit, 1e-300))), of_modulus
        )
        likelihood = AttenuationExample().log_likelihood(table, values, response)
        logarithms.append(float(np.sum(likelihood) + prior.logpdf(enthalpy)))
    largest = float(logsumexp(logarithms))
    return largest + float(np.log(trapezoid(np.exp(np.array(logarithms) - largest), enthalpies)))


@pytest.mark.slow
@pytest.mark.usefixtures("programs", "in_this_process")
def test_temperatures_are_left_out_one_by_one(tmp_path: Path) -> None:
    truth = truth_of(TWIN)
    priors = default_priors("ice", "attenuation")
    known = {name: truth[name] for name in priors.free if name != "activation_enthalpy"}
    result = fit(
        TWIN,
        with_fixed(priors, known),
        out=tmp_path / "run",
        options=SamplerOptions(chains=2, warmup=100, draws=300, seed=3),
    )
    comparison = compare_by_test({"one": result})
    found = comparison.results["one"]
    assert found.tests == ("253.15K", "263.15K")
    assert found.n_points.tolist() == [36, 36]
    whole = log_evidence(TWIN, truth)
    expected = [whole - log_evidence(TWIN.without_part(name), truth) for name in found.tests]
    np.testing.assert_allclose(found.elpd, expected, atol=0.1)
    assert "the temperatures have" in sentences_by_test(comparison)[0]
    kept = compare_kept_by_test({"one": result})
    assert kept is not None
    np.testing.assert_array_equal(kept.results["one"].elpd, found.elpd)


def test_temperatures_of_one_name_are_one_part_with_all_their_readings() -> None:
    conditions = TWIN.conditions
    nudge = np.where(np.arange(conditions.temperature.size) % 2 == 0, 1e-4, 0.0)
    close = replace(
        TWIN, conditions=replace(conditions, temperature=conditions.temperature + nudge)
    )
    assert dict(close.parts) == dict(TWIN.parts)
    assert list(close.parts) == list(TWIN.parts)
    assert close.without_part("253.15K").n_points == TWIN.without_part("253.15K").n_points


def test_only_a_temperature_of_the_table_can_be_left_out() -> None:
    assert TWIN.without_part("253.15K").conditions.n_spectra == 2
    with pytest.raises(InputError, match="has no part '250K'"):
        TWIN.without_part("250K")
    with pytest.raises(InputError, match="no other temperature"):
        TWIN.without_part("253.15K").without_part("263.15K")
