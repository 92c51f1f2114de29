"""Tests of several protocols fitted together, as loading histories that share a flow law."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from conftest import ICE, search_little, with_fixed
from history_twins import GRAIN_SIZE, TEMPERATURE, TRUTH, history_twin
from matplotlib.container import ErrorbarContainer
from page import html_of

from pyburgers.comparison.by_tests import compare_by_test
from pyburgers.comparison.same_data import data_hash
from pyburgers.drawing.views.loading_history import response, softening
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, RateSegment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.experiment import Experiment, MeasuredMicrostructure
from pyburgers.kinds.forward import simulate_data
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.problem import of_one_program, problem_of
from pyburgers.model.parameters import PIEZOMETER
from pyburgers.model.pooling import pooling_of
from pyburgers.model.priors import PriorSet, default_priors, load_priors, save_priors
from pyburgers.model.variants import variant_of, with_variant
from pyburgers.page.joint_section import joint_sections, pooling_table
from pyburgers.page.posterior_figures import figures_for
from pyburgers.sampling.options import SamplerOptions

FREE = ("maxwell_modulus", "activation_enthalpy", "stress_noise")
"""Of the material; noise and drift of strain readings are free as well."""

OPTIONS = SamplerOptions(chains=2, warmup=40, draws=20, seed=11, adapt_delta=0.8, max_treedepth=4)

SIZE_AND_FABRIC = ("steady_state_grain_size", "steady_state_fabric_factor")


def after_creep() -> tuple[MeasuredMicrostructure, ...]:
    return (
        MeasuredMicrostructure(0.05, 160e-6, 8e-6),
        MeasuredMicrostructure(None, 105e-6, 5e-6, 0.74, 0.03, time=4000.0),
    )


def constant_rate_test(name: str = "curve", rate: float = 1e-4) -> ConstantRateExperiment:
    """A short curve of the material of the twins."""
    strain = np.geomspace(5e-4, 0.02, 15)
    template = replace(
        load_constant_rate(ICE / "PIL40.toml"),
        id=name,
        temperature=TEMPERATURE,
        initial_grain_size=GRAIN_SIZE,
        segments=(RateSegment(0.0, rate),),
        strain=strain,
        stress=np.full_like(strain, 5e6),
        final_strain=0.02,
    )
    values = {name: value for name, value in TRUTH.items() if "residual" not in name}
    return simulate_data(template, values, np.random.default_rng(3), source="a test")


def known_priors() -> PriorSet:
    known = {n: v for n, v in TRUTH.items() if n in default_priors("ice").free and n not in FREE}
    return with_fixed(default_priors("ice"), known)


def three_tests() -> list[Experiment]:
    return [constant_rate_test(), history_twin("creep", 12), history_twin("relaxation", 8)]


def test_residuals_of_others_hang_together_over_times_of_their_own_as_before(
    tmp_path: Path,
) -> None:
    """The joint fit and the one without it have one model of the tests that both have."""
    curves = [constant_rate_test(), constant_rate_test("slow", 1e-6)]
    problem = problem_of([*curves, history_twin("creep", 12)], known_priors(), pooling_of())
    left = problem.without("creep")
    for own, before in zip(left.priors, problem.priors[:2], strict=True):
        assert {name for name in own.free if name.startswith("residual_correl")} == {
            "residual_correlation_time",
            "residual_correlated_share",
        }
        assert {name: own[name] for name in own.free} == {name: before[name] for name in own.free}
    times = [own["residual_correlation_time"] for own in left.priors]
    assert times == [own["residual_correlation_time"] for own in problem.priors[:2]]
    assert times[1].location == 100 * times[0].location
    save_priors(left.given_priors, tmp_path / "priors.toml")
    again = problem_of(left.experiments, load_priors(tmp_path / "priors.toml"), left.pooling)
    assert [own.priors for own in again.priors] == [own.priors for own in left.priors]
    stated = known_priors().exchanging(problem.priors[0]["residual_correlation_time"])
    left = problem_of([*curves, history_twin("creep", 12)], stated, pooling_of()).without("creep")
    assert {own["residual_correlation_time"].location for own in left.priors} == {times[0].location}


@pytest.mark.parametrize("law", ["constant", "piezometric"])
def test_grains_that_a_variant_keeps_stay_as_they_are_in_each_test(law: str) -> None:
    fine = constant_rate_test()
    coarse = replace(constant_rate_test("coarse"), initial_grain_size=3.0 * fine.initial_grain_size)
    priors = default_priors("ice")
    if law == "piezometric":
        of_olivine = default_priors("olivine")
        priors = priors.exchanging(*(of_olivine[name] for name in PIEZOMETER))
    problem = problem_of([fine, coarse], with_variant(priors, fine, {"grain_size": law}))
    left = problem.without(fine.id)
    for test, own in zip(
        (*problem.experiments, coarse), (*problem.priors, left.priors[0]), strict=True
    ):
        assert variant_of(own, test).grain_size == law
        assert own["steady_state_grain_size"].location == test.initial_grain_size


@pytest.fixture(scope="module")
def mixed(programs: None, tmp_path_factory: pytest.TempPathFactory) -> Fit:
    """A curve and creep of one material, whose grains were measured."""
    known = {n: v for n, v in TRUTH.items() if n in default_priors("ice").free}
    priors = with_fixed(
        default_priors("ice"),
        {name: v for name, v in known.items() if name not in (*SIZE_AND_FABRIC, *FREE)},
    )
    curve, creep, _ = three_tests()
    at_end = MeasuredMicrostructure(0.02, 180e-6, 9e-6)
    tests = [
        replace(curve, microstructure=(at_end,)),
        replace(creep, microstructure=after_creep()),
    ]
    out = tmp_path_factory.mktemp("mixed") / "run"
    pool = dict.fromkeys(SIZE_AND_FABRIC, "shared")
    with pytest.MonkeyPatch.context() as patch:
        search_little(patch)
        return fit(tests, priors, out=out, pool=pool, options=OPTIONS)


def test_tests_of_several_protocols_become_histories() -> None:
    curves = [constant_rate_test(), constant_rate_test("other", 1e-5)]
    assert of_one_program(curves) == tuple(curves)  # of one kind
    experiments = three_tests()
    problem = problem_of(experiments, known_priors(), pooling_of())
    assert problem.likelihood.name == "loading_history"
    curve = problem.experiments[0]
    assert isinstance(curve, HistoryExperiment)
    np.testing.assert_array_equal(curve.response, experiments[0].response)
    assert problem.experiments[1] is experiments[1]
    assert set(problem.shared) == {"maxwell_modulus", "activation_enthalpy"}
    assert {"stress_noise", "strain_noise"} <= set(problem.free)


def test_the_flow_law_is_one_and_the_noises_are_not(mixed: Fit) -> None:
    draws = {name: test.posterior["posterior"].to_dataset() for name, test in mixed.tests().items()}
    assert list(draws) == ["curve", "creep"]
    for name in ("maxwell_modulus", "activation_enthalpy"):
        shared = draws["curve"][name]
        np.testing.assert_array_equal(shared, draws["creep"][name])
        assert abs(float(shared.mean()) - TRUTH[name]) < 4 * float(shared.std())
    assert not np.array_equal(draws["curve"]["stress_noise"], draws["creep"]["stress_noise"])
    assert draws["creep"]["strain_noise"].mean() == pytest.approx(TRUTH["strain_noise"], rel=0.7)


def test_it_is_read_back_and_predicts_a_test_of_either_kind(mixed: Fit) -> None:
    again = Fit.load(mixed.directory.path)
    assert again.problem.name == "curve+creep"
    slower = again.predict(constant_rate_test("slower", 1e-5), draws=20, separate_from="curve")
    new = slower.posterior["posterior_predictive"]["stress"].to_numpy()[0]
    assert np.mean(np.abs(new.mean(axis=0) - slower.experiment.response)) < 3e5
    unload = again.predict(history_twin("load and unload", 8), draws=20, separate_from="creep")
    strain = unload.posterior["model_response"]["response"].to_numpy()[0]
    np.testing.assert_allclose(
        np.median(strain, axis=0)[-1], unload.experiment.response[-1], rtol=0.1
    )


def test_new_readings_have_the_noise_of_tests_that_read_the_quantity(mixed: Fit) -> None:
    """And not that of tests which do not read it: there it has its prior."""
    draws = {name: test.posterior["posterior"].to_dataset() for name, test in mixed.tests().items()}
    found = mixed.predict(history_twin("load and unload", 8), draws=20)
    own = draws["creep"]["strain_noise"]
    used = found.posterior["posterior"].to_dataset()["strain_noise"]
    assert np.isin(used.to_numpy().ravel(), own.to_numpy().ravel().astype(np.float64)).all()
    assert not any("the fit has no" in note for note in found.notes)


@pytest.mark.usefixtures("little_search")
def test_a_noise_that_a_separate_fit_takes_as_known_has_no_width_beside_it(
    mixed: Fit, tmp_path: Path
) -> None:
    creep = mixed["creep"].experiment
    alone = fit(creep, mixed.problem.given_priors, out=tmp_path / "alone", options=OPTIONS)
    assert alone.priors["stress_noise"].is_fixed
    table = pooling_table(mixed, [alone])
    ratios = table[table["test"] == "creep"].set_index("quantity")["sd_ratio"].dropna()
    assert "maxwell_modulus" in ratios
    assert "stress_noise" not in ratios


def test_measured_microstructure_of_both_kinds_counts(mixed: Fit) -> None:
    posterior = mixed.posterior
    group = posterior["microstructure"].to_dataset()
    np.testing.assert_array_equal(group["strain"], [0.02, 0.05, np.nan])
    np.testing.assert_array_equal(group["time"], [np.nan, np.nan, 4000.0])
    np.testing.assert_allclose(group["measured"][:, 1], [np.nan, np.nan, 0.74])
    creep = mixed["creep"].posterior["microstructure"].to_dataset()
    assert creep["section"].size == 2
    for quantity, index in (("grain_size", 0), ("fabric_factor", 1)):
        model = creep["model"].sel(quantity=quantity).isel(section=index)
        replicated = creep["replicated"].sel(quantity=quantity).isel(section=index)
        assert np.ptp(replicated.to_numpy()) > np.ptp(model.to_numpy())
    again = Fit.load(mixed.directory.path)
    assert again.problem.experiments[1].microstructure == mixed["creep"].experiment.microstructure
    # Densities of grain sizes in metres, if they were counted once alone, would be several.
    assert abs(float(mixed.posterior["sample_stats"]["solver_log_ratio"].max())) < 0.5
    unloaded = replace(history_twin("load and unload", 8), microstructure=after_creep()[1:])
    predicted = mixed.predict(unloaded, draws=20, separate_from="creep")
    assert predicted.experiment.microstructure == after_creep()[1:]


def test_where_it_was_measured_is_part_of_the_data(mixed: Fit) -> None:
    creep = mixed["creep"]
    group = creep.posterior["microstructure"].to_dataset()
    moved = creep.posterior.copy()
    moved["microstructure"] = xr.DataTree(group.assign_coords(time=group["time"] - 1.0))
    assert data_hash(replace(creep, posterior=moved)) != data_hash(creep)


def test_it_is_drawn_along_time_with_what_was_measured(mixed: Fit) -> None:
    creep = mixed["creep"]
    assert "softening" in [recipe.name for recipe in figures_for(creep)]
    grains, fabric, *_ = softening(creep).axes
    (bars,), (factors,) = grains.containers, fabric.containers
    assert isinstance(bars, ErrorbarContainer)
    assert isinstance(factors, ErrorbarContainer)
    path_strain = creep.posterior["predictions"]["path_strain"].median(("chain", "draw"))
    time = creep.posterior["predictions"]["time"]
    reached = np.interp(0.05, path_strain, time)
    at = np.asarray(bars.lines[0].get_xdata())
    np.testing.assert_allclose(at / at[1], [reached / 4000.0, 1.0], rtol=1e-6)
    assert grains.get_xlabel().startswith("time (")
    np.testing.assert_allclose(np.asarray(bars.lines[0].get_ydata()), [160.0, 105.0])
    np.testing.assert_allclose(np.asarray(factors.lines[0].get_ydata()), [0.74])
    assert grains.get_xlim()[1] == pytest.approx(at[1])


def test_recovery_that_dies_away_does_not_stretch_the_axis_of_rates(mixed: Fit) -> None:
    creep = mixed["creep"]
    dying = creep.posterior.copy()
    group = dying["predictions"].to_dataset()
    rate = abs(group["strain_rate"]).median(("chain", "draw"))
    back = np.where(np.arange(rate.size) < rate.size // 2, rate, -1e-12 * rate)
    dying["predictions"] = xr.DataTree(
        group.assign(strain_rate=0 * group["strain_rate"] + xr.DataArray(back, dims=rate.dims))
    )
    (axes,) = (
        one
        for one in response(replace(creep, posterior=dying)).axes
        if "rate" in one.get_title("left")
    )
    assert axes.get_ylim()[0] == pytest.approx(1e-3 * back[back > 0].min(), rel=1e-4)


def test_no_softening_is_drawn_where_nothing_evolves(mixed: Fit) -> None:
    creep = mixed["creep"]
    still = with_variant(
        creep.priors, creep.experiment, {"grain_size": "constant", "fabric": "constant"}
    )
    still_fit = SimpleNamespace(
        experiment=replace(creep.experiment, microstructure=()),
        priors=still,
        posterior=creep.posterior,
    )
    names = [recipe.name for recipe in figures_for(still_fit)]
    assert names == ["history", "prior_posterior", "response", "pairs", "rank"]


@pytest.mark.usefixtures("sketched")
def test_the_page_has_all_tests_and_what_was_measured(mixed: Fit, tmp_path: Path) -> None:
    extras = joint_sections([mixed], [])
    text = html_of([*mixed.tests().values()], tmp_path / "page", joints=[mixed], extras=extras)
    assert "fabric factor 0.740 ± 0.030 at 66.7 min" in text
    assert "160.0 ± 8.0 µm at a path strain of 5 %" in text
    assert "Softening by grain size and fabric" in text
    assert "at the end grains have" in text


@pytest.mark.slow
def test_each_test_is_left_out(programs: None, tmp_path: Path) -> None:
    """Of a fit with the eight draws for each coordinate that a marginal likelihood takes."""
    longer = replace(OPTIONS, warmup=60, draws=60, max_treedepth=5)
    result = fit(three_tests(), known_priors(), out=tmp_path / "run", options=longer)
    (found,) = compare_by_test({"fit": result}, command="test").results.values()
    assert found.tests == ("creep", "curve", "relaxation")
    assert np.isfinite(found.elpd).all()
