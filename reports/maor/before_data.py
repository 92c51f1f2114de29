"""What is known of a test before its curve is fitted: the prior, and the prior and one number.

Draws of the prior are solved by the test's Stan program. Weighed by the likelihood of one number of
the data, such as the peak stress, they are draws of what is known from that number alone.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from common import Fitted, FloatArray, parameter_draws
from scipy.special import softmax

from pyburgers import prior_draws

Number = TypeVar("Number", bound=np.number[Any])

LEAST_EFFECTIVE = 50.0
"""Effective draws below which probabilities of weighed draws are not used."""

READING_ERROR = 0.02
"""Relative standard deviation of the one number, read off a curve."""


@dataclass(frozen=True)
class Datum:
    """One number known of a test without its curve: read off the test, and in each of its draws."""

    observed: Callable[[Fitted], float]
    predicted: Callable[[Fitted], FloatArray]


@dataclass(frozen=True, eq=False)
class Knowledge:
    """A test as it is known from its fit, from the prior, and from the prior and one number.

    Weights are those of the draws of the prior given the one number, shape (n_prior_draws,); they
    add up to 1.
    """

    fit: Fitted
    prior: Fitted
    weights: FloatArray

    @property
    def effective_draws(self) -> float:
        """Number of draws of equal weight that would say as much."""
        return float(1 / np.sum(self.weights**2))

    def mean_before(self, name: str) -> tuple[float, float]:
        """Mean of a parameter (SI) under the prior, and under the prior and one number."""
        draws = parameter_draws(self.prior, name)
        return float(draws.mean()), float(self.weights @ draws)

    def sd_before(self, name: str) -> tuple[float, float]:
        """Width of a parameter (SI) under the prior, and with one number (standard deviations)."""
        draws = parameter_draws(self.prior, name)
        of_mean = draws - self.weights @ draws
        return float(draws.std(ddof=1)), float(np.sqrt(self.weights @ of_mean**2))

    def resampled(self, values: FloatArray, n: int, *, seed: int) -> FloatArray:
        """Draw n of the values of the prior's draws, weighed by the one number."""
        chosen = np.random.default_rng(seed).choice(len(values), size=n, p=self.weights)
        drawn: FloatArray = values[chosen]
        return drawn

    def three(
        self, prior: npt.NDArray[Number], posterior: npt.NDArray[Number]
    ) -> tuple[tuple[npt.NDArray[Number], FloatArray], ...]:
        """Return values with weights under the prior, with one number, and under the posterior."""
        same = [np.full(len(values), 1 / len(values)) for values in (prior, posterior)]
        return (prior, same[0]), (prior, self.weights), (posterior, same[1])


def knowledge(fit: Fitted, datum: Datum, *, n_draws: int, seed: int) -> Knowledge:
    """Gather what is known of a fitted test before and after its data."""
    prior = prior_draws(fit.experiment, fit.priors, draws=n_draws, seed=seed)
    return Knowledge(fit, prior, weights_by(datum, prior))


def weights_by(datum: Datum, prior: Fitted) -> FloatArray:
    """Weigh draws of the prior by the likelihood of one number, its error `READING_ERROR`."""
    deviation = (datum.predicted(prior) / datum.observed(prior) - 1) / READING_ERROR
    weights: FloatArray = softmax(-(deviation**2) / 2)
    return weights
