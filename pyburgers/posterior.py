"""Chain files -> labelled draws: names, symbols, SI units, coordinates.

The only module that knows ArviZ's versions. Draws are kept as an `xarray.DataTree` with ArviZ's
group names, which `arviz.from_netcdf` reads whatever its version.
"""

import json
import tempfile
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import cmdstanpy
import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from scipy.special import logsumexp

from pyburgers.cmdstan import load_model
from pyburgers.constant_rate import ConstantRateExperiment
from pyburgers.errors import SamplingError
from pyburgers.experiment import Experiment
from pyburgers.experiment_files import load_experiment
from pyburgers.forced_oscillation import OscillationExperiment
from pyburgers.parameters import PARAMETER_BY_NAME, REFERENCE_QUANTITIES, Parameter
from pyburgers.priors import PriorSet, load_priors
from pyburgers.run_directory import RunDirectory, write_atomically
from pyburgers.simulation import (
    REFERENCE_SOLVER,
    evaluate,
    program_for,
    quiet_cmdstanpy,
    simulate,
    strain_grid,
    time_grid,
)
from pyburgers.stan_data import (
    StanData,
    reference_quantity,
    solver_block,
    with_grid,
    with_later_additions,
)

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
STRAIN_VARIABLES = {
    "grid_stress": ("stress", "Pa"),
    "grid_stress_replicated": ("stress_replicated", "Pa"),
    "grid_kelvin_strain": ("kelvin_strain", "1"),
    "grid_grain_size": ("grain_size", "m"),
    "grid_fabric_factor": ("fabric_factor", "1"),
    "grid_grain_size_softening": ("grain_size_softening", "1"),
    "grid_fabric_softening": ("fabric_softening", "1"),
}
TIME_VARIABLES = {
    "grid_oscillating_stress": ("stress", "Pa"),
    "grid_stress_replicated": ("stress_replicated", "Pa"),
    "grid_kelvin_strain": ("kelvin_strain", "1"),
    "grid_grain_size": ("grain_size", "m"),
    "grid_dashpot_rate": ("dashpot_rate", "1/s"),
}
"""Generated quantities along strain, or time in oscillating tests: name and unit in the draws."""

GIVEN_OTHERS = "log_lik_given_others"
"""Name in the program for constant rate; empty where residuals are independent."""

CORRELATED = "log_likelihood_given_others"
"""Group of their densities in labelled draws, which only correlated residuals have."""

PREDICTIONS_PER_CYCLE = 30

LEAST_SMOOTHED_DRAWS = 25
"""Importance weights of fewer draws are left as they are: their tail is less than five draws."""


def prediction_grid(experiment: Experiment) -> FloatArray:
    """Strains, or times (s) of an oscillating test, of the predictive bands, shape (n,).

    Strains are denser at each segment's start.
    """
    if isinstance(experiment, OscillationExperiment):
        return time_grid(experiment, PREDICTIONS_PER_CYCLE)
    assert isinstance(experiment, ConstantRateExperiment)  # the only other protocol
    shape = np.union1d(np.geomspace(2e-3, 1.0, 30), np.linspace(0.0, 1.0, 31)[1:])
    return strain_grid(experiment, shape)


def grid_variables(experiment: Experiment) -> tuple[str, dict[str, tuple[str, str]]]:
    """Return the dimension of the predictions, and what they hold: see `STRAIN_VARIABLES`."""
    if isinstance(experiment, OscillationExperiment):
        return "time", TIME_VARIABLES
    return "strain", STRAIN_VARIABLES


def build_posterior(run: RunDirectory, *, report: Callable[[str], None]) -> xr.DataTree:
    """Gather the finished chains of a run into labelled draws and save them.

    Every kept draw is evaluated again at the reference tolerance of the solver, which gives the
    predictive bands and the log ratios for the solver check (Timonen et al. 2023, Stat 12,
    e614).

    Parameters
    ----------
    run : RunDirectory
        A run with at least one finished chain.
    report : callable
        Receives progress sentences.

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
    priors = load_priors(run.priors_file)
    manifest = run.read_manifest()
    files = [str(run.draws_file(chain)) for chain in run.finished_chains()]
    with quiet_cmdstanpy():
        fit = read_chains(files)
        report("Solving every draw again at the reference tolerance.")
        checked = _reference_solution(
            run, files, experiment, seed=manifest["sampler"]["seed"], report=report
        )
    chains = {"chain": list(run.finished_chains())}
    quantities = (
        *(PARAMETER_BY_NAME[name] for name in priors.priors),
        reference_quantity(experiment),
    )
    draws = fit.draws_xr([quantity.name for quantity in quantities]).assign_coords(chains)
    label_draws(draws, quantities, priors)
    at_points = (
        fit.draws_xr(["stress_replicated", "log_lik", "lprior"])
        .rename({"stress_replicated_dim_0": "point", "log_lik_dim_0": "log_lik_point"})
        .assign_coords(chains)
    )
    log_lik = at_points["log_lik"].rename({"log_lik_point": "point"})
    points = {"point": np.arange(experiment.n_points)}
    reference_log_lik = checked["log_lik"].sum("log_lik_dim_0", skipna=False).assign_coords(chains)
    stats = sample_stats(fit).assign_coords(chains)
    stats["solver_log_ratio"] = (
        reference_log_lik - _sampled_log_likelihood(fit).assign_coords(chains)
        if manifest["use_likelihood"]
        else xr.zeros_like(reference_log_lik)  # the solver has no part in the prior
    )
    groups = {
        "posterior": draws,
        "sample_stats": stats,
        "log_likelihood": xr.Dataset({"stress": log_lik}).assign_coords(points),
        **_given_others(fit, chains),
        "log_prior": xr.Dataset({"lprior": at_points["lprior"]}),
        "posterior_predictive": xr.Dataset(
            {"stress": at_points["stress_replicated"]}
        ).assign_coords(points),
        "predictions": _predictions(checked, experiment).assign_coords(chains),
        "posterior_mean_solution": _solution_at_mean(draws, priors, experiment, report),
        "observed_data": xr.Dataset({"stress": ("point", experiment.stress, {"units": "Pa"})}),
        "constant_data": _positions(experiment),
    }
    for dataset in groups.values():
        if "point" in dataset.dims and "point" not in dataset.coords:
            dataset.coords["point"] = np.arange(dataset.sizes["point"])
    return keep_posterior(
        run, groups, experiment=experiment.id, data_kind=experiment.provenance.kind
    )


def _given_others(
    fit: cmdstanpy.CmdStanMCMC, chains: Mapping[str, list[int]]
) -> dict[str, xr.Dataset]:
    """Group of the log densities of single points given all others, where residuals correlate."""
    if not has_correlated_residuals(fit.column_names):
        return {}
    densities = fit.draws_xr([GIVEN_OTHERS])[GIVEN_OTHERS]
    return {
        CORRELATED: xr.Dataset(
            {"stress": densities.rename({f"{GIVEN_OTHERS}_dim_0": "point"})}
        ).assign_coords(chains)
    }


def has_correlated_residuals(columns: Sequence[str]) -> bool:
    """Whether a program's columns hold log densities of points given all others."""
    return f"{GIVEN_OTHERS}[1]" in columns


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
    densities = posterior[CORRELATED if CORRELATED in posterior.children else "log_likelihood"]
    (pointwise,) = densities.to_dataset().data_vars.values()
    return pointwise


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


def read_chains(files: Sequence[str]) -> cmdstanpy.CmdStanMCMC:
    """Read the draws of chains from CmdStan's files."""
    fit = cmdstanpy.from_csv(list(files), method="sample")
    assert isinstance(fit, cmdstanpy.CmdStanMCMC)  # what from_csv gives for this method
    return fit


def _reference_solution(
    run: RunDirectory,
    files: Sequence[str],
    experiment: Experiment,
    *,
    seed: int,
    report: Callable[[str], None],
) -> xr.Dataset:
    """Log likelihood and grid of solutions of every draw at the reference tolerance.

    A draw that has no solution there has NaN.
    """
    data = {
        **with_later_additions(json.loads(run.stan_data_file.read_text(encoding="utf-8"))),
        **solver_block(REFERENCE_SOLVER),
    }
    data = with_grid(data, experiment, prediction_grid(experiment))
    _, variables = grid_variables(experiment)
    model = load_model(program_for(experiment), report=report)
    with tempfile.TemporaryDirectory() as folder:
        data_file = Path(folder) / "data.json"
        data_file.write_text(json.dumps(data), encoding="utf-8")
        try:
            quantities = model.generate_quantities(
                data=str(data_file), previous_fit=list(files), seed=seed, gq_output_dir=folder
            )
            solution: xr.Dataset = quantities.draws_xr(["log_lik", *variables]).load()
        except RuntimeError:
            # One draw without solution is enough for that, and CmdStan does not say which.
            report("Some draws have no solution at the reference tolerance: solving one by one.")
            return _one_by_one(model, data, read_chains(files), list(variables))
    return solution


def _one_by_one(
    model: cmdstanpy.CmdStanModel,
    data: StanData,
    fit: cmdstanpy.CmdStanMCMC,
    variables: Sequence[str],
) -> xr.Dataset:
    """As `generate_quantities`, slower, with NaN where a draw has no solution."""
    coordinates = fit.draws_xr(["coordinate"])["coordinate"].to_numpy()
    shape = coordinates.shape[:2]
    sizes = dict.fromkeys(variables, data["n_grid"]) | {"log_lik": data["n_points"]}
    values = {name: np.full((*shape, size), np.nan) for name, size in sizes.items()}
    for number, index in enumerate(np.ndindex(*shape)):
        position = {"coordinate": coordinates[index].tolist()}
        try:
            solved = evaluate(model, data, position, seed=number)
        except SamplingError:
            continue  # stays NaN, which the solver check reports
        for name, array in values.items():
            array[index] = solved[name]
    return xr.Dataset(
        {name: (("chain", "draw", f"{name}_dim_0"), array) for name, array in values.items()}
    )


def _sampled_log_likelihood(fit: cmdstanpy.CmdStanMCMC) -> xr.DataArray:
    """Log likelihood that the chains have sampled, as their log density holds it.

    Not the sum of ``log_lik``: while sampling the solver also keeps its sensitivities to the
    tolerance, generated quantities have none, so the two solutions take different steps.
    """
    log_density = sample_stats(fit)["lp"]
    other = fit.draws_xr(["lprior", "log_jacobian"])
    # By values: the labels of draws and chains differ between the two.
    return log_density - (other["lprior"] + other["log_jacobian"]).to_numpy()


def sample_stats(fit: cmdstanpy.CmdStanMCMC) -> xr.Dataset:
    """ArviZ's names for the sampler's columns."""
    columns: dict[str, Any] = fit.method_variables()
    dataset = xr.Dataset(
        {name: (("draw", "chain"), columns[key]) for key, name in SAMPLE_STATS.items()}
    ).transpose("chain", "draw")
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


def _positions(experiment: Experiment) -> xr.Dataset:
    """Where along the test stress was observed."""
    if isinstance(experiment, OscillationExperiment):
        time = experiment.prepared.time
        strain = experiment.prepared.strain(time)
    else:
        assert isinstance(experiment, ConstantRateExperiment)  # the only other protocol
        strain = experiment.strain
        time = experiment.time_at(strain)
    return xr.Dataset(
        {
            "strain": ("point", strain, {"units": "1"}),
            "time": ("point", time, {"units": "s"}),
        }
    )


def _predictions(checked: xr.Dataset, experiment: Experiment) -> xr.Dataset:
    """Grid of solutions with strain or time as coordinate."""
    dimension, names = grid_variables(experiment)
    variables = {}
    for column, (name, unit) in names.items():
        values = checked[column].rename({f"{column}_dim_0": dimension})
        values.attrs = {"units": unit}
        variables[name] = values.astype(np.float32)  # drawn, not computed with
    return xr.Dataset(variables).assign_coords({dimension: prediction_grid(experiment)})


def _solution_at_mean(
    draws: xr.Dataset,
    priors: PriorSet,
    experiment: Experiment,
    report: Callable[[str], None],
) -> xr.Dataset:
    """Solution at the posterior mean of the parameters, as drawn in the paper's Fig. 3."""
    mean = {name: float(draws[name].mean()) for name in priors.priors}
    curve = simulate(experiment, mean, report=report)
    dimension, _ = grid_variables(experiment)
    column = {"strain": "strain", "time": "time_s"}[dimension]
    return xr.Dataset(
        {
            "stress": (dimension, curve["stress_Pa"].to_numpy(), {"units": "Pa"}),
            "grain_size": (dimension, curve["grain_size_m"].to_numpy(), {"units": "m"}),
            "fabric_factor": (dimension, curve["fabric_factor"].to_numpy(), {"units": "1"}),
        },
        coords={dimension: curve[column].to_numpy()},
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
        Index parameter; columns rhat, ess_bulk, ess_tail (Vehtari et al. 2021, rank-normalised).
    """
    draws = posterior["posterior"].to_dataset()[free_parameters(posterior)]
    with np.errstate(invalid="ignore", divide="ignore"):  # draws that never moved
        columns = {
            "rhat": az.rhat(draws),
            "ess_bulk": az.ess(draws, method="bulk"),
            "ess_tail": az.ess(draws, method="tail", prob=0.9),
        }
    return pd.DataFrame(
        {name: {key: float(value[key]) for key in draws} for name, value in columns.items()}
    ).rename_axis("parameter")


def summary_table(posterior: xr.DataTree, priors: PriorSet) -> pd.DataFrame:
    """Posterior table in SI units with the prior beside it.

    Returns
    -------
    DataFrame
        Index parameter; columns unit, mean, sd, q5, q95, ess_bulk, ess_tail, rhat, prior,
        prior_mean, prior_sd, prior_q5, prior_q95. The reference stress or flow rate has none:
        NaN there.
    """
    draws = posterior["posterior"].to_dataset()[free_parameters(posterior)]
    rows = {}
    for name, values in draws.data_vars.items():
        row: dict[str, Any] = {
            "unit": values.attrs["units"],
            "mean": float(values.mean()),
            "sd": float(values.std(ddof=1)),
            "q5": float(values.quantile(0.05)),
            "q95": float(values.quantile(0.95)),
        }
        if name not in REFERENCE_QUANTITIES:
            prior = priors[str(name)]
            law = prior.distribution()
            row |= {
                "prior": prior.family,
                "prior_mean": float(law.mean()),
                "prior_sd": float(law.std()),
                "prior_q5": float(law.ppf(0.05)),
                "prior_q95": float(law.ppf(0.95)),
            }
        rows[str(name)] = row
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")
    joined = table.join(convergence_table(posterior))
    order = ["unit", "mean", "sd", "q5", "q95", "ess_bulk", "ess_tail", "rhat"]
    return joined[order + [column for column in table if column not in order]]


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
