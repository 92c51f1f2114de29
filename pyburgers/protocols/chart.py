"""Coordinates that a protocol offers the sampler for its tests: what they ask for and give.

A chart is set up at the posterior mode. Only the speed of a run depends on it, not its result.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from pyburgers.model.priors import PriorSet
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.layout import Layout
from pyburgers.protocols.stan_data import PlainCoordinates, StanData

FloatArray = npt.NDArray[np.float64]

E = TypeVar("E", bound=Experiment)
E_co = TypeVar("E_co", bound=Experiment, covariant=True)


class ChartUnsuited(Exception):  # noqa: N818 - an outcome with a reason, not an error
    """A chart does not apply to a test and its priors; the message says why."""


@dataclass(frozen=True, eq=False)
class Mode:
    """The highest density found, on the real line of the plain coordinates.

    Attributes
    ----------
    values : mapping of str to float
        Every parameter in SI.
    coordinate : array, shape (n_coordinates,)
        Plain coordinates.
    """

    values: Mapping[str, float]
    coordinate: FloatArray


class AtMode(Protocol[E_co]):
    """A test at its posterior mode, and what a chart may ask the Stan program there."""

    @property
    def experiment(self) -> E_co:
        """The test."""

    @property
    def priors(self) -> PriorSet:
        """Its resolved priors."""

    @property
    def coordinates(self) -> PlainCoordinates:
        """What its plain coordinates stand for."""

    @property
    def mode(self) -> Mode:
        """The mode."""

    @property
    def data(self) -> StanData:
        """Data of the program in plain coordinates."""

    def solution(self, at: FloatArray) -> dict[str, FloatArray]:
        """Solution at positions of the protocol's clock (`pyburgers.protocols.forward.solve`)."""

    def generated(self, **changes: object) -> dict[str, FloatArray]:
        """Every variable of the program, with changed entries of its data."""

    def curvature(self, **changes: object) -> FloatArray:
        """Hessian of minus the log density by the plain coordinates, with changed data."""


class Chart(ABC, Generic[E]):
    """Coordinates of a protocol other than the plain ones.

    Attributes
    ----------
    name : str
        As in the option ``--coordinates`` (`docs/coordinates.md`).
    curvature_tolerance : float or None
        Tolerance of the solver for curvatures; None takes that of the run.
    solved : tuple of str
        Parameters that every test must have of its own.
    """

    name: ClassVar[str]
    solved: ClassVar[tuple[str, ...]] = ()
    curvature_tolerance: ClassVar[float | None] = None

    @abstractmethod
    def reference(self, test: AtMode[E]) -> tuple[Any, FloatArray]:
        """Set the chart up at the mode of a test.

        Returns
        -------
        reference
            What the chart is set up with.
        centre : array, shape (n_coordinates,)
            Where the mode lies in it.

        Raises
        ------
        ChartUnsuited
            If priors or record do not suit.
        """

    def rescaled(self, reference: Any, test: AtMode[E], covariance: FloatArray) -> Any:
        """Return the reference, set up further with the posterior's covariance in the chart."""
        return reference

    @abstractmethod
    def block(self, references: Sequence[Any], layout: Layout) -> StanData:
        """Return the data of the chart, given what tests are set up with; none: plain coordinates.

        `pyburgers.protocols.program_data.chart_block` adds what all charts have in common.
        """
