"""The Jacobian that a program states, beside that of differences of its output."""

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt
import pytest
from log_density import Program

FloatArray = npt.NDArray[np.float64]
Columns = Mapping[str, float]
STEP = 2e-3


def assert_jacobian_is_that_of_the_map(
    program: Program,
    point: FloatArray,
    quantities: Callable[[Columns], FloatArray],
    *,
    beside: Callable[[Columns], float] = lambda columns: 0.0,
    within: float = 1e-5,
) -> None:
    """Compare `log_jacobian` with the determinant of quantities (n,) by the first n coordinates.

    `beside` is ln of the determinant of the parameters by these quantities. Differences are of
    fourth order in the step.
    """

    def at(coordinate: FloatArray) -> Columns:
        return program.columns_at({"coordinate": coordinate.tolist()})

    here = at(point)
    scale = np.abs(quantities(here))  # in SI they differ by many powers of ten
    slopes = []
    for shift in STEP * np.eye(point.size)[: scale.size]:
        one, two = (
            quantities(at(point + m * shift)) - quantities(at(point - m * shift)) for m in (1, 2)
        )
        slopes.append((8 * one - two) / (12 * STEP) / scale)
    sign, logarithm = np.linalg.slogdet(np.column_stack(slopes))
    assert sign != 0
    expected = logarithm + np.log(scale).sum() + beside(here)
    assert here["log_jacobian"] == pytest.approx(expected, abs=within)
