"""Coordinates, first metric and tolerance of a fit before its chains start."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from charts_at_modes import chart_at_mode
from conftest import ICE, SMALL_RUN, TESTS
from conftest import Problem as SmallProblem

from pyburgers.cmdstan.program import LEAST_CURVATURE, LEAST_RATIO, Density, Program, load_program
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import read_json
from pyburgers.fitting.charts_at_modes import ChosenChart, ProblemMode, find_mode
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.constant_rate.likelihood import LIKELIHOOD as CONSTANT_RATE
from pyburgers.kinds.forward import simulate_data
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import (
    BDF,
    REFERENCE_SOLVER,
    SolverOptions,
    StanData,
    solver_block,
)
from pyburgers.model.priors import default_priors
from pyburgers.sampling.modes import noisy_tolerances
from pyburgers.sampling.run_directory import RunDirectory
from pyburgers.sbc.data_sets import calibration_priors, simulate_from_prior

pytestmark = pytest.mark.usefixtures("programs")


@dataclass(frozen=True)
class Precise:
    """A curve whose noise is far below a percent, its data and its mode."""

    problem: Problem
    data: StanData
    mode: ProblemMode

    def chart(self, wanted: str) -> ChosenChart:
        return chart_at_mode(self.problem, self.data, wanted=wanted, mode=self.mode)

    @property
    def density(self) -> Density:
        return Density(load_program(CONSTANT_RATE.program), self.data)


@pytest.fixture(scope="module")
def precise() -> Precise:
    twin = load_constant_rate(ICE / "PIL40.toml")
    assert twin.true_parameters is not None
    values = {**twin.true_parameters, "stress_noise": 2e4}
    curve = simulate_data(twin, values, np.random.default_rng(2), source="a test")
    problem = problem_of([curve], default_priors("ice"))
    data = program_data(problem, solver=SolverOptions())
    density = Density(load_program(CONSTANT_RATE.program), data)
    return Precise(problem, data, find_mode(problem, density, seed=1))


def test_the_first_metric_fits_where_noise_is_far_below_a_percent(precise: Precise) -> None:
    chart = precise.chart("valley")
    assert chart.centre is not None
    assert chart.covariance is not None
    around = precise.density.with_data(chart.block)
    widths = np.asarray(np.linalg.cholesky(chart.covariance), dtype=np.float64)
    curvature = widths.T @ around.curvature(chart.centre, 0.1 * widths) @ widths
    # 1 where the metric is right.
    assert np.linalg.eigvalsh(curvature).max() < 3
    # The optimiser comes no nearer than the solver's tolerance lets it; draws lie half a unit for
    # each coordinate below the mode.
    rise = around.expected_rise(chart.centre, chart.covariance)
    assert rise < chart.centre.size / 2


@pytest.mark.parametrize("largest", [1e3, 1e18])
def test_a_covariance_has_a_root_however_far_apart_curvatures_are(largest: float) -> None:
    rng = np.random.default_rng(1)
    axes = np.linalg.qr(rng.standard_normal((12, 12)))[0]
    hessian: FloatArray = (axes * np.geomspace(1.0, largest, 12)) @ axes.T

    class Known(Density):
        def curvature(self, centre: FloatArray, steps: FloatArray | None = None) -> FloatArray:
            return hessian

    covariance = Known(Program(Path()), {}).laplace(np.zeros(12))
    assert np.isfinite(np.linalg.cholesky(covariance)).all()
    assert np.linalg.eigvalsh(covariance)[-1] < 1.001 / LEAST_CURVATURE
    if largest < 1 / LEAST_RATIO:
        assert covariance == pytest.approx(np.linalg.inv(hessian), rel=1e-6, abs=1e-9)


def test_the_sampler_moves_in_standard_deviations_of_plain_coordinates(precise: Precise) -> None:
    """Stan pulls variances of the adapted metric to 1e-3, above those of precise data."""
    density, chart = precise.density, precise.chart("plain")
    assert chart.centre is not None
    assert chart.covariance is not None
    assert chart.first_metric is not None
    spread = np.sqrt(np.diag(chart.covariance))
    assert np.abs(np.log(spread)).max() > 0.5
    np.testing.assert_allclose(np.diag(chart.first_metric), 1)
    # A gradient of Stan's is one by what the sampler moves in.
    points = (chart.centre + 0.3 * spread)[np.newaxis]
    in_units = density.with_data(chart.block).gradients(points)
    by_coordinate = density.gradients(points)
    np.testing.assert_allclose(in_units, by_coordinate * spread, rtol=1e-4)


LOOSE = SolverOptions(tolerance=1e-3)


def loosely(problem: SmallProblem, out: Path, tolerance: float = LOOSE.tolerance) -> Fit:
    return problem.fit(out, replace(SMALL_RUN, draws=40), solver=SolverOptions(tolerance))


def test_chains_start_at_a_tolerance_that_is_not_too_loose(
    small_problem: SmallProblem, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pyburgers.sampling.modes.MAX_NOISE", 0.0)
    monkeypatch.setattr("pyburgers.sampling.modes.MAX_TIGHTENINGS", 1)
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
        monkeypatch.setattr("pyburgers.sampling.modes.MAX_NOISE", share * float(noisy["noise"]))
        loose = Density(model, {**data, "tolerance": LOOSE.tolerance})
        exact = solver_block(REFERENCE_SOLVER)
        again = noisy_tolerances(loose, exact, centre, covariance, seed=SMALL_RUN.seed)
        assert len(again) == found
    # The same call finds its run again, and another tolerance is told as what was asked for.
    assert loosely(small_problem, tmp_path / "run").manifest["noisy"] == [noisy]
    with pytest.raises(InputError, match=r"tolerance .*1e-05.*0\.001"):
        loosely(small_problem, tmp_path / "run", tolerance=1e-5)


@pytest.mark.slow
def test_a_record_that_the_usual_tolerance_cannot_sample_is_told() -> None:
    """With `ode_bdf` a draw of this one takes 275 leapfrog steps at 1e-5, and 13 at 1e-6."""
    template = problem_of(
        [load_experiment(TESTS.parent / "data" / "calibration" / "olivine_known_strain.toml")],
        calibration_priors("olivine"),
    )
    problem = simulate_from_prior(template, seed=47, stress_range=(50e6, 500e6)).problem
    solver = SolverOptions(method=BDF)
    data = program_data(problem, solver=solver)
    chart = chart_at_mode(problem, data, seed=47)
    assert chart.centre is not None
    assert chart.covariance is not None
    density = Density(load_program(problem.likelihood.program), {**data, **chart.block})
    exact = solver_block(REFERENCE_SOLVER)
    (noisy,) = noisy_tolerances(density, exact, chart.centre, chart.covariance, seed=47)
    assert noisy.tolerance == solver.tolerance
    assert noisy.noise > 1
    # The fast solver can sample it.
    smooth = density.with_data(solver_block(SolverOptions()))
    assert noisy_tolerances(smooth, exact, chart.centre, chart.covariance, seed=47) == []
