"""What the package asks of coordinates of the sampler other than the plain ones."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from pyburgers.model.priors import PriorSet
from pyburgers.protocols.coordinates import Layout, PlainCoordinates
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.stan_data import StanData

FloatArray = npt.NDArray[np.float64]

E = TypeVar("E", bound=Experiment)


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
    driving_error : array, shape (n_driving_errors,)
        Errors of what drives the test, standardised.
    """

    values: Mapping[str, float]
    coordinate: FloatArray
    driving_error: FloatArray


@dataclass(frozen=True, eq=False)
class AtMode(Generic[E]):
    """A test by itself at its posterior mode, and what a chart may ask its Stan program there.

    Attributes
    ----------
    experiment, priors
        The test and its resolved priors.
    coordinates : PlainCoordinates
        What its plain coordinates stand for.
    mode : Mode
        The mode.
    data : dict
        Data of the program in plain coordinates.
    solution : callable
        Receives positions on the clock (SI), returns the solution there
        (`pyburgers.protocols.program_data.solve`).
    generated, curvature : callable
        Receive changed entries of the data; return every variable of the program, and the Hessian
        of minus the log density by the plain coordinates.
    """

    experiment: E
    priors: PriorSet
    coordinates: PlainCoordinates
    mode: Mode
    data: StanData
    solution: Callable[[FloatArray], dict[str, FloatArray]]
    generated: Callable[..., dict[str, FloatArray]]
    curvature: Callable[..., FloatArray]


class Chart(ABC, Generic[E]):
    """Coordinates of a protocol other than the plain ones, set up at the posterior mode.

    Only the speed of a run depends on them, not its result.

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
