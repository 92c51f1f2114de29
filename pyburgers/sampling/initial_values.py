"""Initial values of chains: from the prior, or around the posterior mode."""

import numpy as np
import numpy.typing as npt

from pyburgers.cmdstan.program import Program
from pyburgers.common.errors import SamplingError
from pyburgers.model.priors import PriorSet
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.forward import simulate
from pyburgers.protocols.registry import protocol_of
from pyburgers.protocols.stan_data import (
    SolverOptions,
    StanData,
    plain_coordinates,
)

INITIAL_ATTEMPTS = 100


def draw_initial_values(
    experiment: Experiment, priors: PriorSet, *, seed: int, chain: int
) -> dict[str, list[float]]:
    """Draw a start from the prior, again where the solver finds no solution.

    Parameters
    ----------
    experiment, priors
        The problem; priors resolved.
    seed, chain : int
        The start depends on these two alone.

    Returns
    -------
    dict
        Initial values as the program's parameters block wants them.

    Raises
    ------
    SamplingError
        If none of `INITIAL_ATTEMPTS` prior draws has a finite solution.
    """
    rng = np.random.default_rng([seed, chain])
    coordinates = plain_coordinates(experiment, priors)
    grid, reference = experiment.position, protocol_of(experiment).reference.name
    for _ in range(INITIAL_ATTEMPTS):
        values = priors.sample(rng)
        try:
            solution = simulate(experiment, values, at=grid, solver=SolverOptions())
        except SamplingError:
            continue  # this prior draw has no finite solution; the next one may
        start = coordinates.at({**values, reference: solution.attrs[reference]})
        return {"coordinate": start.tolist()}
    raise SamplingError(
        f"{experiment.id}: none of {INITIAL_ATTEMPTS} draws from the prior has a finite solution; "
        "check the units and the bounds of the priors."
    )


def draw_start_around(
    model: Program,
    data: StanData,
    centre: npt.NDArray[np.float64],
    covariance: npt.NDArray[np.float64],
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
