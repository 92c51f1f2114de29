"""Errors of what drives tests among the labelled draws."""

from dataclasses import dataclass

import numpy as np
import stanio

from pyburgers.cmdstan.draw_files import Draws
from pyburgers.posterior.build import driving_errors


@dataclass(frozen=True)
class Driven:
    id: str
    n_driving_errors: int


def test_the_last_coordinates_are_errors_of_the_tests_in_turn() -> None:
    header = ",".join(f"coordinate.{k}" for k in range(1, 6))
    values = np.arange(2 * 3 * 5.0).reshape(2, 3, 5)
    fit = Draws(stanio.parse_header(header), values)
    both = driving_errors(fit, [Driven("a", 2), Driven("b", 1)])  # type: ignore[list-item]
    assert list(both) == ["driving_error[a, 1]", "driving_error[a, 2]", "driving_error[b, 1]"]
    np.testing.assert_array_equal(
        both["driving_error[b, 1]"].transpose("chain", "draw"), values[:, :, 4]
    )
    single = driving_errors(fit, [Driven("a", 2)])  # type: ignore[list-item]
    assert list(single) == ["driving_error[1]", "driving_error[2]"]
    np.testing.assert_array_equal(
        single["driving_error[1]"].transpose("chain", "draw"), values[:, :, 3]
    )
