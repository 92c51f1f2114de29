"""Chain files of a run -> labelled draws: of each test, and of all tests together."""

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pyburgers.cmdstan.draw_files import Draws, read_draws
from pyburgers.cmdstan.program import Program, Unsolved, load_program
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import SamplingError
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import Problem
from pyburgers.kinds.program_data import with_grids
from pyburgers.kinds.stan_data import CENTRE, REFERENCE_SOLVER, SPREAD, StanData, solver_block
from pyburgers.model.parameters import PARAMETER_BY_NAME, PLACE
from pyburgers.model.priors import PriorSet
from pyburgers.model.variants import variant_of
from pyburgers.posterior.groups import (
    GIVEN_OTHERS,
    MICROSTRUCTURE_LOG_LIKELIHOOD,
    PRIOR_DENSITY,
    drawn_at_points,
    grid_group,
    groups_at_points,
    keep_posterior,
    microstructure_group,
    point_groups,
)
from pyburgers.posterior.labelled_draws import (
    DRIVING_ERRORS,
    MICROSTRUCTURE,
    TESTS,
    label_draws,
    own_name,
    sample_stats,
)
from pyburgers.sampling.run_directory import RunDirectory

logger = logging.getLogger(__name__)


def build_posterior(
    run: RunDirectory, problem: Problem, manifest: Mapping[str, Any]
) -> xr.DataTree:
    """Gather the finished chains of a run into labelled draws and save them.

    Every kept draw is evaluated again at the reference tolerance of the solver, for the
    predictive bands and the solver check (Timonen et al. 2023, Stat 12, e614). Groups of a test
    are posterior, sample_stats, log_likelihood (of each point given those before it),
    log_likelihood_given_others (if residuals are correlated), log_prior, model_response and
    posterior_predictive (at the observed points), predictions (on a grid of the clock),
    posterior_mean_solution (if there is one), observed_data, constant_data, `MICROSTRUCTURE` and
    `DRIVING_ERRORS`. Those of several tests are in tests/ID; the top has the points of all tests
    and all draws, shared parameters by their names, others as NAME[TESTS], NAME[centre],
    NAME[spread].
    """
    with run.unchanged_copy(manifest, with_draws=True) as copy:
        groups = _groups_of(copy, problem, manifest)
    return keep_posterior(
        run,
        groups,
        experiment=problem.name,
        data_kind=problem.data_kind,
        protocols={one.id: one.protocol for one in problem.experiments},
    )


def _groups_of(
    run: RunDirectory, problem: Problem, manifest: Mapping[str, Any]
) -> dict[str, xr.Dataset]:
    """Gather the finished chains of a run into the groups of `build_posterior`."""
    likelihood, experiments = problem.likelihood, problem.experiments
    files = run.draws_files()
    grids = [likelihood_of(experiment).grid(experiment) for experiment in experiments]
    data = run.read_stan_data()
    fit = read_draws(files)
    logger.info("Solving every draw again at the reference tolerance.")
    data = with_grids(data, experiments, grids)
    on_grids, sizes = _places_on_grids(experiments, grids)
    program, seed = load_program(likelihood.program), manifest["sampler"]["seed"]
    checked = reference_solution(program, data, files, sizes, seed=seed)
    stats = stats_with_solver(
        fit, checked, unit=data["unit"], use_likelihood=manifest["use_likelihood"]
    )
    at_points = drawn_at_points(fit)
    at_points[PRIOR_DENSITY] = fit.dataset([PRIOR_DENSITY])[PRIOR_DENSITY]
    draws = _draws_of_tests(fit, problem)
    ends = data["point_end"]
    tests = {}
    for e, (experiment, priors) in enumerate(zip(experiments, problem.by_effect(), strict=True)):
        points = at_points.isel(point=slice(ends[e], ends[e + 1]))
        of_test = draws[experiment.id]
        tests[experiment.id] = {
            "posterior": of_test,
            "sample_stats": stats,
            **groups_at_points(_points_of_test(points, experiment, priors), experiment),
            "predictions": grid_group(checked.isel(on_grids[e]), experiment),
            **_solution_at_mean(of_test, priors, experiment),
        }
    common = point_groups(at_points, experiments)
    if MICROSTRUCTURE_LOG_LIKELIHOOD in fit:
        measured = microstructure_group(fit, experiments)
        common[MICROSTRUCTURE] = measured
        first = 0
        for experiment in experiments:
            if n_sections := len(experiment.microstructure):
                sections = measured.isel(section=slice(first, first + n_sections))
                numbered = sections.assign_coords(section=np.arange(n_sections))
                tests[experiment.id][MICROSTRUCTURE] = numbered
                first += n_sections
    if problem.is_single:
        (groups,) = tests.values()
    else:
        groups = {
            "posterior": _all_draws(fit, problem, draws),
            "sample_stats": stats,
            **common,
            **{
                f"{TESTS}/{test}/{name}": group
                for test, own in tests.items()
                for name, group in own.items()
            },
        }
    if any(experiment.n_driving_errors for experiment in experiments):
        groups[DRIVING_ERRORS] = driving_errors(fit, experiments)
    chains = list(run.finished_chains())
    return {
        name: group.assign_coords(chain=chains) if "chain" in group.dims else group
        for name, group in groups.items()
    }


def _places_on_grids(
    experiments: Sequence[Experiment], grids: Sequence[FloatArray]
) -> tuple[list[dict[str, slice]], dict[str, int]]:
    """Return where a program's grids hold each test, those of a protocol in turn, and the sizes."""
    sizes: dict[str, int] = {}
    places = []
    for experiment, grid in zip(experiments, grids, strict=True):
        names = likelihood_of(experiment).grid_quantities
        start = max(sizes.get(name, 0) for name in names)
        places.append({f"{name}_dim_0": slice(start, start + grid.size) for name in names})
        sizes |= dict.fromkeys(names, start + grid.size)
    return places, sizes


def _points_of_test(points: xr.Dataset, experiment: Experiment, priors: PriorSet) -> xr.Dataset:
    """Draws at the points of a test, counted from 0."""
    if GIVEN_OTHERS in points and variant_of(priors, experiment).residuals == "independent":
        points = points.drop_vars(GIVEN_OTHERS)
    return points.assign_coords(point=np.arange(experiment.n_points))


def _draws_of_tests(fit: Draws, problem: Problem) -> dict[str, xr.Dataset]:
    """Labelled draws of the parameters of each test."""
    columns = fit.dataset(["parameter", "log_reference"])
    reference = problem.likelihood.reference
    found = {}
    tests = zip(problem.experiments, problem.by_effect(), strict=True)
    for e, (experiment, priors) in enumerate(tests):
        own = columns["parameter"].isel(parameter_dim_0=e, drop=True)
        values = {
            name: own.isel(parameter_dim_1=PLACE[name] - 1, drop=True) for name in priors.priors
        }
        logarithm = columns["log_reference"].isel(log_reference_dim_0=e, drop=True)
        draws = xr.Dataset({**values, reference.name: np.exp(logarithm)})
        parameters = (PARAMETER_BY_NAME[name] for name in priors.priors)
        label_draws(draws, (*parameters, reference), priors)
        found[experiment.id] = draws
    return found


def _all_draws(fit: Draws, problem: Problem, draws: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Draws of every sampled quantity, each once."""
    first = draws[problem.experiments[0].id]
    variables = {name: first[name] for name in problem.shared}
    own = [name for name in problem.free if name not in problem.shared]
    for e, of_test in enumerate(draws.values()):
        variables |= {
            own_name(name, problem.owner(name, e)): of_test[name]
            for name in (*own, problem.likelihood.reference.name)
            if problem.has_effect(name, e)
        }
    if problem.partial:
        pooled = fit.dataset(["pooled_centre", "pooled_spread"])
        for h, name in enumerate(problem.partial):
            for owner, unit in ((CENTRE, first[name].attrs["units"]), (SPREAD, "1")):
                column = f"pooled_{owner}"
                values = pooled[column].isel({f"{column}_dim_0": h}, drop=True)
                values.attrs = {**first[name].attrs, "units": unit}
                variables[own_name(name, owner)] = values
    return xr.Dataset(variables)


def driving_errors(fit: Draws, experiments: Sequence[Experiment]) -> xr.Dataset:
    """Return standardised errors of what drives tests: driving_error[K] or driving_error[ID, K]."""
    labels = [
        str(k) if len(experiments) == 1 else f"{experiment.id}, {k}"
        for experiment in experiments
        for k in range(1, experiment.n_driving_errors + 1)
    ]
    last = np.moveaxis(fit["coordinate"][..., -len(labels) :], -1, 0)
    named = {own_name("driving_error", label): one for label, one in zip(labels, last, strict=True)}
    return xr.Dataset({name: (("chain", "draw"), one) for name, one in named.items()})


def stats_with_solver(
    fit: Draws, checked: xr.Dataset, *, unit: Sequence[float], use_likelihood: bool
) -> xr.Dataset:
    """Return the sampler's columns, and log ratios of reference to sampled likelihood.

    The log density is that of the coordinates; CmdStan's is that of their numbers in units.
    """
    reference = checked["log_lik"].sum("log_lik_dim_0", skipna=False)
    stats = sample_stats(fit)
    stats["lp"] = stats["lp"] - np.sum(np.log(unit))
    stats["solver_log_ratio"] = (
        reference - _sampled_log_likelihood(fit, stats["lp"])
        if use_likelihood
        else xr.zeros_like(reference)  # the solver has no part in the prior
    )
    return stats


def reference_solution(
    model: Program,
    data: StanData,
    files: Sequence[Path],
    variables: Mapping[str, int],
    *,
    seed: int,
) -> xr.Dataset:
    """Return log likelihood and grid `variables` of draws at the reference tolerance, or NaN."""
    data = {**data, **solver_block(REFERENCE_SOLVER)}
    try:
        return model.generate(data, files, seed=seed).dataset(["log_lik", *variables])
    except Unsolved:
        logger.info("Some draws have no solution at the reference tolerance: looking for them.")
    coordinates = read_draws(files)["coordinate"]
    sizes = {**variables, "log_lik": data["point_end"][-1]}
    values = {n: np.full((*coordinates.shape[:2], size), np.nan) for n, size in sizes.items()}
    for chain, points in enumerate(coordinates):
        solved, drawn = model.generate_at(data, "coordinate", points, seed=seed)
        # The others stay NaN, which the solver check reports.
        for name in values if solved.any() else ():
            values[name][chain, solved] = drawn[name][0]
    return xr.Dataset(
        {name: (("chain", "draw", f"{name}_dim_0"), array) for name, array in values.items()}
    )


def _sampled_log_likelihood(fit: Draws, log_density: xr.DataArray) -> xr.DataArray:
    """Log likelihood that the chains have sampled, as their log density holds it.

    Not the sum of ``log_lik``: while sampling the solver also keeps its sensitivities to the
    tolerance, generated quantities have none, so the two solutions take different steps. Measured
    microstructure is left out: what the solver leaves off there is nothing beside its errors.
    """
    terms = fit.dataset(["lprior", "log_jacobian", "log_pooling"])
    other = terms.to_array().sum("variable", skipna=False)
    # By values: the labels of draws and chains differ between the two.
    others = other.to_numpy()
    if MICROSTRUCTURE_LOG_LIKELIHOOD in fit:
        others = others + fit[MICROSTRUCTURE_LOG_LIKELIHOOD].sum(axis=(2, 3))
    return log_density - others


def _solution_at_mean(
    draws: xr.Dataset, priors: PriorSet, experiment: Experiment
) -> dict[str, xr.Dataset]:
    """Group of the solution at the posterior mean of the parameters, as in the paper's Fig. 3.

    The mean is no draw: where parameters trade off along a curve it may have no solution.
    """
    mean = {name: float(draws[name].mean()) for name in priors.priors}
    try:
        curve = simulate(experiment, mean)
    except SamplingError as error:
        logger.info(f"The posterior mean of the parameters has no solution: {error}")
        return {}
    likelihood = likelihood_of(experiment)
    clock = likelihood.clock
    columns = {
        **{read.name: (read.column, read.si_unit) for read in likelihood.read},
        "grain_size": ("grain_size_m", "m"),
        "fabric_factor": ("fabric_factor", "1"),
    }
    solution = xr.Dataset(
        {
            name: (clock.name, curve[column].to_numpy(), {"units": unit})
            for name, (column, unit) in columns.items()
            if column in curve
        },
        coords={clock.name: curve[clock.column].to_numpy()},
    )
    return {"posterior_mean_solution": solution}
