"""Modes of a problem, the coordinates that are set up there, and draws of the prior as starts."""

import logging
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pyburgers.cmdstan.program import (
    COORDINATE,
    Density,
    Ending,
    ModeNotFound,
    Program,
    load_program,
)
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.fitting.stretched_flow import stretch_flows
from pyburgers.kinds.likelihood import AtMode, ChartUnsuited, likelihood_of
from pyburgers.kinds.problem import Problem
from pyburgers.kinds.program_data import chart_block, density_of, solve, values_of_test
from pyburgers.kinds.stan_data import Mode, SolverOptions, StanData, solver_in
from pyburgers.sampling.manifest import OtherMode
from pyburgers.sampling.modes import START_ATTEMPTS, draw_around, weighed_modes

logger = logging.getLogger(__name__)

N_CANDIDATES, N_BEST = 24, 12
"""Draws of the prior, and how many of them, by their densities, are climbed from.

A climb from far away can end at a lesser mode: on measured salt 23 of 40 climbs did. Where a curve
has a stress of 3 MPa, climbs from the first draws made the spring so soft that nothing flowed, 165
below the mode."""

QUIETER = (3.0, 4.0, 5.0)
"""By how much ln(noise) is lower where climbs from the best end start again.

Noise can take all readings up before anything else moves. Of load and unload with a spring a
hundred times softer than its prior says all twelve climbs ended so, 53 below the mode."""

FLOW_REACH = float(np.log(10.0))
"""How far from its origin ln(flow rate) may be where one of `N_CANDIDATES` has a hyperbolic sine.

The prior of a rate that is exponential in stress spans tens of orders of magnitude: of 24 climbs
from its draws two came within 4e-4 of the creep of rock salt that hardens, a strain of 1.6e-2."""

CLIMB_TOLERANCE = 1e-7
"""Of the solver for the last climb. Gradients at the tolerance of the sampling are not those of its
log density: climbs of a relaxation test ended in a corner of the bounds, 18 below the mode, and of
salt that hardens the third best of four ends, 17 below the best, lay below a mode 11 above it."""

LARGEST_RISE = 2.0
"""Of the log density from the centre of a chart to the mode near it.

Above it the curvature at the centre says little of the posterior: conditional medians of the valley
lie on another arm than the mode, or the optimiser has stopped short of it, as it does in plain
coordinates where noise is far below a percent of the stress."""

LEAST_SPREAD = 1e-3
"""Over its prior's scale: below it a spread at the mode would make the reference degenerate."""


@dataclass(frozen=True, eq=False)
class ProblemMode:
    """The highest density found of a problem, and other modes that were met on the way."""

    tests: tuple[Mode, ...]  # each by itself
    coordinate: FloatArray  # (n_coordinates,), plain ones of all tests together
    others: tuple[OtherMode, ...] = ()


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
    density: Density,
    *,
    wanted: str,
    seed: int,
    mode: ProblemMode | None = None,
) -> ChosenChart:
    """Set up the chart that suits at the posterior mode, or fall back to plain coordinates.

    The density is in plain coordinates. Where its data switch the likelihood off, coordinates stay
    plain and chains start from the prior: what data fix is a poor guide to it. The mode is searched
    for unless it is known. If "auto" is `wanted`, the chart is taken where priors and records suit
    it; other coordinates that do not suit are an `InputError`.
    """
    if not density.data["use_likelihood"]:
        return ChosenChart("plain", "the likelihood is off", {})
    logger.info("Finding the posterior mode, which sets the sampler's coordinates and metric.")
    reason = "asked for"
    try:
        mode = mode or find_mode(problem, density, seed=seed)
        if wanted != "plain":
            return _chart_at(problem, density, mode, seed=seed)
    except (ModeNotFound, ChartUnsuited) as error:
        if wanted not in ("auto", "plain"):
            raise InputError(
                f"{problem.name}: {wanted} coordinates do not apply, because {error}; use "
                "--coordinates auto or plain."
            ) from error
        reason = reason if wanted == "plain" else str(error)
    if mode is None:
        return ChosenChart("plain", reason, {})
    block, centre = dict[str, Any](), mode.coordinate
    if wanted != "plain":
        block, centre = stretch_flows(problem, density, mode.tests, mode.coordinate)
        reason += "; the flow rate is stretched, because data hardly see it" * bool(block)
    covariance = density.with_data(block).laplace(centre)
    # Precise data fix some plain coordinates to a thousandth, and Stan's adaptation of the metric
    # pulls variances to 1e-3.
    block = {**block, "unit": np.sqrt(np.diag(covariance)).tolist()}
    return ChosenChart("plain", reason, block, centre, covariance, mode.others)


def at_mode(problem: Problem, mode: Mode, solver: SolverOptions) -> AtMode[Any]:
    """Return what charts are set up with, for a problem of one test and its mode."""
    (experiment,), (priors,) = problem.experiments, problem.priors
    density = density_of(problem, solver)
    place = np.append(mode.coordinate, mode.driving_error)
    return AtMode(
        experiment,
        priors,
        problem.coordinates[0],
        mode,
        dict(density.data),
        solution=lambda at: solve(experiment, mode.values, at, solver=solver),
        generated=lambda **changes: density.with_data(changes).variables_at(place),
        curvature=lambda **changes: density.with_data(changes).curvature(place),
        covariance=lambda at, **changes: density.with_data(changes).laplace(at),
        generated_at=lambda points, **changes: density.with_data(changes).generated_at(points),
    )


def _chart_at(problem: Problem, density: Density, mode: ProblemMode, *, seed: int) -> ChosenChart:
    """Set a chart up at the mode of every test, with its own mode near there as the centre.

    Pooling and data share the centring of partially pooled parameters, so that there the centre is
    not the mode, and its curvature can be far from that of the posterior.
    """
    chart, layout = problem.likelihood.chart, problem.layout
    # Tables beside histories have plain coordinates.
    in_chart = [one if one.likelihood is problem.likelihood else None for one in problem.alone()]
    for one in in_chart:
        if one is not None:
            _check_pooling(chart.solved(one.priors[0], one.experiments[0]), problem)
    solver = solver_in(density.data)
    if chart.curvature_tolerance is not None:
        solver = replace(solver, tolerance=chart.curvature_tolerance)
    tests = [
        None if one is None else at_mode(one, own, solver)
        for one, own in zip(in_chart, mode.tests, strict=True)
    ]
    references: list[Any] = []
    centre = np.zeros(layout.size)
    for e, test in enumerate(tests):
        reference, position = (
            (None, mode.tests[e].coordinate) if test is None else chart.reference(test)
        )
        by_itself = layout.own[e]
        centre[layout.position[e, by_itself]] = position[by_itself]
        references.append(reference)
    for own, places in zip(mode.tests, layout.errors, strict=True):
        centre[places] = own.driving_error
    pooled = np.array([own.coordinate[layout.pooled] for own in mode.tests])
    log_spread = np.maximum(mode.coordinate[layout.spread], np.log(LEAST_SPREAD))
    pooling = np.array([mode.coordinate[layout.centre], log_spread])
    block = chart_block(problem, references, pooled=pooled, pooling=pooling)
    around = density.with_data({**block, "tolerance": solver.tolerance})
    covariance = around.laplace(centre)
    if problem.partial or around.expected_rise(centre, covariance) > LARGEST_RISE:
        centre = around.ends([centre], seed=seed)[0].place
        covariance = around.laplace(centre)
    for e, (test, places) in enumerate(zip(tests, layout.position, strict=True)):
        if test is not None:
            of_test = covariance[np.ix_(places, places)]
            references[e] = chart.rescaled(references[e], test, of_test)
    block = {**block, **chart.block(references, layout)}
    why = "the priors and the record suit them"
    return ChosenChart(chart.name, why, block, centre, covariance, mode.others)


def _check_pooling(solved: Iterable[str], problem: Problem) -> None:
    """Ask for what a chart solves for to be each test's own."""
    for name in solved:
        pooled = problem.pooling.kinds[name] if name in problem.free else "separate"
        if pooled != "separate":
            raise ChartUnsuited(f"{name} is {pooled.replace('partial', 'partially pooled')}")


def find_mode(problem: Problem, density: Density, *, seed: int) -> ProblemMode:
    """Climb from the best of some draws of the prior, and take the weightiest mode met.

    The density is that of the problem in plain coordinates. Where tests hang together, also from
    the modes of single tests: draws of the prior alone can all end where a test is not fitted at
    all. The seed decides the prior draws.
    """
    exact, ends = _ends(problem, density, seed=seed)
    (_, weightiest), *lesser = weighed_modes(exact, ends)
    others = []
    for log_weight, end in lesser:
        modes = zip(problem.experiments, _modes_of_tests(problem, end), strict=True)
        values = {test.id: {name: own.values[name] for name in problem.free} for test, own in modes}
        others.append(OtherMode(log_weight=log_weight, values=values))
    return ProblemMode(_modes_of_tests(problem, weightiest), weightiest.place, tuple(others))


def _ends(problem: Problem, density: Density, *, seed: int) -> tuple[Density, list[Ending]]:
    """Return the ends of all climbs, the best first, and the density that they are of."""
    solver = solver_in(density.data)
    starts: list[FloatArray] = []
    if not problem.is_single:
        single: list[Mode] = []
        for one in problem.alone():
            _, (highest, *_) = _ends(one, density_of(one, solver), seed=seed)
            single += _modes_of_tests(one, highest)
        places, errors = [own.coordinate for own in single], [own.driving_error for own in single]
        starts = [position_of(problem, places, np.ones(len(problem.partial)), errors)]
    starts += _best_prior_draws(problem, density, seed=seed)
    ends = density.ends(starts, seed=seed)
    places = [end.place for end in ends]
    # The accurate solver can need more steps than it may take.
    with suppress(ModeNotFound):
        tolerance = min(solver.tolerance, CLIMB_TOLERANCE)
        exact = density.with_data({"tolerance": tolerance})
        again = [_with_less_noise(problem, places[0], by) for by in QUIETER]
        return exact, exact.ends([*places, *again], seed=seed)
    return density, ends


def _modes_of_tests(problem: Problem, end: Ending) -> tuple[Mode, ...]:
    """Return the mode of each test where a climb has ended."""
    plain = _plain_of_tests(problem, end.place, end.variables["log_reference"])
    values = end.variables["parameter"]
    return tuple(
        Mode(values_of_test(values, e), own, end.place[places])
        for e, (own, places) in enumerate(zip(plain, problem.layout.errors, strict=True))
    )


def _best_prior_draws(problem: Problem, density: Density, *, seed: int) -> list[FloatArray]:
    """Draw starts and return those with the highest densities."""
    programs, numbers = programs_of_tests(problem), range(1, N_CANDIDATES + 1)
    drawn = [draw_from_prior(problem, programs, seed=seed, chain=number) for number in numbers]
    points = np.array([_flowing(problem, start) for start in drawn])
    best_first = np.argsort(-density.at(points), kind="stable")
    return [points[k] for k in best_first[:N_BEST]]


def _with_less_noise(problem: Problem, start: FloatArray, by: float) -> FloatArray:
    """Lower ln of all noises by a number."""
    layout = problem.layout
    noises = {read.noise for test in problem.experiments for read in likelihood_of(test).read}
    position = start.copy()
    position[layout.position[:, [name in noises for name in layout.names]]] -= by
    return position


def _flowing(problem: Problem, start: FloatArray) -> FloatArray:
    """Keep the flow rate of a hyperbolic sine within `FLOW_REACH` of its origin."""
    reference = problem.likelihood.reference.name
    position = start.copy()
    for coordinates, priors, places in zip(
        problem.coordinates, problem.priors, problem.layout.position, strict=True
    ):
        if reference in coordinates.quantities and not priors["breakdown_stress"].is_fixed:
            i = coordinates.quantities.index(reference)
            reach = FLOW_REACH / coordinates.scale[i]
            position[places[i]] = np.clip(position[places[i]], -reach, reach)
    return position


def programs_of_tests(problem: Problem) -> list[Program]:
    """Return the programs that solve the tests one by one; a table has another than histories."""
    sources = [likelihood_of(experiment).program for experiment in problem.experiments]
    loaded = {source: load_program(source) for source in set(sources)}
    return [loaded[source] for source in sources]


def draw_start(
    problem: Problem,
    density: Density,
    laplace: tuple[FloatArray, FloatArray] | None,
    *,
    seed: int,
    chain: int,
) -> dict[str, list[float]]:
    """Draw the start of a chain around a mode and covariance, or from the prior without them."""
    if laplace is None:
        start = draw_from_prior(problem, programs_of_tests(problem), seed=seed, chain=chain)
    else:
        start = draw_around(density, *laplace, seed=seed, chain=chain)
    return {COORDINATE: start.tolist()}


def draw_from_prior(
    problem: Problem, programs: Sequence[Program], *, seed: int, chain: int
) -> FloatArray:
    """Draw plain coordinates, (n_coordinates,), from the priors until all tests have a solution.

    Partially pooled parameters are drawn apart for each test; centre and spread are put around
    them. The start depends on seed and chain alone.
    """
    rng = np.random.default_rng([seed, chain])
    for _ in range(START_ATTEMPTS):
        values = draw_priors(problem, rng)
        spreads = np.abs(rng.standard_normal(len(problem.partial)))
        tests = zip(problem.experiments, problem.coordinates, values, programs, strict=True)
        plain = []
        # If a test has no finite solution here, the next draw may have one.
        with suppress(SamplingError):
            for one, coordinates, own, program in tests:
                solved = solve(one, own, one.position, solver=SolverOptions(), program=program)
                plain.append(coordinates.at(own, float(solved["log_reference"][0])))
            return position_of(problem, plain, spreads)
    raise SamplingError(
        f"{problem.name}: none of {START_ATTEMPTS} draws from the prior has a finite solution; "
        "check the units and the bounds of the priors."
    )


def draw_priors(problem: Problem, rng: np.random.Generator) -> list[dict[str, float]]:
    """Draw the parameters of each test (SI) from its priors, shared ones once."""
    return share_values(problem, [priors.sample(rng) for priors in problem.priors])


def share_values(problem: Problem, drawn: Sequence[Mapping[str, float]]) -> list[dict[str, float]]:
    """Return parameters of each test, of which shared ones are those of the first test of them."""
    names = problem.layout.names
    return [
        {**own, **{name: drawn[k][name] for name, k in zip(names, sources, strict=True)}}
        for own, sources in zip(drawn, problem.layout.source, strict=True)
    ]


def position_of(
    problem: Problem,
    plain: Sequence[FloatArray],
    spreads: FloatArray,
    errors: Sequence[FloatArray] = (),
) -> FloatArray:
    """Return coordinates of a problem, shape (n_coordinates,), with centres at the mean over tests.

    `plain` has the plain coordinates of each test by itself, `spreads`, shape (n_partial,), those
    of partially pooled parameters over the scales of their priors, `errors` those of what drives
    each test; 0 where none are given.
    """
    layout = problem.layout
    position = np.zeros(layout.size)
    for e, own in enumerate(layout.own):
        position[layout.position[e, own]] = plain[e][own]
    for h, name in enumerate(layout.partial):
        i = layout.names.index(name)
        tests = [e for e in range(layout.n_tests) if layout.source[e, i] == e]
        numbers = np.array([plain[e][i] for e in tests])
        centre = numbers.mean()
        position[layout.centre[h]] = centre
        position[layout.spread[h]] = np.log(spreads[h])
        spread = spreads[h] * problem.pooling.spread_scales[name]
        position[layout.position[tests, i]] = (numbers - centre) / spread
    for places, error in zip(layout.errors, errors, strict=False):
        position[places] = error
    return position


def _plain_of_tests(
    problem: Problem, place: FloatArray, log_reference: FloatArray
) -> list[FloatArray]:
    """Return plain coordinates of each test by itself, the inverse of `position_of`."""
    layout, reference = problem.layout, problem.likelihood.reference.name
    found: list[FloatArray] = []
    tests = zip(problem.coordinates, layout.position, log_reference, strict=True)
    for coordinates, places, logarithm in tests:
        own = place[places].copy()
        for h, name in enumerate(layout.partial):
            i = layout.names.index(name)
            spread = problem.pooling.spread_scales[name] * np.exp(place[layout.spread[h]])
            own[i] = place[layout.centre[h]] + spread * own[i]
        # The first test's own already, where the parameter in whose place it stands is shared.
        if found and reference in coordinates.quantities:
            i = coordinates.quantities.index(reference)
            own[i] = coordinates.of_quantity(i, logarithm)
        found.append(own)
    return found
