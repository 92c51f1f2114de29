"""Simulation-based calibration: parameters from the prior, data from them, a fit, ranks.

If program, coordinates and sampler are right, the rank of a true value among the draws of its
posterior is uniform (Talts et al. 2018, arXiv:1804.06788).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy import stats

from pyburgers.constant_rate import ConstantRateExperiment
from pyburgers.errors import SamplingError
from pyburgers.experiment import Provenance
from pyburgers.fitting import fit
from pyburgers.posterior import convergence_table, free_parameters
from pyburgers.priors import PriorSet
from pyburgers.sampling import SamplerOptions
from pyburgers.simulation import simulate
from pyburgers.stan_data import REFERENCE_STRESS

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

N_BAND_SIMULATIONS = 20_000


@dataclass(frozen=True, eq=False)
class Simulated:
    """Data simulated at a draw from the prior.

    Attributes
    ----------
    experiment : ConstantRateExperiment
        The protocol with simulated stresses; its true parameters are the draw.
    reference_stress : float
        S_0 of the draw, Pa.
    n_unsolvable : int
        Draws before it whose curve the solver could not compute.
    """

    experiment: ConstantRateExperiment
    reference_stress: float
    n_unsolvable: int


@dataclass(frozen=True)
class Replication:
    """One data set of a calibration.

    Attributes
    ----------
    seed : int
        Of this data set.
    ranks : mapping of str to int
        Number of thinned draws below the true value, for each free parameter and S_0.
    n_draws : int
        Thinned draws; ranks go from 0 to this.
    n_unsolvable : int
        See `Simulated`.
    divergences : int
        Of the fit.
    rhat : float
        Largest R-hat of the fit.
    coordinates : str
        Coordinates of the fit.
    """

    seed: int
    ranks: Mapping[str, int]
    n_draws: int
    n_unsolvable: int
    divergences: int
    rhat: float
    coordinates: str


def simulate_from_prior(
    experiment: ConstantRateExperiment, priors: PriorSet, *, seed: int
) -> Simulated:
    """Draw parameters from the prior and simulate the experiment's data at its strains.

    Parameters
    ----------
    experiment : ConstantRateExperiment
        Protocol and strains.
    priors : PriorSet
        Resolved priors.
    seed : int
        Decides the draw and the noise.
    """
    rng = np.random.default_rng(seed)
    n_unsolvable = 0
    while True:
        values = priors.sample(rng)
        try:
            simulated, reference_stress = simulate_data(
                experiment, values, rng, source=f"a draw from the prior, seed {seed}"
            )
        except SamplingError:
            n_unsolvable += 1
            continue
        named = replace(simulated, id=f"{experiment.id}_simulated_{seed}")
        return Simulated(named, reference_stress, n_unsolvable)


def simulate_data(
    experiment: ConstantRateExperiment,
    values: Mapping[str, float],
    rng: np.random.Generator,
    *,
    source: str,
) -> tuple[ConstantRateExperiment, float]:
    """Put the solution at given parameters, with noise, in the place of an experiment's stresses.

    Parameters
    ----------
    experiment : ConstantRateExperiment
        Protocol and strains.
    values : mapping
        SI values by name.
    rng : Generator
        Gives the noise.
    source : str
        Where the parameters come from, for the provenance.

    Returns
    -------
    ConstantRateExperiment
        Synthetic; its true parameters are `values`.
    float
        Reference stress S_0 (Pa).

    Raises
    ------
    SamplingError
        If the solver finds no solution.
    """
    solution = simulate(experiment, values, at=np.unique(experiment.strain))
    stress = np.interp(experiment.strain, solution["strain"], solution["stress_Pa"])
    simulated = replace(
        experiment,
        stress=stress + _draw_residuals(experiment.strain, values, rng),
        provenance=Provenance("synthetic", f"pyburgers, {source}"),
        true_parameters=values,
    )
    return simulated, float(solution.attrs[REFERENCE_STRESS])


def _draw_residuals(
    strain: FloatArray, values: Mapping[str, float], rng: np.random.Generator
) -> FloatArray:
    """Residuals (Pa), shape (n_points,), as `stan/functions/residuals.stan` describes them."""
    residual: FloatArray = values["stress_noise"] * rng.standard_normal(strain.size)
    correlation_strain = values.get("residual_correlation_strain", 0.0)
    if correlation_strain > 0:
        step = np.diff(strain) / correlation_strain
        correlation, spread = np.exp(-step), np.sqrt(-np.expm1(-2 * step))
        for k in range(1, strain.size):
            residual[k] = correlation[k - 1] * residual[k - 1] + spread[k - 1] * residual[k]
    return residual


def replicate(
    experiment: ConstantRateExperiment,
    priors: PriorSet,
    out: Path,
    *,
    seed: int,
    options: SamplerOptions,
    n_thinned: int,
) -> Replication:
    """Simulate one data set, fit it, and rank the true values.

    Parameters
    ----------
    experiment : ConstantRateExperiment
        Protocol and strains.
    priors : PriorSet
        Resolved priors, the same for all data sets.
    out : Path
        Run directory of the fit.
    seed : int
        Of the data set and of the fit.
    options : SamplerOptions
        Chains, iterations, target.
    n_thinned : int
        Draws to keep: evenly spaced, few enough to be nearly independent.
    """
    simulated = simulate_from_prior(experiment, priors, seed=seed)
    result = fit(simulated.experiment, priors, out=out, options=replace(options, seed=seed))
    truth = {
        **(simulated.experiment.true_parameters or {}),
        REFERENCE_STRESS: simulated.reference_stress,
    }
    draws = result.posterior["posterior"].to_dataset()
    ranks = {}
    for name in free_parameters(result.posterior):
        values = draws[name].to_numpy().ravel()
        kept = values[np.linspace(0, values.size - 1, n_thinned).astype(int)]
        ranks[name] = int(np.sum(kept < truth[name]))
    return Replication(
        seed=seed,
        ranks=ranks,
        n_draws=n_thinned,
        n_unsolvable=simulated.n_unsolvable,
        divergences=int(result.posterior["sample_stats"]["diverging"].sum()),
        rhat=float(convergence_table(result.posterior)["rhat"].max()),
        coordinates=result.manifest["coordinates"]["system"],
    )


def simultaneous_band(
    n_ranks: int, n_draws: int, *, probability: float, seed: int = 1
) -> tuple[IntArray, IntArray]:
    """Band that holds the whole empirical distribution of uniform ranks with a probability.

    Pointwise binomial intervals whose common level is set by simulation (Säilynoja, Bürkner and
    Vehtari 2022, Statistics and Computing 32, 32).

    Parameters
    ----------
    n_ranks : int
        Number of data sets.
    n_draws : int
        Ranks go from 0 to this.
    probability : float
        Of the whole band.
    seed : int
        Of the simulation.

    Returns
    -------
    lower, upper : array, shape (n_draws,)
        Limits of the number of ranks that are at most 0, 1, ..., n_draws - 1.
    """
    rng = np.random.default_rng(seed)
    law = stats.binom(n_ranks, np.arange(1, n_draws + 1) / (n_draws + 1))
    count = np.arange(n_ranks + 1)[:, None]
    tail = np.minimum(law.cdf(count), law.sf(count - 1))  # one-sided, of each count at each rank
    smallest = [
        tail[
            counts_at_most(rng.integers(0, n_draws + 1, n_ranks), n_draws), np.arange(n_draws)
        ].min()
        for _ in range(N_BAND_SIMULATIONS)
    ]
    level = float(np.quantile(smallest, 1 - probability))
    lower, upper = (np.asarray(limit, dtype=np.int64) for limit in (law.ppf(level), law.isf(level)))
    return lower, upper


def counts_at_most(ranks: Sequence[int] | IntArray, n_draws: int) -> IntArray:
    """Count the ranks that are at most 0, 1, ..., n_draws - 1, shape (n_draws,)."""
    counts: IntArray = np.cumsum(np.bincount(ranks, minlength=n_draws + 1))[:-1]
    return counts
