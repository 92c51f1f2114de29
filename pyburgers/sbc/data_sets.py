"""One data set of a simulation-based calibration: a prior draw, data from it, a fit, ranks.

If program, coordinates and sampler are right, the rank of a true value among the draws of its
posterior is uniform (Talts et al. 2018, arXiv:1804.06788). `pyburgers.sbc.run` does this
many times, `pyburgers.sbc.rank_uniformity` judges the ranks.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import arviz as az
import numpy as np
import numpy.typing as npt
import xarray as xr

from pyburgers.checks.fit_checks import (
    check_chains,
    check_divergences,
    check_energy,
    check_solver,
    check_treedepth,
    run_checks,
)
from pyburgers.cmdstan.program import load_program
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.fitting.fit import Fit, fit
from pyburgers.model.priors import PriorSet, default_priors, load_priors, shipped_prior_files
from pyburgers.posterior.labelled_draws import convergence_table, free_parameters, response_in
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.forward import simulate, simulate_data
from pyburgers.protocols.problem import one_test
from pyburgers.protocols.program_data import given_parameters, program_data
from pyburgers.protocols.protocol import protocol_of
from pyburgers.protocols.stan_data import (
    SolverOptions,
)
from pyburgers.sampling.options import SamplerOptions

FloatArray = npt.NDArray[np.float64]

LOG_LIKELIHOOD = "log_likelihood"
"""Ranked beside the parameters: it sees errors that no single parameter shows (Modrák et al.
2023, Bayesian Analysis 20, 461-488)."""

PRIOR_ATTEMPTS = 100
"""Draws from the prior without solution, one after the other, at which a calibration gives up."""

RHAT_LIMIT = 1.05
"""Largest R-hat of a fit of a calibration: its chains are short, so that 1.01 is passed by chance.
"""

CHECKS = (check_chains, check_divergences, check_treedepth, check_energy, check_solver)
"""Checks of a fit that short chains can pass."""


@dataclass(frozen=True, eq=False)
class Simulated:
    """Data simulated at a draw from the prior.

    Attributes
    ----------
    experiment : Experiment
        The template with simulated stresses; its true parameters are the draw.
    n_unsolvable : int
        Draws before it whose curve the solver could not compute.
    """

    experiment: Experiment
    n_unsolvable: int


@dataclass(frozen=True)
class Replication:
    """One data set of a calibration.

    Attributes
    ----------
    seed : int
        Of this data set.
    ranks : mapping of str to int
        Number of thinned draws below the true value, for each free parameter, the reference
        quantity and the log likelihood; empty where the fit failed.
    n_draws : int
        Thinned draws; ranks go from 0 to this.
    n_unsolvable : int
        See `Simulated`.
    failure : str or None
        Why there is no fit.
    failed_checks : tuple of str
        Names of the checks of convergence that the fit failed.
    divergences : int
        Of the fit.
    rhat, least_ess : float or None
        Largest R-hat and least bulk effective sample size of the fit.
    coordinates : str or None
        Coordinates of the fit.
    """

    seed: int
    ranks: Mapping[str, int]
    n_draws: int
    n_unsolvable: int
    failure: str | None = None
    failed_checks: tuple[str, ...] = ()
    divergences: int = 0
    rhat: float | None = None
    least_ess: float | None = None
    coordinates: str | None = None


def calibration_priors(material: str) -> PriorSet:
    """Return the priors that a material's program is calibrated with.

    Those in ``data/priors/calibration``, which are narrowed so that draws look like laboratory
    tests, or the material's own where there are none.

    Raises
    ------
    InputError
        If the material has neither.
    """
    files = shipped_prior_files("calibration")
    return load_priors(files[material]) if material in files else default_priors(material)


def check_template(experiment: Experiment) -> None:
    """Check that data of an experiment can be simulated as the program assumes them.

    Raises
    ------
    InputError
        If it has no points, or its protocol cannot simulate such data.
    """
    if experiment.n_points == 0:
        raise InputError(
            f"{experiment.id}: the experiment has no data, expected a [data] table whose points "
            "the simulated data sets take over."
        )
    protocol_of(experiment).check_template(experiment)


def simulate_from_prior(experiment: Experiment, priors: PriorSet, *, seed: int) -> Simulated:
    """Draw parameters from the prior and simulate the experiment's data.

    A draw without a solution within the limits of the solver that fits use
    (`pyburgers.protocols.stan_data.SolverOptions`) is replaced by the next one: the sampler
    rejects such parameters too.

    Parameters
    ----------
    experiment : Experiment
        Protocol and points.
    priors : PriorSet
        Resolved priors.
    seed : int
        Decides the draw and the noise.

    Raises
    ------
    SamplingError
        If none of `PRIOR_ATTEMPTS` draws has a solution.
    """
    rng = np.random.default_rng(seed)
    for n_unsolvable in range(PRIOR_ATTEMPTS):
        values = priors.sample(rng)
        source = f"a draw from the prior, seed {seed}"
        try:
            simulate(experiment, values, solver=SolverOptions())
            simulated = simulate_data(experiment, values, rng, source=source)
        except SamplingError:
            continue  # counted by n_unsolvable
        named = replace(simulated, id=f"{experiment.id}_simulated_{seed}")
        return Simulated(named, n_unsolvable)
    raise SamplingError(
        f"{experiment.id}: none of {PRIOR_ATTEMPTS} draws from the prior has a finite solution; "
        "check the units and the bounds of the priors."
    )


def replicate(
    experiment: Experiment,
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
    experiment : Experiment
        Protocol and points.
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
    try:
        result = fit(simulated.experiment, priors, out=out, options=replace(options, seed=seed))
    except SamplingError as error:
        return Replication(seed, {}, n_thinned, simulated.n_unsolvable, failure=str(error))
    least_ess = float(convergence_table(result.posterior)["ess_bulk"].min())
    rhat = largest_rhat(result.posterior)
    return Replication(
        seed=seed,
        ranks=rank_truth(result, simulated.experiment, n_thinned),
        n_draws=n_thinned,
        n_unsolvable=simulated.n_unsolvable,
        failed_checks=(
            *(one.name for one in run_checks(result.checked_draws, CHECKS) if not one.passed),
            *(["R-hat"] if not rhat <= RHAT_LIMIT else []),
            *(["independent draws"] if not least_ess >= n_thinned else []),
        ),
        divergences=int(result.posterior["sample_stats"]["diverging"].sum()),
        rhat=rhat,
        least_ess=least_ess,
        coordinates=result.manifest["coordinates"]["system"],
    )


def largest_rhat(posterior: xr.DataTree) -> float:
    """Largest R-hat over the sampled quantities, between the halves of a chain where it is alone.

    Parameters
    ----------
    posterior : DataTree
        Labelled draws.

    Returns
    -------
    float
        NaN where draws of a quantity never moved.
    """
    draws = posterior["posterior"].to_dataset()[free_parameters(posterior)]
    if draws.sizes["chain"] == 1:
        half = draws.sizes["draw"] // 2
        parts = (draws.isel(draw=slice(k * half, (k + 1) * half)) for k in range(2))
        halves = [part.assign_coords(chain=[k], draw=range(half)) for k, part in enumerate(parts)]
        draws = xr.concat(halves, "chain")
    with np.errstate(invalid="ignore", divide="ignore"):  # draws that never moved
        rhat = az.rhat(draws)
    return float(np.max([value.item() for value in rhat.data_vars.values()]))


def rank_truth(result: Fit, experiment: Experiment, n_thinned: int) -> dict[str, int]:
    """Count the thinned draws of a fit that lie below the truth, for every ranked quantity.

    Parameters
    ----------
    result : Fit
        Fit of the experiment.
    experiment : Experiment
        With its true parameters.
    n_thinned : int
        Draws to keep.
    """
    draws = result.posterior["posterior"].to_dataset()
    truth = _at_truth(experiment, SolverOptions(**result.manifest["solver"]))
    log_likelihood = response_in(result.posterior, "log_likelihood").sum("point")
    ranked = {
        **{name: draws[name] for name in free_parameters(result.posterior)},
        LOG_LIKELIHOOD: log_likelihood,
    }
    ranks = {}
    for name, values in ranked.items():
        flat = all_draws(values)
        kept = flat[np.linspace(0, flat.size - 1, n_thinned).astype(int)]
        ranks[name] = int(np.sum(kept < truth[name]))
    return ranks


def _at_truth(experiment: Experiment, solver: SolverOptions) -> dict[str, float]:
    """Return true parameters, reference quantity and log likelihood of simulated data."""
    values = experiment.true_parameters
    assert values is not None  # simulated
    given = given_parameters(experiment.material, values)
    data = program_data(one_test(experiment, given), solver=solver)
    draw = load_program(protocol_of(experiment).program).evaluate(data)
    reference = protocol_of(experiment).reference.name
    return {
        **values,
        reference: float(np.exp(draw["log_reference"][0])),
        LOG_LIKELIHOOD: float(draw["log_lik"].sum()),
    }
