"""What is known of a test before its curve is fitted: the prior, and the prior and one number.

Draws of the prior are solved by the test's Stan program. Weighed by the likelihood of one number of
the data, such as the peak stress, they are draws of what is known from that number alone.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.special import softmax

from pyburgers.cmdstan.program import load_program
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.model.priors import PriorSet
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.problem import one_test
from pyburgers.protocols.program_data import program_data
from pyburgers.protocols.protocol import FittedTest, protocol_of
from pyburgers.protocols.stan_data import SolverOptions

FloatArray = npt.NDArray[np.float64]

LEAST_EFFECTIVE = 50.0
"""Effective draws below which probabilities of weighed draws are not used."""

READING_ERROR = 0.02
"""Relative standard deviation of the one number, read off a curve."""

UNCUT = 50.0
"""Half a range of a prior, in its standard deviations, that cuts nothing off."""


@dataclass(frozen=True, eq=False)
class PriorDraws:
    """Draws of the prior of a test with their solutions, to be looked at as a fit is.

    Attributes
    ----------
    experiment : Experiment
        The test.
    priors : PriorSet
        Its resolved priors.
    posterior : DataTree
        Groups posterior (SI) and predictions, as of a fit, of one chain.
    n_unsolved : int
        Draws that were left out because they have no solution.
    """

    experiment: Experiment
    priors: PriorSet
    posterior: xr.DataTree
    n_unsolved: int


@dataclass(frozen=True)
class Datum:
    """One number that is known of a test without its whole curve.

    Attributes
    ----------
    name : str
        Such as peak stress.
    observed : callable
        Receives draws of the test, returns the number that was read off the test itself.
    predicted : callable
        Receives draws, returns the number in each.
    """

    name: str
    observed: Callable[[FittedTest], float]
    predicted: Callable[[FittedTest], FloatArray]


@dataclass(frozen=True, eq=False)
class Knowledge:
    """A test as it is known from the prior, from the prior and one number, and from its fit.

    Attributes
    ----------
    fit : FittedTest
        Draws of the posterior.
    prior : PriorDraws
        Draws of the prior.
    weights : array, shape (n_prior_draws,)
        Of these, given the one number; they add up to 1.
    """

    fit: FittedTest
    prior: PriorDraws
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
        """Draw from what is known by the prior and one number.

        Parameters
        ----------
        values : array, shape (n_prior_draws,)
            Of the draws of the prior.
        n, seed : int
            How many, and what decides which.
        """
        chosen = np.random.default_rng(seed).choice(len(values), size=n, p=self.weights)
        drawn: FloatArray = values[chosen]
        return drawn


def knowledge(fit: FittedTest, datum: Datum, *, n_draws: int, seed: int) -> Knowledge:
    """Gather what is known of a fitted test before and after its data.

    Parameters
    ----------
    fit : FittedTest
        The fit.
    datum : Datum
        The one number.
    n_draws, seed : int
        Draws of the prior.
    """
    prior = prior_draws(fit, n_draws=n_draws, seed=seed)
    return Knowledge(fit, prior, weights_by(datum, prior))


def weights_by(datum: Datum, prior: PriorDraws) -> FloatArray:
    """Weigh draws of the prior by the likelihood of one number, its error `READING_ERROR`.

    Returns
    -------
    array, shape (n_draws,)
        Adding up to 1.
    """
    observed, predicted = datum.observed(prior), datum.predicted(prior)
    deviation = (predicted / observed - 1) / READING_ERROR
    weights: FloatArray = softmax(-(deviation**2) / 2)
    return weights


def prior_draws(fit: FittedTest, *, n_draws: int, seed: int) -> PriorDraws:
    """Draw from the priors of a test, each parameter by itself, and solve every draw.

    Parameters
    ----------
    fit : FittedTest
        Test and priors; its draws are not looked at.
    n_draws, seed : int
        How many, and what decides which.

    Raises
    ------
    InputError
        If the priors of the flow law are joint.
    SamplingError
        If no draw has a solution.
    """
    rng = np.random.default_rng(seed)
    priors, protocol = fit.priors, protocol_of(fit.experiment)
    if priors.flow_law is not None:
        raise InputError(
            f"{fit.experiment.id}: found a joint prior of the flow law, expected a prior for each "
            "parameter by itself."
        )
    values = {
        name: np.full(n_draws, prior.location)
        if prior.is_fixed
        else prior.distribution().rvs(size=n_draws, random_state=rng)
        for name, prior in priors.priors.items()
    }
    problem = one_test(protocol.without_data(fit.experiment), _each_by_itself(priors))
    (coordinates,) = problem.coordinates
    rows = np.column_stack(
        [coordinates.of_quantity(k, values[name]) for k, name in enumerate(coordinates.quantities)]
    )
    grid = protocol.prediction_grid(fit.experiment)
    data = program_data(problem, solver=SolverOptions(), grids=[grid])
    kept, drawn = load_program(protocol.program).generate_at(data, "coordinate", rows)
    if kept.any():
        drawn, kept[kept] = drawn.finite_in([next(iter(protocol.grid_quantities))])
    if not kept.any():
        raise SamplingError(
            f"{fit.experiment.id}: none of {n_draws} draws from the prior has a solution; "
            "check the units and the bounds of the priors."
        )
    clock = protocol.clock.name
    dimensions = ("chain", "draw", clock)
    labels = {"chain": [1], "draw": np.flatnonzero(kept)}
    groups = {
        "posterior": xr.Dataset(
            {name: (dimensions[:2], own[None, kept]) for name, own in values.items()}, labels
        ),
        "predictions": xr.Dataset(
            {
                name: (dimensions, drawn[column], {"units": unit})
                for column, (name, unit) in protocol.grid_quantities.items()
            },
            {**labels, clock: grid},
        ),
    }
    n_unsolved = int(n_draws - kept.sum())
    return PriorDraws(fit.experiment, priors, xr.DataTree.from_dict(groups), n_unsolved)


def parameter_draws(fit: FittedTest, name: str) -> FloatArray:
    """All draws of a parameter (SI), shape (n_draws,)."""
    return all_draws(fit.posterior["posterior"].to_dataset()[name])


def prediction_draws(fit: FittedTest, name: str) -> FloatArray:
    """All draws of a solution along the clock (SI), shape (n_draws, n_grid)."""
    return all_draws(fit.posterior["predictions"].to_dataset()[name]).astype(np.float64)


def _each_by_itself(priors: PriorSet) -> PriorSet:
    """Bound Q_M and beta where nothing is cut, so that no point of the flow law replaces one."""
    changed = []
    for name in ("activation_enthalpy", "beta"):
        prior = priors[name]
        if not prior.is_fixed:
            reach = UNCUT * prior.scale
            lower, upper = prior.location - reach, prior.location + reach
            changed.append(
                replace(prior, lower=max(prior.lower, lower), upper=min(prior.upper, upper))
            )
    return priors.exchanging(*changed)
