"""Checks of the description: what each misses, what it says, and how often by chance."""

import json
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from linear_fits import LinearModel
from scipy.signal import lfilter

from pyburgers.checks.description import (
    check_coverage,
    check_residual_trend,
    check_runs,
    check_segments,
    check_size,
    expected_text,
)
from pyburgers.checks.discrepancies import (
    LEVEL,
    OUTSIDE,
    OVER_READING_ERROR,
    SEGMENT_SPREAD,
    SEGMENT_TREND,
    beside_replicates,
    discrepancies_of,
    family_probability,
)
from pyburgers.checks.fit_checks import (
    Check,
    CheckedDraws,
    CheckKind,
    CheckResult,
    Outcome,
    run_checks,
)
from pyburgers.checks.residual_numbers import (
    autocorrelation,
    longest_run,
    longest_runs,
    segment_parts,
    signed_ranks,
)
from pyburgers.checks.verdicts import CHECKS, verdicts, verdicts_record
from pyburgers.posterior.labelled_draws import CORRELATED

FloatArray = npt.NDArray[np.float64]
CHAINS, DRAWS, POINTS = 2, 500, 50
DESCRIPTION = [one for one in CHECKS if one.kind is CheckKind.DESCRIPTION]
MEGAPASCAL = 1e6
IMPOSED = "what was imposed there is what the stages say"


def correlated(rng: np.random.Generator, correlation: float, *shape: int) -> FloatArray:
    """Residuals of unit variance along the last axis, a process of first order."""
    innovations = rng.standard_normal(shape)
    innovations[..., 1:] *= np.sqrt(1 - correlation**2)
    residuals: FloatArray = lfilter([1.0], [1.0, -correlation], innovations)
    return residuals


def groups(
    residual: FloatArray,
    replicated: FloatArray | None = None,
    *,
    clock: str = "strain",
    segment: npt.NDArray[Any] | None = None,
    reading_error: float | None = None,
    draws: int = DRAWS,
) -> dict[str, xr.Dataset]:
    """Labelled draws about a model that varies a little, in MPa; the response is made up."""
    n = residual.size
    rng = np.random.default_rng(5)
    model = 7.0 + 0.01 * rng.standard_normal((CHAINS, draws, 1)) * np.ones(n)
    if replicated is None:
        replicated = rng.standard_normal(model.shape)
    along = {clock: ("point", np.linspace(0.01, 0.01 * n, n))}
    if segment is not None:
        along["segment"] = ("point", segment)
    if reading_error is not None:
        along["reading_error"] = ("point", np.full(n, reading_error * MEGAPASCAL))
    dims = ("chain", "draw", "point")
    values = {
        "model_response": (dims, model),
        "posterior_predictive": (dims, model + replicated),
        "observed_data": ("point", 7.0 + residual),
    }
    protocol = {"strain": "constant_rate", "time": "forced_oscillation"}[clock]
    return {
        "/": xr.Dataset(attrs={"protocol": protocol}),
        **{
            name: xr.Dataset({"stress": (where, MEGAPASCAL * value)})
            for name, (where, value) in values.items()
        },
        "sample_stats": xr.Dataset({"diverging": (dims[:2], np.zeros(model.shape[:2], bool))}),
        "predictions": xr.Dataset({"x": (("chain", "draw", clock), np.zeros((1, 1, 1)))}),
        "constant_data": xr.Dataset(along),
    }


def history_groups(
    residual: FloatArray,
    replicated: FloatArray | None = None,
    *,
    segment: FloatArray,
    is_strain: bool | FloatArray,
) -> dict[str, xr.Dataset]:
    """As `groups`, of a loading history."""
    own = groups(residual, replicated, clock="time", segment=segment)
    own["/"] = xr.Dataset(attrs={"protocol": "loading_history"})
    quantity = np.broadcast_to(np.asarray(is_strain, dtype=float), residual.shape)
    own["constant_data"] = own["constant_data"].assign(quantity=("point", quantity))
    for name in ("model_response", "posterior_predictive", "observed_data"):
        own[name] = own[name].rename(stress="response")
    return own


def draws_of(**tests: dict[str, xr.Dataset]) -> CheckedDraws:
    """One test, or several of a joint fit."""
    if len(tests) == 1:
        return CheckedDraws(xr.DataTree.from_dict(*tests.values()))
    return CheckedDraws(
        xr.DataTree.from_dict(
            {"sample_stats": next(iter(tests.values()))["sample_stats"]}
            | {
                f"tests/{test}/{name}".rstrip("/"): one
                for test, own in tests.items()
                for name, one in own.items()
            }
        )
    )


def white(seed: int = 1, n: int = POINTS) -> FloatArray:
    return np.random.default_rng(seed).standard_normal(n)


def failed(draws: CheckedDraws) -> dict[str, CheckResult]:
    """Checks of the description that failed, by name."""
    results = run_checks(draws, DESCRIPTION)
    return {one.name: one for one in results if one.outcome is Outcome.NO}


@pytest.mark.parametrize("segment", [None, np.arange(POINTS) // 20.0])
def test_independent_residuals_pass(segment: FloatArray | None) -> None:
    results = run_checks(
        draws_of(one=groups(white(), segment=segment, reading_error=1.0)), DESCRIPTION
    )
    assert [one.name for one in results if one.outcome is not Outcome.YES] == []
    assert all(one.sentence.endswith(".") for one in results)


def trend() -> FloatArray:
    wave: FloatArray = np.sin(np.linspace(0.0, 6.0, POINTS)) + 0.1 * white(3)
    return wave


def having(own: dict[str, xr.Dataset], *names: str) -> dict[str, xr.Dataset]:
    """Labelled draws of a fit in which some parameters are free."""
    free = {name: ((), 1.0, {"fixed": 0}) for name in names}
    return own | {"posterior": xr.Dataset(free)}


STEP = np.repeat([0.0, 1.0], 25)
ADVICE: dict[str, tuple[dict[str, xr.Dataset], tuple[str, ...], tuple[str, ...]]] = {
    "one rate": (
        groups(trend(), segment=np.zeros(POINTS)),
        ("tests at other rates", "whether the strain includes that of the machine"),
        ("kelvin=power_law",),
    ),
    "record": (
        groups(trend(), clock="time"),
        ("kelvin=power_law", "from time "),
        ("residuals=discrepancy",),
    ),
    "laws that the fit has": (
        having(groups(trend(), segment=STEP), "kelvin_stress_exponent")
        | {"log_likelihood_given_others": xr.Dataset()},
        ("maxwell=hyperbolic_sine",),
        ("kelvin=power_law", "residuals=discrepancy"),
    ),
    # Creep under one or several loads tells laws apart, a test at one rate hardly.
    **{
        name: (
            history_groups(trend(), segment=segment, is_strain=is_strain),
            ("--variant kelvin=two_elements", "residuals=discrepancy", IMPOSED),
            ("at one rate other laws hardly differ",),
        )
        for name, segment, is_strain in (("creep", np.zeros(POINTS), True), ("steps", STEP, False))
    },
    "history at one rate": (
        history_groups(trend(), segment=np.zeros(POINTS), is_strain=False),
        ("at one rate other laws hardly differ", "residuals=discrepancy"),
        ("--variant kelvin=two_elements", IMPOSED),
    ),
    "laws that the history has": (
        having(
            history_groups(trend(), segment=np.zeros(POINTS), is_strain=True),
            *("breakdown_stress", "residual_correlation_time"),
        ),
        (
            "(--variant kelvin=power_law or --variant kelvin=two_elements or --variant "
            "hardening=backstress)",
        ),
        ("residuals=discrepancy",),
    ),
}


@pytest.mark.parametrize(("own", "advised", "not_advised"), ADVICE.values(), ids=ADVICE)
def test_laws_are_advised_that_could_help_and_that_the_fit_lacks(
    own: dict[str, xr.Dataset], advised: tuple[str, ...], not_advised: tuple[str, ...]
) -> None:
    result = check_residual_trend(draws_of(one=own))
    assert result.outcome is Outcome.NO
    assert [words for words in advised if words not in result.sentence] == []
    assert [words for words in not_advised if words in result.sentence] == []


def test_a_missed_shape_fails_and_the_longest_run_is_told() -> None:
    residual = 0.3 * white()
    residual[20:32] += 2.0
    residual[[19, 32]] = -0.5
    draws = draws_of(one=groups(residual, segment=np.zeros(POINTS)))
    result = check_residual_trend(draws)
    assert result.outcome is Outcome.NO
    assert result.table["probability"].item() < LEVEL
    assert "12 in a row have one sign, from strain 21 to 32 %" in result.sentence
    assert "the data above the model" in result.sentence
    assert "too narrow" in result.sentence
    assert "residuals=discrepancy" in result.sentence
    record = verdicts_record([result])
    assert json.loads(json.dumps(record))["checks"][0]["table"][0]["where"] == "strain 21 to 32 %"
    assert check_runs(draws).outcome is Outcome.YES


def test_a_long_run_of_small_residuals_fails_the_runs_alone() -> None:
    residual = np.abs(white(2)) * np.where(np.arange(POINTS) % 2, 1.0, -1.0)
    residual[9:30] = 0.05
    assert set(failed(draws_of(one=groups(residual)))) == {"runs"}
    assert "21 in a row have one sign" in check_runs(draws_of(one=groups(residual))).sentence


def test_a_segment_that_lies_aside_is_named_with_its_place_and_size() -> None:
    segment = np.repeat([0.0, 1.0, 2.0], [20, 15, 15])
    residual = 0.5 * white(6) * np.where(np.arange(POINTS) % 2, 1.0, -1.0)
    residual[20:35] += np.linspace(3.0, -3.0, 15)
    result = check_segments(draws_of(one=groups(residual, segment=segment)))
    assert result.outcome is Outcome.NO
    assert "segment 2 (strain 21 to 35 %)" in result.sentence
    assert "MPa above the model and ends" in result.sentence
    assert "behind a step of the rate" in result.sentence
    for variant in ("kelvin=power_law", "maxwell=hyperbolic_sine", "residuals=discrepancy"):
        assert f"--variant {variant}" in result.sentence


def test_a_single_outlier_is_told_as_such() -> None:
    residual = white(4)
    residual[30] = -104.0
    results = failed(draws_of(one=groups(residual, 1.4 * draws_of_noise())))
    assert list(results) == ["largest residual"]
    sentence = results["largest residual"].sentence
    assert "A single reading is an outlier" in sentence
    assert "strain 31 %" in sentence
    assert "100 MPa below the model" in sentence
    assert "too narrow" not in sentence


@pytest.mark.parametrize("n", [36, 72])
def test_a_quantity_that_is_displaced_as_a_whole_is_told(n: int) -> None:
    """Its noise is fitted as large, so that no segment by itself is off by more than chance."""
    residual = 0.05 * white(n=n)
    residual[n // 2 :] += 0.8
    rng = np.random.default_rng(6)
    sizes = np.repeat([0.05, 0.8], n // 2)
    replicated = sizes * rng.standard_normal((CHAINS, DRAWS, n))
    segment, quantity = np.floor(np.arange(n) / 3), np.repeat([0.0, 1.0], n // 2)
    draws = draws_of(one=history_groups(residual, replicated, segment=segment, is_strain=quantity))
    trend = discrepancies_of(draws).table.loc[SEGMENT_TREND].iloc[0]
    assert trend["found"] < trend["at_most"]
    result = check_segments(draws)
    assert result.outcome is Outcome.NO
    assert "standard errors off, a mean over the draws (at most" in result.sentence
    assert "% above the model" in result.sentence
    aside = groups(3.0 + 0.5 * white(2), 3.0 * draws_of_noise())
    result = check_segments(draws_of(good=groups(white()), aside=aside))
    assert result.outcome is Outcome.NO
    assert "residuals of aside" in result.sentence


def draws_of_noise() -> FloatArray:
    return np.random.default_rng(8).standard_normal((CHAINS, DRAWS, POINTS))


def test_one_rate_that_is_described_worse_than_the_others_fails_the_size() -> None:
    segment = np.repeat([0.0, 1.0], 25)
    residual = np.where(np.arange(POINTS) % 2, 1.0, -1.0) * np.repeat([0.2, 1.5], 25)
    result = check_size(draws_of(one=groups(residual, segment=segment)))
    assert result.outcome is Outcome.NO
    assert "segment 2 (strain 26 to 50 %)" in result.sentence
    assert "of the variance of the test" in result.sentence


@pytest.mark.parametrize(("error", "outcome"), [(1.0, "yes"), (0.9, "yes"), (0.5, "no")])
def test_residuals_are_held_against_a_stated_reading_error(error: float, outcome: str) -> None:
    residual = white(5)
    residual /= np.sqrt(np.mean(residual**2))
    result = check_size(draws_of(one=groups(residual, reading_error=error)))
    assert result.outcome.value == outcome
    assert f"{1 / error:.1f} times the stated reading error" in result.sentence


@pytest.mark.parametrize(("missed", "outcome"), [(1.0, "yes"), (2.5, "no")])
def test_many_readings_of_a_quantity_hide_no_misfit_of_another(missed: float, outcome: str) -> None:
    is_strain = np.repeat([1.0, 0.0], [40, 10])
    size = np.where(is_strain > 0, 0.1, missed)
    own = history_groups(
        size * white(5), size * draws_of_noise(), segment=1.0 - is_strain, is_strain=is_strain
    )
    stated = MEGAPASCAL * np.where(is_strain > 0, 0.1, 1.0)
    own["constant_data"] = own["constant_data"].assign(reading_error=("point", stated))
    result = check_size(draws_of(one=own))
    assert result.outcome.value == outcome
    assert ("times the stated reading error of the stress" in result.sentence) == (missed > 1)


def test_the_failing_one_of_two_sizes_is_told() -> None:
    """Spread and reading error are families of their own: the outcome goes by the worse family."""
    rows = {
        (SEGMENT_SPREAD, "the test"): (1.2, 1.3, 0.001, 0.006),
        (OVER_READING_ERROR, "the test"): (1.9, 1.7, 0.0015, 0.0015),
    }
    draws = draws_of(
        test=groups(white(), segment=np.floor(np.arange(POINTS) / 25.0), reading_error=1.0)
    )
    family = discrepancies_of(draws)
    for row, values in rows.items():
        family.table.loc[row] = values
    result = check_size(draws)
    assert result.outcome is Outcome.NO
    assert "1.9 times the stated reading error" in result.meaning


def test_reading_errors_of_tests_with_as_many_readings_are_replicated_apart() -> None:
    alike = groups(white(), reading_error=1.0)
    family = discrepancies_of(draws_of(A=alike, B=alike))
    one, other = (
        leftover.discrepancies[OVER_READING_ERROR][1].ravel() for leftover in family.tests.values()
    )
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.2


def test_the_share_of_the_variance_that_is_left_is_told() -> None:
    residual = white(5)
    result = check_size(draws_of(one=groups(residual)))
    share = result.table["share_of_variance"].item()
    assert share == pytest.approx(np.mean(residual**2) / np.var(residual), rel=0.02)
    assert "no reading error is stated" in result.sentence
    larger = check_size(draws_of(one=groups(10.0 + white(), 10.0 * draws_of_noise())))
    assert larger.outcome is Outcome.NO
    assert "a constant would leave the test less" in larger.sentence
    worse = run_checks(draws_of(one=groups(10.0 + trend())), DESCRIPTION)
    assert sum(one.outcome is Outcome.NO for one in worse) > 1
    verdict = verdicts(worse)[CheckKind.DESCRIPTION].sentence
    assert "a constant would leave the test less" in verdict.split("Also: ")[0]
    assert f"{share:.2%} of the variance" in result.note
    assert "correlates" not in result.note


@pytest.mark.parametrize(("mean", "told"), [(0.48, False), (0.92, True)])
def test_correlation_is_told_only_where_the_draws_show_it(mean: float, told: bool) -> None:
    """The share that correlates is left to its prior by residuals that do not."""
    share = np.random.default_rng(1).beta(4 * mean / (1 - mean), 4, (CHAINS, DRAWS))
    own = groups(white(5)) | {
        CORRELATED: xr.Dataset(),
        "posterior": xr.Dataset({"residual_correlated_share": (("chain", "draw"), share)}),
    }
    result = check_size(draws_of(one=own))
    assert ("most of it correlates" in result.note) == told
    assert "it is misfit" not in result.sentence


@pytest.mark.parametrize("leftover", ["sine", "drift", "process"])
@pytest.mark.parametrize("stated", [False, True])
def test_residuals_that_correlate_do_not_take_misfit_for_a_yes(leftover: str, stated: bool) -> None:
    """Replicates of such a fit correlate as the misfit does, so that all other checks pass."""
    rng = np.random.default_rng(3)
    along = np.linspace(0.0, 1.0, POINTS)
    smooth = {
        "sine": 2.7 * np.sqrt(2.0) * np.sin(9.0 * along),
        "drift": 9.0 * (along - 0.5),
        "process": 3.0 * correlated(rng, 0.95, POINTS),
    }[leftover]
    residual = smooth + white()
    replicated = np.sqrt(np.mean(residual**2)) * correlated(rng, 0.9, CHAINS, DRAWS, POINTS)
    error = 1.0 if stated else None
    own = groups(residual, replicated, reading_error=error) | {CORRELATED: xr.Dataset()}
    result = check_size(draws_of(one=own))
    assert result.outcome is (Outcome.NO if stated else Outcome.CANNOT_TELL)
    if not stated:
        assert "times the reading error that neighbouring residuals tell" in result.sentence
        assert "state stress_uncertainty" in result.sentence


def test_white_noise_passes_where_residuals_may_correlate() -> None:
    for seed in range(10):
        own = groups(white(seed), segment=np.zeros(POINTS)) | {CORRELATED: xr.Dataset()}
        assert check_size(draws_of(one=own)).outcome is Outcome.YES


def test_a_few_readings_cannot_tell_misfit_from_errors_that_correlate() -> None:
    segment = np.arange(10.0) // 2
    own = groups(white(n=10), segment=segment) | {CORRELATED: xr.Dataset()}
    result = check_size(draws_of(one=own))
    assert result.outcome is Outcome.CANNOT_TELL
    assert "too few readings are neighbours" in result.sentence


def test_correlated_residuals_pass_where_replicates_are_correlated() -> None:
    for seed, correlation in ((2, 0.9), (3, 0.95)):
        rng = np.random.default_rng(seed)
        residual = correlated(rng, correlation, POINTS)
        replicated = correlated(rng, correlation, CHAINS, DRAWS, POINTS)
        assert check_residual_trend(draws_of(one=groups(residual))).outcome is Outcome.NO
        draws = draws_of(one=groups(residual, replicated))
        assert "residual trend" not in failed(draws)
        assert seed == 3 or failed(draws) == {}
    result = check_residual_trend(draws)
    assert result.table["found"].item() > 0.5
    assert result.sentence.startswith("No more of a trend than a correct model leaves: ")
    assert "expected of a correct model)" in result.sentence


def test_pairs_across_a_step_of_the_rate_do_not_count() -> None:
    residuals = np.array([[1.0, 1.0, -1.0, -1.0], [1.0, 2.0, 3.0, 4.0]])
    all_pairs, without_step = np.array([True, True, True]), np.array([True, False, True])
    np.testing.assert_allclose(autocorrelation(residuals, all_pairs), [1 / 4, 20 / 30])
    np.testing.assert_allclose(autocorrelation(residuals, without_step), [2 / 4, 14 / 30])
    assert longest_run(residuals[1], all_pairs) == (0, 3)
    assert longest_run(residuals[1], without_step) == (0, 1)
    assert longest_runs(residuals, all_pairs).tolist() == [2, 4]
    assert longest_runs(residuals, without_step).tolist() == [2, 2]
    # Signs that change from point to point within segments, and never where these meet.
    zigzag = np.tile([1.0, -1.0, -1.0, 1.0], 10)
    segment = np.arange(40.0) // 2
    zigzag *= np.linspace(1.0, 1.5, 40)  # no two of one size
    joined = check_residual_trend(draws_of(one=groups(zigzag, segment=segment)))
    assert joined.table["found"].item() == pytest.approx(-0.5, abs=0.01)


def test_a_few_bad_readings_do_not_hide_a_wave() -> None:
    residual = np.sin(np.linspace(0.0, 15.0, POINTS)) + 0.5 * white(3)
    residual[:3] = [12.0, -7.0, 9.0]
    np.testing.assert_allclose(signed_ranks(residual[:5]), np.array([5, -3, 4, 1, 2]) / 5)
    joined = np.ones(POINTS - 1, dtype=bool)
    assert autocorrelation(residual, joined) < 0
    assert autocorrelation(signed_ranks(residual), joined) > 0.5
    assert "residual trend" in failed(draws_of(one=groups(residual, segment=np.zeros(POINTS))))


def test_segments_share_out_what_is_left() -> None:
    segment, position = np.repeat([0, 1], [4, 6]), np.arange(10.0)
    residuals = np.stack([np.arange(10.0), np.tile([1.0, -1.0], 5)])
    trend, spread = segment_parts(residuals, segment, position)
    # A straight line leaves nothing over.
    np.testing.assert_allclose(trend.sum(axis=0)[0], 10.0)
    np.testing.assert_allclose(spread[:, 0] * np.array([4, 6]), trend[:, 0])
    np.testing.assert_allclose(spread[:, 1], 1.0)
    assert (trend[:, 1] < 1.0).all()


def test_the_worst_test_of_a_joint_fit_is_told() -> None:
    joint = draws_of(good=groups(white(), draws=1500), bad=groups(trend(), draws=1500))
    result = check_residual_trend(joint)
    assert result.outcome is Outcome.NO
    assert "neighbouring residuals of bad correlate with 0.9" in result.sentence
    assert result.table["test"].tolist() == ["good", "bad"]
    assert failed(draws_of(a=groups(white()), b=groups(white(4)))) == {}


@pytest.mark.parametrize("n", [1, 2, 4, 9, 10])
@pytest.mark.parametrize("reading_error", [None, 1.0])
def test_fewer_than_ten_readings_cannot_tell(n: int, reading_error: float | None) -> None:
    """A yes to the model, or numbers of what is not there, would be told of them else."""
    draws = draws_of(one=groups(white(n=n), reading_error=reading_error))
    results = {one.name: one for one in run_checks(draws, DESCRIPTION)}
    least = {"coverage": 10, "residual trend": 10, "runs": 10}
    for name, result in results.items():
        needed = least.get(name, 5)
        assert (result.outcome is Outcome.CANNOT_TELL) == (n < needed), name
        if n < needed:
            count = "1 reading is" if n == 1 else f"{n} readings are"
            told = f"{count} too few to tell, at least {needed} are needed; add readings."
            assert result.sentence == told
    verdict = verdicts(list(results.values()))[CheckKind.DESCRIPTION]
    assert (verdict.outcome is Outcome.CANNOT_TELL) == (n < 10)
    # Ten readings are enough to see a wave.
    wave = 2.0 * np.sign(np.sin(np.linspace(0.1, 6.0, 10))) + 0.1 * white(n=10)
    assert failed(draws_of(one=groups(wave, 0.1 * draws_of_noise()[..., :10]))) != {}


def with_limits(own: dict[str, xr.Dataset], n: int) -> dict[str, xr.Dataset]:
    """Make the first readings upper limits above the model, but for rounding of the draws."""
    first, rounding = slice(0, n), 1e-12 * np.random.default_rng(3).standard_normal(n)
    for name in ("model_response", "posterior_predictive", "observed_data"):
        values = own[name]["stress"].to_numpy()
        values[..., first] = MEGAPASCAL * (9.0 + (rounding if values.ndim > 1 else 0.0))
    is_limit = np.arange(own["observed_data"].sizes["point"]) < n
    own["constant_data"] = own["constant_data"].assign(is_limit=("point", is_limit.astype(float)))
    return own


@pytest.mark.parametrize("reading_error", [None, 1.0])
def test_upper_limits_alone_cannot_tell(reading_error: float | None) -> None:
    own = with_limits(groups(white(), reading_error=reading_error), POINTS)
    for result in run_checks(draws_of(one=own), DESCRIPTION):
        assert result.outcome is Outcome.CANNOT_TELL
        assert "50 readings are upper limits, no values; 0 readings are too few" in result.sentence
    joint = draws_of(limits=own, many=groups(white()))
    assert failed(joint) == {}
    assert "unknown in limits, which has upper limits alone" in check_size(joint).sentence


def test_upper_limits_above_the_model_lie_inside_the_band_and_are_no_residuals() -> None:
    residual = white()
    without = draws_of(one=groups(residual[10:], draws_of_noise()[..., 10:]))
    limited = draws_of(one=with_limits(groups(residual, draws_of_noise()), 10))
    outside = [
        float(str(draws.table.loc[(OUTSIDE, "the test"), "found"])) * n
        for draws, n in ((discrepancies_of(without), 40), (discrepancies_of(limited), 50))
    ]
    assert outside[0] == pytest.approx(outside[1], abs=0.05)
    sizes = [
        check_size(draws).table[["share_of_variance", "root_mean_square"]]
        for draws in (without, limited)
    ]
    pd.testing.assert_frame_equal(sizes[0], sizes[1], rtol=0.02)


def test_equal_readings_have_no_variance_to_compare_with() -> None:
    own = groups(white())
    own["observed_data"]["stress"].to_numpy()[:] = 7.1 * MEGAPASCAL
    result = check_size(draws_of(one=own))
    assert "% of the variance" not in result.sentence
    assert "a root mean square of 0.1 MPa of the test" in result.sentence


def test_a_test_of_one_reading_in_a_joint_fit_is_left_to_the_others() -> None:
    joint = draws_of(one=groups(np.ones(1), reading_error=1.0), many=groups(white()))
    results = {one.name: one for one in run_checks(joint, DESCRIPTION)}
    assert all(one.passed for one in results.values())
    for name in ("coverage", "residual trend", "runs", "trend by segment", "largest residual"):
        assert results[name].table["test"].tolist() == ["many"]
    assert "nan" not in results["size of residuals"].sentence
    assert "a root mean square of 1 MPa of one;" in results["size of residuals"].sentence
    verdict = verdicts(list(results.values()))[CheckKind.DESCRIPTION]
    assert verdict.sentence.endswith("; other checks need more than 1 reading of one.")


def test_few_draws_cannot_fail_a_correct_model() -> None:
    """The tail of 150 replicates is known too badly."""
    result = check_residual_trend(draws_of(one=groups(trend(), draws=75)))
    assert result.outcome is Outcome.CANNOT_TELL
    assert "150 draws are too few" in result.sentence
    assert "--draws" in result.sentence


def test_the_coverage_alone_misses_a_misfit_and_never_passes_beyond_its_limit() -> None:
    """The noise of a fit is what it misses, so that its band always holds the data."""
    wave = np.sqrt(2.0) * np.sin(np.linspace(0.0, 6.0, POINTS))
    draws = draws_of(one=groups(wave))
    assert check_coverage(draws).passed
    assert "residual trend" in failed(draws)
    # A tenth of the data inside, of few draws: all other numbers of the family are as small.
    result = check_coverage(draws_of(one=groups(30.0 * white(), draws=300)))
    assert result.outcome is Outcome.NO
    assert "% of the data lie inside the 90 % predictive band (at least 7" in result.sentence
    assert expected_text(pd.Series({"at_most": 0.42}), digits=2, largest=1.0) == (
        "(at most 0.42 expected of a correct model)"
    )
    assert "tells nothing" in expected_text(pd.Series({"at_most": 1.02}), largest=1.0)


def test_a_family_counts_its_worst_number_once() -> None:
    rng = np.random.default_rng(3)
    least = rng.random((4, 2000)).min(axis=0)
    assert family_probability(7e-4, least) == pytest.approx(4 * 7e-4, abs=2e-3)
    assert family_probability(0.5, least) > 0.9
    # Four times the same number are one.
    same = family_probability(7e-4, np.repeat(rng.random((1, 2000)), 4, axis=0).min(axis=0))
    assert same == pytest.approx(7e-4, abs=1.5e-3)


SIZES = st.sampled_from([0.01, 1.0, 30.0])


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n_replicates=st.sampled_from([100, 150, 400, 1000]),
    decimals=st.sampled_from([0, 1, 8]),
    found=st.lists(st.floats(-3.0, 12.0), min_size=1, max_size=12),
    size=SIZES,
)
def test_a_verdict_never_contradicts_the_limit_that_is_printed(
    seed: int, n_replicates: int, decimals: int, found: list[float], size: float
) -> None:
    """Numbers of any kind: with ties, in families of any size, near and beyond all replicates."""
    rng = np.random.default_rng(seed)
    kinds = (OUTSIDE, OVER_READING_ERROR, "a number")
    pairs = {
        (kinds[k % 3], f"test {k}"): (
            size * (one + rng.choice([0.0, 0.3]) * rng.standard_normal(50)),
            size * np.round(rng.standard_normal((n_replicates, 4)), decimals),
        )
        for k, one in enumerate(found)
    }
    judged = beside_replicates(pairs)
    for _, row in judged.table.iterrows():
        outcome, passes = judged.outcome(row), row["found"] <= row["at_most"]
        assert (outcome is Outcome.YES) == passes
        assert np.isfinite(row["at_most"])
        if n_replicates >= 1 / LEVEL:
            assert outcome is not Outcome.CANNOT_TELL


@pytest.mark.parametrize("n_larger", [0, 1, 5])
def test_the_limit_of_replicates_that_are_mostly_alike_is_no_smaller_than_they_are(
    n_larger: int,
) -> None:
    replicates = np.full((600, 1), 1.4)
    replicates[:n_larger] += 0.2
    (row,) = beside_replicates({("a number", "one"): (np.array([1.0]), replicates)}).table.to_dict(
        "records"
    )
    assert 1.4 <= row["at_most"] < 2.5


@pytest.mark.parametrize("n_replicates", [400, 2000])
def test_a_number_far_beyond_all_replicates_fails_in_families_of_any_size(
    n_replicates: int,
) -> None:
    """The least share of replicates that k numbers can have is about k times that of one."""
    replicates = np.random.default_rng(4).standard_normal((20, n_replicates))
    pairs = {("a number", str(k)): (np.zeros(1), one[:, None]) for k, one in enumerate(replicates)}
    pairs["a number", "0"] = (np.array([12.0]), replicates[0][:, None])
    judged = beside_replicates(pairs)
    outcomes = [judged.outcome(row) for _, row in judged.table.iterrows()]
    assert outcomes == [Outcome.NO] + 19 * [Outcome.YES]
    limits = judged.table["at_most"]
    assert (limits > replicates.max(axis=1) - 0.5).all()
    assert (limits < 7.0).all()


def test_the_mean_at_which_a_check_fails_is_told() -> None:
    fits = LinearModel.of_polynomials(40, steps=1, degree=2).fits(5, seed=6)
    for draws in fits:
        table = discrepancies_of(draws).table
        passed = table["family_probability"] > LEVEL
        np.testing.assert_array_equal(table["found"] <= table["at_most"], passed)


@pytest.mark.parametrize(
    ("points", "steps", "degree", "n_fits", "draws"),
    [
        (POINTS, 1, 3, 15, 400),
        *(
            pytest.param(*shape, 500, 1000, marks=pytest.mark.slow)
            for shape in ((30, 0, 4), (60, 2, 2), (150, 3, 5))
        ),
    ],
)
def test_at_most_1_in_100_correct_models_fails_any_check(
    points: int, steps: int, degree: int, n_fits: int, draws: int
) -> None:
    """Fewer than would be 1 in 100 and the chance of so many data sets, at 1 in 1000."""
    fits = LinearModel.of_polynomials(points, steps, degree).fits(n_fits, seed=points, draws=draws)
    count = sum(bool(failed(fit)) for fit in fits)
    assert count <= 0.01 * n_fits + 3.1 * np.sqrt(0.01 * n_fits), count


@pytest.mark.parametrize("check", [check_coverage, check_residual_trend, check_runs])
def test_a_number_that_any_fit_may_have_is_no_evidence(check: Check) -> None:
    rng = np.random.default_rng(1)
    own = groups(white(n=12), correlated(rng, 0.9999, CHAINS, DRAWS, 12))
    result = check(draws_of(one=own | {CORRELATED: xr.Dataset()}))
    assert "(a correct model may leave any, so that this number tells nothing here)" in (
        result.sentence
    )
    assert "a correct model leaves" not in result.sentence
    assert "expected of" not in result.sentence


@pytest.mark.parametrize(
    ("check", "size", "least"),
    [
        (check_residual_trend, 1, 8),
        (check_residual_trend, 2, 5),  # in some data sets a limit is left
        *((check_runs, size, 8) for size in (1, 2, 3)),
    ],
)
def test_a_few_readings_at_each_rate_show_no_trend(check: Check, size: int, least: int) -> None:
    line = np.stack([np.ones(12), np.linspace(-1, 1, 12)])
    rates = np.floor(np.arange(12) / size)
    model = LinearModel(np.linspace(0.001, 0.2, 12), rates, 100.0 * line.T @ line)
    sentences = [check(fit).sentence for fit in model.fits(8, seed=1)]
    silent = [one for one in sentences if "so that this number tells nothing here" in one]
    assert len(silent) >= least
    assert not any("a correct model leaves" in one for one in silent)
