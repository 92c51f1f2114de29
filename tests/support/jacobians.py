"""The Jacobian that a program states, beside that of differences of its output."""

from collections.abc import Callable, Mapping, Sequence

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
    shifts = STEP * np.eye(point.size)
    points = np.vstack([point, *(point + m * shifts for m in (1, -1, 2, -2))])
    rows: Sequence[Columns] = program.generated_at(points)
    if "log_jacobian" not in rows[0]:  # its program has it among the transformed parameters
        rows = [program.columns_at({"coordinate": one.tolist()}) for one in points]
    here = rows[0]
    found = np.array([quantities(row) for row in rows])
    scale = np.abs(found[0])  # in SI they differ by many powers of ten
    ahead, behind, far_ahead, far_behind = found[1:].reshape(4, point.size, -1)[:, : scale.size]
    slopes = (8 * (ahead - behind) - (far_ahead - far_behind)) / (12 * STEP) / scale
    sign, logarithm = np.linalg.slogdet(slopes)
    assert sign != 0
    expected = logarithm + np.log(scale).sum() + beside(here)
    assert here["log_jacobian"] == pytest.approx(expected, abs=within)
