"""Log density of a program at given points."""

import numpy as np

from pyburgers.cmdstan.program import ALL_DIGITS, Program
from pyburgers.common.draws import FloatArray
from pyburgers.kinds.stan_data import StanData


def log_density_at(program: Program, data: StanData, points: FloatArray) -> FloatArray:
    """Log density at points, shape (n_points, n_coordinates), of a program with its data.

    It is minus infinity where the model has no solution. The program's parameter is the vector
    ``coordinate``.
    """
    solved, drawn = program.generate_at(data, "coordinate", points, ALL_DIGITS)
    found = np.full(len(points), -np.inf)
    if solved.any():
        found[solved] = drawn["log_density"][0]
    return np.where(np.isnan(found), -np.inf, found)
