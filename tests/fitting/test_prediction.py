"""What a fit says of another test: every draw solved, under the conditions of that test."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from conftest import ICE, Problem, pair_of, resolved_priors, with_fixed
from kind_examples import TWIN_FILE
from scipy import stats
from scipy.special import logsumexp

from pyburgers import fixed
from pyburgers.common.array_types import FloatArray
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError
from pyburgers.common.netcdf_files import write_netcdf
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.new_sample import MICROSTRUCTURE
from pyburgers.fitting.new_test import (
    Source,
    add_noises,
    parameters_for_other_test,
)
from pyburgers.fitting.prediction import Prediction, predict_test
from pyburgers.fitting.prior_draws import prior_draws
from pyburgers.fitting.sampled_fit import ORIGINS
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.conditions import conditions_of, longer_than_tests
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, RateSegment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.experiment import Experiment, Stated, UncertainCondition, of_kind
from pyburgers.kinds.forced_oscillation.experiment import with_background
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stages import Stage
from pyburgers.kinds.problem import one_test, problem_of
from pyburgers.model.pooling import pooling_of
from pyburgers.model.priors import PriorSet
from pyburgers.predictions.figures import prediction_figure
from pyburgers.predictions.other_tests import (
    DENSITY,
    QUANTILES,
    ROUNDED,
    answers,
    band_table,
    overview_table,
    reading_table,
    score_table,
)


def another_test(fitted: Fit | Problem) -> ConstantRateExperiment:
    """Return a stepped test at other conditions, without data."""
    first = fitted.experiment if isinstance(fitted, Problem) else fitted.problem.experiments[0]
    return replace(
        of_kind(first, ConstantRateExperiment).to_be_solved(),
        id="another",
        temperature=255.0,
        initial_grain_size=500e-6,
        segments=(RateSegment(0.0, 1e-5), RateSegment(0.01, 1e-4)),
        final_strain=0.03,
    )


def values_of(prediction: Prediction, draw: int) -> dict[str, float]:
    group = prediction.posterior["posterior"].to_dataset().isel(chain=0, draw=draw)
    return {str(name): float(column) for name, column in group.items()}


def assert_solves(prediction: Prediction, draw: int, *, rtol: float) -> None:
    """Compare a draw with a forward solution at its parameters."""
    experiment = prediction.experiment
    kind = likelihood_of(experiment)
    predictions = prediction.posterior["predictions"].to_dataset().isel(chain=0, draw=draw)
    at = predictions[kind.clock.name].to_numpy()
    solution = simulate(experiment, values_of(prediction, draw), at=at)
    expected = solution[kind.response.column].to_numpy()
    found = predictions[kind.response.name].to_numpy()
    np.testing.assert_allclose(found, expected, rtol=rtol, atol=rtol * np.abs(expected).max())


def test_the_test_of_a_fit_is_what_the_fit_has(small_fit: Fit) -> None:
    prediction = small_fit.predict(small_fit.experiment)
    for group, rtol in (("model_response", 1e-3), ("predictions", 1e-5)):
        found, expected = (
            tree[group]["stress"].to_numpy().reshape(200, -1)
            for tree in (prediction.posterior, small_fit.posterior)
        )
        np.testing.assert_allclose(found, expected, rtol=rtol)
    found, expected = (
        tree["log_likelihood"]["stress"].sum("point").to_numpy().ravel()
        for tree in (prediction.posterior, small_fit.posterior)
    )
    np.testing.assert_allclose(found, expected, atol=0.05)
    assert any("is part of the fit" in caution for caution in prediction.cautions)


def test_another_test_is_solved_under_its_own_conditions(small_fit: Fit) -> None:
    target = another_test(small_fit)
    prediction = small_fit.predict(target, draws=7)
    assert prediction.posterior["posterior"].sizes == {"chain": 1, "draw": 7}
    numbers = prediction.posterior["posterior"]["fit_draw"].to_numpy()
    every = small_fit.posterior["posterior"]["maxwell_modulus"].to_numpy().ravel()
    drawn = prediction.posterior["posterior"]["maxwell_modulus"].to_numpy()[0]
    np.testing.assert_array_equal(drawn, every[numbers])
    for draw in (0, 6):
        assert_solves(prediction, draw, rtol=1e-5)
    (beyond,) = [text for text in prediction.cautions if text.startswith("Beyond")]
    for words in ("temperature 255 K (fitted: 260)", "initial grain size 500 µm", "strain up to 3"):
        assert words in beyond
    assert "model_response" not in prediction.posterior


def test_noise_has_the_size_of_the_draws_and_follows_the_seed(small_fit: Fit) -> None:
    target = another_test(small_fit)
    first, again, other = (small_fit.predict(target, seed=seed) for seed in (3, 3, 4))
    grids = [one.posterior["predictions"].to_dataset() for one in (first, again, other)]
    noise = [(grid["stress_replicated"] - grid["stress"]).to_numpy() for grid in grids]
    np.testing.assert_array_equal(noise[0], noise[1])
    assert not np.array_equal(noise[0], noise[2])
    size = first.posterior["posterior"]["stress_noise"].to_numpy()[..., np.newaxis]
    assert np.std(noise[0] / size) == pytest.approx(1.0, abs=0.02)
    assert "stress residual of the fit" in first.notes[-1]
    # One draw is enough, of a creep test too.
    for test, name in ((target, "stress"), (creep(target), "strain")):
        one, every = small_fit.predict(test, draws=1), small_fit.predict(test)
        (number,) = one.posterior["posterior"]["fit_draw"].to_numpy()
        found, expected = (
            prediction.posterior["predictions"][name].to_numpy()[0] for prediction in (one, every)
        )
        np.testing.assert_allclose(found[0], expected[number], rtol=1e-5)


def test_a_fit_that_did_not_work_says_so(small_fit: Fit) -> None:
    stats = small_fit.posterior["sample_stats"].to_dataset()
    stats = stats.assign(diverging=xr.ones_like(stats["diverging"]))
    posterior = small_fit.posterior.copy()
    posterior["sample_stats"] = xr.DataTree(stats)
    bad = replace(small_fit, posterior=posterior)
    target = another_test(small_fit)
    synthetic, verdict, *_ = bad.predict(target, draws=5).cautions
    assert synthetic == ORIGINS["synthetic"]
    assert "was not sampled well" in verdict


def test_a_joint_fit_gives_what_its_tests_share(joint: Fit) -> None:
    target = another_test(joint)
    noise = {
        test: joint[test].posterior["posterior"]["stress_noise"].to_numpy().ravel()
        for test in joint.manifest["experiments"]
    }
    in_turn = joint.predict(target)
    drawn = in_turn.posterior["posterior"].to_dataset()
    shared = joint.posterior["posterior"]["maxwell_modulus"].to_numpy().ravel()
    np.testing.assert_array_equal(drawn["maxwell_modulus"].to_numpy()[0], shared)
    first, second = noise.values()
    expected = np.where(np.arange(200) % 2 == 0, first, second)
    np.testing.assert_array_equal(drawn["stress_noise"].to_numpy()[0], expected)
    assert "here of each test in turn: stress residual" in in_turn.notes[0]

    chosen = joint.predict(target, separate_from="other")
    drawn = chosen.posterior["posterior"].to_dataset()
    np.testing.assert_array_equal(drawn["stress_noise"].to_numpy()[0], noise["other"])
    assert "here of other" in chosen.notes[0]
    own = joint["other"].predict(target).posterior["posterior"]["stress_noise"].to_numpy()[0]
    np.testing.assert_array_equal(own, noise["other"])


def test_partially_pooled_parameters_of_a_new_test_come_from_centre_and_spread(
    small_problem: Problem,
) -> None:
    """A log-odds or logarithm behind bounds is normal about the centre."""
    pooling = pooling_of({"maxwell_modulus": "partial", "stress_noise": "shared"})
    problem = problem_of(pair_of(small_problem), small_problem.priors, pooling)
    n = 1500
    rng = np.random.default_rng(1)
    values = {name: np.full(n, prior.location) for name, prior in problem.priors[0].priors.items()}
    values |= {
        "maxwell_modulus": rng.normal(5e9, 1e8, n),
        "activation_enthalpy": rng.normal(62e3, 10.0, n),
        "stress_noise": rng.normal(1e5, 1e3, n),
    }
    dims = ("chain", "draw")
    group = xr.Dataset({name: (dims, own[None]) for name, own in values.items()})
    at_all = xr.Dataset(
        {
            "maxwell_modulus[centre]": (dims, np.full((1, n), 4e9)),
            "maxwell_modulus[spread]": (dims, np.full((1, n), 0.3)),
        }
    )
    grid = xr.Dataset(
        {
            name: ((*dims, "strain"), np.ones((1, n, 2)))
            for name, _ in likelihood_of(problem.experiments[0]).grid_quantities.values()
        },
        {"strain": [0.01, 0.02]},
    )
    tests: dict[str, FittedTest] = {}
    for alone in problem.alone():
        tree = xr.DataTree.from_dict({"posterior": group, "predictions": grid})
        tests[alone.name] = Holder(alone.experiments[0], alone.priors[0], tree)
    passed = [conditions_of(one.experiment, one.posterior) for one in tests.values()]
    source = Source(problem, tests, xr.DataTree.from_dict({"posterior": at_all}), passed, ())
    prediction = predict_test(source, another_test(small_problem), draws=n)
    drawn = prediction.posterior["posterior"]["maxwell_modulus"].to_numpy()[0]
    # Its only bound is zero: the real number behind it is a logarithm.
    assert np.mean(np.log(drawn)) == pytest.approx(np.log(4e9), abs=0.02)
    assert np.std(np.log(drawn)) == pytest.approx(0.3, abs=0.02)
    assert "Maxwell modulus drawn from the centre and spread" in prediction.notes[0]


class Holder:
    """Draws that no sampler made."""

    def __init__(self, experiment: Experiment, priors: PriorSet, posterior: xr.DataTree) -> None:
        self.experiment, self.priors, self.posterior = experiment, priors, posterior


def prior_source(experiment: Experiment, draws: int = 6) -> Source:
    """Draws of the prior of a test, as if they were a fit of it."""
    prior = prior_draws(experiment, resolved_priors(experiment), draws=draws, seed=3)
    problem = one_test(experiment, prior.priors)
    passed = [conditions_of(experiment, prior.posterior)]
    return Source(problem, {experiment.id: prior}, prior.posterior, passed, ())


def test_another_sample_has_a_microstructure_of_its_own(programs: None) -> None:
    curve = load_constant_rate(ICE / "PIL40.toml")
    source = prior_source(curve, draws=80)
    fitted = source.posterior["posterior"].to_dataset()
    found = predict_test(source, replace(curve, id="other"), new_sample=True).posterior
    other, kept = found["posterior"].to_dataset(), found["posterior"]["fit_draw"].to_numpy()
    rank = {
        name: stats.spearmanr(all_draws(fitted[name])[kept], all_draws(other[name])).statistic
        for name in (*MICROSTRUCTURE, "stress_exponent", "activation_enthalpy", "kelvin_modulus")
    }
    # Grain sizes are pooled in part: those of two samples lie about a common one.
    size, *separate = (rank.pop(name) for name in MICROSTRUCTURE)
    assert 0.5 < size < 0.999
    assert np.abs(separate).max() < 0.4
    assert min(rank.values()) == 1.0


def test_an_oscillation_is_predicted_at_another_temperature(programs: None) -> None:
    record = load_forced_oscillation(TWIN_FILE).to_be_solved()
    source = prior_source(record)
    prediction = predict_test(source, replace(record, id="hotter", temperature=1480.0))
    assert_solves(prediction, 0, rtol=2e-4)
    assert any("temperature 1480 K" in caution for caution in prediction.cautions)
    assert any("is part of the fit" in caution for caution in prediction.cautions)


def test_a_record_is_the_same_data_with_another_background(small_fit: Fit) -> None:
    record = load_forced_oscillation(TWIN_FILE)
    other = with_background(record, "removed")
    assert not np.array_equal(other.response, record.response)
    assert record.has_readings_of(other)
    assert not record.has_readings_of(small_fit.experiment)
    assert not small_fit.experiment.has_readings_of(record)


def test_a_table_of_cycles_is_predicted_in_its_own_quantities(programs: None) -> None:
    """Each row of the bands has a period, and tan delta and modulus there in SI units."""
    table = load_attenuation(ICE / "attenuation_twin.toml")
    prediction = predict_test(prior_source(table), table)
    bands = band_table(prediction)
    at = bands["place"].to_numpy()
    period, spectrum, quantity = table.conditions.at(at)
    assert not quantity.any()
    np.testing.assert_array_equal(bands["period_s"], period)
    own_temperature = table.conditions.temperature[table.conditions.first_rows]
    np.testing.assert_array_equal(bands["temperature_K"], own_temperature[spectrum])
    every = prediction.posterior["predictions"]["log_reading"].to_numpy()[0].astype(np.float64)
    for column, own in zip(("tan_delta", "modulus_Pa"), np.hsplit(every, 2), strict=True):
        expected = np.quantile(np.exp(own), 0.05, axis=0)
        np.testing.assert_allclose(bands[f"{column}_q5"], expected, rtol=1e-6)
    readings = reading_table(prediction)
    assert (
        readings["quantity"].tolist()
        == np.repeat(["tan δ", "modulus"], len(table.readings.tan_delta)).tolist()
    )
    solved = prediction.posterior["model_response"]["log_reading"].to_numpy()[0]
    n = len(table.readings.tan_delta)
    for column, rows in (("tan_delta", slice(0, n)), ("modulus_Pa", slice(n, 2 * n))):
        there = readings[column + "_q50"].notna().to_numpy()
        np.testing.assert_array_equal(np.flatnonzero(there), np.arange(2 * n)[rows])
        measured = readings[f"measured_{column}"][there]
        np.testing.assert_allclose(measured, np.exp(table.response[rows]), rtol=1e-12)
        expected = np.quantile(np.exp(solved[:, rows]), 0.95, axis=0)
        np.testing.assert_allclose(readings[f"{column}_q95"][there], expected, rtol=1e-6)
    for shown in (readings, overview_table(prediction)):
        assert {"period_s", "temperature_K"} < {*shown}
    panels = prediction_figure(prediction).axes
    assert [axes.get_ylabel() for axes in panels] == ["tan δ (1)", "modulus (GPa)"]
    assert panels[0].get_xlim()[1] < panels[1].get_xlim()[1]
    named = [float(text.get_text()) for text in panels[0].get_xticklabels()]
    assert named == pytest.approx(own_temperature, rel=1e-3)
    assert panels[1].get_xlabel() == (
        "temperature (K) of spectra over periods of 0.74 to 14000 s (logarithmic)"
    )
    breaks = np.isnan(np.asarray(panels[0].get_lines()[0].get_xdata(), dtype=np.float64))
    assert breaks.sum() == len(table.conditions.first_rows) - 1 > 0


@pytest.mark.parametrize("error", [0.0, 0.02])
def test_an_upper_limit_is_scored_with_the_probability_of_being_below_it(
    programs: None, error: float
) -> None:
    """What lies below is that of the same table without limits; an error is one of the model's."""
    table = load_attenuation(ICE / "attenuation_twin.toml")
    readings = table.readings
    at_limit = np.arange(readings.tan_delta.size) % 2 == 0
    tan_delta = np.maximum(readings.tan_delta, 0.01)
    free = replace(
        readings,
        tan_delta=tan_delta,
        tan_delta_error=np.full(at_limit.size, error),
        limit=np.zeros(at_limit.size),
    )
    limited = replace(free, limit=np.where(at_limit, 1.2 * tan_delta, 0.0))
    source = prior_source(table)
    prediction = predict_test(source, replace(table, readings=limited))
    without_limits = predict_test(source, replace(table, readings=free)).posterior
    solved = without_limits["model_response"]["log_reading"].to_numpy()[0]
    group = without_limits["posterior"].to_dataset().isel(chain=0)
    scatter = group[["attenuation_scatter", "modulus_scatter"]].to_array().to_numpy()
    of_tan_delta = error * np.exp(-solved[:, : at_limit.size])
    stated = np.hstack([of_tan_delta, np.zeros_like(of_tan_delta)])
    noise = np.hypot(np.repeat(scatter.T, at_limit.size, axis=1), stated)
    limit = np.full(2 * at_limit.size, -np.inf)
    limit[: at_limit.size][at_limit] = np.log(1.2 * tan_delta[at_limit])
    new = prediction.posterior["posterior_predictive"]["log_reading"].to_numpy()[0]
    assert ((new > limit) & (new < limit + ROUNDED)).any()  # rounded by the program
    new = np.where(new <= limit + ROUNDED, limit, new)

    def score(reading: FloatArray, without: list[int]) -> float:
        law = stats.norm(np.delete(solved, without, 0), np.delete(noise, without, 0))
        density = np.where(reading <= limit, law.logcdf(limit), law.logpdf(reading))
        return float(np.mean(logsumexp(density, axis=0) - np.log(len(density))))

    scores, told = score_table(prediction).loc[DENSITY], reading_table(prediction)
    np.testing.assert_array_equal(told["is_limit"], limit > -np.inf)
    share = np.mean(new <= limit, axis=0)[limit > -np.inf]
    np.testing.assert_array_equal(told["share_below"][told["is_limit"]], share)
    assert share.any()
    _, labels = prediction_figure(prediction).axes[0].get_legend_handles_labels()
    assert labels[-2:] == ["synthetic data", "upper limits"]
    assert (new <= limit).any()
    assert scores["found"] == pytest.approx(score(prediction.experiment.response, []), rel=1e-6)
    expected = np.mean([score(own, [k]) for k, own in enumerate(new)])
    # Of a solution below its limit the probability alone is known, which leaves the width open.
    assert scores["expected"] == pytest.approx(expected, rel=0.05 if error else 1e-6)


def test_a_fit_of_an_oscillation_predicts_a_test_at_constant_rate(small_problem: Problem) -> None:
    record = load_forced_oscillation(TWIN_FILE).to_be_solved()
    target = replace(another_test(small_problem), material="olivine", temperature=1450.0)
    prediction = predict_test(prior_source(record), target, draws=3)
    assert_solves(prediction, 0, rtol=1e-4)


def test_what_cannot_be_predicted_is_refused(joint: Fit, small_fit: Fit) -> None:
    target = another_test(small_fit)
    ice_record = replace(load_forced_oscillation(TWIN_FILE), material="ice")
    for fit, experiment, options, words in (
        (small_fit, replace(target, material="olivine"), {}, "expected ice like PIL40"),
        (small_fit, ice_record, {}, r"the fit has not, .* simulate .* grain_size=constant"),
        (small_fit, target, {"draws": 0}, "expected at least 1"),
        (joint, target, {"separate_from": "nobody"}, "expected one of PIL40, other"),
    ):
        with pytest.raises(InputError, match=words):
            fit.predict(experiment, **options)


@pytest.mark.parametrize(("asked", "told"), [(200, False), (201, True)])
def test_a_fit_with_fewer_draws_than_asked_for_gives_all(
    asked: int, told: bool, small_fit: Fit
) -> None:
    prediction = small_fit.predict(another_test(small_fit), draws=asked)
    assert prediction.posterior["posterior"].sizes["draw"] == 200
    note = f"The fit has 200 draws, which are all taken; {asked} were asked for."
    assert (note in prediction.notes) is told


def test_all_is_kept_in_the_file(small_fit: Fit, tmp_path: Path) -> None:
    target = another_test(small_fit)
    prediction = small_fit.predict(target, draws=4)
    write_netcdf(tmp_path / "draws.nc", prediction.posterior)
    with xr.open_datatree(tmp_path / "draws.nc", engine="h5netcdf") as kept:
        assert kept.attrs["fitted_to"] == "PIL40"
        assert kept.attrs["cautions"].splitlines() == list(prediction.cautions)


def creep(experiment: ConstantRateExperiment, **changes: Any) -> HistoryExperiment:
    """Return a creep test with a jump of the stress, without readings, of the same sample."""
    stages = (
        Stage("stress", 0.0, 600.0, 255.0, 2e6),
        Stage("stress", 600.0, 1200.0, 255.0, 1e6),
    )
    values: dict[str, Any] = {
        "id": "creep",
        "material": experiment.material,
        "temperature": 255.0,
        "initial_grain_size": experiment.initial_grain_size,
        "provenance": experiment.provenance,
        "metadata": experiment.metadata,
        "notices": (),
        "true_parameters": None,
        "stages": stages,
        "time": np.empty(0),
        "reading_stage": np.empty(0, dtype=np.int64),
        "reading": np.empty(0),
    }
    return HistoryExperiment(**{**values, **changes})


def test_creep_is_predicted_from_a_test_at_constant_rate(
    small_fit: Fit, small_problem: Problem, tmp_path: Path
) -> None:
    prediction = small_fit.predict(creep(small_problem.experiment), draws=5)
    predictions = prediction.posterior["predictions"].to_dataset().isel(chain=0, draw=2)
    solution = simulate(
        prediction.experiment, values_of(prediction, 2), at=predictions["time"].to_numpy()
    )
    np.testing.assert_allclose(predictions["strain"], solution["strain"], rtol=1e-5, atol=1e-12)
    (note,) = prediction.notes
    assert note == "The fit has no strain residual, so that new readings have no noise here."
    assert [one.name for one in answers(prediction)] == ["strain"]
    np.testing.assert_allclose(
        predictions["strain_replicated"], predictions["strain"], rtol=0, atol=1e-10
    )
    assert "strain_q50" in band_table(prediction)
    assert len(prediction_figure(prediction).axes) == 1


@pytest.mark.parametrize(("duration", "longer"), [(9e3, False), (1e5, True)])
def test_creep_that_lasts_longer_than_fitted_cycles_is_doubted(
    duration: float, longer: bool, small_problem: Problem
) -> None:
    source = prior_source(load_attenuation(ICE / "attenuation_twin.toml"))
    stages = (Stage("stress", 0.0, duration, 255.0, 1e5),)
    cautions = predict_test(source, creep(small_problem.experiment, stages=stages)).cautions
    told = "The test lasts 1e+05 s, longer than any fitted period (1e+04 s)"
    assert any(one.startswith(told) for one in cautions) is longer
    assert any("longer than" in one for one in cautions) is longer


def test_creep_that_lasts_longer_than_a_fitted_curve_and_is_molten_is_doubted(
    small_fit: Fit, small_problem: Problem
) -> None:
    for duration, temperature, n_told in ((60.0, 270.0, 0), (3e9, 300.0, 1)):
        stages = (Stage("stress", 0.0, duration, temperature, 1e4),)
        target = creep(small_problem.experiment, stages=stages)
        cautions = small_fit.predict(target, draws=3).cautions
        molten = [one for one in cautions if "ice at 300 K is molten" in one]
        told = [one for one in cautions if "lasts" in one]
        assert (len(molten), len(told)) == (n_told, n_told)
    assert told[0].startswith("The test lasts 3e+09 s, longer than any fitted test (")


def test_a_table_of_cycles_of_a_curve_has_the_modulus_of_the_machine(
    small_fit: Fit, small_problem: Problem
) -> None:
    table = load_attenuation(ICE / "attenuation_twin.toml").to_be_solved()
    told = "E_M is mostly the stiffness of the apparatus"
    assert any(told in one for one in small_fit.predict(table, draws=2).cautions)
    apart = creep(small_problem.experiment, apparatus_compliance=Stated(1e-11, 0.0))
    for fitted in (table, apart):
        cautions = predict_test(prior_source(fitted), table).cautions
        assert not any(told in one for one in cautions)


def test_readings_need_a_noise_that_somebody_knows(small_fit: Fit, small_problem: Problem) -> None:
    readings = {
        "time": np.array([300.0, 900.0]),
        "reading_stage": np.array([0, 1]),
        "reading": np.array([1e-3, 2e-3]),
    }
    target = creep(small_problem.experiment, **readings)
    with pytest.raises(InputError, match="the file states none"):
        small_fit.predict(target, draws=5)
    prediction = small_fit.predict(replace(target, strain_uncertainty=1e-4), draws=20)
    assert "that the file of the test states, 0.01 % on average" in prediction.notes[-1]
    assert reading_table(prediction)["quantity"].tolist() == ["strain", "strain"]
    assert np.isfinite(score_table(prediction)["found"]).all()


def test_a_noise_that_the_fit_took_as_known_is_that_of_new_readings(small_problem: Problem) -> None:
    test = small_problem.experiment
    known = problem_of([test], with_fixed(small_problem.priors, {"stress_noise": 1e5}))
    values = {"stress_noise": np.full(4, 1e5)}
    for target in (test, test.to_be_solved()):
        found, notes = add_noises(values, known, target)
        np.testing.assert_array_equal(found["stress_noise"], 1e5)
        assert "of the fit, 0.1 MPa" in notes[0]


def test_scatters_of_a_table_are_told_without_a_unit_and_none_without_readings(
    small_problem: Problem,
) -> None:
    table = load_attenuation(ICE / "attenuation_twin.toml")
    fitted = one_test(table, resolved_priors(table))
    values = {"attenuation_scatter": np.full(4, 0.19), "modulus_scatter": np.full(4, 0.05)}
    _, notes = add_noises(values, fitted, table)
    assert notes[0] == (
        "New readings scatter by the scatter of ln tan delta of the fit, 0.19 on average."
    )
    curve = one_test(small_problem.experiment, small_problem.priors)
    _, notes = add_noises({"stress_noise": np.full(4, 1e5)}, curve, table.to_be_solved())
    assert notes[0] == (
        "The fit has no scatter of ln tan delta, so that new readings have no noise here."
    )


@pytest.fixture(scope="module")
def strained_and_loaded(small_fit: Fit, small_problem: Problem) -> Prediction:
    """A test that reads stress in its first stages and strain in the last."""
    stages = (
        Stage("strain_rate", 0.0, 100.0, 255.0, 1e-5),
        Stage("hold_strain", 100.0, 600.0, 255.0),
        Stage("stress", 600.0, 1200.0, 255.0, 1e6),
    )
    return small_fit.predict(creep(small_problem.experiment, stages=stages), draws=20)


def test_what_is_imposed_has_no_new_readings(strained_and_loaded: Prediction) -> None:
    table = band_table(strained_and_loaded)
    assert [one.name for one in answers(strained_and_loaded)] == ["stress", "strain"]
    # The start of the last stage is the second row at its time.
    loaded = np.arange(len(table)) >= np.flatnonzero(table["time_s"] == 600.0)[1]
    for column, read in (("stress_Pa", ~loaded), ("strain", loaded)):
        assert np.isfinite(table[f"{column}_q50"]).all()
        new = table[[f"new_{column}_q{q}" for q in QUANTILES]].to_numpy()
        assert np.isfinite(new[read]).all()
        assert np.isnan(new[~read]).all()
    shown = overview_table(strained_and_loaded)
    assert shown["new readings of stress"].iloc[-1] == "imposed"
    assert shown["new readings of strain"].iloc[0] == "imposed"
    assert "imposed" not in shown["new readings of strain"].iloc[-1]
    # Times are shown in the unit of the page.
    assert shown["time (min)"].iloc[-1] == "20"
    assert table["time_s"].iloc[-1] == 1200.0
    axes = prediction_figure(strained_and_loaded).axes[-1]
    assert axes.get_xlabel() == "time (min)"
    assert axes.get_xlim()[1] == pytest.approx(20.0, rel=0.02)


def test_strain_of_zero_and_apparatus_is_no_extrapolation(
    small_fit: Fit, small_problem: Problem
) -> None:
    def beyond(**own: Stated) -> list[str]:
        prediction = small_fit.predict(creep(small_problem.experiment, **own), draws=5)
        return [text for text in prediction.cautions if text.startswith("Beyond")]

    plain = beyond()
    stated = beyond(apparatus_compliance=Stated(1e-8, 0.0), strain_offset=Stated(0.5, 0.0))
    assert "temperature 255 K" in plain[0]
    assert stated == plain
    # The zero of the strain is that of the file.
    target = creep(small_problem.experiment, strain_offset=Stated(5e-3, 1e-3))
    drawn = small_fit.predict(target).posterior["posterior"]["strain_offset"].to_numpy()
    assert drawn.mean() == pytest.approx(5e-3, abs=3e-4)
    assert drawn.std() == pytest.approx(1e-3, rel=0.2)


def test_a_solution_leaves_out_what_belongs_to_another_apparatus(small_problem: Problem) -> None:
    values = {
        "maxwell_modulus": 4e9,
        "apparatus_compliance": 1e-10,
        "strain_offset": 1e-3,
        "temperature_error": 1.5,
        "stress_calibration_error": 0.02,
    }
    furnace = UncertainCondition("temperature_error", 2.0, "furnace A")
    cell = UncertainCondition("stress_calibration_error", 0.01, None)
    fitted = replace(small_problem.experiment, uncertain=(furnace, cell))
    other = creep(small_problem.experiment, uncertain=(furnace, cell))
    kept = {name: values[name] for name in ("maxwell_modulus", "temperature_error")}
    assert parameters_for_other_test(values, fitted, other) == (kept, [])
    # An apparatus without a name is that of one test alone.
    kept["stress_calibration_error"] = 0.02
    assert parameters_for_other_test(values, fitted, replace(other, id=fitted.id)) == (kept, [])
    alone = {"maxwell_modulus": 4e9}
    assert parameters_for_other_test(values, fitted, replace(other, uncertain=())) == (alone, [])


@pytest.mark.parametrize("protocol", ["loading_history", "constant_rate", "forced_oscillation"])
def test_a_test_of_one_temperature_has_the_modulus_there(
    small_problem: Problem, protocol: str
) -> None:
    table = load_attenuation(ICE.parent / "olivine" / "attenuation_A1802.toml")
    curve = small_problem.experiment
    tests = {one.protocol: one for one in (curve, creep(curve), load_forced_oscillation(TWIN_FILE))}
    hot = replace(tests[protocol], material="olivine", temperature=1473.15)
    values = {name: prior.location for name, prior in resolved_priors(table).priors.items()} | {
        "modulus_temperature_coefficient": -2.5e-4,
        "peak_strength": 0.1,
    }
    found, notes = parameters_for_other_test(values, table, hot)
    share = 1 - 2.5e-4 * (1473.15 - values["modulus_reference_temperature"])
    assert found["maxwell_modulus"] == pytest.approx(share * values["maxwell_modulus"], rel=1e-9)
    # The strain that is delayed stays as it was.
    assert found["peak_strength"] == pytest.approx(share * 0.1, rel=1e-9)
    assert notes == ["The Maxwell modulus is that at 1473.15 K in the whole test."]


@pytest.mark.parametrize("volume", [0.0, 1e-5])
def test_a_pressure_is_taken_only_where_a_rate_depends_on_it(
    small_problem: Problem, volume: float
) -> None:
    test = replace(small_problem.experiment, environment={"pressure": 3e8})
    priors = resolved_priors(test).with_(activation_volume=fixed(volume, "m3/mol"))
    prior = prior_draws(test, priors, draws=3, seed=1)
    problem, passed = one_test(test, priors), [conditions_of(test, prior.posterior)]
    source = Source(problem, {test.id: prior}, prior.posterior, passed, ())
    found = predict_test(source, replace(test, id="another", environment={}))
    told = "pressure not stated and taken as 0 MPa (fitted: 300)"
    assert any(told in caution for caution in found.cautions) == (volume > 0)


def test_cycles_that_outlast_every_curve_are_told_unless_a_table_was_fitted(
    small_problem: Problem,
) -> None:
    curve, table = small_problem.experiment, load_attenuation(ICE / "attenuation_twin.toml")
    (told,) = longer_than_tests({"period": (1.0, 1e9)}, [curve])
    assert told.startswith("Cycles of 1e+09 s last longer than any fitted test (")
    assert longer_than_tests({"period": (1.0, 1e9)}, [curve, table]) == ()
    assert longer_than_tests({"period": (1.0, 1.0)}, [curve]) == ()
