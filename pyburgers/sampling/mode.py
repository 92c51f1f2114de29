"""Posterior mode, found by Stan's optimiser: where the sampler's coordinates and metric are set."""

from collections.abc import Iterable, Mapping

import numpy as np
import numpy.typing as npt

from pyburgers.cmdstan.program import Program, load_program
from pyburgers.common.errors import SamplingError
from pyburgers.model.parameters import PROGRAM_PARAMETERS
from pyburgers.model.priors import PriorSet
from pyburgers.protocols.chart import Mode
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.registry import protocol_of
from pyburgers.protocols.stan_data import SolverOptions, StanData, program_data
from pyburgers.sampling.initial_values import draw_initial_values

FloatArray = npt.NDArray[np.float64]

N_STARTS = 4


class ModeNotFound(Exception):  # noqa: N818 - an outcome with a reason, not an error
    """The optimiser failed; the message says how."""


def find_mode(
    experiment: Experiment, priors: PriorSet, *, seed: int, solver: SolverOptions
) -> Mode:
    """Climb from `N_STARTS` draws of the prior and keep the best.

    Parameters
    ----------
    experiment : Experiment
        A test with data.
    priors : PriorSet
        Resolved priors.
    seed : int
        Decides the prior draws.
    solver : SolverOptions
        Tolerance and step limit.

    Raises
    ------
    ModeNotFound
        If the optimiser fails from all starts.
    """
    data = program_data(experiment, priors, solver=solver)
    model = load_program(protocol_of(experiment).program)
    starts = (
        draw_initial_values(experiment, priors, seed=seed, chain=start)
        for start in range(1, N_STARTS + 1)
    )
    variables = climb(model, data, starts, seed=seed)
    return Mode(
        {p.name: float(variables[p.name]) for p in PROGRAM_PARAMETERS},
        np.atleast_1d(np.asarray(variables["coordinate"], dtype=np.float64)),
    )


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
