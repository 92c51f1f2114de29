"""Curvature of the log density of a program, by differences of its gradients."""

import numpy as np

from pyburgers.cmdstan.program import Program
from pyburgers.common.draws import FloatArray
from pyburgers.kinds.stan_data import StanData

DIFFERENCE = 0.05
"""Step of the central differences; coordinates are O(1)."""

LARGEST_STEP = 4.0
"""In posterior standard deviations, beyond which differences are taken again with smaller steps."""

SMALL_STEP = 0.25
"""Of those, in standard deviations as the differences before have them."""

N_REFINEMENTS = 4
"""Each is worth a factor of ten or more in the width of the narrowest direction."""

LEAST_CURVATURE = 0.15
"""Floor of the eigenvalues: flat directions are about as wide as a logistic prior, sd 1.8-2.6."""


def laplace_metric(model: Program, data: StanData, centre: FloatArray) -> FloatArray:
    """Covariance of the Laplace approximation at a mode, shape (n_coordinates, n_coordinates).

    The program's parameter is the vector ``coordinate``. It is the inverse of the Hessian of minus
    the log density, whose eigenvalues are kept above `LEAST_CURVATURE`.
    """
    steps: FloatArray = DIFFERENCE * np.eye(centre.size)
    for _ in range(1 + N_REFINEMENTS):
        curvature, axes = np.linalg.eigh(curvature_at(model, data, centre, steps))
        covariance: FloatArray = (axes / np.maximum(curvature, LEAST_CURVATURE)) @ axes.T
        widths = np.linalg.cholesky(covariance)
        if np.linalg.norm(np.linalg.solve(widths, steps), axis=0).max() <= LARGEST_STEP:
            break
        steps = np.asarray(SMALL_STEP * widths, dtype=np.float64)
    return covariance


def curvature_at(
    model: Program,
    data: StanData,
    centre: FloatArray,
    steps: FloatArray | None = None,
) -> FloatArray:
    """Hessian of minus the log density, symmetric, by central differences of Stan's gradients.

    The columns of `steps`, shape (n_coordinates, n_coordinates), are the steps of the differences;
    by default `DIFFERENCE` along each coordinate.
    """
    if steps is None:
        steps = DIFFERENCE * np.eye(centre.size)
    after, before = (
        model.gradients(data, "coordinate", centre + shift) for shift in (steps.T, -steps.T)
    )
    hessian = -np.linalg.solve(2 * steps.T, after - before)
    symmetric: FloatArray = (hessian + hessian.T) / 2
    return symmetric
