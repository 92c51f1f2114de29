"""Checks of a fit, each with a verdict and a sentence for a non-specialist."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy import stats

from pyburgers.common.draws import BAND, TAIL
from pyburgers.posterior.labelled_draws import CORRELATED, convergence_table, pareto_k, response_in
from pyburgers.sampling.chains import ChainFailure

RHAT_LIMIT = 1.01
ESS_LIMIT = 400
EBFMI_LIMIT = 0.3
PARETO_K_LIMIT = 0.7
ONE_IN = 0.01
"""Share of correct models that would fail the check of the coverage."""


@dataclass(frozen=True, eq=False)
class CheckResult:
    """One check.

    Attributes
    ----------
    name : str
        Short name.
    passed : bool
        Verdict.
    table : DataFrame
        The numbers behind it.
    sentence : str
        What it means and, where it failed, the usual remedy.
    """

    name: str
    passed: bool
    table: pd.DataFrame
    sentence: str


def checks_record(checks: Iterable[CheckResult]) -> list[dict[str, Any]]:
    """Return checks with their numbers as what a JSON file holds."""
    return [
        {
            "name": check.name,
            "passed": check.passed,
            "sentence": check.sentence,
            "table": json.loads(check.table.reset_index().to_json(orient="records")),
        }
        for check in checks
    ]


def check_fit(
    posterior: xr.DataTree, failures: tuple[ChainFailure, ...], max_treedepth: int
) -> tuple[CheckResult, ...]:
    """Run every check.

    Parameters
    ----------
    posterior : DataTree
        Labelled draws (`pyburgers.posterior.labelled_draws.build_posterior`).
    failures : tuple of ChainFailure
        Chains that did not finish.
    max_treedepth : int
        The sampler's limit.
    """
    return (
        check_chains(posterior, failures),
        check_rhat(posterior),
        check_effective_sample_size(posterior),
        check_divergences(posterior),
        check_treedepth(posterior, max_treedepth),
        check_energy(posterior),
        check_solver(posterior),
        check_coverage(posterior),
    )


def check_chains(posterior: xr.DataTree, failures: tuple[ChainFailure, ...]) -> CheckResult:
    """All chains finished."""
    finished = [int(chain) for chain in posterior["posterior"]["chain"]]
    table = pd.DataFrame(
        [{"chain": chain, "outcome": "finished"} for chain in finished]
        + [{"chain": failure.chain, "outcome": failure.reason} for failure in failures]
    )
    sentence = f"All {len(finished)} chains finished."
    if failures:
        sentence = f"{len(failures)} of {len(table)} chains did not finish. {failures[0].reason}"
    return CheckResult("chains", not failures, table, sentence)


def check_rhat(posterior: xr.DataTree) -> CheckResult:
    """Chains agree: R-hat at most 1.01 for every sampled quantity."""
    table = convergence_table(posterior)[["rhat"]]
    if posterior["posterior"].sizes["chain"] == 1:
        return CheckResult(
            "R-hat",
            False,
            table,
            "R-hat compares chains and there is only one; run at least two (--chains 4).",
        )
    # Draws that never moved give a NaN.
    worst = int(table["rhat"].fillna(np.inf).argmax())
    name, value = table.index[worst], float(table["rhat"].iloc[worst])
    passed = value <= RHAT_LIMIT
    sentence = f"The chains agree with each other (largest R-hat {value:.3f}, {name})."
    if not passed:
        sentence = (
            f"The chains have not yet found the same distribution (R-hat {value:.3f} for {name}, "
            f"at most {RHAT_LIMIT} wanted), so means and intervals may still move; run longer "
            "(--warmup, --draws) or tighten priors that the data do not inform."
        )
    return CheckResult("R-hat", passed, table, sentence)


def check_effective_sample_size(posterior: xr.DataTree) -> CheckResult:
    """Bulk and tail effective sample sizes of at least 400."""
    table = convergence_table(posterior)[["ess_bulk", "ess_tail"]]
    least = table.min(axis=1)
    worst, value = least.idxmin(), float(least.min())
    passed = value >= ESS_LIMIT
    sentence = (
        f"Every quantity has at least {value:.0f} effectively independent draws (least: {worst})."
    )
    if not passed:
        sentence = (
            f"{worst} has only {value:.0f} effectively independent draws, {ESS_LIMIT} are wanted "
            "for stable intervals; raise --draws in proportion."
        )
    return CheckResult("effective sample size", passed, table, sentence)


def check_divergences(posterior: xr.DataTree) -> CheckResult:
    """No divergent transitions."""
    diverging = posterior["sample_stats"]["diverging"]
    table = diverging.sum("draw").to_dataframe().rename(columns={"diverging": "divergences"})
    total = int(diverging.sum())
    sentence = "No trajectory diverged: no region of the posterior was too curved to enter."
    if total:
        sentence = (
            f"{total} of {diverging.size} trajectories diverged, so a strongly curved region may "
            "be missed; raise --adapt-delta closer to 1 and look where they sit in the pairs "
            "figure."
        )
    return CheckResult("divergences", total == 0, table, sentence)


def check_treedepth(posterior: xr.DataTree, max_treedepth: int) -> CheckResult:
    """No trajectory was cut at the treedepth limit."""
    depth = posterior["sample_stats"]["tree_depth"]
    saturated = depth >= max_treedepth
    table = pd.DataFrame(
        {
            "saturated": saturated.sum("draw").to_series(),
            "mean_leapfrog_steps": posterior["sample_stats"]["n_steps"].mean("draw").to_series(),
        }
    )
    total = int(saturated.sum())
    sentence = "No trajectory was cut short by the treedepth limit."
    if total:
        sentence = (
            f"{total} of {depth.size} trajectories were cut at treedepth {max_treedepth}, which "
            "makes the sampler slow but not wrong; raise --max-treedepth or run longer."
        )
    return CheckResult("treedepth", total == 0, table, sentence)


def check_energy(posterior: xr.DataTree) -> CheckResult:
    """E-BFMI of every chain at least 0.3 (Betancourt 2016)."""
    energy = posterior["sample_stats"]["energy"]
    fraction = (energy.diff("draw") ** 2).mean("draw") / energy.var("draw")
    table = fraction.to_dataframe("ebfmi")
    least = float(fraction.min())
    passed = least >= EBFMI_LIMIT
    sentence = f"The sampler explores all energy levels (smallest E-BFMI {least:.2f})."
    if not passed:
        sentence = (
            f"The sampler moves slowly between energy levels (E-BFMI {least:.2f}, at least "
            f"{EBFMI_LIMIT} wanted), so tails are explored poorly; lengthen the warm-up."
        )
    return CheckResult("energy", passed, table, sentence)


def check_solver(posterior: xr.DataTree) -> CheckResult:
    """Tolerance of the solver did not matter: Pareto k below 0.7 (Timonen et al. 2023)."""
    ratios = posterior["sample_stats"]["solver_log_ratio"]
    unsolved = int((~np.isfinite(ratios)).sum())
    k = pareto_k(ratios.to_numpy()) if unsolved == 0 else np.inf
    table = pd.DataFrame(
        {
            "pareto_k": [k],
            "largest_log_ratio": [float(np.abs(ratios).max())],
            "unsolved_draws": [unsolved],
        }
    )
    passed = k < PARETO_K_LIMIT
    sentence = (
        "Solving every draw again at the reference tolerance changes nothing that matters "
        f"(Pareto k {k:.2f})."
        if np.isfinite(k)
        else "Solving every draw again at the reference tolerance changes nothing."
    )
    if unsolved:
        sentence = (
            f"{unsolved} of {ratios.size} draws have no solution at the reference tolerance, so "
            "the solver cannot be trusted there; repeat the fit with a tighter --tolerance or "
            "narrower priors."
        )
    elif not passed:
        sentence = (
            f"The solver's tolerance is too loose for this posterior (Pareto k {k:.2f}, below "
            f"{PARETO_K_LIMIT} wanted); repeat the fit with a tighter --tolerance."
        )
    return CheckResult("solver", passed, table, sentence)


def coverage(posterior: xr.DataTree) -> float:
    """Share of the data inside the central 90 % of the replicated data."""
    return float(_share_inside(posterior, response_in(posterior, "observed_data")))


def _replicated_coverage(posterior: xr.DataTree) -> xr.DataArray:
    """Coverage of every replicated data set, dimensions chain and draw."""
    return _share_inside(posterior, response_in(posterior, "posterior_predictive"))


def _share_inside(posterior: xr.DataTree, response: xr.DataArray) -> xr.DataArray:
    """Share of responses, dimension point, inside the central 90 % of the replicated data."""
    replicated = response_in(posterior, "posterior_predictive")
    low, high = (replicated.quantile(q, ("chain", "draw")) for q in (TAIL, 1.0 - TAIL))
    inside: xr.DataArray = ((response >= low) & (response <= high)).mean("point")
    return inside


def check_coverage(posterior: xr.DataTree) -> CheckResult:
    """Predictive band of 90 % holds about 90 % of the data.

    The verdict asks that the count inside is not below what 99 % of correct models would give:
    by the binomial distribution where residuals are independent, by the replicated data where they
    are correlated and leave the band together.
    """
    n_points = posterior["observed_data"].sizes["point"]
    share = coverage(posterior)
    if CORRELATED in posterior.children:
        least = float(_replicated_coverage(posterior).quantile(ONE_IN))
    else:
        least = stats.binom.ppf(ONE_IN, n_points, BAND) / n_points
    table = pd.DataFrame({"share_inside": [share], "least_wanted": [least], "points": [n_points]})
    passed = bool(share >= least)
    sentence = f"{share:.0%} of the data lie inside the 90 % predictive band."
    if not passed:
        sentence = (
            f"Only {share:.0%} of the data lie inside the 90 % predictive band (at least "
            f"{least:.0%} expected of a correct model): the model or the noise does not describe "
            "this curve; look at the residuals before using its parameters."
        )
    return CheckResult("coverage", passed, table, sentence)
