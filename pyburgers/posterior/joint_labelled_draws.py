"""Chain files of a joint fit -> labelled draws: of each test, and of all quantities together."""

import json
import logging
from collections.abc import Mapping

import numpy as np
import xarray as xr

from pyburgers.cmdstan.draws import Draws, read_draws
from pyburgers.cmdstan.program import load_program
from pyburgers.model.parameters import (
    PARAMETER_BY_NAME,
    PROGRAM_PARAMETERS,
    REFERENCE_STRESS_QUANTITY,
)
from pyburgers.posterior.labelled_draws import (
    OF_ALL_TESTS,
    drawn_at_points,
    groups_of_test,
    keep_posterior,
    label_draws,
    point_groups,
    reference_solution,
    stats_with_solver,
)
from pyburgers.protocols.constant_rate.protocol import CONSTANT_RATE
from pyburgers.sampling.joint_stan_data import CENTRE, SPREAD, with_joint_grid
from pyburgers.sampling.problem import JointProblem
from pyburgers.sampling.run_directory import RunDirectory

logger = logging.getLogger(__name__)

TESTS = "tests"
"""Group that holds the groups of every test."""


def own_name(quantity: str, owner: str) -> str:
    """Name of a quantity of one test, or of a centre or spread, among those of a joint fit."""
    return f"{quantity}[{owner}]"


def build_joint_posterior(run: RunDirectory, problem: JointProblem) -> xr.DataTree:
    """Gather the finished chains of a joint run into labelled draws and save them.

    Parameters
    ----------
    run : RunDirectory
        A run with at least one finished chain.
    problem : JointProblem
        What was fitted.

    Returns
    -------
    DataTree
        Groups posterior (shared parameters by their names, others as NAME[TEST], NAME[centre] and
        NAME[spread]), sample_stats, log_likelihood, log_prior, posterior_predictive and
        observed_data of all tests together, one after the other; and in tests/ID those of
        `pyburgers.posterior.labelled_draws.build_posterior` for each, and `OF_ALL_TESTS`.
    """
    manifest = run.read_manifest()
    experiments = problem.experiments
    files = run.draws_files()
    chains = {"chain": list(run.finished_chains())}
    grids = [CONSTANT_RATE.prediction_grid(experiment) for experiment in experiments]
    data = json.loads(run.stan_data_file.read_text(encoding="utf-8"))
    fit = read_draws(files)
    logger.info("Solving every draw again at the reference tolerance.")
    checked = reference_solution(
        load_program(CONSTANT_RATE.program),
        with_joint_grid(data, experiments, grids),
        files,
        list(CONSTANT_RATE.grid_quantities),
        seed=manifest["sampler"]["seed"],
    ).assign_coords(chains)
    stats = stats_with_solver(fit, checked, chains, use_likelihood=manifest["use_likelihood"])
    at_points = drawn_at_points(fit, chains, CONSTANT_RATE.response)
    draws = _draws_of_tests(fit, problem, chains)
    groups: dict[str, xr.Dataset] = {
        "posterior": _all_draws(fit, problem, draws, chains),
        "sample_stats": stats,
        **point_groups(at_points, experiments),
    }
    total = xr.Dataset({"total": at_points["log_lik"].sum("point", skipna=False)})
    ends = np.cumsum([0, *(experiment.n_points for experiment in experiments)])
    grid_ends = np.cumsum([0, *(grid.size for grid in grids)])
    for e, (experiment, priors) in enumerate(zip(experiments, problem.priors, strict=True)):
        points = at_points.isel(point=slice(ends[e], ends[e + 1]))
        on_grid = slice(grid_ends[e], grid_ends[e + 1])
        of_test = groups_of_test(
            draws[experiment.id],
            points.assign_coords(point=np.arange(experiment.n_points)),
            stats,
            checked.isel({f"{name}_dim_0": on_grid for name in CONSTANT_RATE.grid_quantities}),
            experiment,
            priors,
        )
        of_test[OF_ALL_TESTS] = total
        groups |= {f"{TESTS}/{experiment.id}/{name}": group for name, group in of_test.items()}
    return keep_posterior(run, groups, experiment=problem.name, data_kind=problem.data_kind)


def _draws_of_tests(
    fit: Draws, problem: JointProblem, chains: Mapping[str, list[int]]
) -> dict[str, xr.Dataset]:
    """Labelled draws of the parameters of each test, as a fit of it alone has them."""
    columns = fit.dataset(["parameter", "log_stress"]).assign_coords(chains)
    places = {p.name: k for k, p in enumerate(PROGRAM_PARAMETERS)}
    found = {}
    for e, (experiment, priors) in enumerate(zip(problem.experiments, problem.priors, strict=True)):
        own = columns["parameter"].isel(parameter_dim_0=e)
        values = {name: own.isel(parameter_dim_1=places[name]) for name in priors.priors}
        stress = np.exp(columns["log_stress"].isel(log_stress_dim_0=e))
        draws = xr.Dataset({**values, REFERENCE_STRESS_QUANTITY.name: stress}).drop_vars(
            ["parameter_dim_0", "parameter_dim_1", "log_stress_dim_0"], errors="ignore"
        )
        parameters = (PARAMETER_BY_NAME[name] for name in priors.priors)
        label_draws(draws, (*parameters, REFERENCE_STRESS_QUANTITY), priors)
        found[experiment.id] = draws
    return found


def _all_draws(
    fit: Draws,
    problem: JointProblem,
    draws: Mapping[str, xr.Dataset],
    chains: Mapping[str, list[int]],
) -> xr.Dataset:
    """Draws of every sampled quantity, each once."""
    first = draws[problem.experiments[0].id]
    variables = {name: first[name] for name in problem.shared}
    own = [name for name in problem.free if name not in problem.shared]
    for test, of_test in draws.items():
        variables |= {
            own_name(name, test): of_test[name] for name in (*own, REFERENCE_STRESS_QUANTITY.name)
        }
    if problem.partial:
        pooled = fit.dataset(["pooled_centre", "pooled_spread"]).assign_coords(chains)
        for h, name in enumerate(problem.partial):
            for owner, unit in ((CENTRE, first[name].attrs["units"]), (SPREAD, "1")):
                column = f"pooled_{owner}"
                values = pooled[column].isel({f"{column}_dim_0": h}, drop=True)
                values.attrs = {**first[name].attrs, "units": unit}
                variables[own_name(name, owner)] = values
    return xr.Dataset(variables)
