"""Initial values of chains: from the prior, or around the posterior mode."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from pyburgers.cmdstan.program import Program
from pyburgers.common.errors import SamplingError
from pyburgers.protocols.forward import simulate
from pyburgers.protocols.problem import Problem
from pyburgers.protocols.stan_data import SolverOptions, StanData

FloatArray = npt.NDArray[np.float64]

INITIAL_ATTEMPTS = 100


def draw_initial_values(problem: Problem, *, seed: int, chain: int) -> dict[str, list[float]]:
    """Draw a start in plain coordinates from the priors, again where a test has no solution.

    Partially pooled parameters are drawn apart for each test; centre and spread are put around
    them.

    Parameters
    ----------
    problem : Problem
        Tests, priors, pooling.
    seed, chain : int
        The start depends on these two alone.

    Returns
    -------
    dict
        Initial values as the program's parameters block wants them.

    Raises
    ------
    SamplingError
        If none of `INITIAL_ATTEMPTS` prior draws has a finite solution in every test.
    """
    rng = np.random.default_rng([seed, chain])
    reference = problem.protocol.reference.name
    for _ in range(INITIAL_ATTEMPTS):
        drawn = [priors.sample(rng) for priors in problem.priors]
        shared = {name: drawn[0][name] for name in problem.shared}
        values = [{**own, **shared} for own in drawn]
        spreads = np.abs(rng.standard_normal(len(problem.partial)))
        try:
            references = [
                simulate(experiment, own, at=experiment.position, solver=SolverOptions()).attrs[
                    reference
                ]
                for experiment, own in zip(problem.experiments, values, strict=True)
            ]
        except SamplingError:
            continue  # a test has no finite solution here; the next draw may have one
        plain = [
            coordinates.at({**own, reference: found})
            for coordinates, own, found in zip(problem.coordinates, values, references, strict=True)
        ]
        return {"coordinate": position_of(problem, plain, spreads).tolist()}
    raise SamplingError(
        f"{problem.name}: none of {INITIAL_ATTEMPTS} draws from the prior has a finite solution; "
        "check the units and the bounds of the priors."
    )


def position_of(problem: Problem, plain: Sequence[FloatArray], spreads: FloatArray) -> FloatArray:
    """Return coordinates from plain ones of each test and spreads over their scales."""
    layout = problem.layout
    position = np.empty(layout.size)
    # The first test comes last, so that shared coordinates are its own.
    for own, places in zip(reversed(plain), reversed(layout.position), strict=True):
        position[places] = own
    for h, name in enumerate(layout.partial):
        i = layout.names.index(name)
        numbers = np.array([own[i] for own in plain])
        centre = numbers.mean()
        position[layout.centre[h]] = centre
        position[layout.spread[h]] = np.log(spreads[h])
        spread = spreads[h] * problem.pooling.spread_scales[name]
        position[layout.position[:, i]] = (numbers - centre) / spread
    return position


def draw_start_around(
    model: Program,
    data: StanData,
    centre: FloatArray,
    covariance: FloatArray,
    *,
    seed: int,
    chain: int,
) -> dict[str, list[float]]:
    """Draw a start around the posterior mode, again where the solver finds no solution.

    The Laplace approximation with its floor under the curvature is as wide as the prior where the
    data say little, so that starts are dispersed there, and they begin near the curve elsewhere.

    Parameters
    ----------
    model : Program
        The program.
    data : dict
        Its data.
    centre : array, shape (n_coordinates,)
        The mode.
    covariance : array, shape (n_coordinates, n_coordinates)
        `pyburgers.sampling.metric.laplace_metric`.
    seed, chain : int
        The start depends on these two alone.

    Returns
    -------
    dict
        Initial values as the program's parameters block wants them.

    Raises
    ------
    SamplingError
        If none of `INITIAL_ATTEMPTS` draws has a finite solution.
    """
    rng = np.random.default_rng([seed, chain])
    factor = np.linalg.cholesky(covariance)
    for _ in range(INITIAL_ATTEMPTS):
        start = {"coordinate": (centre + factor @ rng.standard_normal(len(factor))).tolist()}
        try:
            solution = model.evaluate(data, start)
        except SamplingError:
            continue  # no solution here; the next draw may have one
        if np.isfinite(solution["log_lik"]).all():
            return start
    raise SamplingError(
        f"none of {INITIAL_ATTEMPTS} starts around the posterior mode has a finite solution; "
        "narrow the priors."
    )
