"""Starts, posterior mode and coordinates of joint fits."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from pyburgers.cmdstan.program import Program
from pyburgers.common.errors import SamplingError
from pyburgers.model.parameters import PROGRAM_PARAMETERS
from pyburgers.protocols.chart import ChartUnsuited, Mode
from pyburgers.protocols.constant_rate.valley import SOLVED, find_valley, noise_exponents
from pyburgers.protocols.forward import simulate
from pyburgers.protocols.stan_data import (
    REFERENCE_STRESS,
    SolverOptions,
    StanData,
    ValleyReference,
    program_data,
)
from pyburgers.sampling.charts import (
    SUITED,
    Geometry,
    ModeOfTest,
    geometry_at_mode,
    laplace_at_mode,
)
from pyburgers.sampling.initial_values import INITIAL_ATTEMPTS
from pyburgers.sampling.joint_stan_data import (
    JointCoordinates,
    JointValley,
    joint_coordinates,
    joint_valley_block,
)
from pyburgers.sampling.mode import N_STARTS, climb, find_mode
from pyburgers.sampling.problem import JointProblem

FloatArray = npt.NDArray[np.float64]

LEAST_SPREAD = 1e-3
"""Over its prior's scale: below it a spread at the mode would make the reference degenerate."""


def draw_joint_start(problem: JointProblem, *, seed: int, chain: int) -> dict[str, list[float]]:
    """Draw a start in plain coordinates from the priors of single tests.

    Partially pooled parameters are drawn apart for each test; centre and spread are put around
    them.

    Parameters
    ----------
    problem : JointProblem
        Tests, priors, pooling.
    seed, chain : int
        The start depends on these two alone.

    Raises
    ------
    SamplingError
        If none of `INITIAL_ATTEMPTS` prior draws has a finite solution in every test.
    """
    rng = np.random.default_rng([seed, chain])
    for _ in range(INITIAL_ATTEMPTS):
        drawn = [priors.sample(rng) for priors in problem.priors]
        shared = {name: drawn[0][name] for name in problem.shared}
        values = [{**own, **shared} for own in drawn]
        spreads = np.abs(rng.standard_normal(len(problem.partial)))
        try:
            stresses = [
                simulate(experiment, own, at=experiment.position, solver=SolverOptions()).attrs[
                    REFERENCE_STRESS
                ]
                for experiment, own in zip(problem.experiments, values, strict=True)
            ]
        except SamplingError:
            continue  # a test has no finite solution here; the next draw may have one
        plain = [
            coordinates.at({**own, REFERENCE_STRESS: stress})
            for coordinates, own, stress in zip(problem.coordinates, values, stresses, strict=True)
        ]
        return {"coordinate": _joint_position(problem, plain, spreads).tolist()}
    raise SamplingError(
        f"{problem.name}: none of {INITIAL_ATTEMPTS} draws from the priors has a finite solution "
        "in every test; check the units and the bounds of the priors."
    )


def _joint_position(
    problem: JointProblem, plain: list[FloatArray], spreads: FloatArray
) -> FloatArray:
    """Coordinates of a joint fit from plain ones of each test and spreads over their scales."""
    layout = joint_coordinates(problem)
    position = np.empty(layout.size)
    # The first test comes last, so that shared coordinates are its own.
    for own, places in zip(reversed(plain), reversed(layout.position), strict=True):
        position[places] = own
    for h, name in enumerate(layout.partial):
        i = layout.names.index(name)
        numbers = np.array([own[i] for own in plain])
        centre = numbers.mean()
        position[layout.centre[h]] = centre
        position[layout.spread[h]] = np.log(spreads[h])
        spread = spreads[h] * problem.pooling.spread_scales[name]
        position[layout.position[:, i]] = (numbers - centre) / spread
    return position


@dataclass(frozen=True, eq=False)
class JointMode:
    """The highest density found.

    Attributes
    ----------
    tests : tuple of Mode
        Values of each test, and its plain coordinates by itself.
    coordinate : array, shape (n_coordinates,)
        Plain coordinates of the joint fit.
    """

    tests: tuple[Mode, ...]
    coordinate: FloatArray


def find_joint_mode(
    model: Program,
    data: StanData,
    problem: JointProblem,
    *,
    seed: int,
    solver: SolverOptions,
) -> JointMode:
    """Climb from the modes of the single tests and from `N_STARTS` draws of the prior.

    The best end is kept. Draws of the prior alone can all end where a test is not fitted at all.

    Parameters
    ----------
    model : Program
        The program.
    data : dict
        Its data in plain coordinates.
    problem : JointProblem
        Tests, priors, pooling.
    seed : int
        Decides the prior draws.
    solver : SolverOptions
        Tolerance and step limit.

    Raises
    ------
    ModeNotFound
        If the optimiser fails from all starts, or for a single test.
    """
    single = [
        find_mode(experiment, priors, seed=seed, solver=solver).coordinate
        for experiment, priors in zip(problem.experiments, problem.priors, strict=True)
    ]
    together = _joint_position(problem, single, np.ones(len(problem.partial)))
    starts = [
        {"coordinate": together.tolist()},
        *(draw_joint_start(problem, seed=seed, chain=k) for k in range(1, N_STARTS + 1)),
    ]
    variables = climb(model, data, starts, seed=seed)
    coordinate = np.asarray(variables["coordinate"], dtype=np.float64)
    values, stresses = variables["parameter"], np.atleast_1d(variables["log_stress"])
    plain = _plain_of_tests(problem, coordinate, stresses)
    names = [p.name for p in PROGRAM_PARAMETERS]
    return JointMode(
        tuple(
            Mode(dict(zip(names, map(float, own), strict=True)), position)
            for own, position in zip(values, plain, strict=True)
        ),
        coordinate,
    )


def _plain_of_tests(
    problem: JointProblem, coordinate: FloatArray, log_stress: FloatArray
) -> list[FloatArray]:
    """Plain coordinates of each test by itself, the inverse of `_joint_position`."""
    layout = joint_coordinates(problem)
    found = []
    tests = zip(problem.coordinates, layout.position, log_stress, strict=True)
    for coordinates, places, stress in tests:
        own = coordinate[places].copy()
        for h, name in enumerate(layout.partial):
            i = layout.names.index(name)
            spread = problem.pooling.spread_scales[name] * np.exp(coordinate[layout.spread[h]])
            own[i] = coordinate[layout.centre[h]] + spread * own[i]
        if REFERENCE_STRESS in coordinates.quantities:
            i = coordinates.quantities.index(REFERENCE_STRESS)
            own[i] = (stress - coordinates.shift[i]) / coordinates.scale[i]
        found.append(own)
    return found


def choose_joint_geometry(
    model: Program,
    data: StanData,
    problem: JointProblem,
    *,
    wanted: str,
    seed: int,
    solver: SolverOptions,
) -> Geometry:
    """Find the posterior mode and set up valley coordinates in every test, or plain ones in all.

    Parameters
    ----------
    model, data, problem
        As for `find_joint_mode`.
    wanted, seed, solver
        As for `pyburgers.sampling.charts.choose_geometry`.

    Raises
    ------
    InputError
        If the coordinates that were asked for do not suit priors or records.
    """
    return geometry_at_mode(
        model,
        data,
        name=problem.name,
        wanted=wanted,
        find=lambda: find_joint_mode(model, data, problem, seed=seed, solver=solver),
        special=lambda mode: _valley(model, data, problem, mode, seed=seed, solver=solver),
    )


def _valley(
    model: Program,
    data: StanData,
    problem: JointProblem,
    mode: JointMode,
    *,
    seed: int,
    solver: SolverOptions,
) -> Geometry:
    """Valley coordinates around the mode in plain ones, and their own mode near the origin.

    Pooling and data share the centring of partially pooled parameters, so that the origin is not
    the mode as it is in a single fit, and its curvature can be far from that of the posterior.
    """
    for name in SOLVED:
        if name in problem.shared:
            raise ChartUnsuited(f"{name} is shared")
    layout = joint_coordinates(problem)
    references = [
        find_valley(
            ModeOfTest(
                model,
                program_data(experiment, priors, solver=solver),
                experiment,
                priors,
                own,
                solver,
            )
        )
        for experiment, priors, own in zip(
            problem.experiments, problem.priors, mode.tests, strict=True
        )
    ]
    pooling = np.concatenate(
        [
            mode.coordinate[layout.centre],
            np.maximum(mode.coordinate[layout.spread], np.log(LEAST_SPREAD)),
        ]
    )
    valley = JointValley(tuple(references), pooling)
    block = joint_valley_block(problem, valley)
    centre, covariance = laplace_at_mode(model, {**data, **block}, np.zeros(layout.size), seed=seed)
    scaled = JointValley(_with_noise(problem, layout, references, covariance), pooling)
    return Geometry("valley", SUITED, joint_valley_block(problem, scaled), centre, covariance)


def _with_noise(
    problem: JointProblem,
    layout: JointCoordinates,
    references: Sequence[ValleyReference],
    covariance: FloatArray,
) -> tuple[ValleyReference, ...]:
    """Let widths grow with the noise, those of parameters that belong to one test alone."""
    found = []
    separate = np.array([problem.pooling.kinds[name] == "separate" for name in layout.names])
    tests = zip(problem.coordinates, problem.priors, layout.position, references, strict=True)
    for coordinates, priors, places, reference in tests:
        exponents = noise_exponents(coordinates, priors, covariance[np.ix_(places, places)])
        found.append(replace(reference, noise_exponent=np.where(separate, exponents, 0.0)))
    return tuple(found)
