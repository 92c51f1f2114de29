"""Coordinates of a problem, set up at the mode that is searched for."""

from pyburgers.cmdstan.program import Density, load_program
from pyburgers.fitting.charts_at_modes import ChosenChart, ProblemMode, choose_chart
from pyburgers.kinds.problem import Problem
from pyburgers.kinds.stan_data import StanData


def chart_at_mode(
    problem: Problem,
    data: StanData,
    *,
    wanted: str = "auto",
    seed: int = 1,
    mode: ProblemMode | None = None,
) -> ChosenChart:
    """Choose coordinates as a fit does, at a mode that is known or searched for."""
    density = Density(load_program(problem.likelihood.program), data)
    return choose_chart(problem, density, wanted=wanted, seed=seed, mode=mode)
