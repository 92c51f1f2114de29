"""Which coordinate of a fit of one to many tests stands for what."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pyburgers.model.pooling import Pooling

IntArray = npt.NDArray[np.int64]

CENTRE, SPREAD = "centre", "spread"
"""Owners of the coordinates that belong to no test."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Which coordinate of a fit stands for what.

    They stand in this order: the first test's, the other tests' own ones, centres, spreads.

    Attributes
    ----------
    names : tuple of str
        Parameters with a coordinate in every test by itself.
    position : array of int, shape (n_tests, n_names)
        Where the coordinate of each parameter of each test stands, from 0; that of a shared
        parameter is the same in all tests.
    shared, partial : tuple of str
        Shared and partially pooled parameters among them.
    centre, spread : array of int, shape (n_partial,)
        Where centres and spreads of the latter stand.
    """

    names: tuple[str, ...]
    position: IntArray
    shared: tuple[str, ...]
    partial: tuple[str, ...]
    centre: IntArray
    spread: IntArray

    @property
    def n_tests(self) -> int:
        """Number of tests."""
        return int(self.position.shape[0])

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return int(self.position.max(initial=-1)) + 1 + 2 * len(self.partial)

    @property
    def pooled(self) -> list[int]:
        """Places of the partially pooled parameters among the names."""
        return [self.names.index(name) for name in self.partial]

    def own(self, test: int) -> list[int]:
        """Places among the names of the parameters that a test has by itself.

        Shared ones are the first test's.
        """
        others = self.partial if test == 0 else (*self.partial, *self.shared)
        return [i for i, name in enumerate(self.names) if name not in others]


def layout_of(names: Sequence[str], n_tests: int, pooling: Pooling) -> Layout:
    """Lay the coordinates of a fit out.

    Parameters
    ----------
    names : sequence of str
        Parameters that are inferred in every test.
    n_tests : int
        Number of tests.
    pooling : Pooling
        How they hang together.
    """
    # One test shares with nobody.
    shared = pooling.of_kind("shared", names) if n_tests > 1 else ()
    partial = pooling.of_kind("partial", names)
    position = np.zeros((n_tests, len(names)), dtype=np.int64)
    position[0] = np.arange(len(names))
    following = len(names)
    for e in range(1, n_tests):
        for i, name in enumerate(names):
            position[e, i] = i if name in shared else following
            following += name not in shared
    centre = following + np.arange(len(partial))
    return Layout(tuple(names), position, shared, partial, centre, centre + len(partial))
