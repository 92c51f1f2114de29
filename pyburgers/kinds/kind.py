"""What the package asks of a kind of test, and every kind; the rest of a kind is in its folder.

To add a kind: a folder whose module ``kind`` has an object ``KIND`` of a class derived
from `Kind`, and its module ``new_file`` one ``NEW_FILE`` (`NewFile`); its name in `NAMES`.
"""

import typing
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from pydantic import ConfigDict, Field

from pyburgers.cmdstan.draw_files import Draws
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.csv_files import write_data
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path
from pyburgers.common.toml_files import Table, checked, read_tables, write_toml
from pyburgers.kinds.coordinates import Layout, Mode, PlainCoordinates
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.stan_data import SolverOptions, StanData
from pyburgers.model.display import Quantity
from pyburgers.model.flow_law_prior import PeakTest
from pyburgers.model.parameters import Parameter
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import PriorSet

FloatArray = npt.NDArray[np.float64]

E = TypeVar("E", bound=Experiment)

NAMES = ("constant_rate", "forced_oscillation", "loading_history", "attenuation")
"""Of all kinds of test, in files, and of their folders."""


class ChartUnsuited(Exception):  # noqa: N818 - an outcome with a reason, not an error
    """A chart does not apply to a test and its priors; the message says why."""


@dataclass(frozen=True, eq=False)
class AtMode(Generic[E]):
    """A test by itself at its posterior mode, and what a chart may ask its Stan program there.

    `experiment`, `priors`: the test and its resolved priors.
    `coordinates`: what its plain coordinates stand for.
    `mode`: the mode.
    `data`: data of the program in plain coordinates.
    `solution`: solution at positions on the clock, SI (`pyburgers.kinds.program_data.solve`).
    `generated`, `curvature`, `covariance`: receive changed entries of the data (the last a position
        before them); return all variables, the Hessian of minus the log density in plain
        coordinates, and the Laplace approximation.
    `generated_at`: receives positions, shape (n, n_coordinates), and changed entries; returns which
        are solved, and the variables there (`pyburgers.cmdstan.program.Program.generate_at`).
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
    generated_at: Callable[..., tuple[npt.NDArray[np.bool_], Draws]]


class Chart(ABC, Generic[E]):
    """Coordinates of a protocol other than the plain ones, set up at the posterior mode.

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
        """Set the chart up at the mode of a test.

        Return what the chart is set up with, and where the mode lies in it, (n_coordinates,). Raise
        ChartUnsuited if priors or record do not suit.
        """

    def rescaled(self, reference: Any, test: AtMode[E], covariance: FloatArray) -> Any:
        """Return the reference, set up further with the posterior's covariance in the chart."""
        return reference

    @abstractmethod
    def block(self, references: Sequence[Any], layout: Layout) -> StanData:
        """Return the data of the chart, given what tests are set up with; none: plain coordinates.

        `pyburgers.kinds.program_data.chart_block` adds what all charts have in common.
        """


class FittedTest(typing.Protocol):
    """A test with its posterior."""

    @property
    def experiment(self) -> Experiment:
        """The test."""

    @property
    def priors(self) -> PriorSet:
        """Its resolved priors."""

    @property
    def posterior(self) -> xr.DataTree:
        """Its labelled draws (`pyburgers.posterior.labelled_draws`)."""


class Kind(ABC, Generic[E]):
    """A kind of test: how it is read, solved, sampled and simulated.

    `name`: as in experiment files, and of the Stan program.
    `clock`: along which the test is driven and solutions are given.
    `response`: what is observed; the program names it in ``NAME_model`` and ``NAME_replicated``.
    `noise`: parameter that is the standard deviation of its readings.
    `reference`: point of the flow law whose logarithm is sampled in place of Q_M or beta.
    `grid_quantities`: variables of the program along the clock: name and SI unit in labelled draws.
    `warmup`, `target_acceptance`: defaults of the sampler: as little as leaves (almost) no
        divergences.
    `solver`: default of the solver while sampling.
    `chart`: coordinates other than the plain ones.
    `points_together`: why single points cannot be left out; None where they can.
    """

    name: ClassVar[str]
    clock: ClassVar[Quantity]
    response: ClassVar[Quantity]
    noise: ClassVar[str]
    reference: ClassVar[Parameter]
    grid_quantities: ClassVar[Mapping[str, tuple[str, str]]]
    warmup: ClassVar[int]
    target_acceptance: ClassVar[float]
    solver: ClassVar[SolverOptions] = SolverOptions()
    chart: ClassVar[Chart[Any] | None] = None
    points_together: ClassVar[str | None] = None

    @property
    def read(self) -> tuple[Quantity, ...]:
        """What is read; `observed_positions` says where, ``grid_NAME`` of the program is each."""
        return (self.response,)

    @property
    def program(self) -> Path:
        """Path of its Stan program."""
        return stan_directory() / f"{self.name}.stan"

    @property
    def charts(self) -> tuple[str, ...]:
        """Names of the coordinates that its tests can be sampled in."""
        return ("plain",) if self.chart is None else ("plain", self.chart.name)

    @abstractmethod
    def load(self, path: Path, tables: Mapping[str, Any] | None = None) -> E:
        """Read and check an experiment file and its data files; `tables` stand for the file."""

    @abstractmethod
    def without_data(self, experiment: E) -> E:
        """Return a test as one to be simulated, if its program can; what drives it is known."""

    @abstractmethod
    def reference_origin(self, experiment: E) -> tuple[float, float]:
        """Return origin and size of ln(`reference`/SI unit) of a test."""

    @abstractmethod
    def tests_block(self, experiments: Sequence[E], priors: Sequence[PriorSet]) -> StanData:
        """Return the data of the program that are about tests of this protocol alone."""

    @abstractmethod
    def grid_block(self, experiments: Sequence[E], grids: Sequence[FloatArray]) -> StanData:
        """Return the positions on the clock (SI) at which the program reports solutions."""

    @abstractmethod
    def prediction_grid(self, experiment: E) -> FloatArray:
        """Positions of the predictive bands on the clock (SI), shape (n,)."""

    @abstractmethod
    def output_grid(self, experiment: E) -> FloatArray:
        """Positions of a smooth curve, the observed ones among them (SI), shape (n,)."""

    def shown_clock(self, experiment: E) -> Quantity:
        """Return the clock in the unit in which figures and tables of a test show it."""
        return self.clock

    def is_read(self, experiment: E, at: FloatArray) -> npt.NDArray[np.bool_]:
        """Return whether each of `read` is read or imposed at positions (SI), (n_read, n)."""
        return np.ones((len(self.read), at.size), dtype=np.bool_)

    def solved_positions(self, data: StanData, at: FloatArray) -> FloatArray:
        """Return where the program gives its solution (SI) when it is asked for positions."""
        return np.asarray(at)

    @abstractmethod
    def solution(self, experiment: E, draw: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return the columns of a solution from the variables of the program and ``grid_CLOCK``.

        They are those of clock and response, and time_s, strain, stress_Pa, kelvin_strain,
        grain_size_m and fabric_factor where the test has them.
        """

    def solution_table(self, experiment: E, solution: pd.DataFrame) -> pd.DataFrame:
        """Return the table that `pyburgers simulate` writes of a solution."""
        return solution

    @abstractmethod
    def observed_positions(self, experiment: E) -> dict[str, tuple[FloatArray, str]]:
        """Return where the points lie along the test, by quantity, with its SI unit.

        Further ones: ``reading_error``, the standard deviation of the response where it is stated,
        ``typical_error``, by which residuals are weighed where it is not and they differ, and
        ``quantity``, the number in `read` of what is read, where that is several.
        """

    def simulated_positions(self, experiment: E) -> FloatArray:
        """Return where (SI) a solution has to be given for `response_in`, not decreasing."""
        return np.unique(experiment.position)

    def response_in(self, experiment: E, solution: pd.DataFrame) -> FloatArray:
        """Return the response (SI), (n_points,), in a solution at `simulated_positions`."""
        found: FloatArray = np.interp(
            experiment.position, solution[self.clock.column], solution[self.response.column]
        )
        return found

    def priors_of(self, experiments: Sequence[E], priors: PriorSet) -> tuple[PriorSet, ...]:
        """Return priors for each of some tests, with what their files and readings add."""
        return tuple(priors for _ in experiments)

    @abstractmethod
    def with_noise(
        self,
        experiment: E,
        response: FloatArray,
        values: Mapping[str, float],
        rng: np.random.Generator,
    ) -> E:
        """Return the test with responses of the model (SI), and noise, in place of its own.

        `response` (n_points,): without noise.
        """

    def stated_priors(self, experiment: E) -> tuple[Prior, ...]:
        """Return priors of what belongs to a test itself, as far as its file states some."""
        return ()

    def noises(self, experiment: E) -> Mapping[str, float | None]:
        """Return the parameters that are noise of readings of a test, and their stated errors."""
        return {self.noise: None}

    def as_history(self, experiment: E) -> Experiment:
        """Return a test as a loading history (`InputError` if it is none), to go with any other."""
        raise InputError(
            f"{experiment.id}: a test of the protocol {self.name} cannot be fitted together with "
            f"tests of other protocols, expected tests of {self.name} alone."
        )

    def check_priors(self, experiment: E, priors: PriorSet) -> None:
        """Check that a test can be fitted with priors (`InputError`); most can with any."""

    def place_text(self, along: xr.Dataset, first: int, last: int) -> str | None:
        """Return where readings lie (two, from 0, of `observed_positions`) if no clock says it."""
        return None

    def remedy(self, free: Collection[str], along: xr.Dataset) -> str | None:
        """Return what to try where a fit with free parameters misses such readings, if known."""
        return None

    def reading_noise(self, experiment: E, values: Mapping[str, FloatArray]) -> FloatArray:
        """Return standard deviations of readings (SI), (n_draws, n_points), from parameters."""
        return np.repeat(values[self.noise][:, np.newaxis], experiment.n_points, axis=1)

    def peak_test(self, experiment: E) -> PeakTest | None:
        """Return the peak of a test as tables of peak stresses have it, if it has one."""
        return None

    def driving_error(self, experiment: E, true: E) -> FloatArray:
        """Return the standardised errors of what drives a simulated test, (n_driving_errors,).

        The true one is the same test driven by what drove the simulation.
        """
        return np.zeros(experiment.n_driving_errors)

    def without_point(self, experiment: E, point: int) -> E:
        """Return the test without one of its points, counted from 0.

        Raise InputError if a point cannot be left out.
        """
        raise InputError(
            f"{experiment.id}: points cannot be left out one by one, expected a comparison without "
            f"fitting again, because {self.points_together}."
        )


class _ProtocolTable(Table):
    """The one key that tells how to read the others."""

    model_config = ConfigDict(extra="ignore")

    protocol: str = Field(description="the kind of test")


@cache
def kinds() -> Mapping[str, Kind[Any]]:
    """Return every kind of test by its name."""
    return MappingProxyType(
        {name: import_module(f"pyburgers.kinds.{name}.kind").KIND for name in NAMES}
    )


def kind_of(experiment: Experiment) -> Kind[Any]:
    """Return the kind of a test."""
    return kinds()[experiment.protocol]


def load_experiment(path: str | Path) -> Experiment:
    """Read and check an experiment file and the data files that it names.

    Parameters
    ----------
    path : str or Path
        The TOML file.

    Returns
    -------
    Experiment
        Of the class of its key `protocol`.

    Raises
    ------
    InputError
        If a file, key, unit or number is not what it has to be.
    """
    path = given_path(path)
    tables = read_tables(path)
    name = checked(path, tables, _ProtocolTable).protocol
    if name not in NAMES:
        expected = " or ".join(map(repr, NAMES))
        raise InputError(
            f"{path}: key 'protocol': found {name!r}, expected {expected} (the kind of test)."
        )
    experiment: Experiment = kinds()[name].load(path, tables)
    return experiment


def save_experiment(experiment: Experiment, directory: Path) -> Path:
    """Write ``experiment.toml`` in SI and its data files into an existing folder; return the first.

    `load_experiment` reads back exactly equal contents, notices included.
    """
    tables = experiment.tables()
    if tables.get("data") is not None:
        tables["data"] = write_data(directory, tables["data"])
    target = directory / "experiment.toml"
    write_toml(target, tables)
    return target
