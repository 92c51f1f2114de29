"""Which test would decide a quantity: expected widths against exact ones, and what is refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from conftest import ICE, copy_of
from refusals import CommandLine
from scipy import stats

import pyburgers
from pyburgers.checks.fit_checks import CheckKind
from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.prediction import Prediction
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.conditions import hours_of
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.experiment import of_kind
from pyburgers.model.priors import default_priors
from pyburgers.predictions.design_plans import Candidate, DesignPlan
from pyburgers.predictions.designs import (
    FOLDS,
    ROUNDED_HOURS,
    _beyond,
    _largest_stress,
    _one_after_the_other,
    design,
    expected_width,
    places_read,
    share_told_apart,
    telling_combinations,
)

PLAN = ICE.parent / "designs" / "ice.toml"


def linear_tests(n: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Truths (n, 2), slopes (2, 9), covariance of correlated noise, solutions and readings."""
    rng = np.random.default_rng(3)
    truths = rng.multivariate_normal([0.0, 1.0], [[1.0, 0.7], [0.7, 2.0]], n)
    slopes = rng.normal(size=(2, 9))
    distance = np.abs(np.subtract.outer(np.arange(9), np.arange(9)))
    noise = 4.0 * np.exp(-distance / 3.0)
    solutions = truths @ slopes
    readings = solutions + rng.multivariate_normal(np.zeros(9), noise, n)
    return truths, slopes, noise, solutions, readings


def test_widths_of_a_linear_test_are_those_of_its_posterior() -> None:
    truths, slopes, noise, solutions, readings = linear_tests(20_000)
    prior = np.cov(truths.T)
    posterior = np.linalg.inv(np.linalg.inv(prior) + slopes @ np.linalg.inv(noise) @ slopes.T)
    features = telling_combinations("linear", solutions, readings, solutions)
    for k in range(2):
        expected = np.sqrt(posterior[k, k] / prior[k, k])
        assert expected_width(truths[:, k], features) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("k", [1, 80, 200])
def test_many_readings_of_few_draws_tell_no_more_than_they_hold(k: int) -> None:
    rng = np.random.default_rng(k)
    truth = rng.normal(size=200)
    solutions = np.tile(truth[:, np.newaxis], k)
    readings = solutions + np.sqrt(k / 3.0) * rng.normal(size=(200, k))
    features = telling_combinations("many", solutions, readings, solutions)
    assert expected_width(truth, features) == pytest.approx(0.5, abs=0.07)


def of_each_fold(features: FloatArray) -> list[FloatArray]:
    """Return features (n, k) that do not depend on the fold."""
    return [features] * FOLDS


def test_an_estimator_may_be_a_curve() -> None:
    truth, own = np.random.default_rng(4).normal(size=(2, 1000))
    features = 10.0 * np.column_stack([truth + own**2, own])
    assert expected_width(truth, of_each_fold(features)) < 0.01


def test_readings_of_noise_alone_narrow_nothing() -> None:
    rng = np.random.default_rng(1)
    features = of_each_fold(rng.normal(size=(1000, 12)))
    assert expected_width(rng.normal(size=1000), features) == 1.0


def test_laws_are_told_apart_as_often_as_their_distance_allows() -> None:
    rng = np.random.default_rng(2)
    apart = 1.5
    first, second = rng.normal(size=(2, 5000, 3))
    second[:, 1] += apart
    share = share_told_apart(of_each_fold(np.vstack([first, second])), 5000)
    assert share == pytest.approx(stats.norm.cdf(apart / 2), abs=0.015)
    same = of_each_fold(rng.normal(size=(4000, 3)))
    assert share_told_apart(same, 2000) == pytest.approx(0.5, abs=0.03)


def plan_for(fit: Fit) -> DesignPlan:
    """Return a plan with the fitted test again, twice, and a colder one that takes too long."""
    first = of_kind(fit.experiment, ConstantRateExperiment)
    again = replace(first.to_be_solved(), id="again")
    colder = replace(again, id="colder", temperature=again.temperature - 15.0)
    return DesignPlan(
        ("maxwell_modulus", "activation_enthalpy"),
        {
            "again": Candidate(again, fit.experiment.n_points, hours=1.0),
            "twice": Candidate(again, fit.experiment.n_points, hours=1.0),
            "colder": Candidate(colder, hours=30.0),
        },
        most_hours=10.0,
    )


def plan_of_one(fit: Fit) -> DesignPlan:
    """Return a plan with the fitted test again."""
    plan = plan_for(fit)
    return replace(plan, candidates={"again": plan.candidates["again"]})


def test_candidates_of_a_fit(small_fit: Fit) -> None:
    found = design(small_fit, plan_for(small_fit), draws=200, choose=2)
    widths = found.table[["maxwell_modulus_width", "activation_enthalpy_width"]]
    assert ((widths > 0) & (widths <= 1)).to_numpy().all()
    # The fitted test once more halves the variance, and its noise is not that of the first time.
    assert widths.loc["again"].to_numpy() == pytest.approx(np.sqrt(1 / 2), abs=0.15)
    assert found.together["maxwell_modulus_width"].iloc[1] == pytest.approx(
        np.sqrt(1 / 3), abs=0.12
    )
    assert found.table.loc["colder", "beyond_limits"] == "longer than 10 h"
    assert set(found.together["candidate"]) == {"again", "twice"}
    assert any("temperature 245 K" in caution for caution in found.cautions)


def test_a_law_is_not_told_from_itself(small_fit: Fit, tmp_path: Path) -> None:
    again = copy_of(small_fit, tmp_path / "again")
    found = design(small_fit, plan_of_one(small_fit), against=again, draws=200)
    assert found.table["told_apart"].to_numpy() == pytest.approx(0.5, abs=0.12)
    assert len({*found.cautions}) == len(found.cautions)
    assert not any(caution.startswith("again: ") for caution in found.cautions)


def test_doubts_about_the_fit_of_the_other_law_are_said(long_fit: Fit, small_fit: Fit) -> None:
    found = design(long_fit, plan_of_one(long_fit), against=small_fit, draws=200)
    badly_sampled = small_fit.verdicts()[CheckKind.SAMPLING].sentence
    assert f"{small_fit.directory.path.name}: {badly_sampled}" in found.cautions


def test_designs_that_cannot_be_judged_are_refused(small_fit: Fit, separate_joint: Fit) -> None:
    plan = plan_for(small_fit)
    with pytest.raises(InputError, match="stress_exponent: is fixed in the fit"):
        design(small_fit, replace(plan, about=("stress_exponent",)))
    with pytest.raises(InputError, match="stress_noise: is a parameter of the residuals"):
        design(small_fit, replace(plan, about=("stress_noise",)))
    with pytest.raises(InputError, match="differs between the tests"):
        design(separate_joint, plan)
    with pytest.raises(InputError, match="found 20, expected at least 200"):
        design(small_fit, plan, draws=20)
    bare: Any = plan.candidates["again"].experiment
    refused: list[tuple[str, Any, Any, dict[str, Any]]] = [
        ("fit: found '.*', expected a fit", str(small_fit.directory.path), plan, {}),
        ("plan: found PosixPath, expected a plan", small_fit, PLAN, {}),
        (
            "again: found .*, expected a pyburgers",
            small_fit,
            replace(plan, candidates={"again": bare}),
            {},
        ),
        ("against: found PosixPath, expected a fit", small_fit, plan, {"against": PLAN}),
        ("draws: found '400', expected a whole number", small_fit, plan, {"draws": "400"}),
    ]
    for said, fit, of, others in refused:
        with pytest.raises(InputError, match=said):
            design(fit, of, **others)
    counts: dict[str, Any] = {"found 0, expected at least 1": 0, "a whole number": 1.5}
    for said, n_readings in counts.items():
        with pytest.raises(InputError, match=f"n_readings: .*{said}"):
            Candidate(bare, n_readings=n_readings)
    for seed in (-1, 2**31 - 6):
        with pytest.raises(InputError, match=rf"seed is {seed}, expected .* to 2147483641"):
            design(small_fit, plan, seed=seed)


def test_laws_are_told_apart_by_fits_of_the_same_data(small_fit: Fit, other_fit: Fit) -> None:
    for against, said in ((small_fit, "found the run itself"), (other_fit, "of other data than")):
        with pytest.raises(InputError, match=said):
            design(small_fit, plan_for(small_fit), against=against, draws=200)


def test_a_plan_is_doubted_where_it_does_not_go_with_its_tests(small_fit: Fit) -> None:
    plan = plan_for(small_fit)
    test = of_kind(plan.candidates["again"].experiment, ConstantRateExperiment)
    lasts = hours_of(test)
    again = Candidate(replace(test, stress_uncertainty=5e6), 100, hours=lasts / 2)
    plan = replace(plan, candidates={"again": again}, most_hours=0.9 * lasts)
    found = design(small_fit, plan, draws=200)
    assert found.table.loc["again", "beyond_limits"] == f"longer than {0.9 * lasts:.3g} h"
    assert found.cautions[:3] == (
        "again: stress_uncertainty_MPa is not used, because new readings have the noise of the "
        "fit.",
        "again: readings is 100, but stress is solved at 59 places, which are all read.",
        f"again: hours is {lasts / 2:.3g}, but the test lasts {lasts:.3g} h.",
    )


def test_a_further_test_widens_nothing() -> None:
    rng = np.random.default_rng(1)
    truth = {"beta": rng.normal(size=200)}
    tells = truth["beta"][:, np.newaxis] + rng.normal(size=(200, 1))
    features = {
        "tells": of_each_fold(tells),
        "noise": of_each_fold(rng.normal(size=(200, 12))),
    }
    alone, both = _one_after_the_other(truth, features, [*features], 2)["beta_width"]
    assert both <= alone


def test_a_single_reading_is_the_last() -> None:
    assert places_read(5, 1).tolist() == [4]
    assert places_read(5, 2).tolist() == [0, 4]


def test_command(small_fit: Fit, tmp_path: Path, cli: CommandLine) -> None:
    plan = tmp_path / "plan.toml"
    again = PLAN.parent / "again.toml"
    plan.write_text(
        f'about = ["maxwell_modulus"]\n[candidates.again]\nfile = "{again}"\n', encoding="utf-8"
    )
    out = tmp_path / "design.csv"
    run = str(small_fit.directory.path)
    arguments = ["design", run, "--candidates", str(plan), "--draws", "200", "--out", str(out)]
    assert "over its width now" in cli(*arguments)
    assert out.is_file()
    assert (tmp_path / "design_together.csv").is_file()
    cli(*arguments[:-1], tmp_path / "design.txt", code=2)


CREEP = """
id = "creep"
material = "ice"
protocol = "loading_history"
temperature_K = 260.0
initial_grain_size_m = 230e-6

[[stages]]
control = "stress"
start_time = 0.0
end_time = 600.0
stress = 8e6

[provenance]
kind = "synthetic"
source = "A test that may be done."
"""


def test_a_quantity_that_the_fit_has_not_read_needs_an_uncertainty_in_the_plan(
    small_fit: Fit, tmp_path: Path
) -> None:
    (tmp_path / "creep.toml").write_text(CREEP, encoding="utf-8")

    def plan(stated: str, file: Path = tmp_path / "creep.toml") -> DesignPlan:
        path = tmp_path / "plan.toml"
        text = f'about = ["maxwell_modulus"]\n[candidates.new]\nfile = "{file}"\n{stated}\n'
        path.write_text(text, encoding="utf-8")
        return pyburgers.load_design_plan(path)

    with pytest.raises(InputError, match="expected strain_uncertainty or stress_uncertainty_MPa"):
        design(small_fit, plan(""), draws=200)
    widths = [
        design(small_fit, plan(f"strain_uncertainty = {stated}"), draws=200)
        .table["maxwell_modulus_width"]
        .item()
        for stated in (1e-6, 1e-2)
    ]
    assert widths[0] < 0.5 < 0.9 < widths[1]
    weak = CREEP.replace("8e6", "8")
    (tmp_path / "weak.toml").write_text(weak, encoding="utf-8")
    found = design(small_fit, plan("strain_uncertainty = 1e-6", tmp_path / "weak.toml"), draws=200)
    assert found.cautions[0] == (
        "new: creep: a largest stress of 8 Pa is unlikely; check its unit."
    )
    assert not any("not used" in caution for caution in found.cautions)
    with pytest.raises(
        InputError, match=r"candidates.new: found strain_uncertainty, expected none"
    ):
        plan("strain_uncertainty = 1e-4", PLAN.parent / "again.toml")


@pytest.mark.parametrize("file", ["ice", "olivine", "dunite"])
def test_stated_hours_of_shipped_plans_are_no_shorter_than_the_tests(file: str) -> None:
    plan = pyburgers.load_design_plan(PLAN.with_stem(file))
    assert len(plan.candidates) >= 6
    for one in plan.candidates.values():
        lasts = hours_of(one.experiment)
        assert one.hours is not None
        assert 0 < ROUNDED_HOURS * lasts <= one.hours


def test_limits_are_read() -> None:
    assert pyburgers.load_design_plan(PLAN).largest_stress == 30e6


@pytest.mark.parametrize(("stated", "limited"), [(True, "stress above 0.5 MPa"), (False, "")])
def test_a_table_without_stated_stresses_exceeds_no_stress(stated: bool, limited: str) -> None:
    table = load_attenuation(ICE / "attenuation_twin.toml")
    conditions = table.conditions
    amplitude = conditions.amplitude if stated else np.zeros(conditions.n_rows)
    table = replace(table, conditions=replace(conditions, amplitude=amplitude))
    tree = xr.DataTree.from_dict({"predictions": xr.Dataset(), "posterior": xr.Dataset()})
    priors = default_priors("ice", "attenuation")
    stress = _largest_stress(Prediction(table, priors, tree, "fit", (), ()))
    plan = DesignPlan(("kelvin_modulus",), {}, largest_stress=0.5e6)
    assert _beyond(plan, Candidate(table), stress) == limited
