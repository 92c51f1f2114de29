"""The check for a trend in residuals: what it compares, where it fails, and how often by chance."""

import json

import numpy as np
import numpy.typing as npt
import pytest
import xarray as xr
from scipy.signal import lfilter

from pyburgers.checks.fit_checks import CheckedDraws
from pyburgers.checks.residual_trend import autocorrelation, check_residual_trend, longest_run
from pyburgers.checks.verdicts import verdicts_record

FloatArray = npt.NDArray[np.float64]
CHAINS, DRAWS, POINTS = 2, 500, 50


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
    segment: FloatArray | None = None,
) -> dict[str, xr.Dataset]:
    """Labelled draws about a model that varies a little; the response is made up."""
    n = residual.size
    rng = np.random.default_rng(5)
    model = 7.0 + 0.01 * rng.standard_normal((CHAINS, DRAWS, 1)) * np.ones(n)
    if replicated is None:
        replicated = rng.standard_normal(model.shape)
    along = {clock: ("point", np.linspace(0.01, 0.01 * n, n))}
    dims = ("chain", "draw", "point")
    return {
        "model_response": xr.Dataset({"log_attenuation": (dims, model)}),
        "posterior_predictive": xr.Dataset({"log_attenuation": (dims, model + replicated)}),
        "observed_data": xr.Dataset({"log_attenuation": ("point", 7.0 + residual)}),
        "sample_stats": xr.Dataset({"diverging": (dims[:2], np.zeros(model.shape[:2], bool))}),
        "predictions": xr.Dataset({"x": (("chain", "draw", clock), np.zeros((1, 1, 1)))}),
        "constant_data": xr.Dataset(
            along if segment is None else {**along, "segment": ("point", segment)}
        ),
    }


def draws_of(**tests: dict[str, xr.Dataset]) -> CheckedDraws:
    """One test, or several of a joint fit."""
    if len(tests) == 1:
        return CheckedDraws(xr.DataTree.from_dict(*tests.values()))
    return CheckedDraws(
        xr.DataTree.from_dict(
            {"sample_stats": next(iter(tests.values()))["sample_stats"]}
            | {
                f"tests/{test}/{name}": one
                for test, own in tests.items()
                for name, one in own.items()
            }
        )
    )


def white(seed: int = 1) -> FloatArray:
    return np.random.default_rng(seed).standard_normal(POINTS)


def test_independent_residuals_pass() -> None:
    result = check_residual_trend(draws_of(one=groups(white())))
    assert result.passed
    assert 0.01 < result.table["probability"].item() < 0.99


def test_a_missed_shape_fails_and_the_longest_run_is_told() -> None:
    residual = 0.3 * white()
    residual[20:32] += 2.0
    residual[[19, 32]] = -0.5
    result = check_residual_trend(draws_of(one=groups(residual)))
    assert not result.passed
    assert result.table["probability"].item() < 0.01
    assert result.table["points_in_run"].item() == 12
    assert "12 in a row have one sign, from strain 21 to 32 %" in result.sentence
    assert "intervals are too narrow" in result.sentence
    assert "residuals=autocorrelated" in result.sentence
    (record,) = verdicts_record([result])["checks"]
    assert json.loads(json.dumps(record))["table"][0]["run"] == "strain 21 to 32 %"


def test_places_are_told_on_the_clock_of_the_protocol() -> None:
    result = check_residual_trend(draws_of(one=groups(np.ones(POINTS), clock="time")))
    assert "from time 0.01 to 0.5 s" in result.sentence


def test_correlated_residuals_pass_where_replicates_are_correlated() -> None:
    rng = np.random.default_rng(2)
    residual = correlated(rng, 0.8, POINTS)
    replicated = correlated(rng, 0.8, CHAINS, DRAWS, POINTS)
    assert not check_residual_trend(draws_of(one=groups(residual))).passed
    assert check_residual_trend(draws_of(one=groups(residual, replicated))).passed


def test_pairs_across_a_step_of_the_rate_do_not_count() -> None:
    residuals = np.array([[1.0, 1.0, -1.0, -1.0], [1.0, 2.0, 3.0, 4.0]])
    all_pairs, without_step = np.array([True, True, True]), np.array([True, False, True])
    np.testing.assert_allclose(autocorrelation(residuals, all_pairs), [1 / 4, 20 / 30])
    np.testing.assert_allclose(autocorrelation(residuals, without_step), [2 / 4, 14 / 30])
    assert longest_run(residuals[1], all_pairs) == (0, 3)
    assert longest_run(residuals[1], without_step) == (0, 1)
    # Signs that change from point to point within segments, and never where these meet.
    zigzag = np.tile([1.0, -1.0, -1.0, 1.0], 10)
    segment = np.arange(40.0) // 2
    joined = check_residual_trend(draws_of(one=groups(zigzag, segment=segment)))
    assert joined.table["autocorrelation"].item() == pytest.approx(-0.5, abs=0.01)


def test_the_worst_test_of_a_joint_fit_is_told() -> None:
    trend = np.sin(np.linspace(0.0, 6.0, POINTS)) + 0.1 * white(3)
    result = check_residual_trend(draws_of(good=groups(white()), bad=groups(trend)))
    assert not result.passed
    assert "neighbouring residuals of bad correlate with 0.9" in result.sentence
    assert result.table.index.tolist() == ["good", "bad"]
    assert check_residual_trend(draws_of(a=groups(white()), b=groups(white(4)))).passed


def test_a_single_point_passes() -> None:
    assert check_residual_trend(draws_of(one=groups(np.ones(1)))).passed


def test_few_correct_models_fail() -> None:
    """A mean with a known noise: the posterior is exact, and the check is run as it is."""
    rng, n_sets, failed = np.random.default_rng(9), 300, 0
    for _ in range(n_sets):
        residual = rng.standard_normal(POINTS)
        own = groups(residual, rng.standard_normal((CHAINS, DRAWS, POINTS)))
        offset = rng.normal(residual.mean(), POINTS**-0.5, (CHAINS, DRAWS, 1))
        for name in ("model_response", "posterior_predictive"):
            own[name] = own[name] + xr.DataArray(offset[..., 0], dims=("chain", "draw"))
        failed += not check_residual_trend(draws_of(one=own)).passed
    assert failed <= 0.02 * n_sets
