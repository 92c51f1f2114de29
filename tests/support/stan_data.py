"""Data of the programs for one test, and parameters in what they write."""

from collections.abc import Mapping, Sequence

import numpy as np

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forced_oscillation.likelihood import N_SOLUTIONS, ShearedReference
from pyburgers.kinds.problem import one_test
from pyburgers.kinds.program_data import chart_block, program_data
from pyburgers.kinds.stan_data import SolverOptions, StanData
from pyburgers.model.parameters import PLACE, PROGRAM_PARAMETERS
from pyburgers.model.priors import PriorSet


def one_test_data(
    experiment: Experiment,
    priors: PriorSet,
    *,
    solver: SolverOptions,
    grid: FloatArray | None = None,
    use_likelihood: bool = True,
    reference: object | None = None,
) -> StanData:
    """Data of a test by itself, in the chart of its protocol where a reference is given."""
    tests = one_test(experiment, priors)
    data = program_data(
        tests,
        solver=solver,
        grids=None if grid is None else [grid],
        use_likelihood=use_likelihood,
    )
    return data if reference is None else {**data, **chart_block(tests, [reference])}


def sheared_reference(flow_slope: Sequence[float], origin: Sequence[float]) -> ShearedReference:
    """Sheared coordinates whose dashpot is about that of the olivine twin, with bends."""
    bends = 0.3 * np.sin(np.arange(N_SOLUTIONS))
    return ShearedReference(
        np.array(flow_slope),
        np.array(origin),
        log_rate_scale=-14.5,
        first_log_rate=-19.0,
        log_dashpot_compliance=np.linspace(-31.0, -20.0, N_SOLUTIONS) + bends,
    )


def parameter_in(columns: Mapping[str, float], name: str, test: int = 1) -> float:
    """A parameter in a row of a program's output, of a test counted from 1."""
    return columns[f"parameter.{test}.{PLACE[name]}"]


def parameters_in(columns: Mapping[str, float], test: int = 1) -> dict[str, float]:
    """Every parameter in a row of a program's output."""
    return {p.name: parameter_in(columns, p.name, test) for p in PROGRAM_PARAMETERS}
