"""Around the modes of a density: their weights, errors of the solver, starts of chains."""

from collections.abc import Mapping, Sequence
from contextlib import suppress

import numpy as np

from pyburgers.cmdstan.program import Density, Ending
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import SamplingError
from pyburgers.sampling.manifest import NoisyTolerance
from pyburgers.sampling.repetitions import TIGHTENING

MAX_DEPTH = 12.0
"""Of the log density below the highest mode: from further below, no volume makes up for it."""

MIN_MODE_DISTANCE = 3.0
"""Distance of two ends, in standard deviations at the one, from which on they are two modes."""

MAX_NOISE = 0.3
"""Of the log density, with which sampling still goes well."""

MAX_TIGHTENINGS = 3
"""Times that the tolerance is tightened for it, if that many are needed."""

N_LINES, N_POINTS = 2, 20
"""Lines through the centre, each with as many points within a standard deviation of it."""

START_ATTEMPTS = 100
"""Draws, one after the other, of which none has a solution, at which a search for a start ends."""


def weighed_modes(density: Density, ends: Sequence[Ending]) -> list[tuple[float, Ending]]:
    """Return modes among ends of climbs, of which the first is the highest, by falling weight.

    Each has ln of its weight over that of the first one returned. A high mode can be so narrow that
    a lower one has most of the posterior.
    """
    highest, *others = ends
    found = [(0.0, highest)]
    candidates = [end for end in others if end.log_density > highest.log_density - MAX_DEPTH]
    if not candidates:
        return found
    try:
        covariance = density.laplace(highest.place)
    except SamplingError:  # at the edge of where the solver has solutions, nothing can be weighed
        return found
    known = [(highest.place, covariance)]
    log_weight = highest.log_density + _log_volume(covariance)
    for end in candidates:
        if any(_distance(end.place, *mode) < MIN_MODE_DISTANCE for mode in known):
            continue
        # An end beside which the solver has no solution is no mode.
        with suppress(SamplingError):
            covariance = density.laplace(end.place)
            known.append((end.place, covariance))
            found.append((end.log_density + _log_volume(covariance) - log_weight, end))
    found.sort(key=lambda one: one[0], reverse=True)
    most = found[0][0]
    return [(weight - most, end) for weight, end in found]


def _log_volume(covariance: FloatArray) -> float:
    """Return ln of the volume around a mode, but for a constant."""
    return float(np.linalg.slogdet(covariance)[1]) / 2


def _distance(place: FloatArray, mode: FloatArray, covariance: FloatArray) -> float:
    """Return the distance of a place from a mode in standard deviations there."""
    apart = place - mode
    return float(np.sqrt(apart @ np.linalg.solve(covariance, apart)))


def noisy_tolerances(
    density: Density,
    reference: Mapping[str, object],
    centre: FloatArray,
    covariance: FloatArray,
    *,
    seed: int,
) -> list[NoisyTolerance]:
    """Return tolerances of the solver, from that of the data on, at which the density is noisy.

    The solver's errors differ from one point to the next. A sampler takes jumps of the log density
    for errors of its steps, and shortens these in vain. The tolerance that is `TIGHTENING` times
    tighter than the last noisy one is good to sample with. Centre, (n_coordinates,), and covariance
    are those of the Laplace approximation. The entries `reference` of the data make solutions
    exact; the seed decides the directions of the lines along which densities are compared.
    """
    points, place = _lines(centre, covariance, np.random.default_rng(seed))
    exact = density.with_data(reference).at(points)
    found: list[NoisyTolerance] = []
    tolerance = float(density.data["tolerance"])
    for _ in range(MAX_TIGHTENINGS):
        with np.errstate(invalid="ignore"):  # two points without a solution
            error = density.with_data({"tolerance": tolerance}).at(points) - exact
        noise = max(_jumps(one, place) for one in np.split(error, N_LINES))
        if noise <= MAX_NOISE:
            break
        found.append(NoisyTolerance(tolerance=tolerance, noise=noise))
        tolerance /= TIGHTENING
    return found


def _lines(
    centre: FloatArray, covariance: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return points along lines through the centre, and their places on each."""
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


def draw_around(
    density: Density, centre: FloatArray, covariance: FloatArray, *, seed: int, chain: int
) -> FloatArray:
    """Draw a start, (n_coordinates,), around a mode, again where the solver finds no solution.

    The covariance is that of `Density.laplace`: as wide as the prior where data say little. The
    start depends on seed and chain alone.
    """
    rng = np.random.default_rng([seed, chain])
    factor = np.linalg.cholesky(covariance)
    for _ in range(START_ATTEMPTS):
        start: FloatArray = centre + factor @ rng.standard_normal(len(factor))
        # Where there is no solution, the next draw may have one.
        with suppress(SamplingError):
            if np.isfinite(density.variables_at(start)["log_lik"]).all():
                return start
    raise SamplingError(
        f"none of {START_ATTEMPTS} starts around the posterior mode has a finite solution; "
        "narrow the priors."
    )
