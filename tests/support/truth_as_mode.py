"""A test at its true parameters, which do for its mode where that only says where to look."""

from typing import Any, TypeVar

import numpy as np

from pyburgers.fitting.charts_at_modes import at_mode
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.likelihood import AtMode
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.stan_data import Mode, SolverOptions
from pyburgers.model.parameters import PROGRAM_PARAMETERS
from pyburgers.model.priors import PriorSet

E = TypeVar("E", bound=Experiment)


def at_truth(experiment: E, priors: PriorSet, solver: SolverOptions) -> AtMode[E]:
    """What charts are set up with; a search for the mode takes seconds of processor time more."""
    return problem_at_truth(problem_of([experiment], priors), solver)


def problem_at_truth(problem: Problem, solver: SolverOptions) -> AtMode[Any]:
    """The same of a problem of one test; what has no truth is in the middle of its prior."""
    (experiment,), (resolved,) = problem.experiments, problem.priors
    truth = experiment.true_parameters
    assert truth is not None
    values = {
        p.name: resolved[p.name].location
        if resolved[p.name].is_fixed
        else truth.get(p.name, resolved[p.name].location)
        for p in PROGRAM_PARAMETERS
    }
    reference = problem.likelihood.reference.name
    found = simulate(experiment, values, at=experiment.position).attrs[reference]
    coordinate = problem.coordinates[0].at({**values, reference: found})
    mode = Mode(values, coordinate, np.zeros(experiment.n_driving_errors))
    return at_mode(problem, mode, solver)
