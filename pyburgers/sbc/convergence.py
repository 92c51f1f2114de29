"""Convergence of a fit of a calibration, and the repetition of a fit without it."""

from collections.abc import Sequence
from dataclasses import replace

from pyburgers.checks import registry
from pyburgers.checks.fit_checks import (
    CheckKind,
    check_divergences,
    check_effective_sample_size,
    check_rhat,
    run_checks,
)
from pyburgers.fitting.fit import Fit
from pyburgers.posterior.labelled_draws import convergence_table, largest_rhat
from pyburgers.sampling.options import SamplerOptions

LONGER = 4
"""Factor on the iterations of a fit that is repeated, and on how closely it keeps its target."""

RHAT_LIMIT = 1.05
"""Largest R-hat of a fit of a calibration: 1.01 is passed by chance in its short chains."""

CHECKS = tuple(
    one
    for one in registry.CHECKS
    if one.kind is CheckKind.SAMPLING and one not in (check_rhat, check_effective_sample_size)
)
"""Checks of a fit that short chains can pass."""


def lengthened(options: SamplerOptions, n_refits: int, failed: Sequence[str]) -> SamplerOptions:
    """Return settings of a repetition: longer, after divergences with steps that diverge less.

    Repetition 0 is the first fit, whose warm-up and target are known numbers; `failed` names the
    checks that the fit before the repetition failed.
    """
    assert options.warmup is not None
    assert options.adapt_delta is not None
    # A stricter target mends nothing else: steps would only be too short.
    stricter = LONGER**n_refits if check_divergences.name in failed else 1
    return replace(
        options,
        warmup=options.warmup * LONGER**n_refits,
        draws=options.draws * LONGER**n_refits,
        adapt_delta=1 - (1 - options.adapt_delta) / stricter,
        max_minutes=0.0,  # the number of draws follows from the data alone
    )


def not_converged(result: Fit, n_ranked: int) -> tuple[str, ...]:
    """Return the names of the checks of convergence that a fit failed."""
    n_effective = convergence_table(result.posterior)["ess_bulk"]
    return (
        *(one.name for one in run_checks(result.checked_draws, CHECKS) if not one.passed),
        *([] if largest_rhat(result.posterior) <= RHAT_LIMIT else ["R-hat"]),
        *([] if n_effective.min() >= n_ranked else ["independent draws"]),
    )
