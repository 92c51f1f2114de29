"""Tests, priors and solver options -> the data dictionary of the Stan program of their protocol."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from pyburgers.cmdstan.program import Density, Program, load_program
from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import SamplingError
from pyburgers.kinds.experiment import Experiment, MeasuredMicrostructure
from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import Problem, one_test
from pyburgers.kinds.stan_data import (
    BDF,
    CHART,
    PLAIN,
    Layout,
    SolverOptions,
    StanData,
    ends,
    solver_block,
)
from pyburgers.model.flow_law_prior import FlowLawPrior
from pyburgers.model.laws import KELVIN_LAWS
from pyburgers.model.parameters import (
    ALL_ENVIRONMENT_NUMBERS,
    ENVIRONMENT,
    PARAMETER_BY_NAME,
    PIEZOMETER,
    PLACE,
    PROGRAM_PARAMETERS,
    RESIDUAL_CORRELATION,
    Parameter,
)
from pyburgers.model.prior_families import FAMILIES, Prior, fixed_prior, is_fixed_at
from pyburgers.model.priors import FLOW_LAW, PriorSet
from pyburgers.model.variants import variant_of

PART_OF_FLOW_LAW = 4
"""Code of a parameter whose density is in the joint prior of the flow law."""


CHART_DATA_PRECISION = 1.0
"""Of a partially pooled number in a chart, as a guess of what data say; speed only."""


def density_of(problem: Problem, solver: SolverOptions, *, use_likelihood: bool = True) -> Density:
    """Return the density of a problem in plain coordinates, its program compiled if need be."""
    program = load_program(problem.likelihood.program)
    if not program.has_cpp:
        solver = replace(solver, method=BDF)
    return Density(program, program_data(problem, solver=solver, use_likelihood=use_likelihood))


def program_data(
    problem: Problem,
    *,
    solver: SolverOptions,
    grids: Sequence[FloatArray] | None = None,
    use_likelihood: bool = True,
) -> StanData:
    """Return all data of the program in plain coordinates, with solutions at `grids` (SI)."""
    layout = problem.layout
    is_fast = problem.likelihood.has_fast_solver
    return {
        **with_grids({}, problem.experiments, grids),
        **_prior_block(problem, layout),
        **flow_law_block(problem.priors[0].flow_law),
        **_coordinate_block(problem, layout),
        **chart_block(problem),
        **tests_block(problem, use_likelihood=use_likelihood),
        **solver_block(solver if is_fast else replace(solver, method=BDF)),
    }


def tests_block(problem: Problem, *, use_likelihood: bool) -> StanData:
    """Return the data of a program that are about the problem."""
    experiments, kelvin = problem.experiments, KELVIN_LAWS[problem.variant.kelvin]
    return {
        "n_tests": len(experiments),
        "temperature": [e.temperature for e in experiments],
        "initial_grain_size": [e.initial_grain_size for e in experiments],
        "point_end": ends(e.n_points for e in experiments),
        "use_likelihood": int(use_likelihood),
        **problem.likelihood.tests_block(experiments, problem.priors),
        "kelvin_law": PLACE[kelvin.parameters[0]] if kelvin.own_stress else 0,
    }


def with_grids(
    data: StanData, experiments: Sequence[Experiment], grids: Sequence[FloatArray] | None
) -> StanData:
    """Return data of a program with other positions of its solutions (see `program_data`)."""
    if grids is None:
        grids = [np.empty(0)] * len(experiments)
    return {**data, **likelihood_of(experiments[0]).grid_block(experiments, grids)}


def chart_block(
    problem: Problem,
    references: Sequence[object] = (),
    *,
    pooled: FloatArray | None = None,
    pooling: FloatArray | None = None,
) -> StanData:
    """Return the data of the protocol's chart; no references keep the plain coordinates.

    `pooled` (n_tests, n_partial), `pooling` (2, n_partial): real numbers behind the partially
        pooled parameters at the references, their centres and ln(spread/scale); default 0.
    """
    layout = problem.layout
    n_partial = len(layout.partial)
    pooled = np.zeros((layout.n_tests, n_partial)) if pooled is None else pooled
    pooling = np.zeros((2, n_partial)) if pooling is None else pooling
    return {
        **problem.likelihood.chart.block(references, layout),
        "coordinate_system": CHART if references else PLAIN,
        "pooled_reference": pooled.tolist(),
        "centre_reference": pooling[0].tolist(),
        "log_spread_reference": pooling[1].tolist(),
        "pooled_data_precision": CHART_DATA_PRECISION if references else 0.0,
    }


def values_of_test(parameter: FloatArray, test: int) -> dict[str, float]:
    """Return the parameters of a test, from 0, by name, from (n_tests, n_parameters)."""
    return {p.name: float(v) for p, v in zip(PROGRAM_PARAMETERS, parameter[test], strict=True)}


def prior_block(priors: PriorSet, parameters: Sequence[Parameter]) -> StanData:
    """Return the priors of a program's parameters, in its order."""
    ordered = [priors[parameter.name] for parameter in parameters]
    joint = FLOW_LAW if priors.flow_law is not None else ()
    return {
        "prior_family": [
            PART_OF_FLOW_LAW if prior.parameter in joint else FAMILIES[prior.family].code
            for prior in ordered
        ],
        "prior_location": [prior.location for prior in ordered],
        "prior_scale": [prior.scale for prior in ordered],
        "prior_lower": [prior.lower for prior in ordered],
        "prior_upper": [prior.upper for prior in ordered],
    }


def flow_law_block(flow_law: FlowLawPrior | None) -> StanData:
    """Return the joint prior of the flow law, the rest of the block `stan/data/priors.stan`."""
    if flow_law is None:
        names = ("flow_law_mean", "flow_law_factor", "flow_law_conditions")
        return {"n_flow_law": 0, **{name: [] for name in names}}
    at = flow_law.conditions
    return {
        "n_flow_law": flow_law.mean.size,
        "flow_law_mean": flow_law.mean.tolist(),
        "flow_law_factor": flow_law.factor.tolist(),
        "flow_law_conditions": [at.temperature, at.stress, at.grain_size],
    }


def _prior_block(problem: Problem, layout: Layout) -> StanData:
    """Return the part of the block `stan/data/priors.stan` that differs between problems."""
    rows = [
        prior_block(_as_solved(priors, experiment), PROGRAM_PARAMETERS)
        for priors, experiment in zip(problem.priors, problem.experiments, strict=True)
    ]
    own = np.zeros((layout.n_tests, len(PROGRAM_PARAMETERS)), dtype=bool)
    for row, places in zip(own, layout.own, strict=True):
        row[[PLACE[layout.names[i]] - 1 for i in places]] = True
    block = {key: [row[key] for row in rows] for key in rows[0]}
    in_flow_law = [PLACE[name] - 1 for name in FLOW_LAW]
    joint = problem.priors[0].flow_law is not None
    return {
        **block,
        "prior_family": np.where(own, block["prior_family"], 0).tolist(),
        "has_flow_law_prior": [int(joint and row[in_flow_law].any()) for row in own],
    }


def _as_solved(priors: PriorSet, experiment: Experiment) -> PriorSet:
    """Priors with the piezometer left out where the grain size does not follow it."""
    if variant_of(priors, experiment).grain_size == "piezometric":
        return priors
    return priors.exchanging(fixed_prior(PARAMETER_BY_NAME[PIEZOMETER[0]], 0.0, "not in use"))


def _coordinate_block(problem: Problem, layout: Layout) -> StanData:
    """Return the block `stan/data/coordinates.stan` but for what a chart says."""
    plain, own = problem.coordinates, layout.own
    shared = [layout.names.index(name) for name in layout.shared]
    parameters = [[PLACE[layout.names[i]] for i in places] for places in own]
    place = np.zeros((layout.n_tests, len(PROGRAM_PARAMETERS)), dtype=np.int64)
    for row, found in zip(place, parameters, strict=True):
        row[np.array(found, dtype=np.int64) - 1] = np.arange(1, len(found) + 1)
    replaced = PLACE.get(plain[0].replaced_parameter or "", 0)
    families = prior_block(problem.priors[0], PROGRAM_PARAMETERS)["prior_family"]
    return {
        "n_coordinates": layout.size,
        "unit": [1.0] * layout.size,
        "n_shared": len(layout.shared),
        "shared_parameter": [PLACE[name] for name in layout.shared],
        "shared_from": (layout.source[:, shared] + 1).tolist(),
        "own_end": ends(len(places) for places in own),
        "own_parameter": list(chain.from_iterable(parameters)),
        "own_position": [
            int(layout.position[test, i]) + 1 for test, places in enumerate(own) for i in places
        ],
        "quantity": np.concatenate(
            [numbers.quantity[places] for numbers, places in zip(plain, own, strict=True)]
        ).tolist(),
        "own_place": place.tolist(),
        "replaced_parameter": [replaced if replaced in found else 0 for found in parameters],
        "n_pooled": len(layout.partial),
        "pooled_parameter": [PLACE[name] for name in layout.partial],
        "pooled_family": [families[PLACE[name] - 1] for name in layout.partial],
        "pooled_position": (layout.position[:, layout.pooled] + 1).tolist(),
        "pooled_quantity": [numbers.quantity[layout.pooled].tolist() for numbers in plain],
        "centre_position": (layout.centre + 1).tolist(),
        "spread_position": (layout.spread + 1).tolist(),
        "spread_scale": [problem.pooling.spread_scales[name] for name in layout.partial],
    }


def given_parameters(material: str, values: Mapping[str, float]) -> PriorSet:
    """Return priors that fix every parameter at SI values; a stress noise that is missing is 1."""
    known = {"stress_noise": 1.0, **values}  # a solution has no noise
    parameters = [p for p in PROGRAM_PARAMETERS if p.name in known]
    priors = {p.name: fixed_prior(p, known[p.name], "given") for p in parameters}
    return PriorSet(material=material, title="given parameters", priors=priors, name="given")


def solve(
    experiment: Experiment,
    values: Mapping[str, float],
    at: FloatArray,
    *,
    solver: SolverOptions,
    program: Program | None = None,
    sections: Sequence[MeasuredMicrostructure] = (),
) -> dict[str, FloatArray]:
    """Solve the model once; return generated quantities, and the positions as ``grid_CLOCK``."""
    priors = given_parameters(experiment.material, values)
    likelihood = likelihood_of(experiment)
    bare = replace(experiment.to_be_solved(), microstructure=tuple(sections))
    data = program_data(one_test(bare, priors), solver=solver, grids=[at])
    advice = "at these parameters; check their units (SI) and the sign of beta."
    try:
        draw = (program or load_program(likelihood.program)).evaluate(data)
    except SamplingError as error:
        raise SamplingError(f"{experiment.id}: the solver found no solution {advice}") from error
    for quantity in likelihood.read:
        if not np.isfinite(draw[f"grid_{quantity.name}"]).all():
            raise SamplingError(
                f"{experiment.id}: the solver found no finite {quantity.name} {advice}"
            )
    clock = f"grid_{likelihood.clock.name}"
    return {**draw, clock: np.asarray(data.get(clock, at))}


def fixed_in_effect(fit: FittedTest) -> tuple[Prior, ...]:
    """Return the fixed parameters that the solution or the likelihood of a test depends on."""
    idle = _idle(fit)
    return tuple(
        prior for name, prior in fit.priors.priors.items() if prior.is_fixed and name not in idle
    )


def _idle(fit: FittedTest) -> frozenset[str]:
    """Name the parameters that nothing depends on."""
    variant = variant_of(fit.priors, fit.experiment)
    read = likelihood_of(fit.experiment).read
    without_readings = {*read} - {read[k] for k in fit.experiment.quantity}
    idle = {*fit.experiment.without_effect, *(one.noise for one in without_readings)}
    if fit.experiment.linear_hardening and variant.hardening == "backstress":
        idle |= {"backstress_limit"}
    if variant.grain_size != "piezometric":
        idle |= {*PIEZOMETER}
    if variant.grain_size != "evolving":
        idle |= {"steady_state_grain_size"}
    if variant.grain_size == "constant":
        idle |= {"critical_strain_grain_size"}
    if variant.fabric == "constant":
        idle |= {"steady_state_fabric_factor", "critical_strain_fabric"}
    if not variant.residuals_correlate:
        idle |= {*RESIDUAL_CORRELATION}
    if variant.residuals == "discrepancy":
        idle |= {"residual_correlated_share"}
    if all(is_fixed_at(fit.priors[name], 0.0) for name in ALL_ENVIRONMENT_NUMBERS):
        idle |= {*ENVIRONMENT}
    return frozenset(idle)
