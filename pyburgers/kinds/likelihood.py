"""What the sampler asks of a kind of test, and the answer in the folder of each kind."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar, Generic

import numpy as np
from numpy.typing import ArrayLike

from pyburgers.cmdstan.draw_files import Draws
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.array_types import BoolArray, FloatArray
from pyburgers.common.errors import InputError
from pyburgers.kinds.experiment import E, Experiment, MeasuredMicrostructure
from pyburgers.kinds.stan_data import Layout, Mode, PlainCoordinates, SolverOptions, StanData
from pyburgers.model.parameters import Parameter
from pyburgers.model.priors import PriorSet
from pyburgers.model.read_quantities import Quantity, ReadQuantity

NAMES = ("constant_rate", "forced_oscillation", "loading_history", "attenuation")
"""Of all kinds of test, in files, and of their folders."""


class ChartUnsuited(Exception):  # noqa: N818 - an outcome with a reason, not an error
    """A chart does not apply to a test and its priors; the message says why."""


@dataclass(frozen=True, eq=False)
class AtMode(Generic[E]):
    """A test by itself at its posterior mode, and what a chart may ask its Stan program there.

    `experiment`, `priors`: the test and its resolved priors.
    `coordinates`, `mode`: what its plain coordinates stand for, and the mode.
    `data`: data of the program in plain coordinates.
    `solution`: solution at positions on the clock, SI (`pyburgers.kinds.program_data.solve`).
    `generated`, `curvature`, `covariance`: receive changed entries of the data, the last a position
        before them; return variables, Hessian of minus the log density, Laplace approximation.
    `generated_at`: receives positions (n, n_coordinates) and changed entries; returns which are
        solved, and the variables there (`pyburgers.cmdstan.program.Program.generate_at`).
    """

    experiment: E
    priors: PriorSet
    coordinates: PlainCoordinates
    mode: Mode
    data: StanData
    solution: Callable[[FloatArray], dict[str, FloatArray]]
    generated: Callable[..., dict[str, FloatArray]]
    curvature: Callable[..., FloatArray]
    covariance: Callable[..., FloatArray]
    generated_at: Callable[..., tuple[BoolArray, Draws]]


class Chart(ABC, Generic[E]):
    """Coordinates of a kind of test other than the plain ones, set up at the posterior mode.

    Only the speed of a run depends on them, not its result.

    `name`: as in the option ``--coordinates`` (`docs/coordinates.md`).
    `curvature_tolerance`: tolerance of the solver for curvatures; None takes that of the run.
    """

    name: ClassVar[str]
    curvature_tolerance: ClassVar[float | None] = None

    def solved(self, priors: PriorSet, experiment: E) -> tuple[str, ...]:
        """Return the parameters that a test must have of its own."""
        return ()

    @abstractmethod
    def reference(self, test: AtMode[E]) -> tuple[Any, FloatArray]:
        """Return what sets the chart up at a mode, and the mode in it, or raise ChartUnsuited."""

    def rescaled(self, reference: Any, test: AtMode[E], covariance: FloatArray) -> Any:
        """Return the reference, set up further with the posterior's covariance in the chart."""
        return reference

    @abstractmethod
    def block(self, references: Sequence[Any], layout: Layout) -> StanData:
        """Return the data of the chart, given what tests are set up with; none: it is not used."""


MICROSTRUCTURE = ("grain_size", "fabric_factor", "grain_size_softening", "fabric_softening")
"""What programs report of the state of grains and fabric."""

_GRID_UNITS: Mapping[str, str] = {
    **dict.fromkeys(("stress", "oscillating_stress"), "Pa"),
    **dict.fromkeys(("strain_rate", "dashpot_rate"), "1/s"),
    "grain_size": "m",
}
"""SI units of what programs report along the clock; all else is a number."""


def grid_quantities(*names: str) -> Mapping[str, tuple[str, str]]:
    """Return variables ``grid_NAME`` of a program with their name in labelled draws and SI unit."""
    return {
        f"grid_{name}": (
            name.removeprefix("oscillating_"),
            _GRID_UNITS.get(name.removesuffix("_replicated"), "1"),
        )
        for name in names
    }


class Likelihood(ABC, Generic[E]):
    """How a kind of test is sampled: data of its Stan program, coordinates, grids and noises.

    `name`: of the kind, and of its program.
    `clock`: along which the test is driven and solutions are given.
    `read`: what is read; ``grid_NAME`` of the program is each, and `Experiment.quantity` says
        which of them a reading is.
    `response`: what is observed; ``response_model`` and ``response_replicated`` of the program.
    `reference`: point of the flow law whose logarithm is sampled in place of Q_M or beta.
    `grid_quantities`: variables of the program along the clock: name and SI unit in labelled draws.
    `warmup`, `target_acceptance`: defaults of the sampler: as little as leaves (almost) no
        divergences.
    `solver`: default of the solver while sampling; `has_fast_solver`: whether it can be fast.
    `chart`: coordinates other than the plain ones.
    """

    name: ClassVar[str]
    clock: ClassVar[Quantity]
    read: ClassVar[tuple[ReadQuantity, ...]]
    response: ClassVar[Quantity]
    reference: ClassVar[Parameter]
    grid_quantities: ClassVar[Mapping[str, tuple[str, str]]]
    warmup: ClassVar[int]
    target_acceptance: ClassVar[float]
    solver: ClassVar[SolverOptions] = SolverOptions()
    has_fast_solver: ClassVar[bool] = False
    chart: ClassVar[Chart[Any]]

    @property
    def program(self) -> Path:
        """Path of its Stan program."""
        return stan_directory() / f"{self.name}.stan"

    @abstractmethod
    def reference_origin(self, experiment: E) -> tuple[float, float]:
        """Return origin and size of ln(`reference`/SI unit) of a test."""

    @abstractmethod
    def tests_block(self, experiments: Sequence[E], priors: Sequence[PriorSet]) -> StanData:
        """Return the data of the program that are about tests of this kind alone."""

    @abstractmethod
    def grid_block(self, experiments: Sequence[E], grids: Sequence[FloatArray]) -> StanData:
        """Return the positions on the clock (SI) at which the program reports solutions."""

    @abstractmethod
    def grid(self, experiment: E, *, fine: bool = False) -> FloatArray:
        """Return positions on the clock (SI), (n,): of predictive bands, or of a smooth curve."""

    def output_grid(self, experiment: E) -> FloatArray:
        """Return positions of a smooth curve and those of the readings (SI), shape (n,)."""
        grid = self.grid(experiment, fine=True)
        return np.sort(np.concatenate([grid, np.setdiff1d(experiment.position, grid)]))

    def shown_clock(self, last: float) -> Quantity:
        """Return the clock in the unit in which a test with such a last position (SI) is shown."""
        return self.clock

    def is_read(self, experiment: E, at: FloatArray) -> BoolArray:
        """Return whether each of `read` is read or imposed at positions (SI), (n_read, n)."""
        return np.ones((len(self.read), at.size), dtype=np.bool_)

    def along(self, experiment: E) -> dict[str, tuple[FloatArray, str]]:
        """Return where the readings lie along a test, by name, with the SI unit.

        ``quantity`` is `Experiment.quantity` where several are read, ``reading_error`` a stated
            standard deviation, ``typical_error`` the size by which residuals that differ are
            weighed otherwise; ``is_limit`` marks upper limits, if there are any.
        """
        found = {self.clock.name: (experiment.position, self.clock.si_unit)}
        if len(self.read) > 1:
            found["quantity"] = (experiment.quantity.astype(np.float64), "1")
        return found

    def reading_noise(
        self, experiment: E, values: Mapping[str, FloatArray], solved: FloatArray
    ) -> FloatArray:
        """Return standard deviations of readings (SI), from parameters and `solved` readings.

        Both arrays have the shape (n_draws, n_points).
        """
        noise = np.stack([values[self.read[k].noise] for k in experiment.quantity], axis=-1)
        # With a discrepancy of the law noise is the reading error alone.
        discrepancy = np.asarray(values.get("discrepancy", 0.0))[..., np.newaxis]
        return np.asarray(noise * np.sqrt(1 + discrepancy**2))

    def own_priors(self, experiments: Sequence[E], priors: PriorSet) -> tuple[PriorSet, ...]:
        """Return priors for each of some tests, with what their files and readings add."""
        return tuple(priors for _ in experiments)

    def check_priors(self, experiment: E, priors: PriorSet) -> None:
        """Check that a test can be fitted with priors (`InputError`); most can with any."""

    def as_history(self, experiment: E) -> Experiment:
        """Return a test as a loading history (`InputError` if it is none), to go with any other."""
        raise InputError(
            f"{experiment.id}: a test of the protocol {self.name} cannot be fitted together with "
            f"tests of other protocols, expected tests of {self.name} alone."
        )


@cache
def likelihoods() -> Mapping[str, Likelihood[Any]]:
    """Return the likelihood of every kind of test by the kind's name."""
    return {name: import_module(f"{__package__}.{name}.likelihood").LIKELIHOOD for name in NAMES}


def likelihood_of(experiment: Experiment) -> Likelihood[Any]:
    """Return the likelihood of a test's kind."""
    return likelihoods()[experiment.protocol]


def spread_over(starts: ArrayLike, ends: ArrayLike, shape: FloatArray) -> FloatArray:
    """Return positions at shares of parts, whose last is 1, shape (n_parts, n_shares).

    Ends are among them exactly: the solver cannot start in a part that rounding makes.
    """
    first, last = np.asarray(starts, dtype=np.float64), np.asarray(ends, dtype=np.float64)
    positions = first[:, np.newaxis] + (last - first)[:, np.newaxis] * shape
    positions[:, -1] = last
    return positions


def strains_of(measured: Sequence[MeasuredMicrostructure]) -> FloatArray:
    """Return the strains (fraction) that were measured at, NaN where a time stands for one."""
    return np.array([one.strain for one in measured], dtype=np.float64)


def times_of(measured: Sequence[MeasuredMicrostructure]) -> FloatArray:
    """Return the times (s) that were measured at, NaN where a strain stands for one."""
    return np.array([one.time for one in measured], dtype=np.float64)


def measured_block(of_tests: Sequence[Sequence[MeasuredMicrostructure]]) -> list[list[float]]:
    """Return the rows of `stan/statistics/measured_microstructure.stan`, of tests in turn."""
    return [one.numbers for measured in of_tests for one in measured]
