"""Measured microstructure of loading histories: its density against independent solutions."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import history_oracle
import numpy as np
import numpy.typing as npt
import pytest
from history_oracle import FABRIC, GRAINS, PATH
from history_twins import TRUTH, history_twin
from log_density import program_with
from scipy import stats
from stan_data import one_test_data, parameters_in
from truth_as_mode import at_truth

from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.kinds.experiment import MeasuredMicrostructure
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stan_data import leg_of_times
from pyburgers.kinds.loading_history.valley import LoadingHistoryValley
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import given_parameters
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.priors import default_priors

FloatArray = npt.NDArray[np.float64]
pytestmark = pytest.mark.usefixtures("programs")

TIGHT = SolverOptions(tolerance=1e-11, max_num_steps=1_000_000)
SECTIONS = {
    "creep": (
        MeasuredMicrostructure(None, 150e-6, 8e-6, time=2500.0),
        MeasuredMicrostructure(None, 120e-6, 5e-6, 0.7, 0.05, time=4000.0),
    ),
    # One at the jump to the second stage, before it.
    "load and unload": (
        MeasuredMicrostructure(0.02, 200e-6, 8e-6),
        MeasuredMicrostructure(None, 180e-6, 8e-6, 0.85, 0.04, time=1500.0),
        MeasuredMicrostructure(None, 140e-6, 6e-6, time=4000.0),
    ),
    "relaxation": (
        MeasuredMicrostructure(0.03, 170e-6, 8e-6, 0.9, 0.05),
        MeasuredMicrostructure(None, 150e-6, 8e-6, time=600.0),
        MeasuredMicrostructure(None, 150e-6, 8e-6, time=3600.0),
    ),
}
PIEZOMETER = {
    "piezometer_reference_grain_size": 1e-3,
    "piezometer_exponent": 1.33,
    "piezometer_stress_floor": 1e6,
}


def measured_twin(name: str) -> HistoryExperiment:
    return replace(history_twin(name, 12), microstructure=SECTIONS[name])


def oracle_microstructure(test: HistoryExperiment, values: Mapping[str, float]) -> FloatArray:
    """Grain size (m) and fabric factor of each section, shape (n, 2), solved with scipy."""
    dense = np.unique(
        np.concatenate(
            [
                np.linspace(0.0, test.end_time, 4001),
                [one.time for one in test.microstructure if one.time is not None],
            ]
        )
    )
    legs = leg_of_times(test, dense)
    parts = [dense[legs == k] for k in range(len(test.legs))]
    state = history_oracle.history(values, test.initial_grain_size, test.legs, parts)
    found = []
    for one in test.microstructure:
        if one.time is not None:
            place = np.searchsorted(dense, one.time)
            found.append(state[[GRAINS, FABRIC], place])
        else:
            moves = np.append(True, np.diff(state[PATH]) > 0)
            along = [
                np.interp(one.strain or 0, state[PATH][moves], state[k][moves]) for k in (5, 6)
            ]
            found.append(np.array(along))
    return np.array(found)


def expected_log_density(test: HistoryExperiment, values: Mapping[str, float]) -> FloatArray:
    """Of each grain size and fabric factor."""
    density = np.zeros((len(test.microstructure), 2))
    for row, one, (size, factor) in zip(
        density, test.microstructure, oracle_microstructure(test, values), strict=True
    ):
        error = one.grain_size_sd / one.grain_size
        row[0] = stats.lognorm.logpdf(one.grain_size, error, scale=size)
        if one.fabric_factor is not None and one.fabric_factor_sd is not None:
            row[1] = stats.norm.logpdf(one.fabric_factor, factor, one.fabric_factor_sd)
    return density


@pytest.mark.parametrize("name", SECTIONS)
def test_the_density_gains_that_of_each_measurement(name: str, tmp_path: Path) -> None:
    test, known = measured_twin(name), history_twin(name, 12)
    (priors,) = problem_of([known], default_priors("ice")).priors
    source = stan_directory() / "loading_history.stan"
    without, program = (
        program_with(source, one_test_data(one, priors, solver=TIGHT), tmp_path / folder)
        for folder, one in (("without", known), ("with", test))
    )
    size = len(program.scale)
    point = {"coordinate": (0.1 * np.random.default_rng(3).standard_normal(size)).tolist()}
    before, after = without.columns_at(point), program.columns_at(point)
    expected = expected_log_density(test, parameters_in(after))
    n = len(test.microstructure)
    found = [[after[f"microstructure_log_lik.{i}.{k}"] for k in (1, 2)] for i in range(1, n + 1)]
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)
    assert after["lp__"] - before["lp__"] == pytest.approx(expected.sum(), rel=1e-5)
    assert after["log_density"] == pytest.approx(after["lp__"], rel=1e-7)
    for i in range(1, known.n_points + 1):
        assert after[f"log_lik.{i}"] == pytest.approx(before[f"log_lik.{i}"], rel=1e-6)
    assert not [column for column in before if column.startswith("microstructure")]


def test_it_is_in_the_density_of_valley_coordinates(tmp_path: Path) -> None:
    test = measured_twin("creep")
    mode = at_truth(test, default_priors("ice"), SolverOptions())
    reference, _ = LoadingHistoryValley().reference(mode)
    data = one_test_data(test, mode.priors, solver=TIGHT, reference=reference)
    program = program_with(stan_directory() / "loading_history.stan", data, tmp_path)
    here = program.columns_at({"coordinate": np.full(len(program.scale), 0.05).tolist()})
    expected = expected_log_density(test, parameters_in(here))
    found = [[here[f"microstructure_log_lik.{i}.{k}"] for k in (1, 2)] for i in (1, 2)]
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)
    assert here["log_density"] == pytest.approx(here["lp__"], rel=1e-7)


def test_the_microstructure_does_not_change_while_stress_relaxes() -> None:
    test = measured_twin("relaxation")
    priors = given_parameters("ice", TRUTH)
    data = one_test_data(test, priors, solver=TIGHT)
    found = load_program(stan_directory() / "loading_history.stan").evaluate(data)
    model = found["microstructure_model"]
    np.testing.assert_allclose(model[1], model[2], rtol=1e-12)
    np.testing.assert_allclose(model, oracle_microstructure(test, TRUTH), rtol=1e-5)


@pytest.mark.parametrize("name", ["creep", "relaxation"])
def test_grains_that_follow_a_piezometer_are_measured_too(name: str) -> None:
    test = measured_twin(name)
    # What tells the law: the steady state is no other size than that at the start.
    values = {**TRUTH, **PIEZOMETER, "steady_state_grain_size": test.initial_grain_size}
    data = one_test_data(test, given_parameters("ice", values), solver=TIGHT)
    found = load_program(stan_directory() / "loading_history.stan").evaluate(data)
    expected = oracle_microstructure(test, values)
    np.testing.assert_allclose(found["microstructure_model"], expected, rtol=1e-4)
    own = oracle_microstructure(test, TRUTH)
    assert np.abs(expected[:, 0] / own[:, 0] - 1).max() > 0.05


def test_a_compliant_apparatus_takes_its_share_of_the_path_strain() -> None:
    test = measured_twin("relaxation")
    values = {**TRUTH, "apparatus_compliance": 1e-9}
    data = one_test_data(test, given_parameters("ice", values), solver=TIGHT)
    found = load_program(stan_directory() / "loading_history.stan").evaluate(data)
    model = found["microstructure_model"]
    np.testing.assert_allclose(model, oracle_microstructure(test, values), rtol=1e-5)
    # The specimen goes on while the apparatus springs back.
    assert model[2, 0] < 0.99 * model[1, 0]
