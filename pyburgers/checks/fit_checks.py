"""What a check is, and the checks of chains and solver.

A new one is a function with a name and a kind in a module of this folder, where
`pyburgers.checks.verdicts` finds it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
import pandas as pd
import xarray as xr

from pyburgers.checks.residual_numbers import outside_band
from pyburgers.common.draws import TAIL
from pyburgers.model.display import label_of
from pyburgers.posterior.labelled_draws import (
    convergence_table,
    groups_of_tests,
    pareto_k,
    response_in,
    sampled_draws,
    told_readings,
)
from pyburgers.sampling.manifest import ChainFailure, OtherMode


class CheckKind(Enum):
    """The question that a check helps to answer; never one for both."""

    SAMPLING = "Was the posterior sampled well?"
    DESCRIPTION = "Does the model describe the data?"


class Outcome(Enum):
    """An answer.

    Examples
    --------
    >>> pyburgers.Outcome("yes") is pyburgers.Outcome.YES
    True
    """

    YES = "yes"
    NO = "no"
    CANNOT_TELL = "cannot tell"


@dataclass(frozen=True, eq=False)
class CheckedDraws:
    """Labelled draws, with numbers that diverged each time before, and modes that climbs met."""

    posterior: xr.DataTree
    failures: tuple[ChainFailure, ...] = ()
    max_treedepth: int = 10
    diverged_before: tuple[int, ...] = ()
    other_modes: tuple[OtherMode, ...] = ()


@dataclass(frozen=True, eq=False)
class Finding:
    """What a check found: the answer, the numbers behind it, what they mean, and what to do.

    The meaning is a sentence for a non-specialist, without full stop where a remedy follows. What
    makes draws unusable says so: nothing can be concluded from them about the data. A note goes
    into a verdict that is a yes. What leads comes first in a verdict that is none.
    """

    outcome: Outcome
    table: pd.DataFrame
    meaning: str
    remedy: str = ""
    unusable: bool = False
    note: str = ""
    leads: bool = False


@dataclass(frozen=True, eq=False)
class Check:
    """A check; below its least draws, or readings of the longest test, it cannot tell."""

    name: str
    kind: CheckKind
    find: Callable[[CheckedDraws], Finding]
    least_draws: int = 0
    least_readings: int = 0

    def __call__(self, draws: CheckedDraws) -> "CheckResult":
        """Look at draws."""
        return CheckResult(**vars(self._doubt(draws) or self.find(draws)), check=self)

    def _doubt(self, draws: CheckedDraws) -> Finding | None:
        """Return why draws or readings cannot be looked at, None where they can."""
        n_draws = draws.posterior["sample_stats"]["diverging"].size
        if n_draws < self.least_draws:
            return _too_few("draws", n_draws, self.least_draws, "raise --draws", unusable=True)
        if self.least_readings > 0:
            told = map(told_readings, groups_of_tests(draws.posterior).values())
            longest = max(told, key=np.count_nonzero)
            most = int(longest.sum())
            if most < self.least_readings:
                few = _too_few("readings", most, self.least_readings, "add readings")
                limits = f"{longest.size - most} readings are upper limits, no values; "
                return replace(few, meaning=limits * (longest.size > most) + few.meaning)
        if self.kind is CheckKind.DESCRIPTION and (unsolved := _n_unsolved(draws.posterior)):
            meaning = f"{unsolved} of {n_draws} draws have no solution {_UNSOLVED}"
            table = pd.DataFrame({"unsolved_draws": [unsolved]})
            return Finding(Outcome.CANNOT_TELL, table, meaning, _TIGHTER)
        return None


@dataclass(frozen=True, eq=False)
class CheckResult(Finding):
    """What a check found, and the check."""

    check: Check = field(kw_only=True)

    @property
    def passed(self) -> bool:
        """Whether it found nothing wrong, and could tell."""
        return self.outcome is Outcome.YES

    @property
    def name(self) -> str:
        """Name of the check."""
        return self.check.name

    @property
    def sentence(self) -> str:
        """What it means and, where it failed, the usual remedy."""
        return f"{self.meaning}; {self.remedy}." if self.remedy else self.meaning


_UNSOLVED = "at the reference tolerance, so the solver cannot be trusted there"
_ANEW = "with --overwrite or another --out"
_LONGER = f"sample again with a longer --warmup, {_ANEW}"
_TIGHTER = f"repeat the fit with a tighter --tolerance, {_ANEW}, or narrower priors"


def _n_unsolved(posterior: xr.DataTree) -> int:
    """Count draws in which the model gives some reading of some test no value."""
    solved = [
        np.isfinite(response.to_numpy()).all(axis=-1)
        for group in groups_of_tests(posterior).values()
        for response in group["model_response"].data_vars.values()
    ]
    return int((~np.all(solved, axis=0)).sum())


def _too_few(what: str, n: int, least: int, remedy: str, *, unusable: bool = False) -> Finding:
    """Return that a check cannot tell."""
    found = f"1 {what[:-1]} is" if n == 1 else f"{n} {what} are"
    return Finding(
        Outcome.CANNOT_TELL,
        pd.DataFrame({what: [n], "least_wanted": [least]}),
        f"{found} too few to tell, at least {least} are needed",
        remedy,
        unusable=unusable,
    )


def check(
    name: str, kind: CheckKind, *, least_draws: int = 0, least_readings: int = 0
) -> Callable[[Callable[[CheckedDraws], Finding]], Check]:
    """Make a check of the function that looks at the draws."""
    return lambda find: Check(name, kind, find, least_draws, least_readings)


RHAT_LIMIT = 1.01
RHAT_USABLE = 1.1
"""Above it chains sample different distributions: what they predict together means nothing."""
ESS_LIMIT = 400
ESS_USABLE = 50
"""Below it not even the middle half of a posterior is known well."""
LEAST_DRAWS = 100
"""Fewer draws, of all chains, cannot show whether they were drawn well, good or bad."""
EBFMI_LIMIT = 0.3
PARETO_K_LIMIT = 0.7
MARGIN = 1.15
"""Effective draws that are asked for over those that are wanted: their number is an estimate."""

LEAST_LENGTHENING = 0.5
"""Share of the draws of a chain by which it is lengthened at least."""

MISSED_DRAWS = 10
"""Draws that each divergent trajectory may stand for, of a region that no trajectory entered."""

MAX_MISSED = 0.05
"""Largest share of the posterior that divergences may stand for, for their influence to be told."""

MAX_CUT = 0.01
"""Share of cut trajectories up to which they are no reason for other checks to fail."""

MAX_INFLUENCE = 0.05
"""Largest move of a mean or a width, in standard deviations, that counts as none.

It is the Monte Carlo error of a mean of 400 independent draws, as few as a fit needs.
"""


def draws_lacking(posterior: xr.DataTree) -> int:
    """Draws that every chain lacks, by the least effective sample size."""
    n_draws = int(posterior["posterior"].sizes["draw"])
    effective = float(convergence_table(posterior)[["ess_bulk", "ess_tail"]].to_numpy().min())
    # Draws that never moved have a NaN, which is no maximum.
    return math.ceil(n_draws * max(LEAST_LENGTHENING, MARGIN * ESS_LIMIT / effective - 1.0))


def _more_draws(posterior: xr.DataTree) -> str:
    return f"add draws to every chain (--more-draws {draws_lacking(posterior)})"


def beyond(value: float, limit: float, digits: int) -> str:
    """Return a number beyond its limit, which stands beside it; rounded, it is beyond it too."""
    text = f"{value:.{digits}f}"
    if (float(text) - limit) * (value - limit) > 0:
        return text
    scale = 10.0**digits
    away = np.ceil if value >= limit else np.floor
    return f"{away(value * scale) / scale:.{digits}f}"


@check("chains", CheckKind.SAMPLING)
def check_chains(draws: CheckedDraws) -> Finding:
    """All chains finished."""
    finished = [int(chain) for chain in draws.posterior["posterior"]["chain"]]
    failures = draws.failures
    table = pd.DataFrame(
        [{"chain": chain, "outcome": "finished"} for chain in finished]
        + [{"chain": failure.chain, "outcome": failure.reason} for failure in failures]
    )
    if not failures:
        n_chains = len(finished)
        all_of_them = "The only chain" if n_chains == 1 else f"All {n_chains} chains"
        return Finding(Outcome.YES, table, f"{all_of_them} finished.")
    missing = f"{len(failures)} of {len(table)} chains did not finish. {failures[0].reason}"
    return Finding(Outcome.NO, table, missing)


@check("R-hat", CheckKind.SAMPLING, least_draws=LEAST_DRAWS)
def check_rhat(draws: CheckedDraws) -> Finding:
    """Chains agree: R-hat at most 1.01 for every sampled quantity."""
    table = convergence_table(draws.posterior)[["rhat"]]
    if draws.posterior["posterior"].sizes["chain"] == 1:
        meaning = "R-hat compares chains and there is only one"
        return Finding(Outcome.CANNOT_TELL, table, meaning, "run at least two (--chains 4)")
    # Draws that never moved give a NaN.
    worst = int(table["rhat"].fillna(np.inf).argmax())
    name, value = table.index[worst], float(table["rhat"].iloc[worst])
    if value <= RHAT_LIMIT:
        agree = f"The chains agree with each other (largest R-hat {value:.3f}, {label_of(name)})."
        return Finding(Outcome.YES, table, agree)
    unusable = not value <= RHAT_USABLE
    more = "" if unusable else f"{_more_draws(draws.posterior)}, or "
    return Finding(
        Outcome.NO,
        table,
        "The chains have not yet found the same distribution (R-hat "
        f"{beyond(value, RHAT_LIMIT, 3)} for {label_of(name)}, at most {RHAT_LIMIT} wanted), so "
        "means and intervals may still move",
        f"{more}{_LONGER}; a tighter prior helps where more is known than it says",
        unusable=unusable,
    )


@check("effective sample size", CheckKind.SAMPLING, least_draws=LEAST_DRAWS)
def check_effective_sample_size(draws: CheckedDraws) -> Finding:
    """Bulk and tail effective sample sizes of at least 400."""
    table = convergence_table(draws.posterior)[["ess_bulk", "ess_tail"]]
    least = table.min(axis=1)
    worst, value = str(least.idxmin()), float(least.min())
    if value >= ESS_LIMIT:
        enough = f"at least {value:.0f} effectively independent draws (least: {label_of(worst)})"
        return Finding(Outcome.YES, table, f"Every quantity has {enough}.")
    which = "bulk" if value == table["ess_bulk"].min() else "tail"
    return Finding(
        Outcome.NO,
        table,
        f"There are only {beyond(value, ESS_LIMIT, 0)} effectively independent draws of "
        f"{label_of(worst)} ({which}), {ESS_LIMIT} are wanted for stable intervals",
        _more_draws(draws.posterior) + f", or {_LONGER}" * (value < ESS_USABLE),
        unusable=value < ESS_USABLE,
    )


def influence(draws: xr.Dataset, diverging: xr.DataArray) -> dict[str, float]:
    """Return moves of quantities if each divergence stood for `MISSED_DRAWS` more draws.

    The larger of the move of the mean, in sd, and the relative one of the sd.
    """
    weights = 1.0 + MISSED_DRAWS * diverging
    weights = weights / weights.sum()
    with np.errstate(invalid="ignore", divide="ignore"):
        standard = (draws - draws.mean()) / draws.std()
        mean = (standard * weights).sum(skipna=False)
        width = (((standard - mean) ** 2 * weights).sum(skipna=False)) ** 0.5
    moves = {}
    for name in map(str, draws):
        move = max(abs(float(mean[name])), abs(float(width[name]) - 1.0))
        moves[name] = np.inf if np.isnan(move) else move
    return moves


@check("divergences", CheckKind.SAMPLING)
def check_divergences(draws: CheckedDraws) -> Finding:
    """No trajectory diverged, or so few that no number depends on them."""
    diverging = draws.posterior["sample_stats"].to_dataset()["diverging"]
    table = diverging.sum("draw").to_dataframe().rename(columns={"diverging": "divergences"})
    total = int(diverging.sum())
    before = " and ".join(map(str, draws.diverged_before))
    if not total:
        none = "No trajectory diverged: no region of the posterior was too curved to enter."
        if before:
            none += f" (With longer steps {before} had; those draws are put aside.)"
        return Finding(Outcome.YES, table, none)
    again = f" ({before} with longer steps)" if before else ""
    found = f"{total} of {diverging.size} trajectories diverged{again}"
    remedy = (
        f"raise --adapt-delta closer to 1, {_ANEW}; a figure of pairs of parameters shows where "
        "they sit"
    )
    curved = "so a strongly curved region may be missed"
    if MISSED_DRAWS * total > MAX_MISSED * diverging.size:
        return Finding(Outcome.NO, table, f"{found}, {curved}", remedy)
    moves = influence(sampled_draws(draws.posterior), diverging)
    name, most = max(moves.items(), key=lambda move: move[1])
    if most > MAX_INFLUENCE:
        moved = (
            f"if each stood for {MISSED_DRAWS} draws, {label_of(name)} would move by "
            f"{beyond(most, MAX_INFLUENCE, 2)} standard deviations (at most {MAX_INFLUENCE} wanted)"
        )
        return Finding(Outcome.NO, table, f"{found}, {curved}: {moved}", remedy)
    return Finding(
        Outcome.YES,
        table,
        f"{found}, but no number depends on them: if each stood for {MISSED_DRAWS} draws that were "
        f"missed, {label_of(name)} would move most, by {most:.3f} standard deviations.",
    )


@check("treedepth", CheckKind.SAMPLING)
def check_treedepth(draws: CheckedDraws) -> Finding:
    """Few trajectories were cut at the treedepth limit, or the draws are good all the same."""
    sampled = draws.posterior["sample_stats"]
    saturated = sampled["tree_depth"] >= draws.max_treedepth
    table = pd.DataFrame(
        {
            "saturated": saturated.sum("draw").to_series(),
            "mean_leapfrog_steps": sampled["n_steps"].mean("draw").to_series(),
        }
    )
    total = int(saturated.sum())
    if not total:
        return Finding(Outcome.YES, table, "No trajectory was cut short by the treedepth limit.")
    found = f"{total} of {saturated.size} trajectories were cut at treedepth {draws.max_treedepth}"
    # A cut trajectory leaves the distribution as it is; draws follow each other more closely.
    others = (check_rhat, check_effective_sample_size, check_divergences)
    if total <= MAX_CUT * saturated.size or all(one(draws).passed for one in others):
        slow = "which makes the sampler slow but not wrong"
        return Finding(Outcome.YES, table, f"{found}, {slow}.")
    return Finding(
        Outcome.NO,
        table,
        f"{found}, so that the chains may not have reached all of the posterior",
        f"raise --max-treedepth, {_ANEW}, or add draws (--more-draws)",
    )


@check("energy", CheckKind.SAMPLING, least_draws=LEAST_DRAWS)
def check_energy(draws: CheckedDraws) -> Finding:
    """E-BFMI of every chain at least 0.3 (Betancourt 2016)."""
    energy = draws.posterior["sample_stats"]["energy"]
    fraction = (energy.diff("draw") ** 2).mean("draw") / energy.var("draw")
    table = fraction.to_dataframe("ebfmi")
    least = float(fraction.min())
    if least >= EBFMI_LIMIT:
        explored = f"The sampler explores all energy levels (smallest E-BFMI {least:.2f})."
        return Finding(Outcome.YES, table, explored)
    return Finding(
        Outcome.NO,
        table,
        "The sampler moves slowly between energy levels (E-BFMI "
        f"{beyond(least, EBFMI_LIMIT, 2)}, at least {EBFMI_LIMIT} wanted), so tails are explored "
        "poorly",
        _LONGER,
    )


@check("solver", CheckKind.SAMPLING)
def check_solver(draws: CheckedDraws) -> Finding:
    """Tolerance of the solver did not matter: Pareto k below 0.7 (Timonen et al. 2023)."""
    ratios = draws.posterior["sample_stats"]["solver_log_ratio"]
    unsolved = int((~np.isfinite(ratios)).sum())
    k = pareto_k(ratios.to_numpy()) if unsolved == 0 else np.inf
    table = pd.DataFrame(
        {
            "pareto_k": [k],
            "largest_log_ratio": [float(np.abs(ratios).max())],
            "unsolved_draws": [unsolved],
        }
    )
    if unsolved:
        return Finding(
            Outcome.NO,
            table,
            f"{unsolved} of {ratios.size} draws have no solution {_UNSOLVED}",
            _TIGHTER,
            unusable=True,
        )
    if ratios.size < LEAST_DRAWS and k >= PARETO_K_LIMIT:
        meaning = f"{ratios.size} draws are too few to tell whether the solver's tolerance matters"
        return Finding(Outcome.CANNOT_TELL, table, meaning, "raise --draws")
    if k < PARETO_K_LIMIT:
        matters = f" that matters (Pareto k {k:.2f})" if np.isfinite(k) else ""
        same = "Solving every draw again at the reference tolerance changes nothing"
        return Finding(Outcome.YES, table, f"{same}{matters}.")
    return Finding(
        Outcome.NO,
        table,
        "The solver's tolerance is too loose for this posterior (Pareto k "
        f"{beyond(k, PARETO_K_LIMIT, 2)}, below {PARETO_K_LIMIT} wanted)",
        f"repeat the fit with a tighter --tolerance, {_ANEW}",
        unusable=True,
    )


def coverage(posterior: xr.DataTree) -> float:
    """Share of the data inside the central 90 % of the replicated data."""
    replicated = response_in(posterior, "posterior_predictive")
    band = replicated.quantile([TAIL, 1.0 - TAIL], ("chain", "draw")).to_numpy()
    observed = response_in(posterior, "observed_data").to_numpy()
    return float((~outside_band(observed, band, np.abs(observed))).mean())


CHAIN_CHECKS = (
    check_chains,
    check_rhat,
    check_effective_sample_size,
    check_divergences,
    check_treedepth,
    check_energy,
)
"""What any chains are checked for."""


def run_checks(draws: CheckedDraws, checks: Sequence[Check]) -> tuple[CheckResult, ...]:
    """Run checks, each on all draws."""
    return tuple(one(draws) for one in checks)
