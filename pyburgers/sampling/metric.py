"""First metric of the sampler: the inverse curvature of the log density at the posterior mode."""

import json
import tempfile
from collections.abc import Iterable
from pathlib import Path

import cmdstanpy
import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.protocols.forward import quiet_cmdstanpy
from pyburgers.protocols.stan_data import StanData

FloatArray = npt.NDArray[np.float64]

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


def laplace_metric(model: cmdstanpy.CmdStanModel, data: StanData, centre: FloatArray) -> FloatArray:
    """Covariance of the Laplace approximation around the posterior mode.

    Parameters
    ----------
    model : CmdStanModel
        Program whose parameter is the vector ``coordinate``.
    data : dict
        Its data.
    centre : array, shape (n_coordinates,)
        The mode in the coordinates that the data choose.

    Returns
    -------
    array, shape (n_coordinates, n_coordinates)
        Inverse of the Hessian of minus the log density by central differences of Stan's
        gradients, with its eigenvalues kept above `LEAST_CURVATURE`.
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


def expected_rise(
    model: cmdstanpy.CmdStanModel, data: StanData, centre: FloatArray, covariance: FloatArray
) -> float:
    """Rise of the log density from a point to the mode of its quadratic approximation there.

    Parameters
    ----------
    model, data, centre
        As for `laplace_metric`.
    covariance : array, shape (n_coordinates, n_coordinates)
        Its result.
    """
    (gradient,) = _gradients(model, data, [centre])
    return float(gradient @ covariance @ gradient) / 2


def curvature_at(
    model: cmdstanpy.CmdStanModel,
    data: StanData,
    centre: FloatArray,
    steps: FloatArray | None = None,
) -> FloatArray:
    """Hessian of minus the log density.

    Parameters
    ----------
    model, data, centre
        As for `laplace_metric`.
    steps : array, shape (n_coordinates, n_coordinates), optional
        Steps of the differences as columns; default: `DIFFERENCE` along each coordinate.

    Returns
    -------
    array, shape (n_coordinates, n_coordinates)
        By central differences of Stan's gradients, symmetric.
    """
    if steps is None:
        steps = DIFFERENCE * np.eye(centre.size)
    difference = _gradients(model, data, centre + steps.T) - _gradients(
        model, data, centre - steps.T
    )
    hessian = -np.linalg.solve(2 * steps.T, difference)
    symmetric: FloatArray = (hessian + hessian.T) / 2
    return symmetric


def _gradients(
    model: cmdstanpy.CmdStanModel, data: StanData, points: Iterable[FloatArray]
) -> FloatArray:
    """Gradients of the log density, shape (n_points, n_coordinates)."""
    with tempfile.TemporaryDirectory() as folder, quiet_cmdstanpy():
        data_file = Path(folder) / "data.json"
        data_file.write_text(json.dumps(data), encoding="utf-8")
        return np.array([_gradient(model, data_file, point) for point in points])


def _gradient(model: cmdstanpy.CmdStanModel, data_file: Path, coordinate: FloatArray) -> FloatArray:
    """Gradient of the log density: what one step of vanishing length records."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        position = folder / "position.json"
        position.write_text(json.dumps({"coordinate": coordinate.tolist()}), encoding="utf-8")
        model.sample(
            data=str(data_file),
            inits=str(position),
            chains=1,
            iter_warmup=0,
            iter_sampling=1,
            adapt_engaged=False,
            step_size=1e-14,
            max_treedepth=1,
            seed=1,
            sig_figs=17,
            save_diagnostics=True,
            output_dir=name,
            show_progress=False,
        )
        (record,) = folder.glob("*diagnostic*.csv")
        row = pd.read_csv(record, comment="#").iloc[0]
    # The record holds the gradient of the potential, which is minus the log density.
    gradient: FloatArray = -row.filter(regex="^g_").to_numpy(dtype=np.float64)
    return gradient
