"""Posterior mode, found by Stan's optimiser: where the sampler's coordinates and metric are set."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import chain

import numpy as np
import numpy.typing as npt

from pyburgers.cmdstan.program import Program, load_program
from pyburgers.common.errors import SamplingError
from pyburgers.protocols.chart import Mode
from pyburgers.protocols.problem import Problem
from pyburgers.protocols.program_data import program_data, values_of_test
from pyburgers.protocols.stan_data import SolverOptions, StanData
from pyburgers.sampling.initial_values import draw_initial_values, position_of

FloatArray = npt.NDArray[np.float64]

N_STARTS = 4


class ModeNotFound(Exception):  # noqa: N818 - an outcome with a reason, not an error
    """The optimiser failed; the message says how."""


@dataclass(frozen=True, eq=False)
class ProblemMode:
    """The highest density found of a problem.

    Attributes
    ----------
    tests : tuple of Mode
        Values of each test, and its plain coordinates by itself.
    coordinate : array, shape (n_coordinates,)
        Plain coordinates of all tests together.
    """

    tests: tuple[Mode, ...]
    coordinate: FloatArray


def find_mode(problem: Problem, *, seed: int, solver: SolverOptions) -> ProblemMode:
    """Climb from `N_STARTS` draws of the prior and keep the best.

    Where tests hang together, also from the modes of single tests: draws of the prior alone can all
    end where a test is not fitted at all.

    Parameters
    ----------
    problem : Problem
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
    starts: Iterable[Mapping[str, object]] = (
        draw_initial_values(problem, seed=seed, chain=start) for start in range(1, N_STARTS + 1)
    )
    if not problem.is_single:
        single = [find_mode(one, seed=seed, solver=solver).coordinate for one in problem.alone()]
        together = position_of(problem, single, np.ones(len(problem.partial)))
        starts = chain([{"coordinate": together.tolist()}], starts)
    model = load_program(problem.protocol.program)
    variables = climb(model, program_data(problem, solver=solver), starts, seed=seed)
    coordinate = np.atleast_1d(variables["coordinate"])
    plain = _plain_of_tests(problem, coordinate, variables["log_reference"])
    values = variables["parameter"]
    return ProblemMode(
        tuple(Mode(values_of_test(values, e), own) for e, own in enumerate(plain)), coordinate
    )


def _plain_of_tests(
    problem: Problem, coordinate: FloatArray, log_reference: FloatArray
) -> list[FloatArray]:
    """Plain coordinates of each test by itself, the inverse of `position_of`."""
    layout, reference = problem.layout, problem.protocol.reference.name
    found: list[FloatArray] = []
    tests = zip(problem.coordinates, layout.position, log_reference, strict=True)
    for coordinates, places, logarithm in tests:
        own = coordinate[places].copy()
        for h, name in enumerate(layout.partial):
            i = layout.names.index(name)
            spread = problem.pooling.spread_scales[name] * np.exp(coordinate[layout.spread[h]])
            own[i] = coordinate[layout.centre[h]] + spread * own[i]
        # The first test's own already, where the parameter in whose place it stands is shared.
        if found and reference in coordinates.quantities:
            i = coordinates.quantities.index(reference)
            own[i] = coordinates.of_quantity(i, logarithm)
        found.append(own)
    return found


def climb(
    model: Program,
    data: StanData,
    starts: Iterable[Mapping[str, object]],
    *,
    seed: int,
) -> Mapping[str, FloatArray]:
    """Climb from every start with Stan's optimiser and return the variables at the best end.

    Parameters
    ----------
    model : Program
        The program.
    data : dict
        Its data.
    starts : iterable of mapping
        Values of its parameters.
    seed : int
        For the optimiser's record; it draws nothing.

    Raises
    ------
    ModeNotFound
        If the optimiser fails from all starts.
    """
    best = None
    n_starts = 0
    for initial in starts:
        n_starts += 1
        try:
            density, variables = model.optimise(data, initial, seed=seed)
        except SamplingError:
            continue  # the optimiser left the region where the solver finds a solution
        if best is None or density > best[0]:
            best = (density, variables)
    if best is None:
        raise ModeNotFound(f"the optimiser failed from all {n_starts} starts")
    return best[1]
