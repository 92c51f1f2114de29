"""Chain files -> labelled draws: names, symbols, SI units, coordinates.

The only module that knows ArviZ's versions. Draws are kept as an `xarray.DataTree` with ArviZ's
group names, which `arviz.from_netcdf` reads whatever its version.
"""

import logging
import warnings
from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.special import logsumexp

from pyburgers.cmdstan.draw_files import Draws
from pyburgers.common.array_types import BoolArray
from pyburgers.common.draws import TAIL, FloatArray
from pyburgers.model.display import shown_quantity, unit_text
from pyburgers.model.parameters import Parameter
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import PriorSet
from pyburgers.model.reference_quantities import REFERENCE_QUANTITIES

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


SAMPLE_STATS = {
    "lp__": "lp",
    "accept_stat__": "acceptance_rate",
    "stepsize__": "step_size",
    "treedepth__": "tree_depth",
    "n_leapfrog__": "n_steps",
    "divergent__": "diverging",
    "energy__": "energy",
}
CORRELATED = "log_likelihood_given_others"
"""Group of their densities in labelled draws, which only correlated residuals have."""

DRIVING_ERRORS = "driving_errors"
"""Group of the errors of what drives the tests, which only tests have where these are sampled."""

MICROSTRUCTURE = "microstructure"
"""Group of what is measured of it and of draws of that, which only such tests have."""

TESTS = "tests"
"""Group that holds the groups of every test of a joint fit."""

LEAST_SMOOTHED_DRAWS = 25
"""Importance weights of fewer draws are left as they are: their tail is less than five draws."""


def own_name(quantity: str, owner: str) -> str:
    """Name of a quantity of one test, or of a centre or spread, among those of a joint fit."""
    return f"{quantity}[{owner}]"


def response_in(posterior: xr.DataTree, group: str) -> xr.DataArray:
    """Return what a group with one variable, the response, holds by point."""
    (values,) = posterior[group].to_dataset().data_vars.values()
    return values


def told_readings(posterior: xr.DataTree) -> BoolArray:
    """Return which readings of a test are values, shape (n,); others are upper limits."""
    along, n = posterior["constant_data"].to_dataset(), posterior["observed_data"].sizes["point"]
    return along["is_limit"].to_numpy() == 0 if "is_limit" in along else np.full(n, True)


def pointwise_log_density(posterior: xr.DataTree) -> xr.DataArray:
    """Return the log density of each point given all others: its log likelihood if independent."""
    return response_in(
        posterior, CORRELATED if CORRELATED in posterior.children else "log_likelihood"
    )


def sample_stats(fit: Draws) -> xr.Dataset:
    """ArviZ's names for the sampler's columns."""
    dataset = xr.Dataset(
        {name: (("chain", "draw"), fit[key]) for key, name in SAMPLE_STATS.items()}
    )
    dataset["diverging"] = dataset["diverging"].astype(bool)
    return dataset.assign_coords(draw=np.arange(dataset.sizes["draw"]))


def label_draws(draws: xr.Dataset, quantities: Iterable[Parameter], priors: PriorSet) -> None:
    """Attach symbols, units and whether a parameter was fixed to the draws of quantities.

    A reference stress or flow rate has no prior: it is fixed if the whole flow law is.
    """
    for quantity in quantities:
        prior, of_draws = priors.priors.get(quantity.name), draws[quantity.name].to_numpy()
        fixed = prior.is_fixed if prior else of_draws.size > 1 and np.ptp(of_draws) == 0
        draws[quantity.name].attrs = {
            "long_name": quantity.label,
            "symbol": quantity.symbol,
            "units": quantity.si_unit,
            "fixed": int(fixed),
        }


def groups_of_tests(posterior: xr.DataTree) -> Mapping[str, xr.DataTree]:
    """Labelled draws of each test by its name; of a fit of one test these are all that there is."""
    if TESTS in posterior.children:
        return posterior[TESTS].children
    return {"the test": posterior}


def free_parameters(posterior: xr.DataTree) -> list[str]:
    """Names of the sampled quantities: free parameters, and the reference stress."""
    dataset = posterior["posterior"].to_dataset()
    return [str(name) for name in dataset.data_vars if not dataset[name].attrs["fixed"]]


def sampled_draws(posterior: xr.DataTree) -> xr.Dataset:
    """Draws of all that was sampled: `free_parameters`, and errors of what drives the tests."""
    draws = posterior["posterior"].to_dataset()[free_parameters(posterior)]
    if DRIVING_ERRORS in posterior.children:
        return draws.merge(posterior[DRIVING_ERRORS].to_dataset())
    return draws


def arviz_data(posterior: xr.DataTree, prior_groups: Mapping[str, xr.Dataset]) -> Any:
    """Return draws and groups of the prior as ArviZ's InferenceData (0.x) or DataTree (1.x)."""
    known = ("posterior_predictive", "log_likelihood", "log_prior", "sample_stats")
    groups: dict[str, Any] = {
        "posterior": sampled_draws(posterior),
        **{
            name: posterior[name].to_dataset()
            for name in (*known, "observed_data", "constant_data")
            if name in posterior.children
        },
        **prior_groups,
    }
    return az.InferenceData(**groups) if _ARVIZ_0 else xr.DataTree.from_dict(groups)


def convergence_table(posterior: xr.DataTree) -> pd.DataFrame:
    """Return R-hat and effective sample sizes, a row for each of `sampled_draws`.

    Columns are rhat (NaN of a single chain), ess_bulk and ess_tail, the worse one of the 5 and
    95 % quantiles (Vehtari et al. 2021, rank-normalised).
    """
    draws = sampled_draws(posterior)
    alone = draws.sizes["chain"] == 1
    with np.errstate(invalid="ignore", divide="ignore"):  # draws that never moved
        columns = {
            "rhat": dict.fromkeys(draws, np.nan) if alone else az.rhat(draws),
            "ess_bulk": az.ess(draws, method="bulk"),
            # A single probability would be taken for the quantile itself, not for a central range.
            "ess_tail": az.ess(draws, method="tail", prob=(TAIL, 1.0 - TAIL)),
        }
    return pd.DataFrame(
        {name: {key: float(value[key]) for key in draws} for name, value in columns.items()}
    ).rename_axis("parameter")


def largest_rhat(posterior: xr.DataTree) -> float:
    """Return the largest R-hat, between halves of a single chain; NaN if some draws never moved."""
    draws = sampled_draws(posterior)
    if draws.sizes["chain"] == 1:
        half = draws.sizes["draw"] // 2
        parts = (draws.isel(draw=slice(k * half, (k + 1) * half)) for k in range(2))
        halves = [part.assign_coords(chain=[k], draw=range(half)) for k, part in enumerate(parts)]
        draws = xr.concat(halves, "chain")
    with np.errstate(invalid="ignore", divide="ignore"):  # draws that never moved
        rhat = az.rhat(draws)
    return float(np.max([value.item() for value in rhat.data_vars.values()]))


def draws_table(posterior: xr.DataTree) -> pd.DataFrame:
    """Return unit, mean, sd, q5, q95, ess_bulk, ess_tail, rhat of the sampled quantities, in SI."""
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


def in_display_units(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table in display units; spreads of pooled parameters stay on the real line."""
    shown = table.copy()
    numbers = [one for one in DIMENSIONAL if one in table]
    for name in table.index:
        quantity = shown_quantity(str(name).split("[")[0])
        if table.loc[name, "unit"] == quantity.si_unit:
            shown.loc[name, numbers] = table.loc[name, numbers] * quantity.display_factor
            shown.loc[name, "unit"] = unit_text(quantity)
    return shown


DIMENSIONAL = ("mean", "sd", "q5", "q95", "prior_mean", "prior_sd", "prior_q5", "prior_q95")
"""Columns of tables of quantities that have their unit."""


def on_scale_of_prior(draws: FloatArray, prior: Prior) -> FloatArray:
    """Return draws (SI), or their logarithms where the prior is normal in these.

    Few draws from a wide lognormal prior have most of its variance, so that what draws say of it
    by moments is chance.
    """
    return np.asarray(np.log(draws) if prior.family == "lognormal" else draws)


def width_beside_prior(draws: FloatArray, prior: Prior) -> float:
    """Return the sd of draws (SI) over that of their prior, both on the scale of the prior."""
    prior_sd = prior.scale if prior.family == "lognormal" else prior.distribution().std()
    return float(np.std(on_scale_of_prior(draws, prior), ddof=1) / prior_sd)


def summary_table(posterior: xr.DataTree, priors: PriorSet) -> pd.DataFrame:
    """Return `draws_table` with the prior beside it; NaN for the reference stress or flow rate."""
    table, draws = draws_table(posterior), posterior["posterior"].to_dataset()
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
            "width_beside_prior": width_beside_prior(draws[name].to_numpy(), prior),
        }
    return table.join(pd.DataFrame.from_dict(rows, orient="index"))


def smooth_weights(
    log_ratios: FloatArray, *, relative_efficiency: float = 1.0
) -> tuple[FloatArray, float]:
    """Return the logarithms of Pareto smoothed importance weights (n,), and Pareto k.

    Log ratios (n,) are those of target to proposal density; the weights add up to 1 (PSIS;
    Vehtari et al. 2024, JMLR 25(72)). The relative efficiency sets how many draws count as the
    tail. Pareto k is minus infinity if all ratios are the same, infinity if they are too few.
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
    """Return effective over nominal draws of means along dimension three, (n,); 1 if all equal."""
    with np.errstate(invalid="ignore", divide="ignore"):  # draws that never moved
        found = az.ess(xr.Dataset({"values": values}), method="mean")
    n_draws = values.sizes["chain"] * values.sizes["draw"]
    return np.asarray(np.nan_to_num(found["values"].to_numpy() / n_draws, nan=1.0))
