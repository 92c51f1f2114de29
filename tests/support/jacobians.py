"""The Jacobian that a program states, beside that of differences of its output."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pytest
from log_density import Program
from stan_data import parameter_in

from pyburgers.common.array_types import FloatArray

Columns = Mapping[str, float]
STEP = 2e-4
"""Small enough for differences of second order: their error is a millionth of the third slope."""


def parameters_named(names: Sequence[str]) -> Callable[[Columns], FloatArray]:
    """Return what takes parameters (SI) of a test by itself from columns."""
    return lambda columns: np.array([parameter_in(columns, name) for name in names])


def assert_jacobian_is_that_of_the_map(
    program: Program,
    point: FloatArray,
    quantities: Callable[[Columns], FloatArray],
) -> Columns:
    """Compare `log_jacobian` with the determinant of quantities (n,) by the first n coordinates.

    Returns the columns at the point.
    """
    here = program.values_at(point)
    scale = np.abs(quantities(here))  # in SI they differ by many powers of ten
    shifts = STEP * np.eye(point.size)[: scale.size]
    ahead, behind = (
        np.array([quantities(program.values_at(one)) for one in point + side * shifts])
        for side in (1, -1)
    )
    sign, logarithm = np.linalg.slogdet((ahead - behind) / (2 * STEP) / scale)
    assert sign != 0
    assert here["log_jacobian"] == pytest.approx(logarithm + np.log(scale).sum(), abs=1e-6)
    return here
