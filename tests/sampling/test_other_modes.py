"""Weights of the modes of densities whose modes are known."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from pyburgers.cmdstan.program import Density, Ending
from pyburgers.common.errors import SamplingError
from pyburgers.sampling.manifest import OtherMode, recorded_modes
from pyburgers.sampling.modes import weighed_modes

FloatArray = npt.NDArray[np.float64]

PLACES = np.array([[0.0, 0.0], [6.0, -2.0]])
SPREADS = np.array([[0.2, 1.0], [0.5, 0.7]])


class Mixture(Density):
    """Two normal distributions far from each other, with the weights 0.7 and 0.3."""

    weights = np.array([0.7, 0.3])

    def __init__(self) -> None:
        pass

    def log_density(self, point: FloatArray) -> float:
        """Logarithm of the density."""
        return float(np.logaddexp.reduce(self._parts(point)))

    def _parts(self, point: FloatArray) -> FloatArray:
        exponent = -0.5 * np.sum(((point - PLACES) / SPREADS) ** 2, axis=1)
        parts: FloatArray = np.log(self.weights) + exponent - np.sum(np.log(SPREADS), axis=1)
        return parts

    def gradients(self, points: FloatArray) -> FloatArray:
        """Return gradients of it."""
        found = []
        for point in points:
            parts = self._parts(point)
            share = np.exp(parts - np.logaddexp.reduce(parts))
            found.append(share @ ((PLACES - point) / SPREADS**2))
        return np.array(found)


class Unsolved(Mixture):
    """The same, without a solution around the second."""

    def gradients(self, points: FloatArray) -> FloatArray:
        if np.asarray(points)[:, 0].max() > 3:
            raise SamplingError("There is no gradient here")
        return super().gradients(points)


def end(mixture: Mixture, place: npt.ArrayLike) -> Ending:
    """An end of a climb."""
    point = np.array(place)
    return Ending(mixture.log_density(point), point, {})


@pytest.fixture
def ends() -> list[Ending]:
    """The highest first: both modes, and two that are not quite at theirs."""
    mixture = Mixture()
    found = [
        end(mixture, [0.0, 0.0]),
        end(mixture, [0.01, 0.1]),
        end(mixture, [6.0, -2.0]),
        end(mixture, [6.1, -2.1]),
    ]
    return sorted(found, key=lambda one: one.log_density, reverse=True)


def test_the_weight_is_that_of_the_probability_around_a_mode(ends: list[Ending]) -> None:
    """The second has a quarter of the density of the first and 0.43 of its probability."""
    (first, highest), (log_weight, beside) = weighed_modes(Mixture(), ends)
    assert first == 0
    np.testing.assert_array_equal(highest.place, PLACES[0])
    assert np.exp(log_weight) == pytest.approx(0.3 / 0.7, rel=0.01)
    np.testing.assert_array_equal(beside.place, PLACES[1])


def test_the_weightiest_mode_comes_first_though_another_is_higher() -> None:
    mixture = Mixture()
    mixture.weights = np.array([0.4, 0.6])
    highest, wide = (end(mixture, place) for place in PLACES)
    assert highest.log_density > wide.log_density
    (_, first), (log_weight, second) = weighed_modes(mixture, [highest, wide])
    assert (first, second) == (wide, highest)
    assert np.exp(log_weight) == pytest.approx(0.4 / 0.6, rel=0.01)


def test_an_end_beside_which_nothing_is_solved_is_no_mode(ends: list[Ending]) -> None:
    assert weighed_modes(Unsolved(), ends) == [(0.0, ends[0])]
    # As where the lesser mode is the one beside which there are solutions.
    turned = sorted(ends, key=lambda one: one.log_density)
    assert turned[0].place[0] > 3
    assert weighed_modes(Unsolved(), turned) == [(0.0, turned[0])]
    # Nor is one that lies far below the highest.
    lower = [replace(one, log_density=one.log_density - 13 * (one.place[0] > 3)) for one in ends]
    assert weighed_modes(Mixture(), lower) == [(0.0, lower[0])]


def test_a_part_of_a_joint_fit_has_its_own_values() -> None:
    values = {"one": {"stress_exponent": 3.0}, "two": {"stress_exponent": 4.0}}
    both = OtherMode(log_weight=-1.5, values=values)
    manifest = {"other_modes": [both.model_dump()]}
    assert recorded_modes(manifest, None) == (both,)
    (of_two,) = recorded_modes(manifest, "two")
    assert of_two == OtherMode(log_weight=-1.5, values={"two": values["two"]})
    assert recorded_modes({}, None) == ()
