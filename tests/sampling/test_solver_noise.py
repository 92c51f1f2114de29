"""A solver whose errors make the log density jump is tightened before chains start."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from charts_at_modes import chart_at_mode
from conftest import SMALL_RUN, TESTS, Problem

from pyburgers.cmdstan.program import load_program
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import read_json
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.sampling.run_directory import RunDirectory
from pyburgers.sampling.solver_noise import noisy_tolerances
from pyburgers.sbc.data_sets import calibration_priors, simulate_from_prior

pytestmark = pytest.mark.usefixtures("programs")

LOOSE = SolverOptions(tolerance=1e-3)


def loosely(problem: Problem, out: Path, tolerance: float = LOOSE.tolerance) -> Fit:
    return fit(
        problem.experiment,
        problem.priors,
        out=out,
        options=replace(SMALL_RUN, draws=40),
        solver=SolverOptions(tolerance),
    )


def test_chains_start_at_a_tolerance_that_is_not_too_loose(
    small_problem: Problem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pyburgers.sampling.solver_noise.MAX_NOISE", 0.0)
    monkeypatch.setattr("pyburgers.sampling.solver_noise.MAX_TIGHTENINGS", 1)
    result = loosely(small_problem, tmp_path / "run")
    (noisy,) = result.manifest["noisy"]
    assert noisy["tolerance"] == LOOSE.tolerance
    used = pytest.approx(LOOSE.tolerance / 10)
    assert result.manifest["solver"]["tolerance"] == used
    run = RunDirectory(tmp_path / "run")
    data = run.read_stan_data()
    assert data["tolerance"] == used
    laplace = read_json(run.metric_file)
    centre, covariance = (np.array(laplace[key]) for key in ("centre", "covariance"))
    model = load_program(
        problem_of([small_problem.experiment], small_problem.priors).likelihood.program
    )
    for share, found in ((0.99, 1), (1.01, 0)):
        monkeypatch.setattr(
            "pyburgers.sampling.solver_noise.MAX_NOISE", share * float(noisy["noise"])
        )
        loose = {**data, "tolerance": LOOSE.tolerance}
        again = noisy_tolerances(model, loose, centre, covariance, seed=SMALL_RUN.seed)
        assert len(again) == found
    # The same call finds its run again, and another tolerance is told as what was asked for.
    assert loosely(small_problem, tmp_path / "run").manifest["noisy"] == [noisy]
    with pytest.raises(InputError, match=r"tolerance .*1e-05.*0\.001"):
        loosely(small_problem, tmp_path / "run", tolerance=1e-5)


def test_the_usual_tolerance_is_enough_for_a_usual_test(small_fit: Fit) -> None:
    assert small_fit.manifest["noisy"] == []
    assert small_fit.manifest["solver"]["tolerance"] == SolverOptions().tolerance


@pytest.mark.slow
def test_a_record_that_the_usual_tolerance_cannot_sample_is_told() -> None:
    """Of this one a draw took 275 leapfrog steps at 1e-5, and takes 13 at 1e-6."""
    template = problem_of(
        [load_experiment(TESTS.parent / "data" / "calibration" / "olivine_known_strain.toml")],
        calibration_priors("olivine"),
    )
    problem = simulate_from_prior(template, seed=47, stress_range=(50e6, 500e6)).problem
    solver = SolverOptions()
    data = program_data(problem, solver=solver)
    chart = chart_at_mode(problem, data, solver, seed=47)
    assert chart.centre is not None
    assert chart.covariance is not None
    model = load_program(problem.likelihood.program)
    (noisy,) = noisy_tolerances(
        model, {**data, **chart.block}, chart.centre, chart.covariance, seed=47
    )
    assert noisy.tolerance == solver.tolerance
    assert noisy.noise > 1
