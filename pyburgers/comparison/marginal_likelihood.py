"""Marginal likelihood of a finished run: density of all its data, the parameters integrated out.

By bridge sampling (Meng and Wong 1996, Statistica Sinica 6, 831-860) in the sampler's coordinates,
which make posteriors close to normal. A normal proposal is fitted to one half of the draws, while
the other half and draws of the proposal give the integral (Gronau et al. 2017, Journal of
Mathematical Psychology 81, 80-97); then the halves change places and the two estimates are
averaged. All terms of the log density are normalised, in the program: that of the coordinates is
what it samples.
"""

import logging
from collections.abc import Callable

import numpy as np
import xarray as xr
from scipy.optimize import brentq
from scipy.special import expit
from scipy.stats import multivariate_normal

from pyburgers.checks.prior_influence import read_off_sentences
from pyburgers.cmdstan.draw_files import read_draws
from pyburgers.cmdstan.program import Density, load_program
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError, SamplingError, require_type
from pyburgers.comparison.results import LogIntegral
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import A_FIT, require_whole
from pyburgers.kinds.stan_data import REFERENCE_SOLVER, solver_block
from pyburgers.posterior.labelled_draws import relative_efficiency

logger = logging.getLogger(__name__)

DRAWS_PER_DIMENSION = 4
"""Least number of draws for each dimension that a proposal is fitted to."""

MARGIN = 50.0
"""Distance beyond the log ratios in which the root is looked for."""


def log_marginal_likelihood(fit: Fit) -> LogIntegral:
    """Log density of all data of a run under its priors, of stresses in Pa.

    Parameters
    ----------
    fit : Fit
        Of one or several tests, no part of a joint fit. If the data took no part, the result is 0,
        but for its error.

    Returns
    -------
    LogIntegral
        At the reference tolerance of the solver. Draws that miss a part of the posterior are not
        in the error: see the checks of the run.

    Raises
    ------
    InputError
        If there are too few draws, or it is a part of a joint fit.
    SamplingError
        If the program fails or the draws have no spread.

    Examples
    --------
    >>> integral = pyburgers.log_marginal_likelihood(fit)
    """
    require_type("fit", fit, Fit, A_FIT)
    require_whole(fit)
    with fit.directory.unchanged_copy(fit.manifest, with_draws=True) as run:
        draws = read_draws(run.draws_files())["coordinate"]
        data = run.read_stan_data()
    stats = fit.posterior["sample_stats"].to_dataset()
    at_reference = (stats["lp"] + stats["solver_log_ratio"]).transpose("chain", "draw").to_numpy()
    program = load_program(fit.problem.likelihood.program)
    density = Density(program, {**data, **solver_block(REFERENCE_SOLVER)})
    logger.info(f"Marginal likelihood of {fit.manifest['experiment']}: bridge sampling.")
    for sentence in read_off_sentences(fit.read_off):
        logger.info(f"note: {sentence}")
    return log_integral(
        draws,
        # A draw without solution at the reference tolerance has no density there.
        np.where(np.isnan(at_reference), -np.inf, at_reference),
        density.at,
        seed=fit.manifest["sampler"]["seed"],
    )


def log_integral(
    draws: FloatArray,
    log_density_at_draws: FloatArray,
    log_density: Callable[[FloatArray], FloatArray],
    *,
    seed: int,
) -> LogIntegral:
    """Integrate a density, nearly normal, from draws of it, (n_chains, n_draws, n_dimensions).

    Its logarithm is known up to a factor, at the draws (n_chains, n_draws) and as a function of
    points (n_points, n_dimensions). The error takes autocorrelation into account.
    """
    n_dimensions = draws.shape[2]
    middle = draws.shape[1] // 2
    n_half = draws.shape[0] * middle
    if n_half < DRAWS_PER_DIMENSION * n_dimensions:
        raise InputError(
            f"bridge sampling: found {2 * n_half} draws of {n_dimensions} coordinates, expected at "
            f"least {2 * DRAWS_PER_DIMENSION * n_dimensions}."
        )
    halves = (slice(0, middle), slice(middle, None))
    estimates = [
        _from_half(
            draws[:, fitted],
            draws[:, used],
            log_density_at_draws[:, used],
            log_density,
            np.random.default_rng([seed, number]),
        )
        for number, (fitted, used) in enumerate((halves, halves[::-1]))
    ]
    return LogIntegral.mean(*estimates)


def _from_half(
    fitted: FloatArray,
    used: FloatArray,
    log_density_at_used: FloatArray,
    log_density: Callable[[FloatArray], FloatArray],
    rng: np.random.Generator,
) -> LogIntegral:
    """Estimate from some draws and as many of the proposal that others give."""
    flat = fitted.reshape(-1, fitted.shape[2])
    try:
        proposal = multivariate_normal(flat.mean(axis=0), np.atleast_2d(np.cov(flat.T)))
    except np.linalg.LinAlgError as error:
        raise SamplingError(
            "bridge sampling: the draws have no spread in some direction; run more of them."
        ) from error
    n_proposals = log_density_at_used.size
    proposed = proposal.rvs(n_proposals, random_state=rng).reshape(n_proposals, -1)
    at_draws = log_density_at_used - proposal.logpdf(used)
    at_proposals = log_density(proposed) - np.atleast_1d(proposal.logpdf(proposed))
    return bridge(at_draws, at_proposals)


def bridge(at_draws: FloatArray, at_proposals: FloatArray) -> LogIntegral:
    """Combine ln(density/proposal) at draws (n_chains, n_draws) and proposals (n,) optimally.

    The error is that of Frühwirth-Schnatter (2004, The Econometrics Journal 7, 143-167), to first
    order, with the effective number of draws.
    """
    if not np.isfinite(at_proposals).any():
        raise SamplingError(
            "bridge sampling: the density is 0 at all draws of the proposal, which is of no use."
        )
    n_effective = at_draws.size * _efficiency(at_draws)
    share = n_effective / (n_effective + at_proposals.size)
    offset = np.log(share) - np.log1p(-share)
    finite = np.concatenate([part[np.isfinite(part)] for part in (at_draws, at_proposals)])

    def proposal_shares(value: float) -> FloatArray:
        """Proposal density over that of the mixture of both, up to a factor."""
        return np.asarray(expit(value - offset - at_draws), dtype=np.float64)

    def density_shares(value: float) -> FloatArray:
        """Density over that of the mixture of both, up to a factor."""
        return np.asarray(expit(at_proposals + offset - value), dtype=np.float64)

    # The fixed point of Meng and Wong; the left-hand side rises with the value, the other falls.
    value = brentq(
        lambda v: share * proposal_shares(v).mean() - (1 - share) * density_shares(v).mean(),
        finite.min() + offset - MARGIN,
        finite.max() + offset + MARGIN,
    )
    here, there = proposal_shares(value), density_shares(value)
    variance = (
        _relative_variance(here) / (here.size * _efficiency(here))
        + _relative_variance(there) / there.size
    )
    return LogIntegral(float(value), float(np.sqrt(variance)))


def _relative_variance(values: FloatArray) -> float:
    """Variance over the square of the mean."""
    return float(np.var(values, ddof=1) / np.mean(values) ** 2)


def _efficiency(values: FloatArray) -> float:
    """Effective over nominal number of draws, for their mean; of chains by draws."""
    labelled = xr.DataArray(values[..., np.newaxis], dims=("chain", "draw", "value"))
    return float(relative_efficiency(labelled)[0])
