"""Posteriors of linear models whose truths come from their priors: exact draws, many data sets."""

from collections.abc import Iterator, Sequence
from types import MappingProxyType

import numpy as np
import xarray as xr
from scipy import stats

from pyburgers.common.array_types import FloatArray
from pyburgers.model.flow_law_prior import PRIOR_QUANTITIES, Conditions, FlowLawPrior
from pyburgers.model.parameters import PARAMETER_BY_NAME, PARAMETERS
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import PriorSet

NAMES = tuple(parameter.name for parameter in PARAMETERS)


def standard_normal(name: str) -> Prior:
    """Return N(0, 1) without bounds."""
    unit = PARAMETER_BY_NAME[name].si_unit
    return Prior(name, "normal", 0.0, 1.0, -np.inf, np.inf, unit, "test")


def uniform(name: str) -> Prior:
    """Return a uniform prior from 1 to 2: neither bound is one of the model."""
    return Prior(name, "uniform", 1.5, 0.5, 1.0, 2.0, PARAMETER_BY_NAME[name].si_unit, "test")


def prior_set(*given: Prior) -> PriorSet:
    """Return priors of some parameters."""
    return PriorSet("ice", "test", MappingProxyType({p.parameter: p for p in given}), "test")


def flow_law(mean: Sequence[float], sd: Sequence[float], at: Conditions) -> FlowLawPrior:
    """Return a flow law of ice whose quantities do not correlate."""
    covariance = np.diag(np.square(sd))
    return FlowLawPrior(PRIOR_QUANTITIES, np.array(mean), covariance, at, "ice", "test")


def labelled(draws: FloatArray, priors: PriorSet) -> xr.DataTree:
    """Return draws of shape (n, n_parameters) as those of one chain."""
    columns = {
        name: (("chain", "draw"), draws[None, :, k], {"fixed": 0})
        for k, name in enumerate(priors.free)
    }
    return xr.DataTree.from_dict({"posterior": xr.Dataset(columns)})


def normal_fits(
    n_fits: int, seed: int, *, draws: int, away: float | None = None
) -> Iterator[tuple[xr.DataTree, PriorSet]]:
    """Make truths from 12 normal priors, data of random designs, and draws of their posteriors.

    The first truth, which the data know well, may lie standard deviations `away` from its prior.
    """
    rng = np.random.default_rng(seed)
    priors = prior_set(*map(standard_normal, NAMES))
    size = len(NAMES)
    for _ in range(n_fits):
        # Some directions are known well, some are left to the priors.
        design = rng.standard_normal((size, size)) * np.exp(rng.uniform(-4, 3, size))[:, None]
        truth = rng.standard_normal(size)
        if away is not None:
            truth[0] = away
            design = np.vstack([design, 3.0 * np.eye(1, size)])
        data = design @ truth + rng.standard_normal(len(design))
        covariance = np.linalg.inv(np.eye(size) + design.T @ design)
        mean = covariance @ design.T @ data
        yield labelled(rng.multivariate_normal(mean, covariance, draws), priors), priors


def uniform_fits(
    n_fits: int, seed: int, *, draws: int, noise: float, beyond: float | None = None
) -> Iterator[tuple[xr.DataTree, PriorSet]]:
    """Make truths from 12 uniform priors, one reading of each, and draws of their posteriors.

    The standard deviation of a reading is `noise` ranges of the prior. The first reading may lie
    standard deviations `beyond` the lower bound.
    """
    rng = np.random.default_rng(seed)
    priors = prior_set(*map(uniform, NAMES))
    for _ in range(n_fits):
        reading = rng.uniform(1.0, 2.0, len(NAMES)) + noise * rng.standard_normal(len(NAMES))
        if beyond is not None:
            reading[0] = 1.0 - beyond * noise
        ends = (1.0 - reading) / noise, (2.0 - reading) / noise
        law = stats.truncnorm(*ends, loc=reading, scale=noise)
        yield labelled(law.rvs((draws, len(NAMES)), random_state=rng), priors), priors
