"""Whether the solver is accurate enough to sample with, before chains start.

What the solver errs by differs from one point to the next. Where the log density jumps by it, a
sampler takes the jumps for errors of its steps, and makes these ever smaller in vain.
"""

from dataclasses import dataclass

import numpy as np

from pyburgers.cmdstan.program import Program
from pyburgers.common.draws import FloatArray
from pyburgers.kinds.stan_data import REFERENCE_SOLVER, StanData, solver_block
from pyburgers.sampling.densities import log_density_at
from pyburgers.sampling.repetitions import TIGHTENING

MAX_NOISE = 0.3
"""Of the log density, with which sampling still goes well (`docs/coordinates_trials.md`)."""

MAX_TIGHTENINGS = 3
"""Times that the tolerance is tightened for it, if that many are needed."""

N_LINES, N_POINTS = 2, 20
"""Lines through the centre, each with as many points within a standard deviation of it."""


@dataclass(frozen=True)
class Noisy:
    """A tolerance of the solver that is too loose, and the noise of the log density there."""

    tolerance: float
    noise: float


def noisy_tolerances(
    model: Program, data: StanData, centre: FloatArray, covariance: FloatArray, *, seed: int
) -> list[Noisy]:
    """Return the tolerances, from that of the data on, at which the log density is too noisy.

    The one `TIGHTENING` times tighter than the last of them is good to sample with. The data are in
    the coordinates that chains move in; centre, shape (n_coordinates,), and covariance, shape
    (n_coordinates, n_coordinates), are those of the Laplace approximation. The seed decides the
    directions of the lines.
    """
    points, place = _lines(centre, covariance, np.random.default_rng(seed))
    exact = log_density_at(model, {**data, **solver_block(REFERENCE_SOLVER)}, points)
    found: list[Noisy] = []
    tolerance = float(data["tolerance"])
    for _ in range(MAX_TIGHTENINGS):
        density = log_density_at(model, {**data, "tolerance": tolerance}, points)
        with np.errstate(invalid="ignore"):  # two points without a solution
            error = density - exact
        noise = max(_jumps(one, place) for one in np.split(error, N_LINES))
        if noise <= MAX_NOISE:
            break
        found.append(Noisy(tolerance, noise))
        tolerance /= TIGHTENING
    return found


def _lines(
    centre: FloatArray, covariance: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Points along lines through the centre, and their places on each."""
    place = np.linspace(-1.0, 1.0, N_POINTS)
    directions = rng.standard_normal((N_LINES, centre.size))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    along = directions @ np.linalg.cholesky(covariance).T
    return np.concatenate([centre + place[:, np.newaxis] * one for one in along]), place


def _jumps(error: FloatArray, place: FloatArray) -> float:
    """Return the spread of errors about a parabola, which steps of a sampler do not mind."""
    known = np.isfinite(error)
    if known.sum() <= 3:
        return 0.0
    smooth = np.polynomial.Polynomial.fit(place[known], error[known], 2)
    return float(np.std(error[known] - smooth(place[known])))
