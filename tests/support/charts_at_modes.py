"""Coordinates of a problem, set up at the mode that is searched for."""

from pyburgers.kinds.coordinates import ProblemMode
from pyburgers.kinds.problem import Problem
from pyburgers.kinds.stan_data import SolverOptions, StanData
from pyburgers.sampling.charts import ChosenChart, choose_chart
from pyburgers.sampling.starts import find_mode


def chart_at_mode(
    problem: Problem,
    data: StanData,
    solver: SolverOptions,
    *,
    wanted: str = "auto",
    seed: int = 1,
    mode: ProblemMode | None = None,
) -> ChosenChart:
    """Choose coordinates as a fit does, at a mode that is searched for unless it is given."""
    return choose_chart(
        problem,
        data,
        lambda: mode or find_mode(problem, seed=seed, solver=solver),
        wanted=wanted,
        seed=seed,
        solver=solver,
    )
