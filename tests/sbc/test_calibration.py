"""Calibration: simulated data are the program's, and truths are ranked among draws."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from conftest import ICE, resolved_priors
from scipy import stats
from stan_data import one_test_data

from pyburgers.cmdstan.program import load_program
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.fitting.fit import Fit
from pyburgers.model.priors import default_priors
from pyburgers.posterior.labelled_draws import convergence_table
from pyburgers.protocols.constant_rate.experiment import load_constant_rate
from pyburgers.protocols.forced_oscillation.experiment import (
    load_forced_oscillation,
    with_background,
)
from pyburgers.protocols.forced_oscillation.preparation import prepare
from pyburgers.protocols.forward import simulate, simulate_data
from pyburgers.protocols.program_data import given_parameters
from pyburgers.protocols.protocol import protocol_of
from pyburgers.protocols.stan_data import REFERENCE_SOLVER
from pyburgers.sbc.data_sets import (
    LOG_LIKELIHOOD,
    RHAT_LIMIT,
    calibration_priors,
    check_template,
    largest_rhat,
    rank_truth,
    simulate_from_prior,
)

OLIVINE = ICE.parent / "olivine" / "olivine_twin.toml"


def test_simulated_data_are_the_solution_at_a_prior_draw_with_noise(programs: None) -> None:
    experiment = load_constant_rate(ICE / "PIL40.toml")
    priors = resolved_priors(experiment)
    simulated = simulate_from_prior(experiment, priors, seed=4)
    again = simulate_from_prior(experiment, priors, seed=4)
    np.testing.assert_array_equal(simulated.experiment.response, again.experiment.response)
    assert simulated.experiment.provenance.kind == "synthetic"
    truth = simulated.experiment.true_parameters
    assert truth is not None
    solution = simulate(experiment, truth, at=np.unique(experiment.strain))
    stress = np.interp(experiment.strain, solution["strain"], solution["stress_Pa"])
    deviation = (simulated.experiment.response - stress) / truth["stress_noise"]
    # A sum of 61 squares of standard normal numbers.
    assert stats.chi2(experiment.n_points).cdf(float(np.sum(deviation**2))) == pytest.approx(
        0.5, abs=0.4999
    )
    assert simulated.n_unsolvable == 0


def test_a_simulated_record_is_prepared_as_the_measured_one_is(programs: None) -> None:
    experiment = with_background(load_forced_oscillation(OLIVINE), "removed")
    truth = dict(experiment.true_parameters or {})
    rng = np.random.default_rng(2)
    simulated = simulate_data(experiment, truth, rng, source="the truth")
    assert simulated.settings == experiment.settings
    np.testing.assert_array_equal(simulated.prepared.time, experiment.prepared.time)
    np.testing.assert_array_equal(simulated.stress, simulated.prepared.stress)
    # Two draws of the noise on one solution, both without trend.
    difference = (simulated.stress - experiment.stress) / truth["stress_noise"]
    assert np.sqrt(np.mean(difference**2)) < 4.0
    quiet = simulate_data(
        experiment, {**truth, "stress_noise": 1.0}, np.random.default_rng(2), source="the truth"
    )
    deviation = (simulated.stress - quiet.stress) / experiment.prepared.uncertainty
    assert 0.7 < np.std(deviation) < 1.3


def test_the_trend_leaves_as_much_noise_as_the_likelihood_expects(programs: None) -> None:
    # The log likelihood at the truth is stationary in the noise s, in the mean over records, if the
    # mean sum of squares is the power of s that its normalisation falls with. That mean is the sum
    # over records with one noisy point.
    experiment = with_background(load_forced_oscillation(OLIVINE), "removed")
    truth = dict(experiment.true_parameters or {})
    quiet = simulate_data(
        experiment, {**truth, "stress_noise": 1.0}, np.random.default_rng(1), source="the truth"
    )
    model = load_program(protocol_of(quiet).program)

    def log_likelihood(log_factor: float) -> float:
        values = {**truth, "stress_noise": truth["stress_noise"] * np.exp(log_factor)}
        data = one_test_data(quiet, given_parameters("olivine", values), solver=REFERENCE_SOLVER)
        return float(model.evaluate(data)["log_lik"].sum())

    step = 0.1
    loss = (log_likelihood(-step) - log_likelihood(step)) / (2 * step)
    noise = truth["stress_noise"] * quiet.prepared.relative_uncertainty
    squares = 0.0
    for one in np.eye(quiet.n_points):
        record = replace(quiet.record, stress=quiet.record.stress + noise * one)
        left = prepare(record, quiet.settings, quiet.id).stress - quiet.stress
        squares += float(np.sum((left / noise) ** 2))
    # Not to the last digit: the trend is fitted beside harmonics, to which it is not orthogonal.
    assert squares == pytest.approx(loss, abs=0.1)
    assert squares < quiet.n_points - 1


def test_draws_without_solution_are_counted_and_replaced(
    programs: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = load_constant_rate(ICE / "PIL40.toml")
    priors = resolved_priors(experiment)
    refused = 2

    def solve_from_the_third_on(*arguments: Any, **options: Any) -> object:
        nonlocal refused
        if refused > 0:
            refused -= 1
            raise SamplingError("no solution")
        return simulate(*arguments, **options)

    monkeypatch.setattr("pyburgers.sbc.data_sets.simulate", solve_from_the_third_on)
    simulated = simulate_from_prior(experiment, priors, seed=4)
    assert simulated.n_unsolvable == 2
    rng = np.random.default_rng(4)
    third = [priors.sample(rng) for _ in range(3)][2]
    assert simulated.experiment.true_parameters == third
    refused = 10**6
    with pytest.raises(SamplingError, match=r"none of 100 draws from the prior .* bounds"):
        simulate_from_prior(experiment, priors, seed=4)


def test_ranks_count_the_draws_below_the_truth(small_fit: Fit) -> None:
    truth = small_fit.experiment.true_parameters
    assert truth is not None
    draws = small_fit.posterior["posterior"].to_dataset()["maxwell_modulus"].to_numpy().ravel()
    ranks = rank_truth(small_fit, small_fit.experiment, draws.size)
    assert ranks["maxwell_modulus"] == int(np.sum(draws < truth["maxwell_modulus"]))
    assert set(ranks) == {*small_fit.priors.free, "reference_stress", LOG_LIKELIHOOD}
    high = replace(small_fit.experiment, true_parameters={**truth, "maxwell_modulus": 1e12})
    ranks = rank_truth(small_fit, high, 50)
    assert ranks["maxwell_modulus"] == 50
    assert ranks[LOG_LIKELIHOOD] == 0  # such a modulus fits far worse than any draw


def test_rhat_of_a_single_chain_compares_its_halves(
    long_fit: Fit, caplog: pytest.LogCaptureFixture
) -> None:
    single = long_fit.posterior.isel(chain=[0])
    assert convergence_table(single)["rhat"].isna().all()
    assert largest_rhat(single) < RHAT_LIMIT
    assert largest_rhat(long_fit.posterior) == convergence_table(long_fit.posterior)["rhat"].max()
    drifting = single.copy(deep=True)
    modulus = drifting["posterior"]["maxwell_modulus"]
    modulus += 3 * float(modulus.std()) * np.linspace(0, 1, modulus.size)
    assert largest_rhat(drifting) > RHAT_LIMIT
    assert not caplog.records


def test_templates_must_have_points_and_a_removed_background() -> None:
    record = with_background(load_forced_oscillation(OLIVINE), "removed")
    check_template(record)
    with pytest.raises(InputError, match=r"'kept', expected 'removed'"):
        check_template(with_background(record, "kept"))
    empty = replace(load_constant_rate(ICE / "PIL40.toml"), strain=np.empty(0), stress=np.empty(0))
    with pytest.raises(InputError, match=r"no data, expected a \[data\] table"):
        check_template(empty)


def test_a_material_without_narrowed_priors_is_calibrated_with_its_own() -> None:
    assert calibration_priors("dunite") == default_priors("dunite")
    narrowed = calibration_priors("ice")
    assert narrowed["stress_exponent"].upper < default_priors("ice")["stress_exponent"].upper
    assert not any(prior.relative_to_max_stress for prior in narrowed.priors.values())
