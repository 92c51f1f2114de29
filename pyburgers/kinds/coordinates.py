"""Coordinates of a fit of one to many tests: those of each test, and which stands for what."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
from scipy.special import expit, logit

from pyburgers.model.parameters import (
    REFERENCE_FLOW_RATE_QUANTITY,
    REFERENCE_QUANTITIES,
    REFERENCE_STRESS_QUANTITY,
)
from pyburgers.model.pooling import Pooling

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

REFERENCE_STRESS = REFERENCE_STRESS_QUANTITY.name
"""Name of the coordinate ln S_0 that replaces Q_M or beta."""

REFERENCE_FLOW_RATE = REFERENCE_FLOW_RATE_QUANTITY.name
"""Name of the coordinate ln(flow rate s) that replaces Q_M or beta in oscillating tests."""

CENTRE, SPREAD = "centre", "spread"
"""Owners of the coordinates that belong to no test."""


@dataclass(frozen=True, eq=False)
class PlainCoordinates:
    """Real-line coordinates of the free parameters, as in `stan/charts/plain.stan`.

    `quantities`: quantity of each coordinate: a parameter, or in place of one the reference stress
        or flow rate, as a logarithm.
    `parameters`: parameter that each coordinate gives a value to.
    `shift`, `scale`, `lower`, `upper` (n_coordinates,): origin, size and bounds of the quantities
        in SI (ln Pa for the reference stress, ln 1/s for the flow rate).
    """

    quantities: tuple[str, ...]
    parameters: tuple[str, ...]
    shift: FloatArray
    scale: FloatArray
    lower: FloatArray
    upper: FloatArray

    @property
    def replaced_parameter(self) -> str | None:
        """Parameter whose place the reference stress or flow rate takes, if any."""
        for quantity, parameter in zip(self.quantities, self.parameters, strict=True):
            if quantity in REFERENCE_QUANTITIES:
                return parameter
        return None

    @property
    def quantity(self) -> FloatArray:
        """Rows of shift, scale, lower and upper bound, shape (n_coordinates, 4)."""
        return np.column_stack([self.shift, self.scale, self.lower, self.upper])

    def at(self, values: Mapping[str, float]) -> FloatArray:
        """Coordinates, shape (n_coordinates,), of SI values that include the reference one."""
        return np.array(
            [
                self.of_quantity(
                    k, np.log(values[name]) if name in REFERENCE_QUANTITIES else values[name]
                )
                for k, name in enumerate(self.quantities)
            ],
            dtype=np.float64,
        )

    def of_quantity(self, k: int, position: npt.ArrayLike) -> FloatArray:
        """Coordinate k, of any shape, where its quantity (or its logarithm) has given values."""
        position = np.asarray(position, dtype=np.float64)
        lower, upper, scale = self.lower[k], self.upper[k], self.scale[k]
        if np.isinf(lower):
            anywhere: FloatArray = (position - self.shift[k]) / scale
            return anywhere
        with np.errstate(divide="ignore"):
            if np.isinf(upper):
                above: FloatArray = np.log((position - lower) / scale)
                return above
            inside: FloatArray = logit((position - lower) / (upper - lower))
            return inside

    def value(self, k: int, position: float) -> float:
        """Quantity k (or its logarithm) at a coordinate, the inverse of `of_quantity`."""
        lower, upper, scale = self.lower[k], self.upper[k], self.scale[k]
        if np.isinf(lower):
            return float(self.shift[k] + scale * position)
        if np.isinf(upper):
            return float(lower + scale * np.exp(position))
        return float(lower + (upper - lower) * expit(position))


@dataclass(frozen=True, eq=False)
class Mode:
    """The highest density found, on the real line of the plain coordinates.

    `values`: every parameter in SI.
    `coordinate` (n_coordinates,): plain coordinates.
    `driving_error` (n_driving_errors,): errors of what drives the test, standardised.
    """

    values: Mapping[str, float]
    coordinate: FloatArray
    driving_error: FloatArray


@dataclass(frozen=True, eq=False)
class Layout:
    """Which coordinate of a fit stands for what.

    They stand in this order: the first test's, the other tests' own ones, centres, spreads, errors
    of what drives the tests. A value that tests share is the first one's of them.

    `names`: parameters with a coordinate in every test by itself.
    `position` (n_tests, n_names): where the coordinate of each parameter of each test stands, from
        0; that of a shared parameter is the same in all tests that share it.
    `source` (n_tests, n_names): test whose value each is, from 0: another one only of shared
        parameters.
    `shared`, `partial`: shared (by some tests at least) and partially pooled parameters among them.
    `centre`, `spread` (n_partial,): where centres and spreads of the latter stand.
    `errors`: where the errors of what drives each test stand.
    `own`: for each test, the places among the names of the parameters that it has by itself, among
        them the shared ones of which it is the first.
    """

    names: tuple[str, ...]
    position: IntArray
    source: IntArray
    shared: tuple[str, ...]
    partial: tuple[str, ...]
    centre: IntArray
    spread: IntArray
    errors: tuple[IntArray, ...]
    own: tuple[list[int], ...]

    @property
    def n_tests(self) -> int:
        """Number of tests."""
        return int(self.position.shape[0])

    @property
    def size(self) -> int:
        """Number of coordinates."""
        n_errors = sum(own.size for own in self.errors)
        return int(self.position.max(initial=-1)) + 1 + 2 * len(self.partial) + n_errors

    @property
    def pooled(self) -> list[int]:
        """Places of the partially pooled parameters among the names."""
        return [self.names.index(name) for name in self.partial]


def layout_of(
    names: Sequence[str],
    n_tests: int,
    pooling: Pooling,
    n_errors: Sequence[int] = (),
    sources: Mapping[str, Sequence[int]] = MappingProxyType({}),
) -> Layout:
    """Lay the coordinates of a fit out."""
    shared_by_all, partial = (pooling.of_kind(kind, names) for kind in ("shared", "partial"))
    source = np.zeros((n_tests, len(names)), dtype=np.int64)
    for i, name in enumerate(names):
        if name not in shared_by_all:
            source[:, i] = sources.get(name, range(n_tests))
    position = np.zeros_like(source)
    following = 0
    for e, i in np.ndindex(*position.shape):
        if source[e, i] == e:
            position[e, i] = following
            following += 1
        else:
            position[e, i] = position[source[e, i], i]
    # One test shares with nobody.
    changes = (source != np.arange(n_tests)[:, np.newaxis]).any(axis=0)
    shared = tuple(name for name, change in zip(names, changes, strict=True) if change)
    centre = following + np.arange(len(partial))
    ends = following + 2 * len(partial) + np.cumsum([0, *(n_errors or [0] * n_tests)])
    own = tuple(
        [i for i, name in enumerate(names) if name not in partial and row[i] == test]
        for test, row in enumerate(source)
    )
    return Layout(
        tuple(names),
        position,
        source,
        shared,
        partial,
        centre,
        centre + len(partial),
        tuple(np.arange(start, end) for start, end in pairwise(ends)),
        own,
    )
