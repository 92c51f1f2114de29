"""What a fit leaves over, beside what replicated data leave over: the checks of the description.

At each draw a number such as the autocorrelation of the residuals is taken of the data and of the
replicated data of that draw (a posterior predictive check of a realised discrepancy, Gelman, Meng
and Stern 1996, Statistica Sinica 6, 733-807). All such numbers of all tests of a fit are one
family: the probability of the worst is compared with that of the worst of each replicate that is
fitted as the data were (`pyburgers.checks.residual_numbers`), so that in 1 of 100 fits at most a
correct model fails any of them (`docs/checks.md`), however many there are, however they hang
together and however far the posterior follows the data. The limit of each number follows from that,
and a number fails if and only if it lies beyond its limit as it is printed.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
import xarray as xr
from scipy.optimize import bisect

from pyburgers.checks.fit_checks import CheckedDraws, Finding, Outcome
from pyburgers.checks.residual_numbers import (
    TINY,
    Tail,
    autocorrelation,
    largest_residual,
    longest_runs,
    mean_squares,
    offsets,
    outside_band,
    over_scatter,
    refitted_means,
    refitted_residuals,
    scale_of,
    segment_parts,
    signed_ranks,
)
from pyburgers.common.array_types import BoolArray, IntArray
from pyburgers.common.draws import TAIL, FloatArray, all_draws
from pyburgers.common.units import rounded_to, span_text
from pyburgers.kinds.likelihood import Likelihood, likelihoods
from pyburgers.posterior.labelled_draws import (
    CORRELATED,
    groups_of_tests,
    response_in,
    told_readings,
)

Pair: TypeAlias = tuple[FloatArray, FloatArray]

LEVEL = 0.003
"""Family probability at which a discrepancy counts. Simulated fits of correct models have it about
as often as it says (`benchmarks/check_sizes.py`); it is well below 1 in 100 so that the upper
confidence limit of such a count is, too."""

READING_ERROR_FACTOR = 1.5
"""Reading errors are seldom known better: residuals may be as much larger than the stated one."""

AS_LARGE = 2**0.5
"""Size of residuals over the reading error where as much correlates as does not."""

AUTOCORRELATION = "autocorrelation"
RUN = "longest run"
SEGMENT_TREND = "trend of a segment"
LARGEST = "largest residual"
SEGMENT_SPREAD = "spread of a segment"
OUTSIDE = "share outside"
OFFSET = "offset of a quantity"
OVER_READING_ERROR = "over reading error"
OVER_SCATTER = "over scatter of neighbours"

FAMILIES = {OVER_READING_ERROR: "stated errors", OVER_SCATTER: "estimated errors"}
"""Discrepancies that are judged apart, because errors may be larger than they seem: a correct model
is next to never beyond the limits. All others are one family."""

DECIMALS = {OUTSIDE: 3, AUTOCORRELATION: 2, SEGMENT_SPREAD: 2}
"""Decimals to which a discrepancy and its limit are printed and compared, if not 1."""

TAIL_EXPONENTS = {AUTOCORRELATION: 1.5, OFFSET: 1.5, SEGMENT_SPREAD: 4.0}
"""Power of a discrepancy, if not 1, whose tail is about exponential: of normal numbers it is 1.5,
of those that cannot exceed a value a larger one."""

NEGLIGIBLE_SHARE = 1e-3
"""Reading errors below this share of the span of the readings make no difference to a verdict."""

ENOUGH_FOR_SHARES = 10
"""Readings of a test. Of fewer a band of 90 % misses less than one by chance, and even all of one
sign are none too rare: 2 of 2^10 are less than `LEVEL`, 2 of 2^9 more."""

ENOUGH = 5
"""Readings of a test: a line and the size of the noise, which are taken from them, leave two."""

LEAST_READINGS = {
    OUTSIDE: ENOUGH_FOR_SHARES,
    AUTOCORRELATION: ENOUGH_FOR_SHARES,
    RUN: ENOUGH_FOR_SHARES,
    SEGMENT_TREND: ENOUGH,
    LARGEST: ENOUGH,
    SEGMENT_SPREAD: ENOUGH,
    OFFSET: ENOUGH,
    OVER_READING_ERROR: 1,
    OVER_SCATTER: ENOUGH,
}
"""Readings without which a discrepancy of a test tells nothing, and is left out. A stated error
needs no other readings to be compared with."""


UNTELLING = "a correct model may leave any, so that this number tells nothing here"
"""What is said of a number whose limit lies at the largest that it can be."""


@dataclass(frozen=True, eq=False)
class Leftover:
    """What a fit leaves over of one test, n readings in the order of their positions.

    Residuals (draws, n) are SI; if readings have errors of their own, over these, times their
    mean. Those of several quantities are weighed by what replicates leave over of each. Readings
    that are no upper limits are told. Every discrepancy has numbers of the data, shape (draws,),
    and of refitted replicates, shape (replicates, their draws); large ones speak against the model.
    Only those with enough readings are there.
    """

    name: str
    group: xr.DataTree
    likelihood: Likelihood[Any]
    position: FloatArray
    segment: IntArray
    quantity: IntArray
    observed: FloatArray
    weight: FloatArray
    is_told: BoolArray
    discrepancies: dict[str, Pair] = field(repr=False)

    @property
    def correlates(self) -> bool:
        """Whether the fit lets residuals correlate."""
        return CORRELATED in self.group.children

    @property
    def discrepancy(self) -> FloatArray | None:
        """Draws of the discrepancy of the law over the reading error, if the law has one."""
        is_table = "period" in self.group["constant_data"].to_dataset()
        if is_table or "posterior" not in self.group.children:
            return None
        drawn = self.group["posterior"].to_dataset().get("discrepancy")
        return None if drawn is None or not drawn.any() else all_draws(drawn).astype(np.float64)

    @property
    def reading_errors(self) -> FloatArray:
        """Draws of the noise of every reading, (draws, n), weighed as residuals are."""
        drawn, read = self.group["posterior"].to_dataset(), self.likelihood.read
        noises = [all_draws(drawn[read[k].noise]).astype(np.float64) for k in self.quantity]
        return np.stack(noises, axis=-1) * self.weight

    @property
    def residual(self) -> FloatArray:
        """Mean residual of each reading over the draws, shape (n,)."""
        mean: FloatArray = self.observed.mean(axis=0)
        return mean

    def size_text(self, size: float, quantity: int) -> str:
        """Return a size of residuals of a quantity (SI) in its display unit."""
        read = self.likelihood.read[quantity]
        return f"{rounded_to(size * read.display_factor, 3)} {read.display_unit}"

    def place(self, first: int, last: int) -> str:
        """Return where readings lie, such as ``strain 5.1 to 6 %``."""
        along = self.group["constant_data"].to_dataset()
        return place_text(self.likelihood, along, first, last)


def place_text(likelihood: Likelihood[Any], along: xr.Dataset, first: int, last: int) -> str:
    """Return where two readings lie, from 0, by `Likelihood.along`: ``time 26.7 to 29.2 days``."""
    if "period" in along:
        period, temperature = (
            span_text(along[name].to_numpy()[[first, last]], digits=4)
            for name in ("period", "temperature")
        )
        read = "modulus" if along["quantity"][first] else "attenuation"
        return f"{read} at {temperature} K, period {period} s"
    position = along[likelihood.clock.name].to_numpy()
    clock = likelihood.shown_clock(position.max())
    span = span_text(clock.display_factor * position[[first, last]], digits=3)
    return f"{clock.name} {span} {clock.display_unit}"


def points_of_segment(leftover: Leftover, number: int) -> tuple[IntArray, str]:
    """Return the readings of a segment by its place among the segments, and where they lie."""
    segments = np.unique(leftover.segment)
    points = np.flatnonzero(leftover.segment == segments[number])
    place = leftover.place(int(points[0]), int(points[-1]))
    return points, place if segments.size == 1 else f"segment {segments[number] + 1} ({place})"


@dataclass(frozen=True, eq=False)
class Judged:
    """Numbers of the data beside those of replicates that are fitted as the data were.

    The table has the index discrepancy and test. Its columns are found (mean over the draws),
    at_most (the largest that passes), probability (that a replicate has as much), and
    family_probability (that a replicate has any discrepancy as improbable).
    """

    table: pd.DataFrame
    n_replicates: int

    def outcome(self, row: "pd.Series[float]") -> Outcome:
        """Whether the model is right in a discrepancy: what is printed decides."""
        if row["found"] <= row["at_most"]:
            return Outcome.YES
        return Outcome.NO if self.n_replicates * LEVEL >= 1 else Outcome.CANNOT_TELL

    def finding(
        self, row: "pd.Series[float]", table: pd.DataFrame, good: str, bad: str, remedy: str
    ) -> Finding:
        """Put the outcome of a discrepancy into words, its numbers in a table."""
        outcome = self.outcome(row)
        if outcome is Outcome.YES:
            return Finding(outcome, table, good)
        if outcome is Outcome.CANNOT_TELL:
            few = f"{self.n_replicates} draws are too few to tell whether it is chance: "
            return Finding(outcome, table, few + bad, "raise --draws")
        return Finding(outcome, table, bad, remedy)


@dataclass(frozen=True, eq=False)
class Family(Judged):
    """All discrepancies of a fit, and the leftovers of its tests by name."""

    tests: Mapping[str, Leftover]


@lru_cache(maxsize=1)
def discrepancies_of(draws: CheckedDraws) -> Family:
    """Compare what a fit leaves over with what fits of replicated data do."""
    groups = groups_of_tests(draws.posterior)
    tests = {name: _leftover(name, group, k) for k, (name, group) in enumerate(groups.items())}
    pairs = {
        (name, test): pair
        for test, leftover in tests.items()
        for name, pair in leftover.discrepancies.items()
    }
    judged = beside_replicates(pairs)
    return Family(judged.table, judged.n_replicates, tests)


def inside_text(row: "pd.Series[Any]", readings: str) -> str:
    """Return how many readings lie inside the predictive band, from the row of `OUTSIDE`."""
    inside, least = 1.0 - row["found"], 1.0 - row["at_most"]
    expected = (
        f"at least {100 * least:.3g}% expected of a correct model" if least > 0 else UNTELLING
    )
    return f"{100 * inside:.3g}% of the {readings} lie inside the 90 % predictive band ({expected})"


def beside_replicates(pairs: Mapping[tuple[str, str], Pair]) -> Judged:
    """Compare discrepancies, by name and test, with those of refitted replicates."""
    tails = {
        key: Tail.of(refits.ravel(), TAIL_EXPONENTS.get(key[0], 1.0))
        for key, (_, refits) in pairs.items()
    }
    shares = {key: tails[key].share(refits).mean(axis=1) for key, (_, refits) in pairs.items()}
    family_of = {key: FAMILIES.get(key[0], "residuals") for key in pairs}
    least = {
        family: np.min([shares[key] for key in pairs if family_of[key] == family], axis=0)
        for family in set(family_of.values())
    }
    rows = []
    for key, (found, _) in pairs.items():
        of_family, digits = least[family_of[key]], DECIMALS.get(key[0], 1)
        probability = float(tails[key].share(found).mean())
        allowed = float(np.exp(-Tail.of(-np.log(of_family)).value(LEVEL)))
        rows.append(
            {
                "found": round(float(found.mean()), digits),
                "at_most": round(_largest_mean(tails[key], found - found.mean(), allowed), digits),
                "probability": probability,
                "family_probability": family_probability(probability, of_family),
            }
        )
    index = pd.MultiIndex.from_tuples(list(pairs), names=["discrepancy", "test"])
    return Judged(pd.DataFrame(rows, index), next(iter(shares.values())).size)


def family_probability(probability: float, least: FloatArray) -> float:
    """Return the probability that the worst discrepancy of a replicate is as improbable."""
    return float(Tail.of(-np.log(least)).share(-np.log(probability)))


def _largest_mean(tail: Tail, about_mean: FloatArray, allowed: float) -> float:
    """Return the largest mean with a probability, given a spread (draws,) about the mean."""
    # Of several means with the probability the largest.
    least = allowed * (1.0 - 1e-9)
    return float(
        bisect(
            lambda mean: tail.share(about_mean + mean).mean() - least,
            tail.ordered[0] - about_mean.max() - 1.0,
            max(tail.ordered[-1], tail.value(allowed)) - about_mean.min() + 1.0,
            xtol=1e-6,
        )
    )


def _leftover(name: str, group: xr.DataTree, number: int) -> Leftover:
    read, model, replicas = (
        response_in(group, part)
        for part in ("observed_data", "model_response", "posterior_predictive")
    )
    along, is_told = group["constant_data"].to_dataset(), told_readings(group)
    likelihood = likelihoods()[group.attrs["protocol"]]
    position = along[likelihood.clock.name].to_numpy()
    segment, quantity = (
        (along[name].to_numpy() if name in along else np.zeros(position.size)).astype(np.int64)
        for name in ("segment", "quantity")
    )
    error = along["reading_error"].to_numpy() if "reading_error" in along else None
    spread = along["typical_error"].to_numpy() if "typical_error" in along else error
    observed, replicated = (
        all_draws(values - model).astype(np.float64) for values in (read, replicas)
    )
    weight = _of_one_size(replicated, quantity) if spread is None else spread.mean() / spread
    observed, replicated = observed * weight, replicated * weight
    band = np.quantile(all_draws(replicas).astype(np.float64), (TAIL, 1.0 - TAIL), axis=0)
    pairs = data_and_refits(
        observed,
        replicated,
        (band - all_draws(model).astype(np.float64).mean(axis=0)) * weight,
        partial(_numbers, segment=segment, position=position, quantity=quantity),
        correlated=CORRELATED in group.children,
    )
    rng = np.random.default_rng([position.size, number])
    noise = rng.standard_normal((len(pairs[OUTSIDE][1]), position.size))
    if error is not None and is_told.any():
        # Many readings of one quantity would hide what is missed of another.
        over_error, of_noise = (
            np.sqrt(mean_squares(one[:, is_told], quantity[is_told]).max(axis=0))
            for one in (observed / error.mean(), noise)
        )
        pairs[OVER_READING_ERROR] = over_error, READING_ERROR_FACTOR * of_noise[:, None]
    elif CORRELATED in group.children:
        span = np.array([np.ptp(read.to_numpy()[quantity == k]) for k in quantity])
        over = partial(over_scatter, position=position, segment=segment, quantity=quantity)
        found = over(observed.mean(axis=0, keepdims=True), least=NEGLIGIBLE_SHARE * span * weight)
        if found.size:
            by_chance = over(noise, least=np.zeros(position.size)).max(axis=0)
            pairs[OVER_SCATTER] = found.max(axis=0), np.maximum(by_chance, AS_LARGE)[:, None]
    enough = {key: pair for key, pair in pairs.items() if is_told.sum() >= LEAST_READINGS[key]}
    return Leftover(
        name, group, likelihood, position, segment, quantity, observed, weight, is_told, enough
    )


def _of_one_size(replicated: FloatArray, quantity: IntArray) -> FloatArray:
    """Weights of readings, shape (n,), that make residuals of all quantities as large."""
    sizes = {k: float(np.sqrt((replicated[:, quantity == k] ** 2).mean())) for k in set(quantity)}
    largest = max(sizes.values())
    return np.array([largest / max(sizes[k], TINY) for k in quantity])


def data_and_refits(
    observed: FloatArray,
    replicated: FloatArray,
    band: FloatArray,
    numbers: Callable[[FloatArray], dict[str, FloatArray]],
    *,
    correlated: bool,
) -> dict[str, Pair]:
    """Return numbers of the data, and of replicates that are fitted as the data were.

    Residuals of the data, and of the replicated data of each draw, have the shape (draws, n),
    the predictive band about the mean response (2, n). The share of readings outside the band
    is one more number; replicates have widths of their own.
    """
    means = refitted_means(observed, replicated, correlated=correlated)
    found = numbers(observed)
    parts = [
        {
            name: values.reshape(residuals.shape[:2])
            for name, values in numbers(residuals.reshape(-1, observed.shape[1])).items()
        }
        for residuals in refitted_residuals(observed, means)
    ]
    pairs = {
        name: (values, np.concatenate([part[name] for part in parts]))
        for name, values in found.items()
    }
    # Where residuals correlate the width of the noise does not go with what is left over.
    shares = _outside(means if correlated else means / np.maximum(scale_of(means), TINY), band)
    # As many readings as no replicate has outside may be chance, too.
    shares[shares.argmax()] += 1.0 / observed.shape[1]
    pairs[OUTSIDE] = _outside(observed.mean(axis=0, keepdims=True), band), shares[:, None]
    return pairs


def _outside(values: FloatArray, band: FloatArray) -> FloatArray:
    """Share of readings, shape (..., n), outside a band, shape (2, n)."""
    share: FloatArray = outside_band(values, band, np.abs(band).max()).mean(axis=-1)
    return share


def _numbers(
    residuals: FloatArray,
    segment: IntArray,
    position: FloatArray,
    quantity: IntArray,
) -> dict[str, FloatArray]:
    """Discrepancies that residuals alone say, each of shape (draws,)."""
    joined = np.diff(segment) == 0
    trend, spread = segment_parts(residuals, segment, position)
    found = {
        AUTOCORRELATION: autocorrelation(signed_ranks(residuals), joined),
        RUN: longest_runs(residuals, joined),
        LARGEST: largest_residual(residuals),
        SEGMENT_TREND: trend.max(axis=0),
        OFFSET: np.abs(offsets(residuals, quantity)).max(axis=0),
    }
    return found if len(spread) == 1 else {**found, SEGMENT_SPREAD: np.sqrt(spread.max(axis=0))}
