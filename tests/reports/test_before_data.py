"""Draws of the prior, solved by Stan, and what one number of the data makes of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from synthetic_fit import make_fit, with_problem

from pyburgers.cmdstan.program import Program, Unsolved
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.fitting.fit import Fit
from pyburgers.model.flow_law_prior import PRIOR_QUANTITIES, Conditions, FlowLawPrior
from pyburgers.protocols.forward import simulate
from pyburgers.studies.maor.before_data import (
    READING_ERROR,
    Knowledge,
    knowledge,
    parameter_draws,
    prediction_draws,
    prior_draws,
)
from pyburgers.studies.maor.ice_curves import PEAK_STRESS, peaks

N_DRAWS = 600


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("ice"), draws=50)


@pytest.fixture(scope="module")
def known(programs: None, fit: Fit) -> Knowledge:
    return knowledge(fit, PEAK_STRESS, n_draws=N_DRAWS, seed=1)


def test_every_parameter_has_its_prior(known: Knowledge, fit: Fit) -> None:
    for name in fit.priors.free:
        draws = parameter_draws(known.prior, name)
        assert draws.size == N_DRAWS
        assert stats.kstest(draws, fit.priors[name].distribution().cdf).pvalue > 1e-3


def test_each_draw_is_solved_at_its_own_parameters(known: Knowledge, fit: Fit) -> None:
    draws = known.prior.posterior["posterior"].to_dataset()
    grid = known.prior.posterior["predictions"]["strain"].to_numpy()
    stress = prediction_draws(known.prior, "stress")
    for k in (0, 17, N_DRAWS - 1):
        values = {name: float(draws[name][0, k]) for name in fit.priors.priors}
        expected = simulate(fit.experiment, values, at=grid)["stress_Pa"]
        assert stress[k] == pytest.approx(expected.to_numpy(), rel=1e-3)


def test_the_peak_stress_weighs_the_draws_that_meet_it(known: Knowledge, fit: Fit) -> None:
    observed = fit.experiment.response.max()
    _, stress = peaks(known.prior)
    deviation = (stress / observed - 1) / READING_ERROR
    assert known.weights.sum() == pytest.approx(1)
    expected = np.exp(-(deviation**2) / 2)
    assert known.weights == pytest.approx(expected / expected.sum(), rel=1e-9, abs=1e-300)
    assert known.effective_draws == pytest.approx(expected.sum() ** 2 / (expected**2).sum())
    mean = known.weights @ stress
    assert mean == pytest.approx(observed, rel=2 * READING_ERROR)


def test_the_peak_stress_narrows_n_through_the_priors_of_the_flow_law(known: Knowledge) -> None:
    alone, with_peak = known.sd_before("stress_exponent")
    assert with_peak < 0.6 * alone
    # Nothing in a peak stress is about the fabric's critical strain.
    alone, with_peak = known.sd_before("critical_strain_fabric")
    assert with_peak > 0.3 * alone


def test_the_same_seed_gives_the_same_draws(known: Knowledge, fit: Fit) -> None:
    again = prior_draws(fit, n_draws=N_DRAWS, seed=1)
    assert np.array_equal(
        prediction_draws(again, "stress"), prediction_draws(known.prior, "stress")
    )


def test_a_draw_without_solution_is_left_out_and_counted(
    programs: None, fit: Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    solve = Program.generate

    def failing_at_one(program: Program, data: object, files: list[Path], **options: int) -> object:
        rows = np.loadtxt(files[0], delimiter=",", skiprows=1, ndmin=2)
        if (rows[:, 7] == bad).any():
            raise Unsolved("no solution at some draw")
        return solve(program, data, files, **options)  # type: ignore[arg-type]

    whole = prior_draws(fit, n_draws=8, seed=2)
    prior = fit.priors["maxwell_modulus"]
    modulus = parameter_draws(whole, "maxwell_modulus")[5]
    bad = np.log((modulus - prior.lower) / prior.scale)
    monkeypatch.setattr(Program, "generate", failing_at_one)
    left = prior_draws(fit, n_draws=8, seed=2)
    assert left.n_unsolved == 1
    assert left.posterior["posterior"]["draw"].to_numpy().tolist() == [0, 1, 2, 3, 4, 6, 7]
    kept = np.delete(prediction_draws(whole, "stress"), 5, axis=0)
    assert prediction_draws(left, "stress") == pytest.approx(kept, rel=1e-6)


def test_priors_without_any_solution_are_refused(
    programs: None, fit: Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object, **__: object) -> None:
        raise Unsolved("no solution")

    monkeypatch.setattr(Program, "generate", failing)
    with pytest.raises(SamplingError, match="none of 3 draws from the prior has a solution"):
        prior_draws(fit, n_draws=3, seed=1)


def test_joint_priors_of_the_flow_law_are_refused(fit: Fit) -> None:
    conditions = Conditions(260.0, 5e6, 230e-6)
    joint = FlowLawPrior(PRIOR_QUANTITIES, np.zeros(4), np.eye(4), conditions, "ice", "a test")
    priors = replace(fit.priors, flow_law=joint)
    with pytest.raises(InputError, match="found a joint prior of the flow law"):
        prior_draws(with_problem(fit, fit.experiment, priors), n_draws=3, seed=1)
