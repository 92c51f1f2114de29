"""What the sampler moves in: coordinates, where their origin lies, and the first metric."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from pyburgers.cmdstan.program import Program
from pyburgers.common.errors import InputError
from pyburgers.model.priors import PriorSet
from pyburgers.protocols.chart import Chart, ChartUnsuited, Mode
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.forward import solve
from pyburgers.protocols.registry import protocol_of
from pyburgers.protocols.stan_data import (
    PlainCoordinates,
    SolverOptions,
    StanData,
    plain_coordinates,
    solver_block,
)
from pyburgers.sampling.metric import curvature_at, expected_rise, laplace_metric
from pyburgers.sampling.mode import ModeNotFound, climb, find_mode

logger = logging.getLogger(__name__)

FloatArray = npt.NDArray[np.float64]

SUITED = "the priors and the record suit them"

LARGEST_RISE = 2.0
"""Of the log density from the centre of a chart to the mode near it.

Above it the curvature at the centre says little of the posterior: conditional medians of the valley
lie on another arm than the mode, or the optimiser has stopped short of it, as it does in plain
coordinates where noise is far below a percent of the stress."""


@dataclass(frozen=True, eq=False)
class Geometry:
    """Coordinates of a run.

    Attributes
    ----------
    system : str
        Name of the coordinates (`docs/coordinates.md`).
    reason : str
        Why they were taken.
    block : dict
        Stan data of the coordinates; empty for plain ones.
    centre : array, shape (n_coordinates,), or None
        The posterior mode, or a point near it; None where chains start from the prior with the
        unit metric.
    covariance : array, shape (n_coordinates, n_coordinates), or None
        Laplace approximation there, the sampler's first metric.
    """

    system: str
    reason: str
    block: StanData
    centre: FloatArray | None = None
    covariance: FloatArray | None = None


def check_coordinates(experiment: Experiment, wanted: str) -> None:
    """Check that coordinates are for tests of a protocol.

    Raises
    ------
    InputError
        If they are not.
    """
    charts = protocol_of(experiment).charts
    if wanted not in ("auto", *charts):
        choices = ", ".join(("auto", *charts[:-1]))
        raise InputError(
            f"{experiment.id}: {wanted} coordinates are not for tests of the protocol "
            f"{experiment.protocol}, expected --coordinates {choices} or {charts[-1]}."
        )


def choose_geometry(
    model: Program,
    data: StanData,
    experiment: Experiment,
    priors: PriorSet,
    *,
    wanted: str,
    seed: int,
    solver: SolverOptions,
) -> Geometry:
    """Find the posterior mode and set up the coordinates that suit, or fall back to plain ones.

    Parameters
    ----------
    model : Program
        The program for the experiment.
    data : dict
        Its data in plain coordinates. Where they switch the likelihood off, coordinates stay
        plain and chains start from the prior: what data fix is a poor guide to it.
    experiment : Experiment
        A test with data.
    priors : PriorSet
        Resolved priors.
    wanted : str
        "auto" takes the chart of the protocol where priors and record suit it; checked by
        `check_coordinates`.
    seed : int
        Decides where the search for the mode starts.
    solver : SolverOptions
        Tolerance and step limit.

    Raises
    ------
    InputError
        If the coordinates that were asked for do not suit priors or record.
    """
    chart = protocol_of(experiment).chart

    def special(mode: Mode) -> Geometry:
        if chart is None:
            raise ChartUnsuited(f"tests of the protocol {experiment.protocol} have no others")
        return _at_mode(chart, model, data, experiment, priors, mode, seed, solver)

    return geometry_at_mode(
        model,
        data,
        name=experiment.id,
        wanted=wanted,
        find=lambda: find_mode(experiment, priors, seed=seed, solver=solver),
        special=special,
    )


class HasCoordinate(Protocol):
    """A posterior mode, of one test or of several."""

    @property
    def coordinate(self) -> FloatArray:
        """Plain coordinates, shape (n_coordinates,)."""


AnyMode = TypeVar("AnyMode", bound=HasCoordinate)


def geometry_at_mode(
    model: Program,
    data: StanData,
    *,
    name: str,
    wanted: str,
    find: Callable[[], AnyMode],
    special: Callable[[AnyMode], Geometry],
) -> Geometry:
    """Find the mode and set up special coordinates there, or fall back to plain ones.

    Parameters
    ----------
    model : Program
        The program.
    data : dict
        Its data in plain coordinates.
    name : str
        Of what is fitted, for error messages.
    wanted : str
        Coordinates that were asked for.
    find : callable
        Finds the mode, or raises `pyburgers.sampling.mode.ModeNotFound`.
    special : callable
        Sets up the chart of the protocol at a mode, or raises
        `pyburgers.protocols.chart.ChartUnsuited`.

    Raises
    ------
    InputError
        If the coordinates that were asked for do not suit priors or record.
    """
    if not data["use_likelihood"]:
        return Geometry("plain", "the likelihood is off", {})
    logger.info("Finding the posterior mode, which sets the sampler's coordinates and metric.")
    mode = None
    try:
        mode = find()
        if wanted == "plain":
            return _plain(model, data, mode, "asked for")
        return special(mode)
    except (ModeNotFound, ChartUnsuited) as error:
        if wanted not in ("auto", "plain"):
            raise InputError(
                f"{name}: {wanted} coordinates do not apply, because {error}; use "
                "--coordinates auto or plain."
            ) from error
        return _plain(model, data, mode, "asked for" if wanted == "plain" else str(error))


def _plain(model: Program, data: StanData, mode: HasCoordinate | None, reason: str) -> Geometry:
    if mode is None:
        return Geometry("plain", reason, {})
    covariance = laplace_metric(model, data, mode.coordinate)
    return Geometry("plain", reason, {}, mode.coordinate, covariance)


def laplace_at_mode(
    model: Program, data: StanData, start: FloatArray, *, seed: int
) -> tuple[FloatArray, FloatArray]:
    """Climb to the mode in the coordinates that the data choose.

    Parameters
    ----------
    model : Program
        The program.
    data : dict
        Its data.
    start : array, shape (n_coordinates,)
        Where to climb from.
    seed : int
        For the optimiser's record.

    Returns
    -------
    centre : array, shape (n_coordinates,)
        The mode.
    covariance : array, shape (n_coordinates, n_coordinates)
        Laplace approximation there.

    Raises
    ------
    ModeNotFound
        If the optimiser fails.
    """
    found = climb(model, data, [{"coordinate": start.tolist()}], seed=seed)
    centre = np.asarray(found["coordinate"], dtype=np.float64)
    return centre, laplace_metric(model, data, centre)


@dataclass(frozen=True, eq=False)
class ModeOfTest:
    """A test at its posterior mode; methods as `pyburgers.protocols.chart.AtMode` has them."""

    model: Program
    data: StanData
    experiment: Any
    priors: PriorSet
    mode: Mode
    solver: SolverOptions

    @property
    def coordinates(self) -> PlainCoordinates:
        """What its plain coordinates stand for."""
        return plain_coordinates(self.experiment, self.priors)

    def solution(self, at: FloatArray) -> dict[str, FloatArray]:
        """Solution at the mode."""
        return solve(self.experiment, self.mode.values, at, solver=self.solver)

    def generated(self, **changes: object) -> dict[str, FloatArray]:
        """Variables of the program at the mode."""
        position = {"coordinate": self.mode.coordinate.tolist()}
        return self.model.evaluate({**self.data, **changes}, position)

    def curvature(self, **changes: object) -> FloatArray:
        """Curvature at the mode."""
        return curvature_at(self.model, {**self.data, **changes}, self.mode.coordinate)


def _at_mode(
    chart: Chart[Any],
    model: Program,
    data: StanData,
    experiment: Experiment,
    priors: PriorSet,
    mode: Mode,
    seed: int,
    solver: SolverOptions,
) -> Geometry:
    """Set a chart up at the mode of a test, with its own mode near there as the centre."""
    if chart.curvature_tolerance is not None:
        data = {**data, **solver_block(SolverOptions(chart.curvature_tolerance))}
    test = ModeOfTest(model, data, experiment, priors, mode, solver)
    reference, centre = chart.reference(test)
    around = {**data, **chart.block(reference)}
    covariance = laplace_metric(model, around, centre)
    if expected_rise(model, around, centre, covariance) > LARGEST_RISE:
        centre, covariance = laplace_at_mode(model, around, centre, seed=seed)
    reference = chart.rescaled(reference, test, covariance)
    return Geometry(chart.name, SUITED, chart.block(reference), centre, covariance)
