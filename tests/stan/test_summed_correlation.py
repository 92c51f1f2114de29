"""Residuals whose correlation is summed over a grid, against dense covariances and integrals."""

from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt
import pytest
from conftest import ICE, TESTS
from history_twins import history_twin
from scipy import stats
from scipy.special import logsumexp
from summed_oracle import covariance, summed_density

from pyburgers.cmdstan.program import Density, load_program
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.problem import Problem, one_test
from pyburgers.kinds.program_data import correlation_block, program_data, solve
from pyburgers.kinds.stan_data import SolverOptions, StanData
from pyburgers.model.pooling import NOTHING_SUMMED, SEPARATE
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import PriorSet, default_priors
from pyburgers.model.variants import with_variant

FloatArray = npt.NDArray[np.float64]
pytestmark = pytest.mark.usefixtures("programs")

POSITION = np.concatenate([np.linspace(0.002, 0.08, 14), [0.08], np.linspace(0.081, 0.12, 9)])
SEGMENT = [0] * 14 + [1] * 10
OTHER = np.array([0.01, 0.02, 0.02, 0.05, 0.06])
"""Positions of a first test of two segments, the second of which begins where the first ends, and
of a second test, which has two readings at one position."""

SLOPE, LOG_NOISE = 0.7, -0.4
"""At which densities are compared."""


def uniform(name: str, lower: float, upper: float) -> Prior:
    numbers = {"lower": lower, "upper": upper}
    return Prior.of_family(name, "uniform", numbers, unit="1", source="test")


def fixed(name: str, value: float) -> Prior:
    return Prior.of_family(name, "fixed", {"value": value}, unit="1", source="test")


def priors_with(*changed: Prior) -> PriorSet:
    experiment = load_constant_rate(ICE / "PIL40.toml")
    priors = with_variant(default_priors("ice"), experiment, {"residuals": "autocorrelated"})
    return priors.resolved(2e6).exchanging(*changed)


PRIORS = {
    "standard": (),
    "narrow": (
        uniform("residual_correlated_share", 0.2, 0.6),
        uniform("residual_correlation_strain", 0.0, 0.05),
    ),
    "known share": (fixed("residual_correlated_share", 0.8),),
    "known strain": (fixed("residual_correlation_strain", 0.02),),
}


@cache
def observed(share: float = 0.7, seed: int = 1) -> FloatArray:
    """Residuals of both tests with s = 1 about lines through the origin of slope 1."""
    rng = np.random.default_rng(seed)
    found = []
    for position, segment in ((POSITION, SEGMENT), (OTHER, [0] * OTHER.size)):
        factor = np.linalg.cholesky(covariance(position, segment, 0.02, share))
        found.append(position + factor @ rng.standard_normal(position.size))
    return np.concatenate(found)


def data_of(priors: PriorSet, *, use_likelihood: bool = True) -> StanData:
    """Data of the straight lines, with the grid of two tests at constant rate."""
    tests = tuple(load_constant_rate(ICE / f"{name}.toml") for name in ("PIL40", "PIL72"))
    problem = Problem(tests, priors, (priors, priors), SEPARATE)
    return {
        "n_tests": 2,
        "point_end": [0, POSITION.size, POSITION.size + OTHER.size],
        "position": [*POSITION, *OTHER],
        "segment": [*SEGMENT, *[0] * OTHER.size],
        "observed": observed().tolist(),
        "use_likelihood": int(use_likelihood),
        "block_end": [0, 2, 3],
        "n_in_block": [14, 10, OTHER.size],
        **correlation_block(problem),
    }


def lines(priors: PriorSet, **options: bool) -> Density:
    return Density(
        load_program(TESTS / "stan" / "summed_correlation.stan"), data_of(priors, **options)
    )


@pytest.mark.parametrize("name", PRIORS)
def test_the_density_is_the_brute_force_sum(name: str) -> None:
    """Of two tests in blocks of different sizes; and of each reading given others."""
    density = lines(priors_with(*PRIORS[name]))
    found = density.variables_at(np.array([SLOPE, LOG_NOISE]))
    tests = ((POSITION, SEGMENT, 0), (OTHER, [0] * OTHER.size, POSITION.size))
    for e, (position, segment, first) in enumerate(tests):
        readings = observed()[first : first + position.size]
        residual = (readings - SLOPE * position) / np.exp(LOG_NOISE)

        def summed(
            known: npt.NDArray[np.bool_],
            residual: FloatArray = residual,
            position: FloatArray = position,
            segment: list[int] = segment,
        ) -> float:
            parts = [k for k, one in zip(segment, known, strict=True) if one]
            return summed_density(density.data, residual[known], position[known], parts)

        everything = np.ones(position.size, dtype=np.bool_)
        joint = summed(everything) - position.size * LOG_NOISE
        assert found["log_likelihood"][e] == pytest.approx(joint, rel=1e-10)
        own = found["log_densities"][first : first + position.size]
        assert own[:, 0].sum() == pytest.approx(joint, rel=1e-10)
        for k in (0, 1, position.size - 2):
            before, others = np.arange(position.size) < k, np.arange(position.size) != k
            up_to = before | ~others
            assert own[k, 0] == pytest.approx(summed(up_to) - summed(before) - LOG_NOISE, rel=1e-8)
            assert own[k, 1] == pytest.approx(
                summed(everything) - summed(others) - LOG_NOISE, rel=1e-8
            )


def test_the_gradient_is_that_of_the_density() -> None:
    density = lines(priors_with())
    place, step = np.array([SLOPE, LOG_NOISE]), 1e-5
    (gradient,) = density.gradients(place[np.newaxis])
    for k in range(2):
        shift = step * np.eye(2)[k]
        ends = [density.variables_at(place + sign * shift) for sign in (1, -1)]
        rise = ends[0]["log_likelihood"].sum() - ends[1]["log_likelihood"].sum()
        assert gradient[k] == pytest.approx(rise / (2 * step) - place[k], rel=1e-4)


@cache
def integral_grid(n: int = 60) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Shares, strains and prior masses (n, n) of a fine midpoint rule over both."""
    edges = np.append(1 - np.exp(-np.linspace(0, 9, n)), 1.0)
    scores = np.linspace(-3.5, 3.5, n + 1)
    law = priors_with()["residual_correlation_strain"].distribution()
    lengths = law.ppf(stats.norm.cdf((scores[1:] + scores[:-1]) / 2))
    mass = np.outer(np.diff(edges), np.diff(stats.norm.cdf(scores)))
    return (edges[1:] + edges[:-1]) / 2, lengths, mass


@cache
def exact_log_likelihoods(share: float, seed: int) -> tuple[FloatArray, FloatArray]:
    """Of the first test: a grid of ln s, and log likelihoods there at shares and strains."""
    shares, lengths, _ = integral_grid()
    residual = observed(share, seed)[: POSITION.size] - SLOPE * POSITION
    log_noise = np.linspace(-2.0, 2.5, 91)
    found = np.empty((log_noise.size, shares.size, lengths.size))
    for j, one in enumerate(shares):
        for m, length in enumerate(lengths):
            dense = covariance(POSITION, SEGMENT, length, one)
            square = residual @ np.linalg.solve(dense, residual)
            volume = np.linalg.slogdet(dense)[1] + residual.size * np.log(2 * np.pi)
            found[:, j, m] = -0.5 * (square * np.exp(-2 * log_noise) + volume)
    return log_noise, found - residual.size * log_noise[:, np.newaxis, np.newaxis]


@pytest.mark.parametrize("share", [0.3, 0.7, 0.99])
def test_the_posterior_of_the_noise_is_that_of_the_integral(share: float) -> None:
    """With w and the strain integrated out by a fine rule, as a sampler of both would have it."""
    data = {**data_of(priors_with()), "observed": observed(share, 2).tolist()}
    log_noise, exact = exact_log_likelihoods(share, 2)
    _, _, mass = integral_grid()
    points = np.column_stack([np.full(log_noise.size, SLOPE), log_noise])
    _, drawn = Density(load_program(TESTS / "stan" / "summed_correlation.stan"), data).generated_at(
        points
    )
    summed = drawn["log_densities"][0, :, : POSITION.size, 0].sum(axis=-1)
    moments = []
    for log_density in (summed, logsumexp(exact + np.log(mass), axis=(1, 2))):
        weight = np.exp(log_density - 0.5 * log_noise**2)
        weight /= weight.sum()
        mean = weight @ log_noise
        moments.append((mean, np.sqrt(weight @ (log_noise - mean) ** 2)))
    (mean, sd), (exact_mean, exact_sd) = moments
    assert abs(mean - exact_mean) < 0.03 * exact_sd
    assert sd == pytest.approx(exact_sd, rel=0.02)


def drawn_correlations(density: Density, n_draws: int = 4000) -> FloatArray:
    """Draws (n_draws, 2) of the strain and w of the first test, at one slope and noise."""
    points = np.tile([SLOPE, LOG_NOISE], (n_draws, 1))
    _, drawn = density.generated_at(points)
    return np.asarray(drawn["residual_correlation"][0, :, 0])


def test_draws_have_their_exact_conditional() -> None:
    """Shares and strains, and how they hang together, given slope and noise."""
    drawn = drawn_correlations(lines(priors_with()))
    shares, lengths, mass = integral_grid(300)
    residual = (observed()[: POSITION.size] - SLOPE * POSITION) / np.exp(LOG_NOISE)
    weight = np.empty_like(mass)
    for m, length in enumerate(lengths):
        variance, squares = np.zeros((shares.size, 0)), np.empty(0)
        for part in (slice(0, 14), slice(14, 24)):
            own = POSITION[part]
            correlation = np.exp(-np.abs(np.subtract.outer(own, own)) / length)
            value, vector = np.linalg.eigh(correlation)
            variance = np.hstack([variance, np.outer(shares, value) + (1 - shares)[:, np.newaxis]])
            squares = np.append(squares, (vector.T @ residual[part]) ** 2)
        weight[:, m] = -0.5 * (squares / variance + np.log(variance)).sum(axis=1)
    weight = mass * np.exp(weight - weight.max())
    weight /= weight.sum()
    for values, known, axis in ((drawn[:, 1], shares, 1), (drawn[:, 0], lengths, 0)):
        below = np.interp(values, known, np.cumsum(weight.sum(axis=axis)))
        assert stats.kstest(below, "uniform").pvalue > 1e-3
    means = weight.sum(axis=1) @ shares, weight.sum(axis=0) @ np.log(lengths)
    together = float(np.einsum("jm,j,m", weight, shares - means[0], np.log(lengths) - means[1]))
    found = np.cov(drawn[:, 1], np.log(drawn[:, 0]))[0, 1]
    assert found == pytest.approx(together, abs=4 * np.std(drawn[:, 1]) * 1.0 / np.sqrt(4000))


@pytest.mark.parametrize("name", ["standard", "narrow"])
def test_without_likelihood_the_prior_comes_back(name: str) -> None:
    priors = priors_with(*PRIORS[name])
    drawn = drawn_correlations(lines(priors, use_likelihood=False))
    for values, parameter in (
        (drawn[:, 1], "residual_correlated_share"),
        (drawn[:, 0], "residual_correlation_strain"),
    ):
        assert stats.kstest(values, priors[parameter].distribution().cdf).pvalue > 1e-3


def test_what_is_known_is_not_drawn() -> None:
    for name, column, value in (("known share", 1, 0.8), ("known strain", 0, 0.02)):
        drawn = drawn_correlations(lines(priors_with(*PRIORS[name])), n_draws=20)
        np.testing.assert_allclose(drawn[:, column], value, rtol=1e-12)
        assert np.ptp(drawn[:, 1 - column]) > 0


def cases_of_programs() -> list[tuple[Experiment, str]]:
    curve = load_constant_rate(ICE / "PIL40.toml")
    truth = {
        **(curve.true_parameters or {}),
        "residual_correlation_strain": 0.02,
        "residual_correlated_share": 0.6,
    }
    return [
        (replace(curve, true_parameters=truth), "residual_correlation_strain"),
        (history_twin("mixed", 8), "residual_correlation_time"),
    ]


@pytest.mark.parametrize(("experiment", "length"), cases_of_programs(), ids=["curve", "history"])
def test_the_programs_sum_over_their_own_residuals(experiment: Experiment, length: str) -> None:
    """The log likelihood of readings against the sum in SciPy; and with coordinates for both."""
    variant = {"residuals": "autocorrelated"}
    priors = with_variant(default_priors("ice"), experiment, variant)
    solver = SolverOptions(1e-9)
    problem, with_all = (
        problem_with(experiment, priors, pooling) for pooling in (SEPARATE, NOTHING_SUMMED)
    )
    assert {*problem.summed} == {length, "residual_correlated_share"}
    truth = dict(experiment.true_parameters or {})
    solution = solve(experiment, truth, experiment.position, solver=solver)
    reference = problem.likelihood.reference.name
    truth[reference] = float(np.exp(solution["log_reference"][0]))
    found, given = (
        Density(
            load_program(one.likelihood.program), program_data(one, solver=solver)
        ).variables_at(one.coordinates[0].at(truth))
        for one in (problem, with_all)
    )
    response = problem.likelihood.response.name
    noise = problem.likelihood.reading_noise(
        experiment, {name: np.array([value]) for name, value in truth.items()}
    )[0]
    residual = (experiment.response - found[f"{response}_model"]) / noise
    segment = list(problem.likelihood.along(experiment)["segment"][0])
    data = program_data(problem, solver=solver)
    expected = summed_density(data, residual, experiment.position, segment) - np.log(noise).sum()
    assert found["log_lik"].sum() == pytest.approx(expected, rel=1e-9)
    k = experiment.n_points // 2
    others = np.arange(experiment.n_points) != k
    without = summed_density(
        data, residual[others], experiment.position[others], np.array(segment)[others].tolist()
    )
    given_others = expected - (without - np.log(noise[others]).sum())
    assert found["log_lik_given_others"][k] == pytest.approx(given_others, rel=1e-7)
    dense = covariance(
        experiment.position, segment, truth[length], truth["residual_correlated_share"]
    )
    at_truth = stats.multivariate_normal.logpdf(residual, np.zeros(residual.size), dense)
    assert given["log_lik"].sum() == pytest.approx(at_truth - np.log(noise).sum(), rel=1e-9)


def problem_with(experiment: Experiment, priors: PriorSet, pooling: object) -> Problem:
    """A problem of one test, with or without the sum."""
    resolved = one_test(experiment, priors).likelihood.own_priors([experiment], priors)[0]
    return one_test(experiment, resolved.resolved(experiment.largest_stress), pooling)  # type: ignore[arg-type]
