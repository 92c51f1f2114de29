"""A curve at constant rate and a table of attenuation of one material, fitted together."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ICE, search_little, with_fixed
from history_twins import history_twin
from page import html_of
from truths import truth_of

from pyburgers.cmdstan.program import load_program
from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.comparison.by_tests import compare_by_test
from pyburgers.fitting.charts_at_modes import at_mode
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.constant_rate.likelihood import LIKELIHOOD as CONSTANT_RATE
from pyburgers.kinds.loading_history.valley import LoadingHistoryValley
from pyburgers.kinds.problem import Problem, one_test, problem_of
from pyburgers.kinds.program_data import (
    chart_block,
    density_of,
    given_parameters,
    program_data,
    values_of_test,
)
from pyburgers.kinds.stan_data import Mode, SolverOptions
from pyburgers.kinds.together import default_priors_for, pooling_for
from pyburgers.model.prior_families import is_fixed_at
from pyburgers.model.priors import PriorSet
from pyburgers.page.joint_section import joint_sections, pooling_table
from pyburgers.predictions.attenuation import predict_attenuation
from pyburgers.predictions.exports import export
from pyburgers.predictions.stress_cycles import Regime
from pyburgers.sampling.options import SamplerOptions

TIGHT = SolverOptions(tolerance=1e-12, max_num_steps=1_000_000)

ONE_MODULUS = {"maxwell_modulus": "shared"}
"""Pooling in which a table has nothing of its own."""


def curve() -> ConstantRateExperiment:
    """A part of the synthetic curve."""
    twin = load_constant_rate(ICE / "curve_beside_attenuation_twin.toml")
    return replace(twin, strain=twin.strain[::6], stress=twin.stress[::6])


def table() -> AttenuationExperiment:
    return load_attenuation(ICE / "attenuation_twin.toml")


def priors() -> PriorSet:
    return default_priors_for([curve(), table()])


def both(pool: dict[str, str] | None = None) -> Problem:
    experiments = [table(), curve()]
    return problem_of(experiments, priors(), pooling_for(experiments, pool))


def evaluated(problem: Problem, coordinate: FloatArray, **chart: object) -> dict[str, FloatArray]:
    data = {**program_data(problem, solver=TIGHT), **chart}
    return load_program(problem.likelihood.program).evaluate(
        data, {"coordinate": coordinate.tolist()}
    )


def test_a_table_shares_flow_law_and_kelvin_part_and_has_no_microstructure() -> None:
    problem = both()
    # Histories come first and the table stays one.
    assert problem.likelihood.name == "loading_history"
    assert [one.protocol for one in problem.experiments] == ["loading_history", "attenuation"]
    assert isinstance(problem.experiments[1], AttenuationExperiment)
    # Priors of both kinds come with the package.
    found = priors()
    assert not found["critical_strain_fabric"].is_fixed
    assert not is_fixed_at(found["attenuation_scatter"], 0.0)
    assert default_priors_for([curve()]).title != found.title
    assert {"stress_exponent", "kelvin_modulus", "kelvin_viscosity"} <= set(problem.shared)
    assert problem.kind("maxwell_modulus") == "separate"
    assert not problem.partial  # one test alone has a grain size that evolves
    names, own = problem.layout.names, problem.layout.own[1]
    assert [names[i] for i in own] == ["maxwell_modulus"]
    assert not problem.has_effect("critical_strain_fabric", 1)
    assert problem.owner("critical_strain_fabric", 1) == problem.experiments[0].id
    seen = problem.by_effect()
    assert "critical_strain_fabric" in seen[0].free
    assert "critical_strain_fabric" not in seen[1].free
    assert pooling_for([curve(), table()], {"all": "shared"}).kinds["maxwell_modulus"] == "shared"


def test_laws_that_no_table_has_are_refused() -> None:
    power_law = with_fixed(priors(), {"kelvin_stress_exponent": 2.0})
    with pytest.raises(InputError, match="kelvin=power_law is not for tests of the protocol att"):
        problem_of([curve(), table()], power_law, pooling_for([curve(), table()]))


@pytest.mark.usefixtures("programs")
@pytest.mark.parametrize("seed", [1, 2])
def test_the_density_is_that_of_the_curve_and_that_of_the_table(seed: int) -> None:
    """Point by point, each of its own program; priors count once."""
    problem = both(ONE_MODULUS)
    history = problem.experiments[0]
    position = 0.3 * np.random.default_rng(seed).standard_normal(problem.layout.size)
    joint = evaluated(problem, position)
    curve_alone = evaluated(problem_of([history], priors()), position)
    values = given_parameters("ice", values_of_test(joint["parameter"], 1))
    table_alone = evaluated(one_test(problem.experiments[1], values), np.empty(0))
    n = history.n_points
    np.testing.assert_allclose(joint["log_lik"][:n], curve_alone["log_lik"], rtol=1e-8)
    np.testing.assert_allclose(joint["log_lik"][n:], table_alone["log_lik"], rtol=1e-8)
    np.testing.assert_allclose(
        joint["response_model"][n:], table_alone["response_model"], rtol=1e-12
    )
    assert joint["log_density"] == pytest.approx(
        curve_alone["log_density"] + table_alone["log_lik"].sum(), rel=1e-10
    )


FREE = (
    "maxwell_modulus",
    "kelvin_modulus",
    "activation_enthalpy",
    "stress_noise",
    "modulus_scatter",
)


@pytest.fixture(scope="module")
def fitted(programs: None, tmp_path_factory: pytest.TempPathFactory) -> Fit:
    truth = truth_of(curve())
    known = {name: truth[name] for name in priors().free if name not in FREE}
    with pytest.MonkeyPatch.context() as patch:
        search_little(patch)
        return fit(
            [curve(), table()],
            with_fixed(priors(), known),
            out=tmp_path_factory.mktemp("both") / "run",
            options=SamplerOptions(chains=2, warmup=100, draws=60, seed=3, adapt_delta=0.8),
        )


def test_a_fit_says_of_each_what_it_would_by_itself(fitted: Fit) -> None:
    names = [experiment.id for experiment in fitted.problem.experiments]
    of_curve, of_table = (fitted[name] for name in names)
    assert f"stress_noise[{names[0]}]" in fitted.summary().index
    assert "stress_noise" in of_curve.summary().index
    assert "stress_noise" not in of_table.summary().index
    for one in (of_curve, of_table):
        truth = truth_of(one.experiment)
        draws = one.posterior["posterior"]
        for name in ("maxwell_modulus", "kelvin_modulus", "activation_enthalpy"):
            assert abs(float(draws[name].mean()) - truth[name]) < 4 * float(draws[name].std())
    assert of_table.posterior.attrs["protocol"] == "attenuation"
    assert of_curve.posterior.attrs["protocol"] == "loading_history"
    residual = of_table.posterior["model_response"]["log_reading"].mean(("chain", "draw"))
    assert np.std(residual.to_numpy() - of_table.experiment.response) < 0.1
    assert set(fitted.manifest["coordinates"]) >= {"system"}


def test_it_is_read_back_and_predicts_attenuation_and_a_table(fitted: Fit) -> None:
    again = Fit.load(fitted.directory.path)
    name = table().id
    cycles = predict_attenuation(again[name], [1e-3, 1e-1], [Regime(1e6, 0.17e6)])
    assert np.isfinite(cycles["tan_delta"]).all()
    predicted = again.predict(replace(table(), id="again"), draws=20, separate_from=name)
    new = predicted.posterior["model_response"]["log_reading"].to_numpy()[0]
    assert np.std(new.mean(axis=0) - table().response) < 0.1


def test_a_table_has_no_steady_state_of_a_microstructure_that_evolves(fitted: Fit) -> None:
    of_curve, of_table = fitted[curve().id], fitted[table().id]
    for of_test, is_told in ((of_curve, True), (of_table, False)):
        content = json.loads(*export(of_test, "json"))
        assert ("steady" in content["microstructure"]) is is_told
    with pytest.raises(InputError, match="evolving grain size and fabric of the fit"):
        export(of_table, "aspect")
    size: dict[str, Any] = {"grain_size": 1e-4}
    for given, wanted in (({}, "--grain-size-um and --fabric"), (size, "--fabric")):
        with pytest.raises(InputError, match=f"{table().id} tells nothing, expected {wanted}"):
            export(of_table, "aspect", microstructure="steady_state", **given)
    assert export(of_table, "aspect", microstructure="steady_state", fabric_factor=0.7, **size)
    with pytest.raises(InputError, match="found 'steady_state'"):
        predict_attenuation(of_table, [1e-3], [Regime(1e6, 1e5)], microstructure="steady_state")


@pytest.mark.usefixtures("sketched")
def test_it_has_a_page(fitted: Fit, tmp_path: Path) -> None:
    extras = joint_sections([fitted], [])
    html = html_of([*fitted.tests().values()], tmp_path / "page", joints=[fitted], extras=extras)
    assert table().id in html
    shown = pooling_table(fitted)
    microstructure_and_noise = shown[shown["quantity"] == "stress_noise"]
    assert list(microstructure_and_noise["test"]) == [curve().id]


@pytest.mark.slow
def test_each_is_left_out(fitted: Fit) -> None:
    (found,) = compare_by_test({"fit": fitted}, command="test").results.values()
    assert set(found.tests) == {curve().id, table().id}
    assert np.isfinite(found.elpd).all()


@pytest.mark.usefixtures("programs")
def test_gradients_are_those_of_the_density() -> None:
    problem = both()
    density = density_of(problem, SolverOptions(1e-11, 1_000_000))
    rng = np.random.default_rng(4)
    position, along = 0.3 * rng.standard_normal((2, problem.layout.size))
    (gradient,) = density.gradients(position[np.newaxis])
    step = 1e-4
    high, low = (
        evaluated(problem, position + sign * step * along)["log_density"] for sign in (1, -1)
    )
    assert gradient @ along == pytest.approx((high - low) / (2 * step), rel=1e-5)


@pytest.mark.usefixtures("programs")
def test_valley_coordinates_of_the_curve_leave_the_table_alone() -> None:
    """With nothing of its own the table adds its likelihood, in whatever coordinates."""
    problem = both(ONE_MODULUS)
    alone = problem_of([CONSTANT_RATE.as_history(curve())], priors())
    truth = truth_of(curve())
    plain = alone.coordinates[0]
    # Any point does as the reference: the curve's truth.
    known = given_parameters("ice", truth)
    at_truth = evaluated(one_test(alone.experiments[0], known), np.empty(0))
    reference_rate = {"reference_flow_rate": float(np.exp(at_truth["log_reference"][0]))}
    mode = Mode(
        values_of_test(at_truth["parameter"], 0),
        plain.at({**truth, **reference_rate}),
        np.empty(0),
    )
    reference, _ = LoadingHistoryValley().reference(at_mode(alone, mode, TIGHT))
    position = 0.2 * np.random.default_rng(5).standard_normal(alone.layout.size)
    curve_alone = evaluated(alone, position, **chart_block(alone, [reference]))
    joint = evaluated(problem, position, **chart_block(problem, [reference, None]))
    n = alone.experiments[0].n_points
    np.testing.assert_allclose(joint["parameter"][0], curve_alone["parameter"][0], rtol=1e-10)
    assert joint["log_density"] == pytest.approx(
        curve_alone["log_density"] + joint["log_lik"][n:].sum(), rel=1e-9
    )


@pytest.mark.usefixtures("programs")
def test_a_table_takes_no_part_in_partial_pooling() -> None:
    """Of three tests two have a steady-state grain size."""
    creep = replace(history_twin("creep", 8), id="creep")
    experiments = [curve(), creep, table()]
    pooling = pooling_for(experiments, ONE_MODULUS)
    assert pooling.kinds["steady_state_grain_size"] == "partial"
    three = problem_of(experiments, priors(), pooling)
    two = problem_of(experiments[:2], priors(), pooling)
    assert three.layout.size == two.layout.size
    position = 0.3 * np.random.default_rng(6).standard_normal(two.layout.size)
    joint, without = evaluated(three, position), evaluated(two, position)
    n = two.experiments[0].n_points + two.experiments[1].n_points
    assert joint["log_density"] == pytest.approx(
        without["log_density"] + joint["log_lik"][n:].sum(), rel=1e-10
    )
