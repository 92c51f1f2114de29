"""Are ranks uniform, and if not, what is wrong with the posterior: bands and verdicts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from pyburgers.common.array_types import IntArray

N_BAND_SIMULATIONS = 20_000

PROBABILITY = 0.95
"""With which a band holds the whole distribution of the ranks of a right posterior."""

LEAST_DATA_SETS = 20
"""Data sets below which bands are so wide that nothing can be said."""

NOTICEABLE = 2.0
"""Standard errors from which a shift or spread of the ranks is named as what is wrong."""

Verdict = Literal["calibrated", "within chance", "not calibrated", "too few data sets"]

VERDICTS_TEXT = (
    "A quantity is calibrated if the distribution of its ranks stays inside the narrow band. For a "
    f"right program, this band holds the whole distribution in {PROBABILITY:.0%} of calibrations. "
    "Of many quantities, one leaves its own band now and then. It is within chance if it stays "
    f"inside the wide band, which holds all quantities together in {PROBABILITY:.0%}. Outside the "
    "wide band, a quantity is not calibrated. The mean rank is a share of all draws, 0.5 if right. "
    "The spread of the ranks is their standard deviation about 0.5 over that of uniform ranks, 1 "
    "if right."
)


@dataclass(frozen=True)
class RankVerdict:
    """The verdict on the ranks of one quantity."""

    mean: float
    """Mean rank as a share of all draws; 0.5 if right."""
    spread: float
    """Root mean square distance of the ranks from 0.5 over that of uniform ones; 1 if right."""
    verdict: Verdict
    sentence: str


@dataclass(frozen=True, eq=False)
class RankBands:
    """Limits (n_draws,) of the number of ranks of at most 0, 1, ..., of one quantity and of all."""

    n_ranks: int
    n_draws: int
    own: tuple[IntArray, IntArray]
    joint: tuple[IntArray, IntArray]


def rank_bands(n_ranks: int, n_draws: int, n_quantities: int) -> RankBands:
    """Return the bands of a calibration, whose quantities are taken as independent."""
    own, joint = (
        simultaneous_band(n_ranks, n_draws, probability=probability)
        for probability in (PROBABILITY, PROBABILITY ** (1 / n_quantities))
    )
    return RankBands(n_ranks, n_draws, own, joint)


def judge_ranks(ranks: Mapping[str, Sequence[int]], bands: RankBands) -> dict[str, RankVerdict]:
    """Judge every quantity."""
    return {name: _judge(np.asarray(values), bands) for name, values in ranks.items()}


def _judge(ranks: IntArray, bands: RankBands) -> RankVerdict:
    share = (ranks + 0.5) / (bands.n_draws + 1)
    mean = float(np.mean(share))
    spread = float(np.sqrt(12.0 * np.mean((share - 0.5) ** 2)))
    counts = counts_at_most(ranks, bands.n_draws)
    if ranks.size < LEAST_DATA_SETS:
        verdict: Verdict = "too few data sets"
        sentence = f"{ranks.size} data sets say nothing, expected at least {LEAST_DATA_SETS}."
    elif is_inside(counts, bands.own):
        verdict, sentence = "calibrated", "True values lie where the posterior says."
    elif is_inside(counts, bands.joint):
        verdict = "within chance"
        sentence = "The ranks leave their own band, as far as one of several quantities may."
    else:
        verdict, sentence = "not calibrated", _what_is_wrong(mean, spread, ranks.size)
    return RankVerdict(mean, spread, verdict, sentence)


def is_inside(counts: IntArray, band: tuple[IntArray, IntArray]) -> bool:
    """Tell whether counts of ranks (`counts_at_most`) lie inside a band everywhere."""
    return bool(np.all((counts >= band[0]) & (counts <= band[1])))


def _what_is_wrong(mean: float, spread: float, n_ranks: int) -> str:
    """Say which way the ranks differ most from uniform ones."""
    # Variances of u and of (u - 1/2)^2 for a uniform u are 1/12 and 1/180.
    shift = (mean - 0.5) * np.sqrt(12.0 * n_ranks)
    widening = (spread**2 - 1.0) / 12.0 * np.sqrt(180.0 * n_ranks)
    if max(abs(shift), abs(widening)) < NOTICEABLE:
        return "The ranks have the right mean and spread but another shape than uniform ones."
    if abs(shift) > abs(widening):
        side, fault = ("above", "low") if shift > 0 else ("below", "high")
        return f"True values lie {side} the draws too often: the posterior is too {fault}."
    if widening > 0:
        return "True values lie in the tails of the draws too often: the posterior is too narrow."
    return "True values lie in the middle of the draws too often: the posterior is too wide."


def simultaneous_band(
    n_ranks: int, n_draws: int, *, probability: float
) -> tuple[IntArray, IntArray]:
    """Return limits (n_draws,) that hold the distribution of uniform ranks with a probability.

    They are binomial intervals, their common level simulated (Säilynoja, Bürkner and Vehtari
    2022, Statistics and Computing 32, 32).
    """
    rng = np.random.default_rng(1)
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
