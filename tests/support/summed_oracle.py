"""Densities of residuals whose correlation is summed over a grid, by dense covariances in SciPy."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats
from scipy.interpolate import CubicSpline
from scipy.special import logsumexp

FloatArray = npt.NDArray[np.float64]


def covariance(
    position: FloatArray, segment: Sequence[int], length: float, share: float
) -> FloatArray:
    """Of residuals over s."""
    correlated = np.exp(-np.abs(np.subtract.outer(position, position)) / length)
    together = np.equal.outer(segment, segment)
    matrix: FloatArray = share * correlated * together + (1 - share) * np.eye(position.size)
    return matrix


def summed_density(
    data: Mapping[str, Any], residual: FloatArray, position: FloatArray, segment: Sequence[int]
) -> float:
    """Log density of residuals over s: a dense one at every node, then spline and sum in SciPy."""
    shares, lengths = np.array(data["share_node"][0]), np.array(data["length_node"][0])
    at_nodes = np.array(
        [
            [
                stats.multivariate_normal.logpdf(
                    residual,
                    np.zeros(residual.size),
                    covariance(position, segment, length, share),
                )
                if residual.size
                else 0.0
                for length in lengths
            ]
            for share in shares
        ]
    )
    for axis, (n, cells) in enumerate(
        ((shares.size, data["n_share_cells"]), (lengths.size, data["n_length_cells"]))
    ):
        if n > 1:
            middle = (np.arange(cells) + 0.5) / cells
            node = np.linspace(middle[0], middle[-1], n)
            at_nodes = CubicSpline(node, at_nodes, axis=axis)(middle)
    mass = np.add.outer(data["log_share_mass"], data["log_length_mass"])
    return float(logsumexp(at_nodes + mass))
