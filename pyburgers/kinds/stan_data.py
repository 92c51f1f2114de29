"""What the data of every Stan program have in common: solver, coordinates and their layout.

Only this module, `program_data`, the `likelihood` of each kind and the tables of rates know
the data blocks in `stan/data/` and of the programs.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, chain, pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import expit, logit

from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.common.errors import InputError
from pyburgers.model.pooling import Pooling
from pyburgers.model.reference_quantities import (
    REFERENCE_FLOW_RATE_QUANTITY,
    REFERENCE_QUANTITIES,
    REFERENCE_STRESS_QUANTITY,
)

StanData = dict[str, Any]


PLAIN, CHART = 1, 2
"""Codes of the coordinate systems: each program has plain ones and the chart of its protocol."""

BDF, FAST = "bdf", "fast"
SOLVERS = (BDF, FAST)
"""Solvers by their codes in the data of programs."""


@dataclass(frozen=True)
class SolverOptions:
    """Options of the solver of the differential equations.

    Attributes
    ----------
    tolerance : float
        Relative and absolute tolerance; the states are O(1), so one number fits both. The default
        is as loose as sampling with `ode_bdf_tol` allows: with it the log density of some
        oscillations varies by 0.05 between neighbouring points. At 3e-5 it varies by 0.3.
    max_num_steps : int
        Steps between two output strains before the solver gives up, which rejects the draw.
    method : str
        ``"fast"``: an implicit Runge-Kutta method in C++ for the kinds of test that have it, and
        Stan's `ode_bdf_tol` elsewhere; ``"bdf"``: `ode_bdf_tol` everywhere.

    Examples
    --------
    >>> pyburgers.SolverOptions(tolerance=1e-8)
    SolverOptions(tolerance=1e-08, max_num_steps=20000, method='fast')
    """

    tolerance: float = 1e-5
    max_num_steps: int = 20_000
    method: str = FAST

    def __post_init__(self) -> None:
        """Raise InputError if a value is out of range."""
        if not 1e-13 <= self.tolerance <= 1e-2:
            raise InputError(
                f"tolerance is {self.tolerance:g}, expected a number from 1e-13 to 1e-2 (option "
                "--tolerance)."
            )
        if self.max_num_steps < 1:
            raise InputError(f"max_num_steps is {self.max_num_steps}, expected at least 1.")
        if self.method not in SOLVERS:
            raise InputError(
                f"method is {self.method!r}, expected {' or '.join(SOLVERS)} (option --solver)."
            )


REFERENCE_SOLVER = SolverOptions(tolerance=1e-10, max_num_steps=1_000_000, method=BDF)
"""Tolerance at which a solution is taken as exact."""


def solver_block(solver: SolverOptions) -> StanData:
    """Return the block `stan/data/solver.stan`, and which solver it is."""
    return {
        "tolerance": solver.tolerance,
        "max_num_steps": solver.max_num_steps,
        "solver": SOLVERS.index(solver.method),
    }


def solver_in(data: Mapping[str, Any]) -> SolverOptions:
    """Return the options of the solver in the data of a program."""
    return SolverOptions(data["tolerance"], data["max_num_steps"], SOLVERS[data["solver"]])


def ends(sizes: Iterable[int]) -> list[int]:
    """Return where the parts of a ragged array end, after a leading 0."""
    return list(accumulate(sizes, initial=0))


def joined(entries: Sequence[StanData]) -> StanData:
    """Return lists of all tests, one behind the other."""
    return {name: list(chain.from_iterable(own[name] for own in entries)) for name in entries[0]}


REFERENCE_STRESS = REFERENCE_STRESS_QUANTITY.name
"""Name of the coordinate ln S_0 that replaces Q_M or beta."""


REFERENCE_FLOW_RATE = REFERENCE_FLOW_RATE_QUANTITY.name
"""Name of the coordinate ln(flow rate s) that replaces Q_M or beta in oscillating tests."""


CENTRE, SPREAD = "centre", "spread"
"""Owners of the coordinates that belong to no test."""


@dataclass(frozen=True, eq=False)
class PlainCoordinates:
    """Real-line coordinates of the free parameters, as in `stan/charts/plain.stan`.

    `quantities`, `parameters`: quantity of each coordinate, and the parameter that it gives: they
        differ where the logarithm of a reference stress or flow rate takes a parameter's place.
    `shift`, `scale`, `lower`, `upper` (n_coordinates,): origin, size and bounds of quantities (SI).
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
        pairs = zip(self.quantities, self.parameters, strict=True)
        return next((parameter for name, parameter in pairs if name in REFERENCE_QUANTITIES), None)

    @property
    def quantity(self) -> FloatArray:
        """Rows of shift, scale, lower and upper bound, shape (n_coordinates, 4)."""
        return np.column_stack([self.shift, self.scale, self.lower, self.upper])

    def at(self, values: Mapping[str, float], log_reference: float | None = None) -> FloatArray:
        """Coordinates, shape (n_coordinates,), of SI values.

        They include the reference one, unless its logarithm is given, which is never too small.
        """

        def position(name: str) -> float:
            if name not in REFERENCE_QUANTITIES:
                return values[name]
            return float(np.log(values[name])) if log_reference is None else log_reference

        found = [self.of_quantity(k, position(name)) for k, name in enumerate(self.quantities)]
        return np.array(found, dtype=np.float64)

    def of_quantity(self, k: int, position: npt.ArrayLike) -> FloatArray:
        """Coordinate k, of any shape, where its quantity (or its logarithm) has given values."""
        position = np.asarray(position, dtype=np.float64)
        lower, upper, scale = self.lower[k], self.upper[k], self.scale[k]
        if np.isinf(lower):
            return np.asarray((position - self.shift[k]) / scale)
        with np.errstate(divide="ignore"):
            if np.isinf(upper):
                return np.asarray(np.log((position - lower) / scale))
            return np.asarray(logit((position - lower) / (upper - lower)))

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

    `values`, `coordinate` (n_coordinates,): every parameter in SI; plain coordinates.
    `driving_error` (n_driving_errors,): standardised errors of what drives the test.
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
    `position`, `source` (n_tests, n_names): place of each coordinate, and test whose value it is.
    `shared`, `partial`: shared (by some tests at least) and partially pooled parameters among them.
    `centre`, `spread` (n_partial,): where centres and spreads of the latter stand.
    `errors`: where the errors of what drives each test stand.
    `own`: for each test, places among the names of parameters that it has by itself, or shares as
        first.
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
    n_errors: Sequence[int],
    sources: Mapping[str, Sequence[int]],
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
    ends = following + 2 * len(partial) + np.cumsum([0, *n_errors])
    own = tuple(
        [i for i, name in enumerate(names) if name not in partial and row[i] == test]
        for test, row in enumerate(source)
    )
    errors = tuple(np.arange(start, end) for start, end in pairwise(ends))
    spread = centre + len(partial)
    return Layout(tuple(names), position, source, shared, partial, centre, spread, errors, own)
