"""Likelihood of measured microstructure: against other solutions, and its draws."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import history_oracle
import numpy as np
import pytest
from conftest import ICE, Problem
from history_oracle import FABRIC, GRAINS, PATH
from history_twins import PIEZOMETER, TRUTH, history_twin
from log_density import program_with
from scipy import stats
from stan_data import one_test_data, parameters_in
from truth_as_mode import at_truth

from pyburgers.cmdstan.program import load_program
from pyburgers.common.array_types import FloatArray
from pyburgers.comparison.same_data import data_hash
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.experiment import MeasuredMicrostructure
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.likelihood import likelihood_of, strains_of
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stan_data import leg_of_times
from pyburgers.kinds.program_data import given_parameters
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.priors import default_priors
from pyburgers.sampling.options import SamplerOptions

Measured = ConstantRateExperiment | HistoryExperiment
pytestmark = pytest.mark.usefixtures("programs")

TIGHT = SolverOptions(tolerance=1e-11, max_num_steps=1_000_000)
QUICK = SamplerOptions(chains=2, warmup=20, draws=15, seed=1, adapt_delta=0.8)
SECTIONS = {
    "curve": (
        MeasuredMicrostructure(0.05, 200e-6, 10e-6),
        MeasuredMicrostructure(0.15, 170e-6, 8e-6, 0.7, 0.05),
    ),
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


def measured_test(name: str) -> Measured:
    known = load_constant_rate(ICE / "PIL40.toml") if name == "curve" else history_twin(name, 12)
    return replace(known, microstructure=SECTIONS[name])


def solved(test: Measured, values: Mapping[str, float]) -> FloatArray:
    """Grain size (m) and fabric factor of each section, shape (n, 2).

    Those of a curve are from another run of its program, those of a history are solved with scipy.
    """
    if isinstance(test, ConstantRateExperiment):
        solution = simulate(test, values, at=strains_of(test.microstructure)).set_index("strain")
        strains = [one.strain for one in test.microstructure]
        return solution.reindex(strains)[["grain_size_m", "fabric_factor"]].to_numpy()
    stated = [one.time for one in test.microstructure if one.time is not None]
    dense = np.union1d(np.linspace(0.0, test.end_time, 4001), stated)
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
                np.interp(one.strain or 0, state[PATH][moves], state[k][moves])
                for k in (GRAINS, FABRIC)
            ]
            found.append(np.array(along))
    return np.array(found)


def modelled(test: Measured, values: Mapping[str, float]) -> FloatArray:
    """The same as the program of the test has them."""
    data = one_test_data(test, given_parameters("ice", values), solver=TIGHT)
    found: FloatArray = load_program(likelihood_of(test).program).evaluate(data)[
        "microstructure_model"
    ]
    return found


def expected_log_density(test: Measured, values: Mapping[str, float]) -> FloatArray:
    """Of each grain size and fabric factor."""
    density = np.zeros((len(test.microstructure), 2))
    for row, one, (size, factor) in zip(
        density, test.microstructure, solved(test, values), strict=True
    ):
        error = one.grain_size_sd / one.grain_size
        row[0] = stats.lognorm.logpdf(one.grain_size, error, scale=size)
        if one.fabric_factor is not None and one.fabric_factor_sd is not None:
            row[1] = stats.norm.logpdf(one.fabric_factor, factor, one.fabric_factor_sd)
    return density


@pytest.mark.parametrize(
    ("name", "system"),
    [*((name, "plain") for name in SECTIONS), ("curve", "valley"), ("creep", "valley")],
)
def test_the_density_gains_that_of_each_measurement(name: str, system: str, tmp_path: Path) -> None:
    test = measured_test(name)
    known, own = replace(test, microstructure=()), likelihood_of(test)
    truth = at_truth(known, default_priors("ice"), SolverOptions())
    reference = own.chart.reference(truth)[0] if system == "valley" else None
    without, program = (
        program_with(
            own.program,
            one_test_data(one, truth.priors, solver=TIGHT, reference=reference),
            tmp_path / folder,
        )
        for folder, one in (("without", known), ("with", test))
    )
    width, within = (0.3, 1e-8) if name == "curve" else (0.1, 1e-5)
    coordinate = width * np.random.default_rng(3).standard_normal(program.scale.size)
    point = {"coordinate": coordinate.tolist()}
    before, after = without.columns_at(point), program.columns_at(point)
    expected = expected_log_density(test, parameters_in(after))
    n = len(test.microstructure)
    found = [[after[f"microstructure_log_lik.{i}.{k}"] for k in (1, 2)] for i in range(1, n + 1)]
    np.testing.assert_allclose(found, expected, rtol=within, atol=within)
    assert after["lp__"] - before["lp__"] == pytest.approx(np.sum(found), rel=1e-7)
    assert after["log_density"] == pytest.approx(after["lp__"], rel=1e-7)
    for i in range(1, known.n_points + 1):
        assert after[f"log_lik.{i}"] == pytest.approx(before[f"log_lik.{i}"], rel=1e-6)
    assert not [column for column in before if column.startswith("microstructure")]


@pytest.mark.parametrize(
    ("name", "within"), [("curve", 1e-6), ("creep", 1e-4), ("relaxation", 1e-4)]
)
def test_grains_that_follow_a_piezometer_are_measured_too(name: str, within: float) -> None:
    test = measured_test(name)
    truth = dict(test.true_parameters or {})
    values = {**truth, **PIEZOMETER}
    expected = solved(test, values)
    np.testing.assert_allclose(modelled(test, values), expected, rtol=within)
    own = solved(test, truth)
    assert np.abs(expected[:, 0] / own[:, 0] - 1).max() > 0.05


def test_a_compliant_apparatus_takes_its_share_of_the_path_strain() -> None:
    test = measured_test("relaxation")
    values = {**TRUTH, "apparatus_compliance": 1e-9}
    model = modelled(test, values)
    np.testing.assert_allclose(model, solved(test, values), rtol=1e-5)
    # The specimen goes on while the apparatus springs back.
    assert model[2, 0] < 0.99 * model[1, 0]


def test_draws_keep_it_apart(small_problem: Problem, small_fit: Fit, tmp_path: Path) -> None:
    """And it counts as data: in influences of the prior, and where fits are compared."""
    one = small_problem.experiment
    rows = (MeasuredMicrostructure(0.01, 220e-6, 5e-6), *SECTIONS["curve"][1:])
    seen = tuple(replace(row, strain=0.01 * (k + 1)) for k, row in enumerate(rows))
    other = replace(one, id="other", microstructure=())
    measured = replace(one, microstructure=seen)
    single = fit(measured, small_problem.priors, out=tmp_path / "single", options=QUICK)
    joint = fit([other, measured], small_problem.priors, out=tmp_path / "joint", options=QUICK)
    for result in (single, joint):
        group = result.posterior["microstructure"].to_dataset()
        assert group["model"].dims == ("chain", "draw", "section", "quantity")
        assert group["quantity"].values.tolist() == ["grain_size", "fabric_factor"]
        np.testing.assert_allclose(group["strain"], [0.01, 0.02])
        np.testing.assert_allclose(group["measured"], [[220e-6, np.nan], [170e-6, 0.7]], rtol=1e-12)
        assert (np.ptp(group["replicated"].to_numpy(), axis=(0, 1))[:, 0] > 1e-6).all()
    own = joint[one.id].posterior
    assert own["microstructure"].to_dataset().equals(joint.posterior["microstructure"].to_dataset())
    assert "microstructure" not in small_fit.posterior.children
    assert "microstructure" not in joint["other"].posterior.children
    assert data_hash(small_fit) != data_hash(single)
    ratio = single.posterior["sample_stats"]["solver_log_ratio"]
    assert float(np.abs(ratio).max()) < 0.1
