"""Comparison: leave-one-out in closed form, weights, sentences, refusals, points left out."""

import json
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import LONG_RUN, Problem, with_fixed
from scipy import stats
from synthetic_fit import make_fit, with_problem
from synthetic_olivine_fit import make_olivine_fit
from truths import truth_of

from pyburgers.cli.compare import save_comparison
from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.common.errors import InputError
from pyburgers.comparison.by_points import compare, leave_one_out, leave_out_exactly
from pyburgers.comparison.conclusions import comparison_table, sentences
from pyburgers.comparison.figures import pointwise_differences
from pyburgers.comparison.results import Comparison, LeaveOneOut, Pair, PairOutcome, standard_error
from pyburgers.comparison.same_data import data_hash, stacking_weights
from pyburgers.drawing.style import image
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.constant_rate.likelihood import LIKELIHOOD as CONSTANT_RATE


def normal_model(observed: FloatArray, *, prior_sd: float) -> tuple[xr.DataTree, FloatArray]:
    """Exact draws of the mean of N(mean, 1) data with prior N(0, prior_sd), and the exact elpd."""
    rng = np.random.default_rng(4)

    def posterior(values: FloatArray) -> tuple[float, float]:
        precision = 1 / prior_sd**2 + values.size
        return float(values.sum() / precision), float(precision**-0.5)

    mean, sd = posterior(observed)
    means = rng.normal(mean, sd, (4, 1000))
    log_lik = stats.norm.logpdf(observed, means[..., None])
    tree = xr.DataTree.from_dict(
        {
            "log_likelihood": xr.Dataset({"stress": (("chain", "draw", "point"), log_lik)}),
            "observed_data": xr.Dataset({"stress": ("point", observed)}),
            "constant_data": xr.Dataset({"strain": ("point", np.arange(observed.size) * 0.01)}),
        }
    )
    exact = []
    for k in range(observed.size):
        mean, sd = posterior(np.delete(observed, k))
        exact.append(stats.norm.logpdf(observed[k], mean, np.hypot(1.0, sd)))
    return tree, np.array(exact)


def test_leave_one_out_of_a_normal_model_is_the_closed_form() -> None:
    observed = np.random.default_rng(1).normal(0.5, 1.0, 40)
    tree, exact = normal_model(observed, prior_sd=3.0)
    found = leave_one_out(tree)
    np.testing.assert_allclose(found.elpd, exact, atol=0.01)
    assert not found.unreliable.any()
    assert found.n_effective == pytest.approx(1.0, abs=0.4)
    # A unit of stress shifts all alike.
    in_pascal = tree.copy()
    in_pascal["log_likelihood"] = xr.DataTree(tree["log_likelihood"].to_dataset() - np.log(1e6))
    shifted = leave_one_out(in_pascal).elpd
    np.testing.assert_allclose(shifted, found.elpd - np.log(1e6), rtol=1e-12)
    # Of three points the one at 9 pulls the mean by a third of its distance.
    tree, _ = normal_model(np.array([0.0, 0.1, 9.0]), prior_sd=100.0)
    assert leave_one_out(tree).unreliable.tolist()[-1]


def result(elpd: FloatArray, pareto_k: float = 0.1) -> LeaveOneOut:
    size = elpd.size
    return LeaveOneOut(elpd, np.full(size, pareto_k), np.zeros(size, dtype=bool), elpd.sum() + 2)


def test_stacking_weights_maximise_the_density_of_the_mixture() -> None:
    rng = np.random.default_rng(6)
    elpd = rng.normal(0.0, 1.0, (3, 50))
    weights = stacking_weights(elpd)
    assert weights.sum() == pytest.approx(1.0)

    def density(shares: FloatArray) -> float:
        return float(np.log(shares @ np.exp(elpd)).sum())

    others = rng.dirichlet(np.ones(3), 500)
    assert all(density(weights) >= density(other) for other in others)
    # All goes to a fit that is better everywhere, by a little or by orders of magnitude.
    for loss in (-1.0, -1e5):
        worse = np.array([[0.0] * 30, [loss] * 30])
        np.testing.assert_allclose(stacking_weights(worse), [1.0, 0.0], atol=1e-6)


def comparison_of(*results: tuple[str, LeaveOneOut], segment: IntArray | None = None) -> Comparison:
    ordered = dict(sorted(results, key=lambda item: -item[1].total))
    size = results[0][1].elpd.size
    return Comparison(
        ordered,
        stacking_weights(np.array([one.elpd for one in ordered.values()])),
        xr.DataArray(
            np.linspace(0.01, 0.2, size),
            coords={"segment": ("point", np.arange(size) if segment is None else segment)},
            dims="point",
            name="strain",
        ),
        CONSTANT_RATE.clock,
        dict.fromkeys(ordered, "standard"),
        correlated=(),
    )


def test_difference_has_the_standard_error_of_a_sum_over_points() -> None:
    rng = np.random.default_rng(8)
    one, other = rng.normal(size=(2, 50))
    error = float(np.sqrt(50) * np.std(one - other, ddof=1))
    assert standard_error(one - other) == pytest.approx(error)
    (pair,) = comparison_of(("one", result(one)), ("other", result(other))).pairs()
    assert pair.difference == pytest.approx(abs(float((one - other).sum())))
    assert pair.error == pytest.approx(error)


def test_a_sentence_for_each_pair() -> None:
    rng = np.random.default_rng(9)
    noise = rng.normal(size=60)
    flat = np.zeros(60)
    comparison = comparison_of(
        ("good", result(flat)),
        ("alike", result(flat - 0.02)),
        ("unclear", result(flat - 0.15 + 2 * (noise - noise.mean()))),
        ("bad", result(flat - 1.0 - 0.1 * noise)),
    )
    found = sentences(comparison)
    assert len(found) == 6
    assert "good and alike predict these data alike" in found[0]
    assert "Cannot tell which of good and unclear predicts these data better" in found[1]
    assert "good predicts these data clearly better than bad" in found[2]
    table = comparison_table(comparison)
    assert table.index.tolist() == ["good", "alike", "unclear", "bad"]
    assert table["difference"].iloc[0] == 0
    assert table["weight"].sum() == pytest.approx(1.0)


def test_a_fit_listed_as_worse_that_weighs_more_has_a_sentence() -> None:
    gains = np.array([0.4] * 30 + [-15.0])
    comparison = comparison_of(("best", result(np.zeros(31))), ("other", result(gains)))
    assert list(comparison.results) == ["best", "other"]
    assert comparison.weights[1] > 0.5
    (about,) = [one for one in sentences(comparison) if "larger weight" in one]
    assert about.startswith(f"other has the larger weight ({comparison.weights[1]:.2f} against")
    assert "although its elpd is lower" in about
    assert "30 of 31 points better than best, by 12.0 together, and loses 15.0 at" in about


def test_points_that_cannot_be_trusted_are_named_until_they_are_left_out() -> None:
    doubtful = result(np.zeros(10))
    doubtful.pareto_k[3] = 0.9
    comparison = comparison_of(("one", doubtful), ("two", result(np.full(10, -1.0))))
    assert not comparison.reliable
    assert "one: its elpd may be far off" in sentences(comparison)[-1]
    assert "1 point (number 4) with a Pareto k above 0.7" in sentences(comparison)[-1]
    settled = replace(doubtful, exact=np.arange(10) == 3)
    comparison = comparison_of(("one", settled), ("two", result(np.full(10, -1.0))))
    assert comparison.reliable
    (only,) = sentences(comparison)
    assert "one predicts these data clearly better than two" in only


def test_points_that_cannot_be_trusted_do_not_decide_which_fit_is_better() -> None:
    """The others have to say the same."""
    doubtful = result(np.zeros(10))
    doubtful.pareto_k[:6] = 0.9
    everywhere, at_these, at_others = np.full(10, -2.0), np.zeros(10), np.zeros(10)
    at_these[:6], at_others[:6], at_others[6:] = -9.0, 9.0, -0.1
    for elpd, outcome in ((everywhere, PairOutcome.BETTER), (at_these, PairOutcome.CANNOT_TELL)):
        (pair,) = comparison_of(("one", doubtful), ("two", result(elpd))).pairs()
        assert pair.outcome is outcome
        hangs = "because it hangs on 6 points with a Pareto k above 0.7" in pair.sentence()
        assert hangs is (outcome is PairOutcome.CANNOT_TELL)
    (pair,) = comparison_of(("two", result(at_others)), ("one", doubtful)).pairs()
    assert pair.outcome is PairOutcome.CANNOT_TELL
    doubtful.pareto_k[:] = 0.9
    (pair,) = comparison_of(("one", doubtful), ("two", result(everywhere))).pairs()
    assert pair.outcome is PairOutcome.CANNOT_TELL
    # Nor do draws that failed a check.
    doubted = replace(result(np.full(10, -9.0)), doubts=("It failed.",))
    (pair,) = comparison_of(("good", result(np.zeros(10))), ("bad", doubted)).pairs()
    assert pair.outcome is PairOutcome.CANNOT_TELL
    assert pair.doubt == "the elpd of bad may be far off"


@pytest.mark.parametrize(("n_points", "told"), [(1, "over 1 point"), (2, "over 2 points")])
def test_one_and_two_readings_have_no_standard_error(n_points: int, told: str) -> None:
    comparison = comparison_of(
        ("one", result(np.zeros(n_points))), ("two", result(np.full(n_points, -9.0)))
    )
    assert told in sentences(comparison)[0]
    assert comparison.pairs()[0].outcome is PairOutcome.CANNOT_TELL
    assert len(comparison_table(comparison)) == 2


def test_fits_that_were_not_sampled_well_are_named(small_fit: Fit, long_fit: Fit) -> None:
    comparison = compare({"short": small_fit, "long": long_fit})
    assert comparison.results["long"].doubts == ()
    (doubt,) = comparison.results["short"].doubts
    assert doubt.startswith(f"The fit of {small_fit.experiment.id} failed its check of ")
    assert "effective sample size: its elpd may be far off." in doubt
    assert f"short: {doubt}" in sentences(comparison)
    assert not comparison.reliable
    settled = {
        name: replace(one, exact=np.ones(one.elpd.size, dtype=bool))
        for name, one in comparison.results.items()
    }
    assert not replace(comparison, results=settled).reliable
    assert replace(comparison, results={"long": settled["long"]}).reliable


def test_priors_that_were_read_off_the_data_are_named_beside_the_evidence(tmp_path: Path) -> None:
    plain = make_fit(tmp_path, draws=100)
    modulus = replace(plain.priors["kelvin_modulus"], read_off=("made up for a test",))
    flagged = with_problem(plain, plain.experiment, plain.priors.exchanging(modulus))
    said = sentences(compare({"plain": plain, "flagged": flagged}))
    (told,) = (one for one in said if "read off these data" in one)
    assert told.startswith("flagged: Priors that were read off these data: E_K. ")
    assert "marginal likelihood is too high" in told


@pytest.mark.parametrize(("correlated", "told"), [((), 0), (("one",), 1), (("one", "two"), 0)])
def test_what_elpd_compares_is_said_where_residuals_of_some_fits_correlate(
    correlated: tuple[str, ...], told: int
) -> None:
    rng = np.random.default_rng(5)
    comparison = comparison_of(*((name, result(rng.normal(size=9))) for name in ("one", "two")))
    said = sentences(replace(comparison, correlated=correlated))
    assert sum("a gap is filled whatever the law" in one for one in said) == told


@pytest.mark.parametrize(
    "names",
    [
        ("one", "two", "three"),
        ("dunite_4581_autocorrelated", "dunite_4581_kelvin_power_law", "dunite_4581_sine"),
    ],
)
def test_the_figure_draws_every_fit_but_the_best_and_its_legend_fits(
    names: tuple[str, ...],
) -> None:
    rng = np.random.default_rng(3)
    comparison = comparison_of(
        *((name, result(rng.normal(-k, 0.1, 30))) for k, name in enumerate(names))
    )
    figure = pointwise_differences(comparison)
    assert image(figure, "png").startswith(b"\x89PNG")
    (legend,) = figure.legends
    labels = [text.get_text() for text in legend.get_texts()]
    assert len(labels) == 2
    assert all(label.endswith(f"less {names[0]}") for label in labels)
    extent = legend.get_window_extent()
    assert figure.bbox.x0 <= extent.x0
    assert extent.x1 <= figure.bbox.x1


def test_what_is_saved_holds_numbers_points_and_origins(tmp_path: Path) -> None:
    fits = {"one": make_fit(tmp_path / "one"), "two": make_fit(tmp_path / "two")}
    comparison = compare(fits)
    save_comparison(comparison, fits, tmp_path, command="pyburgers compare one two")
    table = pd.read_csv(tmp_path / "comparison.csv", index_col="fit")
    points = pd.read_csv(tmp_path / "pointwise.csv", index_col="point")
    for name in fits:
        assert points[f"{name} elpd"].sum() == pytest.approx(table["elpd"][name])
    np.testing.assert_allclose(points["strain"], comparison.position)
    record = json.loads((tmp_path / "comparison.json").read_text(encoding="utf-8"))
    assert record["command"] == "pyburgers compare one two"
    assert record["fits"]["one"]["fingerprint"] == fits["one"].manifest["fingerprint"]
    assert record["sentences"] == list(sentences(comparison))
    (pair,) = comparison.pairs()
    assert record["pairs"] == [{**asdict(pair), "outcome": str(pair.outcome)}]


def test_points_of_an_oscillation_stay_flagged(tmp_path: Path) -> None:
    olivine = make_olivine_fit(tmp_path / "olivine")
    with pytest.raises(InputError, match=r"cannot be left out one by one, expected .*\.$"):
        leave_out_exactly(olivine, result(np.zeros(5)), [0], tmp_path / "refits")


def test_refits_are_kept_in_a_folder_of_any_type(
    small_fit: Fit, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    folders = []

    def kept(one: Fit, found: LeaveOneOut, points: object, folder: Path) -> LeaveOneOut:
        folders.append(folder)
        return found

    monkeypatch.setattr("pyburgers.comparison.by_points.leave_out_exactly", kept)
    monkeypatch.setattr(LeaveOneOut, "unreliable", property(lambda one: ~one.exact))
    compare({"one": small_fit, "same": small_fit}, refits=str(tmp_path))
    assert folders == [tmp_path / "one", tmp_path / "same"]


def test_fits_of_other_data_are_refused(tmp_path: Path) -> None:
    one, same = make_fit(tmp_path / "one", seed=1), make_fit(tmp_path / "same", seed=1)
    other = make_fit(tmp_path / "other", seed=2)
    assert data_hash(one) == data_hash(same)
    assert data_hash(one) != data_hash(other)
    with pytest.raises(InputError, match=r"other: is a fit of other data than one .*\.$"):
        compare({"one": one, "other": other})
    # A record whose background is taken off ends in other digits on another processor.
    before = same.posterior["observed_data"].to_dataset()
    same.posterior["observed_data"] = xr.DataTree(before * (1 + 1e-14))
    assert not before.equals(same.posterior["observed_data"].to_dataset())
    assert data_hash(one) == data_hash(same)


@pytest.fixture(scope="module")
def wrong_fit(small_problem: Problem, tmp_path_factory: pytest.TempPathFactory) -> Fit:
    """The small problem with a Kelvin element three times too stiff."""
    truth = truth_of(small_problem.experiment)
    priors = with_fixed(small_problem.priors, {"kelvin_modulus": 3 * truth["kelvin_modulus"]})
    out = tmp_path_factory.mktemp("wrong") / "run"
    return fit(small_problem.experiment, priors, out=out, options=LONG_RUN)


def test_the_model_behind_the_data_predicts_them_better(long_fit: Fit, wrong_fit: Fit) -> None:
    comparison = compare({"wrong": wrong_fit, "right": long_fit})
    assert list(comparison.results) == ["right", "wrong"]
    assert "right predicts these data clearly better than wrong" in sentences(comparison)[0]
    assert comparison.weights[0] > 0.9


def test_a_point_left_out_in_earnest_has_the_approximated_density(
    small_fit: Fit, tmp_path: Path
) -> None:
    approximate = leave_one_out(small_fit.posterior)
    # The least expected one of those whose weights have a finite variance.
    point = int(np.argmin(np.where(approximate.pareto_k < 0.5, approximate.elpd, np.inf)))
    assert approximate.pareto_k[point] < 0.5
    exact = leave_out_exactly(small_fit, approximate, [point], tmp_path / "refits")
    # The fit without it is as short.
    assert [f"without point {point + 1} failed its check" in one for one in exact.doubts] == [True]
    assert exact.exact.tolist() == [k == point for k in range(exact.elpd.size)]
    # Leaving an unexpected point out must cost it something.
    seen = small_fit.posterior["log_likelihood"].to_dataset()["stress"].isel(point=point)
    assert exact.elpd[point] < float(np.log(np.exp(seen).mean()))
    assert exact.elpd[point] == pytest.approx(approximate.elpd[point], abs=0.4)
    kept = np.arange(exact.elpd.size) != point
    np.testing.assert_array_equal(exact.elpd[kept], approximate.elpd[kept])
    without = Fit.load(tmp_path / "refits" / f"point_{point + 1}")
    assert without.experiment.n_points == small_fit.experiment.n_points - 1


@pytest.mark.parametrize(
    ("difference", "error", "outcome"),
    [
        (3.3, 17.2, PairOutcome.CANNOT_TELL),
        (0.1, 4.2, PairOutcome.CANNOT_TELL),
        (9.0, 6.0, PairOutcome.CANNOT_TELL),
        (3.9, 0.5, PairOutcome.CANNOT_TELL),
        (1.0, 0.9, PairOutcome.ALIKE),
        (2.2, 0.7, PairOutcome.ALIKE),
        (4.0, 0.5, PairOutcome.BETTER),
        (28.0, 7.0, PairOutcome.BETTER),
    ],
)
def test_a_small_difference_of_large_error_is_no_likeness(
    difference: float, error: float, outcome: PairOutcome
) -> None:
    assert Pair("one", "other", difference, error).outcome is outcome


@pytest.mark.parametrize(
    ("n_points", "correlation"), [(3, 0.0), (5, 0.0), (8, 0.0), (14, 0.0), (14, 0.3), (60, 0.3)]
)
def test_points_seldom_prefer_one_of_two_fits_that_are_as_good(
    n_points: int, correlation: float
) -> None:
    """Points of a segment of their own each, or neighbours of one segment that correlate."""
    apart = np.abs(np.subtract.outer(np.arange(n_points), np.arange(n_points)))
    root = np.linalg.cholesky(np.where(apart > 0, correlation**apart, 1.0))
    off = 3.0 * np.random.default_rng(n_points).normal(size=(2000, n_points)) @ root.T
    segment = np.zeros(n_points, dtype=np.int64) if correlation else None
    none = ("one", result(np.zeros(n_points)))
    pairs = [comparison_of(none, ("other", result(one)), segment=segment).pairs()[0] for one in off]
    better = np.mean([pair.outcome is PairOutcome.BETTER for pair in pairs])
    # Two standard errors of a normal number leave 0.0455, here with an error of 0.0047.
    assert better < 0.0455 + 3 * 0.0047
    few = Pair("a", "b", 12.0, 4.1, clear=4.53)
    assert few.sentence() == (
        "Cannot tell which of a and b predicts these data better (difference of elpd 12.0, "
        "standard error 4.1), because a standard error this uncertain counts 4.5 times, not 2."
    )


def test_each_outcome_has_its_words() -> None:
    said = [Pair("a", "b", *numbers).sentence() for numbers in ((9, 1), (1, 1), (3.3, 17.2))]
    assert said == [
        "a predicts these data clearly better than b (difference of elpd 9.0, standard error 1.0).",
        "a and b predict these data alike (difference of elpd 1.0, standard error 1.0).",
        "Cannot tell which of a and b predicts these data better (difference of elpd 3.3, standard "
        "error 17.2).",
    ]


def test_numbers_in_doubt_and_errors_that_are_none_decide_nothing() -> None:
    doubtful = Pair("a", "b", 9.0, 1.0, "the elpd of a may be far off")
    assert doubtful.outcome is PairOutcome.CANNOT_TELL
    assert doubtful.sentence().startswith("Cannot tell which of a and b predicts these data better")
    assert doubtful.sentence().endswith(
        "elpd 9.0, standard error 1.0), because the elpd of a may be far off."
    )
    assert replace(doubtful, difference=0.0).outcome is PairOutcome.CANNOT_TELL
    for error in (math.nan, math.inf):
        without = Pair("a", "b", 9.0, error)
        assert without.outcome is PairOutcome.CANNOT_TELL
        assert without.sentence().endswith("(difference of elpd 9.0, no standard error).")


def test_the_error_of_a_difference_counts_neighbours_of_a_segment() -> None:
    """Of spectra each of which is off as a whole, the error is mostly that of so many numbers."""
    segment = np.arange(140) // 10
    off = np.random.default_rng(3).normal(size=(200, 14))
    errors = [standard_error(one[segment], segment) for one in off]
    assert 0.75 < np.mean(errors) / (10 * np.sqrt(14)) < 1.05
    one = off[0][segment]
    apart = np.abs(np.subtract.outer(np.arange(140), np.arange(140)))
    same = np.equal.outer(segment, segment)
    weights = np.where(same, np.maximum(1 - apart / np.ceil(1.3 * np.sqrt(140)), 0), 0)
    exact = np.sqrt((one - one.mean()) @ weights @ (one - one.mean()) * 140 / 139)
    comparison = comparison_of(
        ("one", result(np.zeros(140))), ("other", result(one)), segment=segment
    )
    (pair,) = comparison.pairs()
    assert pair.error == pytest.approx(exact)
    assert comparison_table(comparison)["difference_se"].max() == pytest.approx(exact)


def test_neighbours_that_change_sides_leave_the_error_of_independent_points() -> None:
    sides = np.tile([1.0, -1.0], 20)
    assert standard_error(sides, np.zeros(40, dtype=np.int64)) == standard_error(sides)


def test_a_comparison_knows_the_segments_of_the_points(small_fit: Fit) -> None:
    comparison = compare({"one": small_fit, "same": small_fit})
    along = small_fit.posterior["constant_data"].to_dataset()
    assert comparison.segment.tolist() == along["segment"].astype(int).to_numpy().tolist()
