"""Checks of whether the model describes the data: what is missed, where, and what to try."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pandas as pd

from pyburgers.checks.advice import against_reading_errors, discrepancy_text, remedy
from pyburgers.checks.discrepancies import (
    AUTOCORRELATION,
    ENOUGH,
    ENOUGH_FOR_SHARES,
    LARGEST,
    OFFSET,
    OUTSIDE,
    OVER_READING_ERROR,
    OVER_SCATTER,
    RUN,
    SEGMENT_SPREAD,
    SEGMENT_TREND,
    UNTELLING,
    Family,
    Leftover,
    discrepancies_of,
    inside_text,
    points_of_segment,
)
from pyburgers.checks.fit_checks import (
    LEAST_DRAWS,
    CheckedDraws,
    CheckKind,
    Finding,
    Outcome,
    check,
)
from pyburgers.checks.residual_numbers import (
    autocorrelation,
    longest_run,
    mean_squares,
    offsets,
    segment_parts,
    signed_ranks,
    straight_line,
)
from pyburgers.common.draws import TAIL
from pyburgers.common.units import counted, rounded_to
from pyburgers.posterior.labelled_draws import response_in

LARGEST_LEVEL_SQUARED = 12.5
"""Square of the mean of noise over its standard error, which 1 of 2500 exceeds: what a constant
that is not fitted leaves more than the variance."""

SHARE = "residual_correlated_share"
UNSTATED = "no reading error is stated"
SEVERITY = (Outcome.NO, Outcome.CANNOT_TELL, Outcome.YES)
"""The order in which findings decide."""

NARROW = "the intervals of its parameters are then too narrow"
DESCRIPTION = CheckKind.DESCRIPTION


class Told(NamedTuple):
    """A discrepancy in words: of a model that is right in it, and of one that misses something.

    The place is a segment, strain or time; it is empty if it is all of the test.
    """

    good: str
    bad: str
    remedy: str
    where: str


Row: TypeAlias = "pd.Series[Any]"
Tell = Callable[[Leftover, Row], Told]
"""Puts a discrepancy of a test into words."""


def finding_of(draws: CheckedDraws, discrepancies: tuple[str, ...], tell: Tell) -> Finding:
    """Judge discrepancies of all tests by the least probable one."""
    family = discrepancies_of(draws)
    every = family.table.reset_index()
    table = every[every["discrepancy"].isin(discrepancies)].reset_index(drop=True)
    # Some discrepancies are families of their own, so that the worst goes by the family's.
    order = table.assign(passes=table["found"] <= table["at_most"]).sort_values(
        ["passes", "family_probability", "probability"], kind="stable"
    )
    worst = table.loc[order.index[0]]
    leftover = family.tests[worst["test"]]
    told = tell(leftover, worst)
    table = table.assign(
        where=[tell(family.tests[row["test"]], row).where for _, row in table.iterrows()]
    )
    return family.finding(worst, table, told.good, told.bad, told.remedy)


def beside(leftover: Leftover, residual: float, point: int) -> str:
    """Return how far data lie from the model at a point, such as ``12 MPa above it``."""
    read = leftover.likelihood.read[leftover.quantity[point]]
    size = abs(residual) / leftover.weight[point]
    far = f"{rounded_to(size * read.display_factor)} {read.display_unit}"
    return f"{far} {'above' if residual > 0 else 'below'} the model"


@check("coverage", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH_FOR_SHARES)
def check_coverage(draws: CheckedDraws) -> Finding:
    """Predictive band of 90 % holds about 90 % of the data."""
    return finding_of(draws, (OUTSIDE,), _tell_coverage)


@check("residual trend", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH_FOR_SHARES)
def check_residual_trend(draws: CheckedDraws) -> Finding:
    """Neighbouring residuals go together no more than replicated ones do."""
    return finding_of(draws, (AUTOCORRELATION,), _tell_trend)


@check("runs", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH_FOR_SHARES)
def check_runs(draws: CheckedDraws) -> Finding:
    """No more residuals in a row have one sign than replicated ones do."""
    return finding_of(draws, (RUN,), _tell_run)


@check("trend by segment", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH)
def check_segments(draws: CheckedDraws) -> Finding:
    """No segment lies off the model, or tilts against it, as a whole, and no quantity does."""
    found = finding_of(draws, (SEGMENT_TREND, OFFSET), _tell_segment)
    of_tests = found.table.sort_values("probability", kind="stable").drop_duplicates("test")
    return replace(found, table=of_tests.sort_index())


@check("largest residual", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH)
def check_largest(draws: CheckedDraws) -> Finding:
    """No residual is too large beside the others."""
    return finding_of(draws, (LARGEST,), _tell_largest)


@check("size of residuals", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH)
def check_size(draws: CheckedDraws) -> Finding:
    """Residuals are of one size in all segments, and no larger than errors of the readings."""
    family = discrepancies_of(draws)
    sizes = pd.DataFrame.from_dict(
        {name: _sizes(leftover) for name, leftover in family.tests.items()}, "index"
    ).rename_axis("test")
    sentence = "; ".join(
        f"{row['share_of_variance']:.2%} of the variance of {name} (root mean square "
        f"{row['root_mean_square']})"
        if np.isfinite(row["share_of_variance"])
        else f"a root mean square of {row['root_mean_square']} of {name}"
        if row["root_mean_square"]
        else f"unknown in {name}, which has upper limits alone"
        for name, row in sizes.iterrows()
    )
    left = f"What the model leaves over is {sentence}" + "".join(
        f", and most of it correlates in {name}"
        for name, leftover in family.tests.items()
        if _mostly_correlates(leftover)
    )
    left += "".join(
        f"; other checks need more than {counted(leftover.is_told.sum(), 'reading')} of {name}"
        for name, leftover in family.tests.items()
        if leftover.is_told.any() and not leftover.discrepancies.keys() - {OVER_READING_ERROR}
    )
    left += "".join(
        f"; {discrepancy_text(leftover)}"
        for leftover in family.tests.values()
        if leftover.discrepancy is not None
    )
    findings = [
        *_against_variance(sizes),
        *against_reading_errors(family, sizes),
        *_against_limits(draws, family),
        *_against_neighbours(draws, family, sizes),
    ]
    unsaid = Finding(Outcome.YES, sizes, f"{UNSTATED} to compare it with.")
    worst = next((one for kind in SEVERITY for one in findings if one.outcome is kind), unsaid)
    note = f"{left[0].lower()}{left[1:]}"
    meaning = f"{left}; {worst.meaning[0].lower()}{worst.meaning[1:]}"
    return replace(worst, meaning=meaning, note=note)


def _against_limits(draws: CheckedDraws, family: Family) -> list[Finding]:
    """Compare sizes with stated errors and with each other, as far as there are such."""
    limits = (OVER_READING_ERROR, SEGMENT_SPREAD)
    stated = family.table.index.isin(limits, "discrepancy").any()
    return [finding_of(draws, limits, _tell_size)] if stated else []


def _against_variance(sizes: pd.DataFrame) -> list[Finding]:
    """Compare what is left over with what a constant would leave."""
    most = 1.0 + LARGEST_LEVEL_SQUARED / sizes["readings"]
    beyond = (sizes["share_of_variance"] / most).fillna(0.0)
    test = str(beyond.idxmax())
    if not beyond[test] > 1.0:
        return []
    missed = f"a constant would leave {test} less (at most {most[test]:.2%} by chance)"
    advice = "see whether its units and priors are right"
    return [Finding(Outcome.NO, sizes, missed, advice, leads=True)]


def _against_neighbours(draws: CheckedDraws, family: Family, sizes: pd.DataFrame) -> list[Finding]:
    """Compare sizes with errors that neighbouring readings tell, where none are stated.

    Residuals that correlate take up any misfit, but may be errors that neighbours share: larger
    ones tell nothing without a stated error. Independent ones are held against trends.
    """
    findings = []
    if family.table.index.isin((OVER_SCATTER,), "discrepancy").any():
        found = finding_of(draws, (OVER_SCATTER,), _tell_size)
        passed = found.outcome is Outcome.YES
        findings.append(
            replace(
                found,
                outcome=Outcome.YES if passed else Outcome.CANNOT_TELL,
                table=sizes.join(family.table.loc[OVER_SCATTER]),
                meaning=f"{UNSTATED}; {found.meaning}",
            )
        )
    for name, leftover in family.tests.items():
        if (
            leftover.correlates
            and leftover.discrepancy is None
            and not {OVER_SCATTER, OVER_READING_ERROR} & {*leftover.discrepancies}
        ):
            few = (
                f"residuals of {name} may correlate, and too few readings are neighbours to tell "
                "errors of readings from misfit"
            )
            told = Finding(Outcome.CANNOT_TELL, sizes, few, _state_errors(leftover))
            findings.append(told)
    return findings


def _mostly_correlates(leftover: Leftover) -> bool:
    """Whether draws show that more than half of the variance of residuals correlates."""
    if not leftover.correlates or "posterior" not in leftover.group.children:
        return False
    if leftover.discrepancy is not None:
        return False
    share = leftover.group["posterior"].to_dataset().get(SHARE)
    return share is None or float(share.quantile(TAIL)) > 0.5


def _state_errors(leftover: Leftover) -> str:
    """Return the advice to state errors of the readings of a test."""
    read = {leftover.likelihood.read[k].name for k in np.unique(leftover.quantity)}
    keys = sorted(f"{name}_uncertainty" for name in read & {"stress", "strain"})
    if keys:
        return f"state {' and '.join(keys)} in the experiment file and fit again"
    return "state the errors of its readings and fit again"


def expected_text(row: Row, *, digits: int = 1, largest: float = np.inf) -> str:
    """Return the limit of a number in brackets; `largest` is the largest that it can be at all."""
    if row["at_most"] >= largest:
        return f"({UNTELLING})"
    return f"(at most {row['at_most']:.{digits}f} expected of a correct model)"


def _passing(good: str, found: str) -> str:
    """Return what is good and the number found; that alone, if any number would pass."""
    return f"{found[0].upper()}{found[1:]}." if UNTELLING in found else f"{good}: {found}."


def _tell_coverage(leftover: Leftover, row: Row) -> Told:
    share = inside_text(row, "data")
    return Told(
        f"{share}.",
        f"Only {share}: the model or the noise does not describe this curve",
        "look at the residuals before using its parameters",
        "",
    )


def _tell_trend(leftover: Leftover, row: Row) -> Told:
    first, run, where = _run(leftover)
    n = leftover.residual.size
    # Neighbours go together most if sizes rise to the middle and fall from there; in segments of k
    # readings sums of their products are at most cos(pi / (k + 1)) of the squares.
    smoothest = signed_ranks(n - np.abs(2.0 * np.arange(n) - n + 0.5))
    in_one = float(autocorrelation(smoothest, np.ones(n - 1, dtype=np.bool_)))
    largest = round(min(in_one, np.cos(np.pi / (np.bincount(leftover.segment).max() + 1))), 2)
    found = (
        f"signed ranks of neighbouring residuals of {leftover.name} correlate with "
        f"{row['found']:.2f} {expected_text(row, digits=2, largest=largest)}"
    )
    return Told(
        _passing("No more of a trend than a correct model leaves", found),
        f"The residuals look like a trend: {found}, and {run}: the model misses the shape of the "
        f"curve there, and {NARROW}",
        remedy(leftover, first),
        where,
    )


def _tell_run(leftover: Leftover, row: Row) -> Told:
    first, run, where = _run(leftover)
    longest = np.bincount(leftover.segment).max()
    expected = (
        f"longest runs of {leftover.name} have {row['found']:.1f} residuals, a mean over the draws "
        f"{expected_text(row, largest=longest)}; of mean residuals {run}"
    )
    return Told(
        _passing("No longer a run than a correct model leaves", expected),
        f"Too long a run: {expected}: the model misses the shape of the curve there, and {NARROW}",
        remedy(leftover, first),
        where,
    )


def _tell_segment(leftover: Leftover, row: Row) -> Told:
    if row["discrepancy"] == OFFSET:
        return _tell_offset(leftover, row)
    trend, _ = segment_parts(leftover.residual[None], leftover.segment, leftover.position)
    points, where = points_of_segment(leftover, int(trend[:, 0].argmax()))
    line = straight_line(leftover.position[points], leftover.residual[points])
    offset = (
        f"a straight line through the residuals of {leftover.name}, {where}, starts "
        f"{beside(leftover, line[0], points[0])} and ends "
        f"{beside(leftover, line[-1], points[-1])}"
    )
    return Told(
        f"No segment is off as a whole: {offset}, no more than chance.",
        f"A segment is off as a whole: {offset}, which chance does not do: the model misses its "
        f"level or slope, and {NARROW}",
        remedy(leftover, int(points[0])),
        where,
    )


def _tell_offset(leftover: Leftover, row: Row) -> Told:
    numbers = np.unique(leftover.quantity)
    by_quantity = offsets(leftover.residual[None], leftover.quantity)[:, 0]
    worst = numbers[np.abs(by_quantity).argmax()]
    points = np.flatnonzero(leftover.quantity == worst)
    mean = float(leftover.residual[points].mean())
    where = leftover.place(int(points[0]), int(points[-1]))
    offset = (
        f"residuals of {leftover.name}, {where}, lie on average "
        f"{beside(leftover, mean, points[0])}; in single draws they lie {row['found']:.1f} "
        f"standard errors off, a mean over the draws {expected_text(row)}"
    )
    return Told(
        f"Nothing is displaced as a whole: {offset}.",
        f"All readings are displaced together: {offset}: the model misses their level, calls it "
        f"noise, and {NARROW}",
        "see whether the unit, the zero or the calibration of the readings is wrong, and whether "
        "priors exclude what was read",
        where,
    )


def _tell_largest(leftover: Leftover, row: Row) -> Told:
    sizes = np.abs(leftover.residual)
    point = int(sizes.argmax())
    where = leftover.place(point, point)
    others = np.sqrt(np.mean(np.delete(sizes, point) ** 2))
    beyond = int(np.sum(sizes > row["at_most"] * others))
    far = (
        f"the reading of {leftover.name} at {where} lies "
        f"{beside(leftover, leftover.residual[point], point)}; the largest of a draw is "
        f"{row['found']:.1f} times the root mean square of the others, a mean over the draws "
        f"{expected_text(row)}"
    )
    if beyond > 1:
        bad = f"{beyond} readings lie too far off: {far}"
        return Told(f"No outlier: {far}.", bad, "look at them in the raw record", where)
    return Told(
        f"No outlier: {far}.",
        f"A single reading is an outlier: {far}; it alone makes s larger and pulls the curve",
        "look at it in the raw record, and leave it out if it was a mistake",
        where,
    )


def _run(leftover: Leftover) -> tuple[int, str, str]:
    """Return the first point of the longest run of one sign, the run in words, where it lies."""
    first, last = longest_run(leftover.residual, np.diff(leftover.segment) == 0)
    where = leftover.place(first, last)
    side = "above" if leftover.residual[first] > 0 else "below"
    run = f"{last - first + 1} in a row have one sign, from {where}, the data {side} the model"
    return first, run, where


def _tell_size(leftover: Leftover, row: Row) -> Told:
    ratio, most = row["found"], row["at_most"]
    if row["discrepancy"] != SEGMENT_SPREAD:
        if row["discrepancy"] == OVER_SCATTER:
            error = "the reading error that neighbouring residuals tell"
            meaning = "they are misfit unless neighbouring readings share an error"
            advice = _state_errors(leftover)
        else:
            error = f"the stated reading error{_worst_quantity(leftover)}"
            meaning = "the model misses more than the readings are uncertain by, and calls it noise"
            advice = remedy(leftover, int(np.abs(leftover.residual).argmax()))
        found = f"residuals of {leftover.name} are {ratio:.1f} times {error}"
        return Told(
            f"{found}, as it may be (at most {most:.1f}).",
            f"{found} (at most {most:.1f}): {meaning}",
            advice,
            leftover.place(0, -1),
        )
    _, spread = segment_parts(leftover.residual[None], leftover.segment, leftover.position)
    points, where = points_of_segment(leftover, int(spread[:, 0].argmax()))
    found = f"residuals of {leftover.name}, {where}, are {ratio:.2f} times those of the whole test"
    return Told(
        f"{found}, no more than chance (at most {most:.2f}).",
        f"{found} (at most {most:.2f} expected of a correct model): the model describes one "
        f"segment worse than the others, and {NARROW}",
        remedy(leftover, int(points[0])),
        where,
    )


def _worst_quantity(leftover: Leftover) -> str:
    """Say of which quantity residuals are largest over stated errors; nothing if one is read."""
    told = leftover.is_told
    kinds = np.unique(leftover.quantity[told])
    sizes = mean_squares(leftover.observed[:, told], leftover.quantity[told]).mean(axis=1)
    return f" of the {leftover.likelihood.read[kinds[sizes.argmax()]].name}" * (kinds.size > 1)


def _sizes(leftover: Leftover) -> dict[str, object]:
    """Share of the variance of told readings that is left over, and its size in display units."""
    squares, told = (leftover.observed**2).mean(axis=0), leftover.is_told
    data = response_in(leftover.group, "observed_data").to_numpy()
    about_mean, sizes = np.zeros(data.size), []
    for kind in np.unique(leftover.quantity):
        here = (leftover.quantity == kind) & told
        if not here.any():
            continue
        # Equal readings have no spread, not even by rounding.
        beyond_first = data[here] - data[here][0]
        about_mean[here] = leftover.weight[here] * (beyond_first - beyond_first.mean())
        size = float(np.mean(squares[here] / leftover.weight[here] ** 2) ** 0.5)
        sizes.append(leftover.size_text(size, int(kind)))
    spread = float((about_mean**2).sum())
    return {
        "share_of_variance": float(squares[told].sum()) / spread if spread > 0 else np.nan,
        "root_mean_square": " and ".join(sizes),
        # Residuals that correlate may all lie aside by chance.
        "readings": 1 if leftover.correlates else max(1, told.sum()),
    }
