"""Draws of the prior of a test, solved by Stan."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from synthetic_fit import make_fit

from pyburgers.cmdstan.program import Program, Unsolved
from pyburgers.common.array_types import FloatArray
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.prior_draws import PriorDraws, prior_draws
from pyburgers.kinds.forward import simulate
from pyburgers.model.flow_law_prior import PRIOR_QUANTITIES, Conditions, FlowLawPrior

N_DRAWS = 600


def parameter_draws(drawn: PriorDraws, name: str) -> FloatArray:
    return all_draws(drawn.posterior["posterior"].to_dataset()[name])


def stresses(drawn: PriorDraws) -> FloatArray:
    """Of the solutions (Pa), shape (n_draws, n_grid)."""
    return all_draws(drawn.posterior["predictions"].to_dataset()["stress"])


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("ice"), draws=50)


@pytest.fixture(scope="module")
def drawn(programs: None, fit: Fit) -> PriorDraws:
    return prior_draws(fit.experiment, fit.priors, draws=N_DRAWS)


def test_every_parameter_has_its_prior(drawn: PriorDraws, fit: Fit) -> None:
    for name in fit.priors.free:
        draws = parameter_draws(drawn, name)
        assert draws.size == N_DRAWS
        assert stats.kstest(draws, fit.priors[name].distribution().cdf).pvalue > 1e-3


def test_each_draw_is_solved_at_its_own_parameters(drawn: PriorDraws, fit: Fit) -> None:
    draws = drawn.posterior["posterior"].to_dataset()
    grid = drawn.posterior["predictions"]["strain"].to_numpy()
    stress = stresses(drawn)
    for k in (0, 17, N_DRAWS - 1):
        values = {name: float(draws[name][0, k]) for name in fit.priors.priors}
        expected = simulate(fit.experiment, values, at=grid)["stress_Pa"]
        assert stress[k] == pytest.approx(expected.to_numpy(), rel=1e-3)


def test_draws_are_shown_in_a_line(drawn: PriorDraws) -> None:
    assert repr(drawn) == f"<{N_DRAWS} draws of the prior of {drawn.experiment.id}>"


def test_the_same_seed_gives_the_same_draws(drawn: PriorDraws, fit: Fit) -> None:
    again = prior_draws(fit.experiment, fit.priors, draws=N_DRAWS, seed=1)
    assert np.array_equal(stresses(again), stresses(drawn))


def test_a_draw_without_solution_is_left_out_and_counted(
    programs: None, fit: Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    solve = Program.generate

    def failing_at_one(program: Program, data: object, files: list[Path], **options: int) -> object:
        rows = np.loadtxt(files[0], delimiter=",", skiprows=1, ndmin=2)
        if (rows[:, 7] == bad).any():
            raise Unsolved("no solution at some draw")
        return solve(program, data, files, **options)  # type: ignore[arg-type]

    whole = prior_draws(fit.experiment, fit.priors, draws=8, seed=2)
    prior = fit.priors["maxwell_modulus"]
    modulus = parameter_draws(whole, "maxwell_modulus")[5]
    bad = np.log((modulus - prior.lower) / prior.scale)
    monkeypatch.setattr(Program, "generate", failing_at_one)
    left = prior_draws(fit.experiment, fit.priors, draws=8, seed=2)
    assert left.n_unsolved == 1
    assert left.posterior["posterior"]["draw"].to_numpy().tolist() == [0, 1, 2, 3, 4, 6, 7]
    kept = np.delete(stresses(whole), 5, axis=0)
    assert stresses(left) == pytest.approx(kept, rel=1e-6)


def test_priors_without_any_solution_are_refused(
    programs: None, fit: Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object, **__: object) -> None:
        raise Unsolved("no solution")

    monkeypatch.setattr(Program, "generate", failing)
    with pytest.raises(SamplingError, match="none of 3 draws from the prior has a solution"):
        prior_draws(fit.experiment, fit.priors, draws=3, seed=1)


def test_joint_priors_of_the_flow_law_are_refused(fit: Fit) -> None:
    conditions = Conditions(260.0, 5e6, 230e-6)
    joint = FlowLawPrior(PRIOR_QUANTITIES, np.zeros(4), np.eye(4), conditions, "ice", "a test")
    priors = replace(fit.priors, flow_law=joint)
    with pytest.raises(InputError, match="found a joint prior of the flow law"):
        prior_draws(fit.experiment, priors, draws=3)
