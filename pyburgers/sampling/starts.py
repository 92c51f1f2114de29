"""Where chains start: draws of the prior, the posterior mode and draws around it."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from pyburgers.cmdstan.program import ModeNotFound, Program, load_program
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import SamplingError
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import Problem
from pyburgers.kinds.program_data import program_data, solve, values_of_test
from pyburgers.kinds.stan_data import (
    Mode,
    OtherMode,
    ProblemMode,
    SolverOptions,
    StanData,
    solver_block,
)
from pyburgers.sampling.densities import log_density_at
from pyburgers.sampling.other_modes import modes_beside_the_highest

INITIAL_ATTEMPTS = 100
N_STARTS = 4
"""Draws of the prior that are climbed from where one quantity is read along the clock."""

N_CANDIDATES, N_BEST = 24, 12
"""Draws where several are, and how many of them, by their densities, are climbed from.

A climb from far away can end where the noise of these quantities takes all up: of a test of three
stages it did from two of the eight draws with the best densities, and from the worst six no climb
came near the data. It can also end at a lesser mode: on measured salt 23 of 40 climbs did, and the
best four of two seeds in five, whichever had the highest densities to begin with."""

FLOW_REACH = float(np.log(10.0))
"""How far from its origin ln(flow rate) may be where one of `N_CANDIDATES` has a hyperbolic sine.

The prior of a rate that is exponential in stress spans tens of orders of magnitude: of 24 climbs
from its draws two came within 4e-4 of the creep of rock salt that hardens, a strain of 1.6e-2."""

CLIMB_TOLERANCE = 1e-7
"""Of the solver for the last climb. Gradients at the tolerance of the sampling are not those of its
log density: climbs of a relaxation test ended in a corner of the bounds, 18 below the mode, and of
salt that hardens the third best of four ends, 17 below the best, lay below a mode 11 above it."""


def programs_of_tests(problem: Problem) -> list[Program]:
    """Return the programs that solve the tests one by one; a table has another than histories."""
    sources = [likelihood_of(experiment).program for experiment in problem.experiments]
    loaded = {source: load_program(source) for source in set(sources)}
    return [loaded[source] for source in sources]


def draw_initial_values(
    problem: Problem, programs: Sequence[Program], *, seed: int, chain: int
) -> dict[str, list[float]]:
    """Draw a start in plain coordinates from the priors, again where a test has no solution.

    Partially pooled parameters are drawn apart for each test; centre and spread are put around
    them. The programs are those of the tests (`programs_of_tests`); the start depends on seed and
    chain alone. Returns what the program's parameters block wants. Raises `SamplingError` if none
    of `INITIAL_ATTEMPTS` draws has a finite solution in every test.
    """
    rng = np.random.default_rng([seed, chain])
    reference = problem.likelihood.reference.name
    for _ in range(INITIAL_ATTEMPTS):
        drawn = [priors.sample(rng) for priors in problem.priors]
        values = problem.hanging_together(drawn)
        spreads = np.abs(rng.standard_normal(len(problem.partial)))
        try:
            solutions = [
                solve(one, own, one.position, solver=SolverOptions(), program=program)
                for one, own, program in zip(problem.experiments, values, programs, strict=True)
            ]
        except SamplingError:
            continue  # a test has no finite solution here; the next draw may have one
        plain = [
            coordinates.at({**own, reference: float(np.exp(solution["log_reference"][0]))})
            for coordinates, own, solution in zip(
                problem.coordinates, values, solutions, strict=True
            )
        ]
        return {"coordinate": position_of(problem, plain, spreads).tolist()}
    raise SamplingError(
        f"{problem.name}: none of {INITIAL_ATTEMPTS} draws from the prior has a finite solution; "
        "check the units and the bounds of the priors."
    )


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
    for e in range(layout.n_tests):
        own = layout.own(e)
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


def draw_start_around(
    model: Program,
    data: StanData,
    centre: FloatArray,
    covariance: FloatArray,
    *,
    seed: int,
    chain: int,
) -> dict[str, list[float]]:
    """Draw a start around the posterior mode, again where the solver finds no solution.

    The Laplace approximation with its floor under the curvature is as wide as the prior where the
    data say little, so that starts are dispersed there, and they begin near the curve elsewhere.
    The covariance, shape (n_coordinates, n_coordinates), is that of `laplace_metric`; the start
    depends on seed and chain alone. Raises `SamplingError` if none of `INITIAL_ATTEMPTS` draws has
    a solution.
    """
    rng = np.random.default_rng([seed, chain])
    factor = np.linalg.cholesky(covariance)
    for _ in range(INITIAL_ATTEMPTS):
        start = {"coordinate": (centre + factor @ rng.standard_normal(len(factor))).tolist()}
        try:
            solution = model.evaluate(data, start)
        except SamplingError:
            continue  # no solution here; the next draw may have one
        if np.isfinite(solution["log_lik"]).all():
            return start
    raise SamplingError(
        f"none of {INITIAL_ATTEMPTS} starts around the posterior mode has a finite solution; "
        "narrow the priors."
    )


def find_mode(problem: Problem, *, seed: int, solver: SolverOptions) -> ProblemMode:
    """Climb from the best of some draws of the prior, and on from every end more accurately.

    Where tests hang together, also from the modes of single tests: draws of the prior alone can all
    end where a test is not fitted at all. The seed decides the prior draws. Raises `ModeNotFound`
    if the optimiser fails from all starts, or for a single test.
    """
    model = load_program(problem.likelihood.program)
    data, ends = _ends(problem, model, seed=seed, solver=solver)
    others = (
        OtherMode(log_weight, _free_values(problem, beside["parameter"]))
        for log_weight, beside in modes_beside_the_highest(model, data, ends)
    )
    return replace(_mode_at(problem, ends[0][1]), others=tuple(others))


def _ends(
    problem: Problem, model: Program, *, seed: int, solver: SolverOptions
) -> tuple[StanData, list[tuple[float, dict[str, FloatArray]]]]:
    """Return the ends of all climbs, the best first, and the data that they are of."""
    data = program_data(problem, solver=solver)
    starts = _best_prior_draws(problem, model, data, seed=seed)
    if not problem.is_single:
        single = [_only_mode(one, seed=seed, solver=solver) for one in problem.alone()]
        together = position_of(
            problem,
            [own.coordinate for own in single],
            np.ones(len(problem.partial)),
            [own.driving_error for own in single],
        )
        starts = [{"coordinate": together.tolist()}, *starts]
    ends = model.ends(data, starts, seed=seed)
    closer = replace(solver, tolerance=min(solver.tolerance, CLIMB_TOLERANCE))
    there = [{"coordinate": np.atleast_1d(end["coordinate"]).tolist()} for _, end in ends]
    # The accurate solver can need more steps than it may take.
    with suppress(ModeNotFound):
        accurate = {**data, **solver_block(closer)}
        ends, data = model.ends(accurate, there, seed=seed), accurate
    return data, ends


def _only_mode(problem: Problem, *, seed: int, solver: SolverOptions) -> Mode:
    """Return the mode of a single test, whose other modes nobody asks for."""
    _, ends = _ends(problem, load_program(problem.likelihood.program), seed=seed, solver=solver)
    return _mode_at(problem, ends[0][1]).tests[0]


def _mode_at(problem: Problem, variables: Mapping[str, FloatArray]) -> ProblemMode:
    """Return the mode where a climb has ended."""
    coordinate = np.atleast_1d(variables["coordinate"])
    plain = _plain_of_tests(problem, coordinate, variables["log_reference"])
    values = variables["parameter"]
    modes = (
        Mode(values_of_test(values, e), own, coordinate[places])
        for e, (own, places) in enumerate(zip(plain, problem.layout.errors, strict=True))
    )
    return ProblemMode(tuple(modes), coordinate)


def _free_values(problem: Problem, parameter: FloatArray) -> dict[str, dict[str, float]]:
    """Return the free parameters, by tests."""
    found = {}
    for e, experiment in enumerate(problem.experiments):
        values = values_of_test(parameter, e)
        found[experiment.id] = {name: values[name] for name in problem.free}
    return found


def _best_prior_draws(
    problem: Problem, model: Program, data: StanData, *, seed: int
) -> list[dict[str, list[float]]]:
    """Draw starts and return those with the highest densities."""
    n_drawn = N_CANDIDATES if len(problem.likelihood.read) > 1 else N_STARTS
    programs = programs_of_tests(problem)
    drawn = [
        draw_initial_values(problem, programs, seed=seed, chain=start)
        for start in range(1, n_drawn + 1)
    ]
    if n_drawn == N_STARTS:
        return drawn
    points = np.array([_flowing(problem, start["coordinate"]) for start in drawn])
    best_first = np.argsort(-log_density_at(model, data, points), kind="stable")
    return [{"coordinate": points[k].tolist()} for k in best_first[:N_BEST]]


def _flowing(problem: Problem, coordinate: Sequence[float]) -> FloatArray:
    """Keep the flow rate of a hyperbolic sine within `FLOW_REACH` of its origin."""
    reference = problem.likelihood.reference.name
    position = np.array(coordinate)
    for coordinates, priors, places in zip(
        problem.coordinates, problem.priors, problem.layout.position, strict=True
    ):
        if reference in coordinates.quantities and not priors["breakdown_stress"].is_fixed:
            i = coordinates.quantities.index(reference)
            reach = FLOW_REACH / coordinates.scale[i]
            position[places[i]] = np.clip(position[places[i]], -reach, reach)
    return position


def _plain_of_tests(
    problem: Problem, coordinate: FloatArray, log_reference: FloatArray
) -> list[FloatArray]:
    """Plain coordinates of each test by itself, the inverse of `position_of`."""
    layout, reference = problem.layout, problem.likelihood.reference.name
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
