"""Chain files -> labelled draws: names, symbols, SI units, coordinates.

The only module that knows ArviZ's versions. Draws are kept as an `xarray.DataTree` with ArviZ's
group names, which `arviz.from_netcdf` reads whatever its version.
"""

import json
import logging
import warnings
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from scipy.special import logsumexp

from pyburgers.cmdstan.draws import Draws, read_draws
from pyburgers.cmdstan.program import Program, load_program
from pyburgers.common.atomic_files import write_atomically
from pyburgers.common.errors import SamplingError
from pyburgers.model.parameters import PARAMETER_BY_NAME, REFERENCE_QUANTITIES, Parameter
from pyburgers.model.priors import PriorSet, load_priors
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.forward import REFERENCE_SOLVER, simulate
from pyburgers.protocols.protocol import Quantity
from pyburgers.protocols.registry import load_experiment, protocol_of
from pyburgers.protocols.stan_data import (
    StanData,
    solver_block,
    with_grid,
    with_later_additions,
)
from pyburgers.sampling.run_directory import RunDirectory

logger = logging.getLogger(__name__)

with warnings.catch_warnings():
    # ArviZ 0.23 announces its next major version at import, once a day.
    warnings.filterwarnings("ignore", "\\s*ArviZ is undergoing", FutureWarning)
    import arviz as az

# ArviZ 0.x has this function at the top; 1.x keeps it with the array statistics, where it takes log
# likelihoods of points to be left out, the log ratios with the other sign.
_ARVIZ_0 = hasattr(az, "psislw")
_psislw = az.psislw if _ARVIZ_0 else import_module("arviz_stats.base").array_stats.psislw
_RATIO_SIGN = 1.0 if _ARVIZ_0 else -1.0

FloatArray = npt.NDArray[np.float64]

SAMPLE_STATS = {
    "lp__": "lp",
    "accept_stat__": "acceptance_rate",
    "stepsize__": "step_size",
    "treedepth__": "tree_depth",
    "n_leapfrog__": "n_steps",
    "divergent__": "diverging",
    "energy__": "energy",
}
GIVEN_OTHERS = "log_lik_given_others"
"""Name in the program for constant rate; empty where residuals are independent."""

CORRELATED = "log_likelihood_given_others"
"""Group of their densities in labelled draws, which only correlated residuals have."""

OF_ALL_TESTS = "log_likelihood_of_all_tests"
"""Group of the log likelihood of the data of all tests, which only tests of a joint fit have."""

LEAST_SMOOTHED_DRAWS = 25
"""Importance weights of fewer draws are left as they are: their tail is less than five draws."""


def build_posterior(run: RunDirectory) -> xr.DataTree:
    """Gather the finished chains of a run into labelled draws and save them.

    Every kept draw is evaluated again at the reference tolerance of the solver, which gives the
    predictive bands and the log ratios for the solver check (Timonen et al. 2023, Stat 12,
    e614).

    Parameters
    ----------
    run : RunDirectory
        A run with at least one finished chain.

    Returns
    -------
    DataTree
        Groups posterior, sample_stats, log_likelihood (of each point given those before it),
        log_likelihood_given_others (where residuals are correlated; elsewhere the same),
        log_prior, posterior_predictive (at the observed points), predictions (on a grid of
        strains, or times of an oscillating test), posterior_mean_solution, observed_data,
        constant_data; dimensions chain, draw, point, and strain or time. Stresses of an
        oscillating test are without trend where its background is removed, save that of
        posterior_mean_solution.
    """
    experiment = load_experiment(run.experiment_file)
    protocol = protocol_of(experiment)
    priors = load_priors(run.priors_file)
    manifest = run.read_manifest()
    files = run.draws_files()
    data = json.loads(run.stan_data_file.read_text(encoding="utf-8"))
    data = with_grid(with_later_additions(data), experiment, protocol.prediction_grid(experiment))
    fit = read_draws(files)
    logger.info("Solving every draw again at the reference tolerance.")
    checked = reference_solution(
        load_program(protocol_of(experiment).program),
        data,
        files,
        list(protocol.grid_quantities),
        seed=manifest["sampler"]["seed"],
    )
    chains = {"chain": list(run.finished_chains())}
    quantities = (
        *(PARAMETER_BY_NAME[name] for name in priors.priors),
        protocol.reference,
    )
    draws = fit.dataset([quantity.name for quantity in quantities]).assign_coords(chains)
    label_draws(draws, quantities, priors)
    groups = groups_of_test(
        draws,
        drawn_at_points(fit, chains, protocol.response),
        stats_with_solver(fit, checked, chains, use_likelihood=manifest["use_likelihood"]),
        checked.assign_coords(chains),
        experiment,
        priors,
    )
    return keep_posterior(
        run, groups, experiment=experiment.id, data_kind=experiment.provenance.kind
    )


def drawn_at_points(fit: Draws, chains: Mapping[str, list[int]], response: Quantity) -> xr.Dataset:
    """Draws at the points of a program's data, and of its prior density.

    Parameters
    ----------
    fit : Draws
        Chains of a program for curves.
    chains : mapping
        Coordinate of the dimension chain.
    response : Quantity
        What was observed.

    Returns
    -------
    Dataset, dimensions chain, draw, point
        replicated responses, log_lik, `GIVEN_OTHERS` where residuals are correlated, and lprior.
    """
    names = [f"{response.name}_replicated", "log_lik"]
    if GIVEN_OTHERS in fit:
        names.append(GIVEN_OTHERS)
    columns = {name: fit.dataset([name])[name].rename({f"{name}_dim_0": "point"}) for name in names}
    lprior = fit.dataset(["lprior"])["lprior"]
    drawn = xr.Dataset({**columns, "lprior": lprior}).assign_coords(chains)
    return drawn.assign_coords(point=np.arange(drawn.sizes["point"]))


def stats_with_solver(
    fit: Draws,
    checked: xr.Dataset,
    chains: Mapping[str, list[int]],
    *,
    use_likelihood: bool,
) -> xr.Dataset:
    """Sampler's columns, and the log ratio of reference to sampled likelihood of every draw.

    Parameters
    ----------
    fit : Draws
        Chains of a program for curves.
    checked : Dataset
        From `reference_solution`.
    chains : mapping
        Coordinate of the dimension chain.
    use_likelihood : bool
        Whether the data took part.
    """
    reference = checked["log_lik"].sum("log_lik_dim_0", skipna=False).assign_coords(chains)
    stats = sample_stats(fit).assign_coords(chains)
    stats["solver_log_ratio"] = (
        reference - _sampled_log_likelihood(fit).assign_coords(chains)
        if use_likelihood
        else xr.zeros_like(reference)  # the solver has no part in the prior
    )
    return stats


def groups_of_test(
    draws: xr.Dataset,
    at_points: xr.Dataset,
    stats: xr.Dataset,
    checked: xr.Dataset,
    experiment: Experiment,
    priors: PriorSet,
) -> dict[str, xr.Dataset]:
    """Return the groups of `build_posterior` for one test.

    Parameters
    ----------
    draws : Dataset
        Labelled draws of its parameters.
    at_points : Dataset
        From `drawn_at_points`.
    stats : Dataset
        From `stats_with_solver`.
    checked : Dataset
        Its solutions on the prediction grid, from `reference_solution`.
    experiment, priors
        The test and its resolved priors.
    """
    return {
        "posterior": draws,
        "sample_stats": stats,
        **point_groups(at_points, [experiment]),
        "predictions": _predictions(checked, experiment),
        "posterior_mean_solution": _solution_at_mean(draws, priors, experiment),
        "constant_data": xr.Dataset(
            {
                name: ("point", values, {"units": unit})
                for name, (values, unit) in protocol_of(experiment)
                .observed_positions(experiment)
                .items()
            },
            {"point": np.arange(experiment.n_points)},
        ),
    }


def point_groups(at_points: xr.Dataset, experiments: Sequence[Experiment]) -> dict[str, xr.Dataset]:
    """Return the groups of what belongs to points, those of several tests one after the other.

    Parameters
    ----------
    at_points : Dataset
        From `drawn_at_points`, all points of the tests.
    experiments : sequence of Experiment
        The tests.
    """
    response = protocol_of(experiments[0]).response
    name = response.name
    observed = np.concatenate([experiment.response for experiment in experiments])
    points = {"point": np.arange(observed.size)}
    groups = {
        "log_likelihood": xr.Dataset({name: at_points["log_lik"]}),
        "log_prior": xr.Dataset({"lprior": at_points["lprior"]}),
        "posterior_predictive": xr.Dataset({name: at_points[f"{name}_replicated"]}),
        "observed_data": xr.Dataset(
            {name: ("point", observed, {"units": response.si_unit})}, points
        ),
    }
    if GIVEN_OTHERS in at_points:
        groups[CORRELATED] = xr.Dataset({name: at_points[GIVEN_OTHERS]})
    return groups


def response_in(posterior: xr.DataTree, group: str) -> xr.DataArray:
    """Return what a group with one variable, the response, holds by point."""
    (values,) = posterior[group].to_dataset().data_vars.values()
    return values


def pointwise_log_density(posterior: xr.DataTree) -> xr.DataArray:
    """Log density of each point given all others and the parameters, from labelled draws.

    What leave-one-out needs: of independent residuals the log likelihood of the point.

    Parameters
    ----------
    posterior : DataTree
        Labelled draws with the group log_likelihood, one variable.

    Returns
    -------
    DataArray, dimensions chain, draw, point
    """
    return response_in(
        posterior, CORRELATED if CORRELATED in posterior.children else "log_likelihood"
    )


def total_log_likelihood(posterior: xr.DataTree) -> xr.DataArray:
    """Log likelihood of all data that took part: in a test of a joint fit those of all tests.

    Parameters
    ----------
    posterior : DataTree
        Labelled draws with the group log_likelihood, one variable.

    Returns
    -------
    DataArray, dimensions chain, draw
    """
    if OF_ALL_TESTS in posterior.children:
        return posterior[OF_ALL_TESTS].to_dataset()["total"]
    return response_in(posterior, "log_likelihood").sum("point")


def keep_posterior(
    run: RunDirectory, groups: Mapping[str, xr.Dataset], *, experiment: str, data_kind: str
) -> xr.DataTree:
    """Save groups of draws as the posterior of a run.

    Parameters
    ----------
    run : RunDirectory
        A run with finished chains, which the draws are of.
    groups : mapping of str to Dataset
        By ArviZ's names.
    experiment, data_kind : str
        Name of the experiment or table, and the kind of its provenance.

    Returns
    -------
    DataTree
        What was saved.
    """
    tree: xr.DataTree = xr.DataTree.from_dict(
        {name: dataset.drop_attrs(deep=False) for name, dataset in groups.items()}
    )
    tree.attrs = {
        "experiment": experiment,
        "data_kind": data_kind,
        "fingerprint": run.read_manifest()["fingerprint"],
        "chains": json.dumps(list(run.finished_chains())),
    }
    write_atomically(run.posterior_file, lambda path: tree.to_netcdf(path, engine="h5netcdf"))
    return tree


def load_posterior(run: RunDirectory) -> xr.DataTree | None:
    """Labelled draws of a run, or None where they do not cover all finished chains yet."""
    if not run.posterior_file.is_file():
        return None
    with xr.open_datatree(run.posterior_file, engine="h5netcdf") as opened:
        tree = opened.load()
    if json.loads(tree.attrs["chains"]) != list(run.finished_chains()):
        return None
    return tree


def reference_solution(
    model: Program,
    data: StanData,
    files: Sequence[Path],
    variables: Sequence[str],
    *,
    seed: int,
) -> xr.Dataset:
    """Log likelihood and grid of solutions of every draw at the reference tolerance.

    A draw that has no solution there has NaN.

    Parameters
    ----------
    model : Program
        The program.
    data : dict
        Its data, with the grid.
    files : sequence of Path
        Its chains.
    variables : sequence of str
        Generated quantities on the grid.
    seed : int
        Of replicated data.
    """
    data = {**data, **solver_block(REFERENCE_SOLVER)}
    try:
        return model.generate(data, files, seed=seed).dataset(["log_lik", *variables])
    except SamplingError:
        # One draw without solution is enough for that, and CmdStan does not say which.
        logger.info("Some draws have no solution at the reference tolerance: solving one by one.")
        return _one_by_one(model, data, read_draws(files), variables)


def _one_by_one(
    model: Program,
    data: StanData,
    fit: Draws,
    variables: Sequence[str],
) -> xr.Dataset:
    """As `generate_quantities`, slower, with NaN where a draw has no solution."""
    coordinates = fit["coordinate"]
    shape = coordinates.shape[:2]
    n_grid = data["n_grid"] + sum(data.get("n_further_grid", []))
    n_points = data["n_points"] + sum(data.get("n_further_points", []))
    sizes = dict.fromkeys(variables, n_grid) | {"log_lik": n_points}
    values = {name: np.full((*shape, size), np.nan) for name, size in sizes.items()}
    for number, index in enumerate(np.ndindex(*shape)):
        position = {"coordinate": coordinates[index].tolist()}
        try:
            solved = model.evaluate(data, position, seed=number)
        except SamplingError:
            continue  # stays NaN, which the solver check reports
        for name, array in values.items():
            array[index] = solved[name]
    return xr.Dataset(
        {name: (("chain", "draw", f"{name}_dim_0"), array) for name, array in values.items()}
    )


def _sampled_log_likelihood(fit: Draws) -> xr.DataArray:
    """Log likelihood that the chains have sampled, as their log density holds it.

    Not the sum of ``log_lik``: while sampling the solver also keeps its sensitivities to the
    tolerance, generated quantities have none, so the two solutions take different steps.
    """
    log_density = sample_stats(fit)["lp"]
    terms = ["lprior", "log_jacobian"]
    if "log_pooling" in fit:  # the program for constant rate
        terms.append("log_pooling")
    other = fit.dataset(terms).to_array().sum("variable", skipna=False)
    # By values: the labels of draws and chains differ between the two.
    return log_density - other.to_numpy()


def sample_stats(fit: Draws) -> xr.Dataset:
    """ArviZ's names for the sampler's columns."""
    dataset = xr.Dataset(
        {name: (("chain", "draw"), fit[key]) for key, name in SAMPLE_STATS.items()}
    )
    dataset["diverging"] = dataset["diverging"].astype(bool)
    return dataset.assign_coords(draw=np.arange(dataset.sizes["draw"]))


def label_draws(draws: xr.Dataset, quantities: Iterable[Parameter], priors: PriorSet) -> None:
    """Attach symbols, units and whether a parameter was fixed to the draws of quantities."""
    for quantity in quantities:
        fixed = quantity.name in priors.priors and priors[quantity.name].is_fixed
        draws[quantity.name].attrs = {
            "long_name": quantity.label,
            "symbol": quantity.symbol,
            "units": quantity.si_unit,
            "fixed": int(fixed),
        }


def _predictions(checked: xr.Dataset, experiment: Experiment) -> xr.Dataset:
    """Grid of solutions with the clock as coordinate."""
    protocol = protocol_of(experiment)
    clock = protocol.clock.name
    variables = {}
    for column, (name, unit) in protocol.grid_quantities.items():
        values = checked[column].rename({f"{column}_dim_0": clock})
        values.attrs = {"units": unit}
        variables[name] = values.astype(np.float32)  # drawn, not computed with
    return xr.Dataset(variables).assign_coords({clock: protocol.prediction_grid(experiment)})


def _solution_at_mean(draws: xr.Dataset, priors: PriorSet, experiment: Experiment) -> xr.Dataset:
    """Solution at the posterior mean of the parameters, as drawn in the paper's Fig. 3."""
    mean = {name: float(draws[name].mean()) for name in priors.priors}
    protocol, curve = protocol_of(experiment), simulate(experiment, mean)
    clock, response = protocol.clock, protocol.response
    columns = {
        response.name: (response.column, response.si_unit),
        "grain_size": ("grain_size_m", "m"),
        "fabric_factor": ("fabric_factor", "1"),
    }
    return xr.Dataset(
        {
            name: (clock.name, curve[column].to_numpy(), {"units": unit})
            for name, (column, unit) in columns.items()
        },
        coords={clock.name: curve[clock.column].to_numpy()},
    )


def free_parameters(posterior: xr.DataTree) -> list[str]:
    """Names of the sampled quantities: free parameters, and the reference stress."""
    dataset = posterior["posterior"].to_dataset()
    return [str(name) for name in dataset.data_vars if not dataset[name].attrs["fixed"]]


def convergence_table(posterior: xr.DataTree) -> pd.DataFrame:
    """R-hat and effective sample sizes, a row for each sampled quantity.

    Returns
    -------
    DataFrame
        Index parameter; columns rhat (NaN of a single chain), ess_bulk, ess_tail (Vehtari et al.
        2021, rank-normalised).
    """
    draws = posterior["posterior"].to_dataset()[free_parameters(posterior)]
    alone = draws.sizes["chain"] == 1
    with np.errstate(invalid="ignore", divide="ignore"):  # draws that never moved
        columns = {
            "rhat": dict.fromkeys(draws, np.nan) if alone else az.rhat(draws),
            "ess_bulk": az.ess(draws, method="bulk"),
            "ess_tail": az.ess(draws, method="tail", prob=0.9),
        }
    return pd.DataFrame(
        {name: {key: float(value[key]) for key in draws} for name, value in columns.items()}
    ).rename_axis("parameter")


def draws_table(posterior: xr.DataTree) -> pd.DataFrame:
    """Table of the sampled quantities in SI units.

    Returns
    -------
    DataFrame
        Index parameter; columns unit, mean, sd, q5, q95, ess_bulk, ess_tail, rhat.
    """
    draws = posterior["posterior"].to_dataset()[free_parameters(posterior)]
    rows = {
        str(name): {
            "unit": values.attrs["units"],
            "mean": float(values.mean()),
            "sd": float(values.std(ddof=1)),
            "q5": float(values.quantile(0.05)),
            "q95": float(values.quantile(0.95)),
        }
        for name, values in draws.data_vars.items()
    }
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")
    joined = table.join(convergence_table(posterior))
    return joined[["unit", "mean", "sd", "q5", "q95", "ess_bulk", "ess_tail", "rhat"]]


def summary_table(posterior: xr.DataTree, priors: PriorSet) -> pd.DataFrame:
    """Posterior table in SI units with the prior beside it.

    Returns
    -------
    DataFrame
        Columns of `draws_table`, then prior, prior_mean, prior_sd, prior_q5, prior_q95. The
        reference stress or flow rate has none: NaN there.
    """
    table = draws_table(posterior)
    rows: dict[str, dict[str, Any]] = {}
    for name in table.index:
        if name in REFERENCE_QUANTITIES:
            continue
        prior = priors[name]
        law = prior.distribution()
        rows[name] = {
            "prior": prior.family,
            "prior_mean": float(law.mean()),
            "prior_sd": float(law.std()),
            "prior_q5": float(law.ppf(0.05)),
            "prior_q95": float(law.ppf(0.95)),
        }
    return table.join(pd.DataFrame.from_dict(rows, orient="index"))


def grain_size_share(posterior: xr.DataTree) -> xr.DataArray:
    """Share of the softening beyond the stress peak that grain size does; fabric does the rest.

    Tells the two arms of the valley in the critical strains apart (`docs/coordinates.md`).

    Parameters
    ----------
    posterior : DataTree
        Labelled draws.

    Returns
    -------
    DataArray, dimensions chain and draw
        ln of the strength lost to grain size between peak and end over ln of all that is lost.
    """
    predictions = posterior["predictions"].to_dataset()
    peak = predictions["stress"].argmax("strain")
    lost = {
        name: np.log(predictions[name].isel(strain=peak) / predictions[name].isel(strain=-1))
        for name in ("grain_size_softening", "fabric_softening")
    }
    share: xr.DataArray = lost["grain_size_softening"] / (
        lost["grain_size_softening"] + lost["fabric_softening"]
    )
    return share


def smooth_weights(
    log_ratios: FloatArray, *, relative_efficiency: float = 1.0
) -> tuple[FloatArray, float]:
    """Pareto smoothed importance weights (PSIS; Vehtari et al. 2024, JMLR 25(72)).

    Parameters
    ----------
    log_ratios : array, shape (n,)
        Log ratios of target to proposal density.
    relative_efficiency : float
        Effective over nominal number of draws; sets how many of them count as the tail.

    Returns
    -------
    log_weights : array, shape (n,)
        Logarithms of weights that add up to 1.
    pareto_k : float
        Shape of the generalised Pareto tail of the ratios; minus infinity where they are all the
        same, infinity where they are too few to have a tail.
    """
    ratios = log_ratios.ravel()
    if np.ptp(ratios) < 1e-12:
        return np.full(ratios.size, -np.log(ratios.size)), -np.inf
    if ratios.size < LEAST_SMOOTHED_DRAWS:
        return ratios - logsumexp(ratios), np.inf
    smoothed, shape = _psislw(_RATIO_SIGN * ratios, relative_efficiency)
    log_weights: FloatArray = np.asarray(smoothed) - logsumexp(smoothed)
    return log_weights, float(shape)


def pareto_k(log_ratios: FloatArray) -> float:
    """Shape of the generalised Pareto tail of importance ratios (`smooth_weights`)."""
    return smooth_weights(log_ratios)[1]


def relative_efficiency(values: xr.DataArray) -> FloatArray:
    """Effective over nominal number of draws of the mean of what was drawn.

    Parameters
    ----------
    values : DataArray, dimensions chain, draw and one more
        Draws.

    Returns
    -------
    array, shape (n,)
        Along the other dimension; 1 where the draws never vary.
    """
    with np.errstate(invalid="ignore", divide="ignore"):  # draws that never moved
        found = az.ess(xr.Dataset({"values": values}), method="mean")
    n_draws = values.sizes["chain"] * values.sizes["draw"]
    efficiency: FloatArray = np.nan_to_num(found["values"].to_numpy() / n_draws, nan=1.0)
    return efficiency
