"""What the sampler moves in: coordinates, where their origin lies, and the first metric."""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from pyburgers.cmdstan.program import Program
from pyburgers.common.errors import InputError
from pyburgers.model.priors import PriorSet
from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.stan_data import (
    SolverOptions,
    StanData,
    plain_coordinates,
    sheared_block,
    solver_block,
    valley_block,
)
from pyburgers.sampling.metric import expected_rise, laplace_metric
from pyburgers.sampling.mode import Mode, ModeNotFound, climb, find_mode
from pyburgers.sampling.sheared import ShearedUnsuited, find_sheared
from pyburgers.sampling.valley import ValleyUnsuited, find_valley, noise_exponents

logger = logging.getLogger(__name__)

FloatArray = npt.NDArray[np.float64]

Coordinates = Literal["auto", "plain", "valley", "sheared"]

SUITED = "the priors and the record suit them"

LARGEST_RISE = 2.0
"""Of the log density from the origin of valley coordinates to the mode near it.

Above it the curvature at the origin says little of the posterior: conditional medians lie on
another arm than the mode, or the optimiser has stopped short of it, as it does in plain coordinates
where noise is far below a percent of the stress."""


CURVATURE_TOLERANCE = 1e-7
"""Of the solver for the curvature of oscillating tests, by differences of gradients.

At tolerances as loose as those for sampling, its error can be as large as these differences where
the dashpot carries most of the loss: at 1e-4 slopes of the flow rate came out 50 times too
large."""


@dataclass(frozen=True, eq=False)
class Geometry:
    """Coordinates of a run.

    Attributes
    ----------
    system : {"plain", "valley", "sheared"}
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


def check_coordinates(experiment: Experiment, wanted: Coordinates) -> None:
    """Check that coordinates are for tests of a protocol.

    Raises
    ------
    InputError
        If they are not.
    """
    special = "valley" if isinstance(experiment, ConstantRateExperiment) else "sheared"
    if wanted not in ("auto", "plain", special):
        raise InputError(
            f"{experiment.id}: {wanted} coordinates are not for tests of the protocol "
            f"{experiment.protocol}, expected --coordinates auto, plain or {special}."
        )


def choose_geometry(
    model: Program,
    data: StanData,
    experiment: Experiment,
    priors: PriorSet,
    *,
    wanted: Coordinates,
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
    wanted : {"auto", "plain", "valley", "sheared"}
        "auto" takes valley coordinates for tests at constant rate and sheared ones for
        oscillating tests, where priors and record suit them; checked by `check_coordinates`.
    seed : int
        Decides where the search for the mode starts.
    solver : SolverOptions
        Tolerance and step limit.

    Raises
    ------
    InputError
        If the coordinates that were asked for do not suit priors or record.
    """

    def special(mode: Mode) -> Geometry:
        if isinstance(experiment, ConstantRateExperiment):
            return _valley(model, data, experiment, priors, mode, seed, solver)
        return _sheared(model, data, experiment, priors, mode)

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
    wanted: Coordinates,
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
    wanted : {"auto", "plain", "valley", "sheared"}
        Coordinates that were asked for.
    find : callable
        Finds the mode, or raises `pyburgers.sampling.mode.ModeNotFound`.
    special : callable
        Sets up valley or sheared coordinates at a mode, or raises
        `pyburgers.sampling.valley.ValleyUnsuited` or `pyburgers.sampling.sheared.ShearedUnsuited`.

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
    except (ModeNotFound, ValleyUnsuited, ShearedUnsuited) as error:
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


def _valley(
    model: Program,
    data: StanData,
    experiment: ConstantRateExperiment,
    priors: PriorSet,
    mode: Mode,
    seed: int,
    solver: SolverOptions,
) -> Geometry:
    """Valley coordinates, whose origin is at conditional medians given the mode."""
    coordinates = plain_coordinates(experiment, priors)
    centre = np.zeros_like(mode.coordinate)
    valley = find_valley(experiment, priors, mode, solver=solver)
    around = {**data, **valley_block(valley)}
    covariance = laplace_metric(model, around, centre)
    if expected_rise(model, around, centre, covariance) > LARGEST_RISE:
        centre, covariance = laplace_at_mode(model, around, centre, seed=seed)
    exponents = noise_exponents(coordinates, priors, covariance)
    block = valley_block(replace(valley, noise_exponent=exponents))
    return Geometry("valley", SUITED, block, centre, covariance)


def _sheared(
    model: Program,
    data: StanData,
    experiment: Experiment,
    priors: PriorSet,
    mode: Mode,
) -> Geometry:
    coordinates = plain_coordinates(experiment, priors)
    tight = {**data, **solver_block(SolverOptions(CURVATURE_TOLERANCE))}
    reference, centre = find_sheared(model, tight, priors, coordinates, mode)
    block = sheared_block(reference)
    covariance = laplace_metric(model, {**tight, **block}, centre)
    return Geometry("sheared", SUITED, block, centre, covariance)
