"""What comparisons found, and which of two fits predicts better: better, alike or cannot tell."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from types import MappingProxyType
from typing import Self

import numpy as np
import xarray as xr
from scipy import stats

from pyburgers.checks.fit_checks import PARETO_K_LIMIT
from pyburgers.common.array_types import BoolArray, IntArray
from pyburgers.common.draws import FloatArray
from pyburgers.common.units import count_points
from pyburgers.model.read_quantities import Quantity

NO_DIFFERENCE = 4.0
"""Difference of elpd below which fits predict alike (Sivula et al. 2020, arXiv:2008.10296)."""

CLEAR = 2.0
"""Standard errors that a difference may be off, if the error is known well (`clear_errors`)."""

LEAST_UNITS = 3
"""Points, or tests, of which a standard error says something."""

REACH = 1.3
"""Points from which on readings of a segment count as independent, over the root of the number of
all points (Lazarus et al. 2018, Journal of Business and Economic Statistics 36, 541-559)."""


class PairOutcome(StrEnum):
    """What a comparison of two fits comes to."""

    BETTER = "better"
    ALIKE = "alike"
    CANNOT_TELL = "cannot tell"


@dataclass(frozen=True)
class Pair:
    """Two fits, the higher elpd first; a doubt says after "because" why numbers do not decide.

    `clear`: standard errors that the difference may be off.
    """

    better: str
    worse: str
    difference: float
    error: float
    doubt: str = ""
    clear: float = CLEAR

    @property
    def outcome(self) -> PairOutcome:
        """Better beyond `NO_DIFFERENCE` and `clear` errors; alike if both together stay below."""
        if self.doubt or not math.isfinite(self.error):
            return PairOutcome.CANNOT_TELL
        if self.difference >= max(NO_DIFFERENCE, self.clear * self.error):
            return PairOutcome.BETTER
        if abs(self.difference) + self.clear * self.error < NO_DIFFERENCE:
            return PairOutcome.ALIKE
        return PairOutcome.CANNOT_TELL

    def sentence(self, what: str = "these data") -> str:
        """Say it, of predictions of `what`."""
        error = (
            f"standard error {self.error:.1f}" if math.isfinite(self.error) else "no standard error"
        )
        numbers = f"difference of elpd {self.difference:.1f}, {error}"
        doubt = self.doubt
        if replace(self, clear=CLEAR).outcome is not self.outcome:
            doubt = f"a standard error this uncertain counts {self.clear:.1f} times, not {CLEAR:g}"
        because = f", because {doubt}" if doubt else ""
        match self.outcome:
            case PairOutcome.BETTER:
                said = f"{self.better} predicts {what} clearly better than {self.worse}"
            case PairOutcome.ALIKE:
                said = f"{self.better} and {self.worse} predict {what} alike"
            case PairOutcome.CANNOT_TELL:
                said = f"Cannot tell which of {self.better} and {self.worse} predicts {what} better"
        return f"{said} ({numbers}){because}."


def clear_errors(n_units: float) -> float:
    """Return standard errors over independent units that a difference may be off (Student's t)."""
    return float(stats.t.ppf(stats.norm.cdf(CLEAR), n_units - 1))


def standard_error(pointwise: FloatArray, segment: IntArray | None = None) -> float:
    """Return the standard error of a sum over points, or tests; NaN of a single one.

    Points of one segment, in their order, may correlate with neighbours, which count with weights
    that fall to 0 at `REACH` (Newey and West 1987, Econometrica 55, 703-708). The error is no
    smaller than that of independent points, and without segments it is that.
    """
    n = pointwise.size
    if n < 2:
        return math.nan
    apart = pointwise - pointwise.mean()
    together = independent = float(apart @ apart)
    if segment is not None:
        for k, weight, same in _neighbours(segment):
            together += 2 * weight * float((apart[k:] * apart[:-k])[same].sum())
    return math.sqrt(n / (n - 1) * max(independent, together))


def independent_points(segment: IntArray) -> float:
    """Return how many independent points a `standard_error` with segments is worth.

    The error adds products of neighbours, whose scatter leaves it less certain (Satterthwaite
    1946, Biometrics Bulletin 2, 110-114).
    """
    n = segment.size
    shared = sum(weight**2 * int(same.sum()) for _, weight, same in _neighbours(segment))
    return n**2 / max(n + 2 * shared, 1)


def _clear_of(n_points: int) -> float:
    """Return `clear_errors` of points of one segment."""
    return clear_errors(independent_points(np.zeros(n_points, dtype=np.int64)))


def _neighbours(segment: IntArray) -> Iterator[tuple[int, float, BoolArray]]:
    """Yield distances, their weights, and which pairs (n - distance,) share a segment."""
    reach = math.ceil(REACH * math.sqrt(segment.size))
    for k in range(1, min(reach, segment.size)):
        yield k, 1 - k / reach, segment[k:] == segment[:-k]


def doubt_about(units: str, n_units: int, unreliable: Sequence[str]) -> str:
    """Say as `Pair.doubt` that units, such as "2 tests", are few or fits unreliable."""
    reasons = []
    if n_units < LEAST_UNITS:
        reasons.append(f"a standard error over {units} says nothing")
    if unreliable:
        reasons.append(f"the elpd of {' and '.join(unreliable)} may be far off")
    return " and ".join(reasons)


def weight_sentence(
    best: str, other: str, weights: tuple[float, float], gains: FloatArray, *, unit: str
) -> str | None:
    """Say why a fit of lower elpd weighs more, given its gains (n,); None if it does not."""
    if weights[1] <= weights[0]:
        return None
    won = gains > 0
    return (
        f"{other} has the larger weight ({weights[1]:.2f} against {weights[0]:.2f}) although its "
        f"elpd is lower: it predicts {int(won.sum())} of {gains.size} {unit} better than {best}, "
        f"by {gains[won].sum():.1f} together, and loses {-gains[~won].sum():.1f} at the others, "
        f"{-gains.min():.1f} of it at one. A mixture escapes such losses with a small share of "
        f"{best}; a weight is a share in it, not the probability of a fit."
    )


LARGEST_ERROR = 1.0
"""Monte Carlo error of the log density of a test from which it is flagged."""

COMPARISON_TEXT = (
    "Measure: expected log predictive density of each point given all others (elpd), by importance "
    "sampling from the fit of all points; higher is better. A fit is better by a difference of "
    f"{NO_DIFFERENCE:g} or more that is also {CLEAR:g} or more of its standard errors; fits are "
    f"alike where even {CLEAR:g} standard errors further apart they would differ by less than "
    f"{NO_DIFFERENCE:g}; else the data cannot tell. Over few points a standard error counts more "
    f"often, by Student's t: of one segment {_clear_of(8):.1f} times over 8 points, "
    f"{_clear_of(60):.1f} times over 60. Standard errors allow for correlation of neighbouring "
    f"points of a segment or spectrum. Points with a Pareto k above {PARETO_K_LIMIT} "
    "are not reliable; pyburgers compare leaves them out by fitting again. The data cannot tell "
    "which fit is better if the reliable points by themselves say something else, if a fit was not "
    f"sampled well, or if there are fewer than {LEAST_UNITS} points. Weights are those of the best "
    "mixture of the fits, and arbitrary between fits that predict alike."
)

BY_TEST_TEXT = (
    "Measure: log density of each whole test given the others, readings in SI units; higher is "
    "better. The fits were repeated without each test, and the density is a ratio of marginal "
    "likelihoods, by bridge sampling. A test's own parameters are averaged under their priors, "
    "which costs as much as the test narrows them. A fit is better by a difference of "
    f"{NO_DIFFERENCE:g} that is also {CLEAR:g} standard errors, {clear_errors(3):.1f} over three "
    "tests. With two tests, or if a fit was not sampled well, the data cannot tell which fit is "
    "better."
)


@dataclass(frozen=True)
class LogIntegral:
    """Natural logarithm of an integral, and its Monte Carlo standard error."""

    value: float
    error: float

    @classmethod
    def mean(cls, one: Self, other: Self) -> Self:
        """Mean of two independent estimates; its error is at least half their distance."""
        stated = 0.5 * float(np.hypot(one.error, other.error))
        return cls(0.5 * (one.value + other.value), max(stated, 0.5 * abs(one.value - other.value)))


@dataclass(frozen=True, eq=False)
class LeaveOneOut:
    """How well a fit predicts each point from the others; arrays have the shape (n_points,).

    The elpd is the log predictive density of each point given all others, readings in SI. A
    point is exact if it was left out by fitting again, so that its Pareto k does not matter.
    The lppd is the log density of the points that the fit has seen, summed. Doubts name fits
    whose draws failed a check, notes the priors that were read off the data.
    """

    elpd: FloatArray
    pareto_k: FloatArray
    exact: BoolArray
    lppd: float
    doubts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def unreliable(self) -> BoolArray:
        """Points whose elpd may be far off: Pareto k above 0.7, and not left out in earnest."""
        return np.asarray((self.pareto_k > PARETO_K_LIMIT) & ~self.exact)

    @property
    def reliable(self) -> bool:
        """Whether no point is left with too heavy a tail and all draws passed their checks."""
        return not self.doubts and not self.unreliable.any()

    @property
    def total(self) -> float:
        """Elpd of all points."""
        return float(self.elpd.sum())

    @property
    def n_effective(self) -> float:
        """Effective number of parameters: what seeing a point adds to its own density."""
        return self.lppd - self.total


@dataclass(frozen=True, eq=False)
class Comparison:
    """Fits of the same data, the best first.

    Attributes
    ----------
    results : mapping of str to LeaveOneOut
        By name, in order of falling elpd.
    weights : array, shape (n_fits,)
        Stacking weights in the same order: shares in the mixture of predictions that predicts
        left-out points best (Yao et al. 2018, Bayesian Analysis 13, 917-1007). Weights of fits that
        predict alike are arbitrary.
    position : DataArray, dimension point
        Positions of the points on the clock of the tests (SI). The coordinate ``segment`` numbers
        the segments and spectra of all tests. Points of several tests have the coordinate ``test``.
    clock : Quantity
        Of the tests.
    variants : mapping of str to str
        Variant of the model by name of the fit, as
        `pyburgers.model.variants.ModelVariant.short_text`.
    correlated : tuple of str
        Names of the fits whose residuals correlate.

    Examples
    --------
    >>> comparison = pyburgers.compare({"one": fit, "same": fit})
    >>> len(comparison.weights)
    2
    """

    results: Mapping[str, LeaveOneOut]
    weights: FloatArray
    position: xr.DataArray
    clock: Quantity
    variants: Mapping[str, str]
    correlated: tuple[str, ...]

    @property
    def reliable(self) -> bool:
        """Whether all results are."""
        return all(result.reliable for result in self.results.values())

    @property
    def segment(self) -> IntArray:
        """Segment or spectrum of each point, shape (n_points,)."""
        return self.position["segment"].to_numpy()

    def pairs(self) -> tuple[Pair, ...]:
        """Relate every two fits, the better first.

        Examples
        --------
        >>> len(pyburgers.compare({"one": fit, "same": fit}).pairs())
        1
        """
        return tuple(
            _pair({better: one, worse: other}, self.segment)
            for (better, one), (worse, other) in itertools.combinations(self.results.items(), 2)
        )

    def gap_sentences(self, names: Mapping[str, str] = MappingProxyType({})) -> tuple[str, ...]:
        """Say what elpd compares if residuals correlate in some fits and not in others.

        Parameters
        ----------
        names : mapping of str to str
            Other names for fits in the sentence, by name.

        Returns
        -------
        tuple of str
            A sentence; none if all fits are alike in that.

        Examples
        --------
        >>> sentences = pyburgers.compare({"one": fit, "same": fit}).gap_sentences()
        """
        if not 0 < len(self.correlated) < len(self.results):
            return ()
        called = ", ".join(names.get(name, name) for name in self.correlated)
        return (
            "The expected log predictive density (elpd) is that of each reading given all others, "
            f"later ones as well: where residuals correlate ({called}), what its two "
            "neighbours missed is taken over into it, and a gap is filled whatever the law. So it "
            "is no measure of how close a law comes by itself, nor of how well it predicts another "
            "test.",
        )


def _pair(results: Mapping[str, LeaveOneOut], segment: IntArray) -> Pair:
    """Relate two fits of the same points, the better first; reliable points must say the same."""
    (better, one), (worse, other) = results.items()
    failed = [name for name, result in results.items() if result.doubts]
    unreliable = one.unreliable | other.unreliable
    pointwise = one.elpd - other.elpd
    pair = _of_points(better, worse, pointwise, segment, failed)
    rest = _of_points(better, worse, pointwise[~unreliable], segment[~unreliable], failed)
    same = rest.outcome is pair.outcome and (
        rest.difference > 0 or pair.outcome is PairOutcome.ALIKE
    )
    if pair.outcome is PairOutcome.CANNOT_TELL or same:
        return pair
    number = count_points(int(unreliable.sum()))
    return replace(pair, doubt=f"it hangs on {number} with a Pareto k above {PARETO_K_LIMIT}")


def _of_points(
    better: str, worse: str, pointwise: FloatArray, segment: IntArray, failed: Sequence[str]
) -> Pair:
    """Relate two fits by their difference at some points."""
    doubt = doubt_about(count_points(pointwise.size), pointwise.size, failed)
    error = standard_error(pointwise, segment)
    clear = clear_errors(independent_points(segment))
    return Pair(better, worse, float(pointwise.sum()), error, doubt, clear)


@dataclass(frozen=True, eq=False)
class LeaveOneTestOut:
    """How well a joint fit predicts each test from the others; arrays have the shape (n_tests,).

    Kept are the log marginal likelihoods of the fit of all tests and of those without each, of
    readings in SI units. The kind names in the plural what is left out: tests, or parts of a single
    one. Doubts name fits whose draws failed a check, notes the priors that were read off the
    data.
    """

    tests: tuple[str, ...]
    n_points: IntArray
    all_tests: LogIntegral
    without: tuple[LogIntegral, ...]
    doubts: tuple[str, ...]
    kind: str = "tests"
    notes: tuple[str, ...] = ()

    @property
    def elpd(self) -> FloatArray:
        """Log density of each test given the others (readings in SI), shape (n_tests,)."""
        return self.all_tests.value - np.array([one.value for one in self.without])

    @property
    def error(self) -> FloatArray:
        """Monte Carlo standard error of `elpd`, shape (n_tests,)."""
        return np.hypot(self.all_tests.error, self._errors_without)

    @property
    def total(self) -> float:
        """Sum of `elpd` over the tests."""
        return float(self.elpd.sum())

    @property
    def total_error(self) -> float:
        """Monte Carlo standard error of `total`, in which the joint fit counts for every test."""
        all_tests = len(self.tests) * self.all_tests.error
        return float(np.hypot(all_tests, np.linalg.norm(self._errors_without)))

    @property
    def reliable(self) -> bool:
        """Whether all errors are small and all draws passed their checks."""
        return not self.doubts and bool(np.all(self.error <= LARGEST_ERROR))

    @property
    def _errors_without(self) -> FloatArray:
        """Monte Carlo standard errors of `without`, shape (n_tests,)."""
        return np.array([one.error for one in self.without])


@dataclass(frozen=True, eq=False)
class ComparisonByTest:
    """Joint fits of the same tests, the best first.

    Attributes
    ----------
    results : mapping of str to LeaveOneTestOut
        By name, in order of falling total.
    weights : array, shape (n_fits,)
        Stacking weights in the same order, as of `Comparison`, with
        tests in the place of points.
    variants : mapping of str to str
        Variant of the model by name of the fit.

    Examples
    --------
    >>> comparison = pyburgers.compare_by_test({"shared": joint, "separate": separate})
    >>> list(comparison.results)
    ['shared', 'separate']
    """

    results: Mapping[str, LeaveOneTestOut]
    weights: FloatArray
    variants: Mapping[str, str]

    @property
    def reliable(self) -> bool:
        """Whether all results are."""
        return all(result.reliable for result in self.results.values())


def has_several_tests(comparison: Comparison) -> bool:
    """Tell whether the points are those of several tests."""
    return "test" in comparison.position.coords


def difference_by_test(one: LeaveOneTestOut, other: LeaveOneTestOut) -> tuple[float, float, float]:
    """Return the difference of two totals, its standard error over tests, and that of the draws."""
    by_test = one.elpd - other.elpd
    # A fit less itself has no error.
    monte_carlo = 0.0 if one is other else float(np.hypot(one.total_error, other.total_error))
    return float(by_test.sum()), standard_error(by_test), monte_carlo
