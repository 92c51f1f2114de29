"""Parameters of a sample that was not fitted: what a joint fit knows of them beforehand."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import xarray as xr

from pyburgers.common.draws import FloatArray, all_draws
from pyburgers.kinds.problem import Problem
from pyburgers.kinds.stan_data import CENTRE, SPREAD
from pyburgers.model.pooling import pooling_of
from pyburgers.posterior.labelled_draws import own_name

MICROSTRUCTURE = (
    "steady_state_grain_size",
    "steady_state_fabric_factor",
    "critical_strain_grain_size",
    "critical_strain_fabric",
)
"""Parameters of a sample, of which those that tests do not share say little of another one."""


def of_new_test(
    problem: Problem,
    posterior: xr.DataTree,
    name: str,
    kept: npt.NDArray[np.int64],
    rng: np.random.Generator,
) -> FloatArray:
    """Draw a partially pooled parameter (SI) of a test that was not fitted, for kept draws."""
    group = posterior["posterior"].to_dataset()
    centre, spread = (all_draws(group[own_name(name, owner)])[kept] for owner in (CENTRE, SPREAD))
    return _scattered(problem, name, centre, spread, rng)


def _scattered(
    problem: Problem, name: str, centre: FloatArray, sd: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Draw a parameter (SI) about centres, normal on the real line behind its bounds: (n,)."""
    plain = problem.coordinates[0]
    k = plain.quantities.index(name)
    real = plain.of_quantity(k, centre) + sd * rng.standard_normal(centre.size)
    return np.array([plain.value(k, position) for position in real])


def microstructure_of_new_sample(
    problem: Problem, values: Mapping[str, FloatArray], rng: np.random.Generator
) -> dict[str, FloatArray]:
    """Return the microstructure (SI) that a joint fit would give another sample beforehand.

    Separate parameters are drawn from their priors. A single test with default pooling knows those
    that are pooled in part up to two deviations from the common centre.
    """
    pooling = pooling_of() if problem.is_single else problem.pooling
    priors = problem.priors[0]
    names = [name for name in MICROSTRUCTURE if name in priors.free]
    size = values[names[0]].size if names else 0
    drawn = {
        name: np.array([priors[name].sample(rng) for _ in range(size)])
        for name in pooling.of_kind("separate", names)
    }
    if problem.is_single:
        for name in pooling.of_kind("partial", names):
            spread = pooling.spread_scales[name] * np.abs(rng.standard_normal(size))
            drawn[name] = _scattered(problem, name, values[name], np.sqrt(2) * spread, rng)
    return drawn
