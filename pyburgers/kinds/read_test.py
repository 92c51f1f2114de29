"""What a test says of its readings: where they lie, what they are of, how noisy they are."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.common.errors import InputError
from pyburgers.model.peak_test import PeakTest

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Stated:
    """A number that a file states with its uncertainty, in SI.

    `value`, `sd`: mean and standard deviation; with an sd of 0 the number is known.
    """

    value: float
    sd: float


@dataclass(frozen=True, eq=False, kw_only=True)
class ReadTest(ABC):
    """The part of an `Experiment` that is about its readings.

    `of_points`: attributes with an entry for each point; a constant of each derived class.
    `points_together`: why single points cannot be left out; empty if they can. A constant as well.
    """

    of_points: ClassVar[tuple[str, ...]] = ()
    points_together: ClassVar[str] = ""
    id: str

    @property
    @abstractmethod
    def position(self) -> FloatArray:
        """Positions of the readings on the clock of the protocol (SI), shape (n_points,)."""

    @property
    @abstractmethod
    def response(self) -> FloatArray:
        """Readings for comparison with the model (SI unit), shape (n_points,)."""

    @property
    def response_limit(self) -> FloatArray:
        """Response at or below which a reading is an upper limit; -inf: none, (n_points,)."""
        return np.full(self.n_points, -np.inf)

    @property
    def n_points(self) -> int:
        """Number of data points; zero for an experiment that can only be simulated."""
        return len(self.response)

    @property
    def quantity(self) -> npt.NDArray[np.int64]:
        """Number, in what its kind reads, of what each reading is of, shape (n_points,)."""
        return np.zeros(self.n_points, dtype=np.int64)

    @property
    @abstractmethod
    def noises(self) -> Mapping[str, float | None]:
        """Noises (parameters) of what is read, and the sizes (SI) that the file states.

        Zero: each reading has a stated error, and there may be no noise beside it.
        """

    @property
    def stated(self) -> Mapping[str, Stated]:
        """Parameters of the test and its apparatus that its file states."""
        return {}

    @property
    def peak(self) -> PeakTest | None:
        """Its peak as tables of peak stresses have it, if it has one."""
        return None

    def solution_table(self, solution: pd.DataFrame) -> pd.DataFrame:
        """Return the table that `pyburgers simulate` writes of a solution."""
        return solution

    @property
    def n_driving_errors(self) -> int:
        """Number of uncertain numbers in what drives the test, which are inferred with it."""
        return 0

    def driving_error(self, true: Self) -> FloatArray:
        """Return the standardised errors of what drives a simulated test, (n_driving_errors,).

        `true`: the same test, driven by what drove the simulation.
        """
        return np.zeros(self.n_driving_errors)

    def without_point(self, point: int) -> Self:
        """Return the test without one of its points, counted from 0, unless they go together."""
        if self.points_together:
            raise InputError(
                f"{self.id}: points cannot be left out one by one, expected a comparison without "
                f"fitting again, because {self.points_together}."
            )
        left: dict[str, Any] = {
            name: np.delete(getattr(self, name), point) for name in self.of_points
        }
        return replace(self, **left)
