"""When the chains of a run continue: with shorter steps, or because their draws are too few."""

import logging
import math
from collections.abc import Callable

from pyburgers.checks.fit_checks import (
    ESS_LIMIT,
    CheckKind,
    Outcome,
    check_divergences,
    check_effective_sample_size,
    check_rhat,
    check_solver,
    run_checks,
)
from pyburgers.common.units import counted, duration_text
from pyburgers.fitting.sampled_fit import FitT, SampledFit
from pyburgers.posterior.labelled_draws import convergence_table
from pyburgers.sampling.chains import chains_at_once
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.repetitions import SHORTENING, shorten_steps, shortened, tighten_solver

logger = logging.getLogger(__name__)


MAX_REFITS = 2
"""Times that a run is repeated at a tighter tolerance of the solver."""

MAX_SHORTENED = 2
"""Times that a run is repeated with shorter steps."""

MAX_DIVERGENT_SHARE = 0.01
"""Share of the trajectories that may diverge for shorter steps to be tried; where more do, it is
the coordinates or the priors that do not suit the posterior."""

MENDED_BY_DRAWS = frozenset({check_rhat.name, check_effective_sample_size.name})
"""Checks that more draws of the same chains can mend."""

MARGIN = 1.15
"""Effective draws that are asked for over those that are wanted: their number is an estimate."""

LEAST_LENGTHENING = 0.5
"""Share of the draws of a chain by which it is lengthened at least."""


def sample_until_good(
    sample: Callable[[int | None], FitT], options: SamplerOptions, more_draws: int | None
) -> FitT:
    """Sample until more of the same would not help, or would take too long; return the last fit.

    `sample` runs the chains that the run directory lacks, adds draws to each chain if it is given
    a number, first `more_draws`, and loads the fit.
    """
    result = sample(more_draws)
    while True:
        if put_aside_where_few_diverged(result):
            result = sample(None)
        elif more_draws := _more_draws(result, options):
            result = sample(more_draws)
        else:
            return result


def put_aside_where_few_diverged(result: SampledFit) -> bool:
    """Put chains aside in which a few trajectories diverged, so that they go on; tell whether.

    They go on with shorter steps. The manifest notes it (`shorten_steps`): the same command samples
    as many draws. Nothing is put aside if no number depends on the divergences
    (`check_divergences`), chains are missing, more than `MAX_DIVERGENT_SHARE` diverged,
    or steps were shortened `MAX_SHORTENED` times.
    """
    diverging = result.posterior["sample_stats"]["diverging"]
    counts = {int(chain): int(diverging.sel(chain=chain).sum()) for chain in diverging["chain"]}
    divergences = sum(counts.values())
    many = divergences > MAX_DIVERGENT_SHARE * diverging.size
    if many or len(shortened(result.manifest)) == MAX_SHORTENED or result.missing_chains():
        return False
    found = check_divergences(result.checked_draws)
    if found.passed:
        return False
    shorten_steps(result.directory, counts)
    concerned = sum(count > 0 for count in counts.values())
    logger.info(
        f"{found.meaning}. {counted(concerned, 'chain')} of {len(counts)} continue from the last "
        f"draw with steps {SHORTENING:g} times shorter; the earlier draws are put aside."
    )
    return True


def _more_draws(result: SampledFit, options: SamplerOptions) -> int | None:
    """Return the draws that every chain lacks, if they are all that is lacking and time is left.

    It is decided by the draws alone how many: as many as the least effective sample size asks for,
    and at least half as many again. If they do not fit into the time, none are added.
    """
    minutes = options.minutes_of_sampling
    if not minutes:
        return None
    asked = [one for one in result.asked_checks() if one.kind is CheckKind.SAMPLING]
    failed = [one for one in run_checks(result.checked_draws, asked) if not one.passed]
    curable = all(
        one.name in MENDED_BY_DRAWS and one.outcome is Outcome.NO and not one.unusable
        for one in failed
    )
    if not failed or not curable:
        return None
    n_draws = int(result.posterior["posterior"].sizes["draw"])
    effective = convergence_table(result.posterior)[["ess_bulk", "ess_tail"]].to_numpy().min()
    more: int = math.ceil(n_draws * max(MARGIN * ESS_LIMIT / effective - 1.0, LEAST_LENGTHENING))
    spent = sum(one["wall_seconds"] for one in result.manifest["chains"].values())
    spent /= chains_at_once(options)
    needed = spent * more / (n_draws + result.manifest["sampler"]["warmup"])
    how_long = f"{counted(more, 'more draw')} of each chain take about {duration_text(needed)}"
    if spent + needed > 60.0 * minutes:
        enough = math.ceil((spent + needed) / 60.0)
        logger.info(
            f"{failed[0].meaning}. {how_long}, which --max-minutes {minutes:g} does not allow: run "
            f"the same command with --max-minutes {enough}."
        )
        return None
    logger.info(f"{failed[0].meaning}. {how_long}: all chains continue.")
    return more


def put_aside_where_tolerance_matters(result: SampledFit) -> bool:
    """Put all chains aside if the tolerance of the solver was too loose, and tell whether."""
    solver = check_solver(result.checked_draws)
    loose = solver.outcome is Outcome.NO and not result.missing_chains()
    if not loose or len(result.manifest["refits"]) == MAX_REFITS:
        return False
    tight = tighten_solver(result.directory, float(solver.table["pareto_k"].iloc[0]))
    logger.info(f"{solver.sentence} Sampling all chains again at a tolerance of {tight:g}.")
    return True
