"""What the sampler moves in: coordinates, where their origin lies, and the first metric."""

import logging
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pyburgers.cmdstan.program import ALL_DIGITS, ModeNotFound, Program, load_program
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.kinds.likelihood import AtMode, Chart, ChartUnsuited
from pyburgers.kinds.problem import Problem
from pyburgers.kinds.program_data import chart_block, program_data, solve
from pyburgers.kinds.stan_data import (
    Mode,
    OtherMode,
    ProblemMode,
    SolverOptions,
    StanData,
    solver_block,
)
from pyburgers.sampling.laplace import curvature_at, laplace_metric

logger = logging.getLogger(__name__)


SUITED = "the priors and the record suit them"

LARGEST_RISE = 2.0
"""Of the log density from the centre of a chart to the mode near it.

Above it the curvature at the centre says little of the posterior: conditional medians of the valley
lie on another arm than the mode, or the optimiser has stopped short of it, as it does in plain
coordinates where noise is far below a percent of the stress."""

LEAST_SPREAD = 1e-3
"""Over its prior's scale: below it a spread at the mode would make the reference degenerate."""


@dataclass(frozen=True, eq=False)
class ChosenChart:
    """Coordinates of a run: "plain", or the name of the protocol's chart, and why they were taken.

    `block` has the Stan data of the coordinates. Around the `centre`, shape (n_coordinates,), the
    posterior mode or a point near it, `covariance` is the Laplace approximation, shape
    (n_coordinates, n_coordinates). Both are None if chains start from the prior with the unit
    metric. `other_modes` are those that were met beside the posterior mode.
    """

    name: str
    reason: str
    block: StanData
    centre: FloatArray | None = None
    covariance: FloatArray | None = None
    other_modes: tuple[OtherMode, ...] = ()

    @property
    def first_metric(self) -> FloatArray | None:
        """The covariance in the units that the sampler moves in (`stan/data/coordinates.stan`)."""
        if self.covariance is None:
            return None
        unit = np.array(self.block.get("unit", np.ones(len(self.covariance))))
        return np.asarray(self.covariance / np.outer(unit, unit))


def choose_chart(
    problem: Problem,
    data: StanData,
    find_mode: Callable[[], ProblemMode],
    *,
    wanted: str,
    seed: int,
    solver: SolverOptions,
) -> ChosenChart:
    """Set up the chart that suits at the posterior mode, or fall back to plain coordinates.

    The data are in plain coordinates. Where they switch the likelihood off, coordinates stay plain
    and chains start from the prior: what data fix is a poor guide to it. `find_mode` returns the
    mode or raises `ModeNotFound`. If "auto" is `wanted`, the chart is taken where priors and
    records suit it. The seed is for the record of the optimiser, which draws nothing. Raises
    `InputError` if the coordinates that were asked for do not suit priors or records.
    """
    if not data["use_likelihood"]:
        return ChosenChart("plain", "the likelihood is off", {})
    logger.info("Finding the posterior mode, which sets the sampler's coordinates and metric.")
    model, chart = load_program(problem.likelihood.program), problem.likelihood.chart
    mode, reason = None, "asked for"
    try:
        mode = find_mode()
        if wanted != "plain":
            chosen = _chart_at(chart, problem, model, data, mode, seed=seed, solver=solver)
            return replace(chosen, other_modes=mode.others)
    except (ModeNotFound, ChartUnsuited) as error:
        if wanted not in ("auto", "plain"):
            raise InputError(
                f"{problem.name}: {wanted} coordinates do not apply, because {error}; use "
                "--coordinates auto or plain."
            ) from error
        reason = reason if wanted == "plain" else str(error)
    if mode is None:
        return ChosenChart("plain", reason, {})
    covariance = laplace_metric(model, data, mode.coordinate)
    # Precise data fix some plain coordinates to a thousandth, and Stan's adaptation of the metric
    # pulls variances to 1e-3.
    unit = np.sqrt(np.diag(covariance))
    block: StanData = {"unit": unit.tolist()}
    return ChosenChart("plain", reason, block, mode.coordinate, covariance, mode.others)


def at_mode(problem: Problem, mode: Mode, solver: SolverOptions) -> AtMode[Any]:
    """Return what charts are set up with, for a problem of one test and its mode."""
    model = load_program(problem.likelihood.program)
    data = program_data(problem, solver=solver)
    position = np.append(mode.coordinate, mode.driving_error)
    (experiment,), (priors,), (coordinates,) = (
        problem.experiments,
        problem.priors,
        problem.coordinates,
    )
    return AtMode(
        experiment,
        priors,
        coordinates,
        mode,
        data,
        solution=lambda at: solve(experiment, mode.values, at, solver=solver),
        generated=lambda **changes: model.evaluate(
            {**data, **changes}, {"coordinate": position.tolist()}
        ),
        curvature=lambda **changes: curvature_at(model, {**data, **changes}, position),
        covariance=lambda at, **changes: laplace_metric(model, {**data, **changes}, at),
        generated_at=lambda points, **changes: model.generate_at(
            {**data, **changes}, "coordinate", points, ALL_DIGITS
        ),
    )


def _chart_at(
    chart: Chart[Any],
    problem: Problem,
    model: Program,
    data: StanData,
    mode: ProblemMode,
    *,
    seed: int,
    solver: SolverOptions,
) -> ChosenChart:
    """Set a chart up at the mode of every test, with its own mode near there as the centre.

    Pooling and data share the centring of partially pooled parameters, so that there the centre is
    not the mode, and its curvature can be far from that of the posterior.
    """
    alone = problem.alone()
    for one in alone:
        if one.likelihood is problem.likelihood:
            _check_pooling(chart.solved(one.priors[0], one.experiments[0]), problem)
    if chart.curvature_tolerance is not None:
        solver = SolverOptions(chart.curvature_tolerance)
        data = {**data, **solver_block(solver)}
    layout = problem.layout
    # Tables beside histories have plain coordinates.
    tests = [
        at_mode(one, own, solver) if one.likelihood is problem.likelihood else None
        for one, own in zip(alone, mode.tests, strict=True)
    ]
    references: list[Any] = []
    centre = np.zeros(layout.size)
    for e, test in enumerate(tests):
        reference, position = (
            (None, mode.tests[e].coordinate) if test is None else chart.reference(test)
        )
        by_itself = layout.own(e)
        centre[layout.position[e, by_itself]] = position[by_itself]
        references.append(reference)
    for own, places in zip(mode.tests, layout.errors, strict=True):
        centre[places] = own.driving_error
    pooled = np.array([own.coordinate[layout.pooled] for own in mode.tests])
    log_spread = np.maximum(mode.coordinate[layout.spread], np.log(LEAST_SPREAD))
    pooling = np.array([mode.coordinate[layout.centre], log_spread])
    block = chart_block(problem, references, pooled=pooled, pooling=pooling)
    around = {**data, **block}
    covariance = laplace_metric(model, around, centre)
    if problem.partial or expected_rise(model, around, centre, covariance) > LARGEST_RISE:
        centre, covariance = laplace_at_mode(model, around, centre, seed=seed)
    references = [
        None
        if test is None
        else chart.rescaled(reference, test, covariance[np.ix_(places, places)])
        for reference, test, places in zip(references, tests, layout.position, strict=True)
    ]
    block = chart_block(problem, references, pooled=pooled, pooling=pooling)
    return ChosenChart(chart.name, SUITED, block, centre, covariance)


_POOLED = {"shared": "shared", "partial": "partially pooled"}


def _check_pooling(solved: Iterable[str], problem: Problem) -> None:
    """Ask for what a chart solves for to be each test's own."""
    for name in solved:
        if name in problem.free and problem.pooling.kinds[name] != "separate":
            raise ChartUnsuited(f"{name} is {_POOLED[problem.pooling.kinds[name]]}")


def laplace_at_mode(
    model: Program, data: StanData, start: FloatArray, *, seed: int
) -> tuple[FloatArray, FloatArray]:
    """Climb to the mode in the coordinates that the data choose.

    Returns it, shape (n_coordinates,), and the covariance of the Laplace approximation there, shape
    (n_coordinates, n_coordinates). Raises `ModeNotFound` if the optimiser fails.
    """
    (_, found), *_ = model.ends(data, [{"coordinate": start.tolist()}], seed=seed)
    centre = np.asarray(found["coordinate"], dtype=np.float64)
    return centre, laplace_metric(model, data, centre)


def expected_rise(
    model: Program, data: StanData, centre: FloatArray, covariance: FloatArray
) -> float:
    """Rise of the log density from a point to the mode of its quadratic approximation there."""
    (gradient,) = model.gradients(data, "coordinate", [centre])
    return float(gradient @ covariance @ gradient) / 2
