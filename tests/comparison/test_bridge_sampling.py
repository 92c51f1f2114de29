"""Bridge sampling against closed forms, and how honest its error is."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy import stats
from scipy.special import gammaln

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.comparison.marginal_likelihood import log_integral
from pyburgers.comparison.results import LogIntegral

LogDensity = Callable[[FloatArray], FloatArray]

MIXING = np.eye(20) + 0.2 * np.random.default_rng(0).standard_normal((20, 20))
"""Makes coordinates hang together."""


def chains(rng: np.random.Generator, shape: tuple[int, int, int], memory: float) -> FloatArray:
    """Standard normal draws, each chain an autoregressive process."""
    draws = rng.standard_normal(shape)
    for k in range(1, shape[1]):
        draws[:, k] = memory * draws[:, k - 1] + np.sqrt(1 - memory**2) * draws[:, k]
    return draws


def normal(size: int) -> tuple[LogDensity, float, FloatArray]:
    """A correlated normal times e^3, its log integral, and the factor of its covariance."""
    factor = MIXING[:size, :size]
    inverse = np.linalg.inv(factor)
    _, logarithm = np.linalg.slogdet(factor)
    exact = 3.0 + 0.5 * size * np.log(2 * np.pi) + float(logarithm)
    return lambda x: 3.0 - 0.5 * np.sum((x @ inverse.T) ** 2, axis=-1), exact, factor


def skewed(shape: float, size: int) -> tuple[LogDensity, float]:
    """Logarithms of gamma variables without their normalisation, and the log integral."""
    return lambda x: np.sum(shape * x - np.exp(x), axis=-1), size * float(gammaln(shape))


def found_normal(seed: int, *, size: int, memory: float) -> tuple[LogIntegral, float]:
    density, exact, factor = normal(size)
    draws = chains(np.random.default_rng(seed), (4, 400, size), memory) @ factor.T
    return log_integral(draws, density(draws), density, seed=seed), exact


def found_skewed(seed: int, *, size: int) -> tuple[LogIntegral, float]:
    density, exact = skewed(2.0, size)
    uniform = stats.norm.cdf(chains(np.random.default_rng(seed), (4, 400, size), 0.5))
    draws = np.log(stats.gamma.ppf(uniform, 2.0))
    return log_integral(draws, density(draws), density, seed=seed), exact


@pytest.mark.parametrize("size", [1, 20])
def test_the_integral_of_a_normal_and_of_a_skewed_density_is_the_closed_form(size: int) -> None:
    found, exact = found_normal(1, size=size, memory=0.0)
    assert found.value == pytest.approx(exact, abs=4 * found.error)
    assert found.error < 0.02
    skewed_found, exact = found_skewed(2, size=10)
    assert skewed_found.value == pytest.approx(exact, abs=4 * skewed_found.error)
    assert skewed_found.error < 0.1
    slow, _ = found_normal(1, size=size, memory=0.9)  # autocorrelation makes the error larger
    assert slow.error > 1.5 * found.error


@pytest.mark.parametrize(
    "trial",
    [
        lambda seed: found_normal(seed, size=12, memory=0.0),
        lambda seed: found_normal(seed, size=12, memory=0.8),
        lambda seed: found_skewed(seed, size=6),
    ],
    ids=["normal", "autocorrelated", "skewed"],
)
def test_errors_are_as_large_as_the_scatter(
    trial: Callable[[int], tuple[LogIntegral, float]],
) -> None:
    trials = [trial(seed) for seed in range(30)]
    off = np.array([found.value - exact for found, exact in trials])
    stated = np.array([found.error for found, _ in trials])
    # 30 draws give a standard deviation to 13 %.
    assert 0.6 < np.sqrt(np.mean((off / stated) ** 2)) < 1.5
    assert abs(np.mean(off)) < 3 * np.std(off) / np.sqrt(off.size)


def test_points_without_density_count_as_such() -> None:
    """Half of a normal: the integral is half of it."""
    density, exact, factor = normal(4)

    def half(x: FloatArray) -> FloatArray:
        return np.where(x[..., 0] > 0, density(x), -np.inf)

    draws = chains(np.random.default_rng(5), (4, 1000, 4), 0.0) @ factor.T
    draws *= np.sign(draws[..., :1])
    found = log_integral(draws, half(draws), half, seed=5)
    assert found.value == pytest.approx(exact - np.log(2), abs=4 * found.error)


def test_distant_halves_widen_the_error() -> None:
    both = LogIntegral.mean(LogIntegral(0.0, 0.1), LogIntegral(1.0, 0.1))
    assert (both.value, both.error) == (0.5, 0.5)
    alike = LogIntegral.mean(LogIntegral(0.5, 0.1), LogIntegral(0.5, 0.1))
    assert alike.error == pytest.approx(0.1 / np.sqrt(2))


def test_what_gives_no_integral_is_refused() -> None:
    density, _, _ = normal(4)
    few = np.zeros((2, 10, 4))
    with pytest.raises(
        InputError, match=r"found 20 draws of 4 coordinates, expected at least 32\.$"
    ):
        log_integral(few, density(few), density, seed=1)
    stuck = np.zeros((2, 100, 4))
    with pytest.raises(SamplingError, match="no spread"):
        log_integral(stuck, density(stuck), density, seed=1)
    draws = chains(np.random.default_rng(6), (2, 100, 4), 0.0)
    with pytest.raises(SamplingError, match="density is 0"):
        log_integral(draws, density(draws), lambda x: np.full(len(x), -np.inf), seed=1)
