"""Checks of whether the model describes the data: what is missed, where, and what to try."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.checks.discrepancies import (
    AUTOCORRELATION,
    ENOUGH,
    ENOUGH_FOR_SHARES,
    LARGEST,
    OUTSIDE,
    OVER_READING_ERROR,
    RUN,
    SEGMENT_SPREAD,
    SEGMENT_TREND,
    Family,
    Leftover,
    discrepancies_of,
)
from pyburgers.checks.fit_checks import (
    LEAST_DRAWS,
    CheckedDraws,
    CheckKind,
    Finding,
    Outcome,
    check,
)
from pyburgers.checks.residual_numbers import longest_run, segment_parts, straight_line
from pyburgers.posterior.labelled_draws import CORRELATED, free_parameters, response_in
from pyburgers.protocols.advice import LET_CORRELATE, laws_to_try

NARROW = "the intervals of its parameters are then too narrow"
DESCRIPTION = CheckKind.DESCRIPTION


class Told(NamedTuple):
    """A discrepancy of a test in words.

    Attributes
    ----------
    good : str
        What it is, for a model that is right in it.
    bad : str
        What is missed, and where.
    remedy : str
        What to try.
    where : str
        Segment, strain or time; empty where it is all of the test.
    """

    good: str
    bad: str
    remedy: str
    where: str


Row: TypeAlias = "pd.Series[Any]"
Tell = Callable[[Leftover, Family, Row], Told]
"""Puts a discrepancy of a test into words."""


@check("coverage", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH_FOR_SHARES)
def check_coverage(draws: CheckedDraws) -> Finding:
    """Predictive band of 90 % holds about 90 % of the data."""
    return _finding(draws, (OUTSIDE,), _tell_coverage)


@check("residual trend", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH_FOR_SHARES)
def check_residual_trend(draws: CheckedDraws) -> Finding:
    """Neighbouring residuals go together no more than replicated ones do."""
    return _finding(draws, (AUTOCORRELATION,), _tell_trend)


@check("runs", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH_FOR_SHARES)
def check_runs(draws: CheckedDraws) -> Finding:
    """No more residuals in a row have one sign than replicated ones do."""
    return _finding(draws, (RUN,), _tell_run)


@check("trend by segment", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH)
def check_segments(draws: CheckedDraws) -> Finding:
    """No segment lies off the model, or tilts against it, as a whole."""
    return _finding(draws, (SEGMENT_TREND,), _tell_segment)


@check("largest residual", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH)
def check_largest(draws: CheckedDraws) -> Finding:
    """No residual is too large beside the others."""
    return _finding(draws, (LARGEST,), _tell_largest)


@check("size of residuals", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH)
def check_size(draws: CheckedDraws) -> Finding:
    """Residuals are of one size in all segments, and not above a stated reading error."""
    family = discrepancies_of(draws)
    sizes = pd.DataFrame.from_dict(
        {name: _sizes(leftover) for name, leftover in family.tests.items()}, "index"
    ).rename_axis("test")
    sentence = "; ".join(
        f"{row['share_of_variance']:.2%} of the variance of {name} (root mean square "
        f"{row['root_mean_square']})"
        if np.isfinite(row["share_of_variance"])
        else f"a root mean square of {row['root_mean_square']} of {name}"
        for name, row in sizes.iterrows()
    )
    correlated = any(CORRELATED in one.group.children for one in family.tests.values())
    left = f"What the model leaves over is {sentence}" + (
        ", and part of it correlates: it is misfit, told as such" if correlated else ""
    )
    note = f"{left[0].lower()}{left[1:]}"
    compared = family.table.index.isin((OVER_READING_ERROR, SEGMENT_SPREAD), "discrepancy")
    if not compared.any():
        meaning = f"{left}; no reading error is stated to compare it with."
        return Finding(Outcome.YES, sizes, meaning, note=note)
    judged = _finding(draws, (OVER_READING_ERROR, SEGMENT_SPREAD), _tell_size)
    meaning = f"{left}; {judged.meaning[0].lower()}{judged.meaning[1:]}"
    return judged._replace(meaning=meaning, note=note)


def _finding(draws: CheckedDraws, discrepancies: tuple[str, ...], tell: Tell) -> Finding:
    """Judge discrepancies of all tests by the least probable one."""
    family = discrepancies_of(draws)
    every = family.table.reset_index()
    table = every[every["discrepancy"].isin(discrepancies)].reset_index(drop=True)
    # Some discrepancies are families of their own, so that the outcome goes by the family's.
    worst = table.sort_values(["family_probability", "probability"], kind="stable").iloc[0]
    leftover = family.tests[worst["test"]]
    told = tell(leftover, family, worst)
    table = table.assign(
        where=[tell(family.tests[row["test"]], family, row).where for _, row in table.iterrows()]
    )
    return family.finding(worst, table, told.good, told.bad, told.remedy)


def _tell_coverage(leftover: Leftover, family: Family, row: Row) -> Told:
    inside, least = 1.0 - row["found"], 1.0 - row["at_most"]
    share = f"{inside:.0%} of the data lie inside the 90 % predictive band"
    return Told(
        f"{share} (at least {least:.0%} expected of a correct model).",
        f"Only {share} (at least {least:.0%} expected of a correct model): the model or the noise "
        "does not describe this curve",
        "look at the residuals before using its parameters",
        "",
    )


def _tell_trend(leftover: Leftover, family: Family, row: Row) -> Told:
    run, where = _run(leftover)
    found = (
        f"signed ranks of neighbouring residuals of {leftover.name} correlate with "
        f"{row['found']:.2f} (at most {row['at_most']:.2f} expected of a correct model)"
    )
    return Told(
        f"No more of a trend than a correct model leaves: {found}.",
        f"The residuals look like a trend: {found}, and {run}: the model misses the shape of the "
        f"curve there, and {NARROW}",
        _remedy(leftover, _run_of(leftover)[0]),
        where,
    )


def _tell_run(leftover: Leftover, family: Family, row: Row) -> Told:
    run, where = _run(leftover)
    expected = f"at most {row['at_most']:.0f} in a row expected of a correct model"
    return Told(
        f"No longer a run than a correct model leaves: of {leftover.name}, {run} ({expected}).",
        f"Too long a run: of {leftover.name}, {run} ({expected}): the model misses the shape of "
        f"the curve there, and {NARROW}",
        _remedy(leftover, _run_of(leftover)[0]),
        where,
    )


def _tell_segment(leftover: Leftover, family: Family, row: Row) -> Told:
    trend, _ = segment_parts(leftover.residual[None], leftover.segment, leftover.position)
    points = _points_of_segment(leftover, int(trend[:, 0].argmax()))
    where = _segment_name(leftover, points)
    line = straight_line(leftover.position[points], leftover.residual[points])
    offset = (
        f"a straight line through the residuals of {leftover.name}, {where}, starts "
        f"{_beside(leftover, line[0], points[0])} and ends "
        f"{_beside(leftover, line[-1], points[-1])}"
    )
    return Told(
        f"No segment is off as a whole: {offset}, no more than chance.",
        f"A segment is off as a whole: {offset}, which chance does not do: the model misses its "
        f"level or slope, and {NARROW}",
        _remedy(leftover, int(points[0])),
        where,
    )


def _tell_largest(leftover: Leftover, family: Family, row: Row) -> Told:
    sizes = np.abs(leftover.residual)
    point = int(sizes.argmax())
    where = leftover.place(point, point)
    others = np.sqrt(np.mean(np.delete(sizes, point) ** 2))
    beyond = int(np.sum(sizes > row["at_most"] * others))
    far = (
        f"the reading of {leftover.name} at {where} lies "
        f"{_beside(leftover, leftover.residual[point], point)}, {row['found']:.1f} times the root "
        f"mean square of the others (at most {row['at_most']:.1f} expected of a correct model)"
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


def _tell_size(leftover: Leftover, family: Family, row: Row) -> Told:
    ratio, most = row["found"], row["at_most"]
    if row["discrepancy"] == OVER_READING_ERROR:
        found = f"residuals of {leftover.name} are {ratio:.1f} times the stated reading error"
        return Told(
            f"{found}, as it may be (at most {most:.1f}).",
            f"{found} (at most {most:.1f}): the model misses more than the readings are uncertain "
            "by, and calls it noise",
            _remedy(leftover, int(np.abs(leftover.residual).argmax())),
            leftover.place(0, -1),
        )
    _, spread = segment_parts(leftover.residual[None], leftover.segment, leftover.position)
    points = _points_of_segment(leftover, int(spread[:, 0].argmax()))
    where = _segment_name(leftover, points)
    ratio, most = np.sqrt(ratio), np.sqrt(most)
    found = f"residuals of {leftover.name}, {where}, are {ratio:.1f} times those of the whole test"
    return Told(
        f"{found}, no more than chance (at most {most:.1f}).",
        f"{found} (at most {most:.1f} expected of a correct model): the model describes one "
        f"segment worse than the others, and {NARROW}",
        _remedy(leftover, int(points[0])),
        where,
    )


def _sizes(leftover: Leftover) -> dict[str, object]:
    """Share of the variance of the data that is left over, and its size in display units."""
    squares = (leftover.observed**2).mean(axis=0)
    data = response_in(leftover.group, "observed_data").to_numpy()
    about_mean, sizes = np.zeros(data.size), []
    for kind in np.unique(leftover.quantity):
        here = leftover.quantity == kind
        about_mean[here] = leftover.weight[here] * (data[here] - data[here].mean())
        size = float(np.mean(squares[here] / leftover.weight[here] ** 2) ** 0.5)
        sizes.append(leftover.size_text(size, int(kind)))
    spread = float((about_mean**2).sum())
    return {
        "share_of_variance": float(squares.sum()) / spread if spread > 0 else np.nan,
        "root_mean_square": " and ".join(sizes),
    }


def _run_of(leftover: Leftover) -> tuple[int, int]:
    return longest_run(leftover.residual, np.diff(leftover.segment) == 0)


def _run(leftover: Leftover) -> tuple[str, str]:
    """Return the longest run of one sign in words, and where it lies."""
    first, last = _run_of(leftover)
    where = leftover.place(first, last)
    side = "above" if leftover.residual[first] > 0 else "below"
    return (
        f"{last - first + 1} in a row have one sign, from {where}, the data {side} the model",
        where,
    )


def _points_of_segment(leftover: Leftover, number: int) -> npt.NDArray[np.int64]:
    return np.flatnonzero(leftover.segment == np.unique(leftover.segment)[number])


def _segment_name(leftover: Leftover, points: npt.NDArray[np.int64]) -> str:
    place = leftover.place(int(points[0]), int(points[-1]))
    if np.unique(leftover.segment).size == 1:
        return place
    return f"segment {leftover.segment[points[0]] + 1} ({place})"


def _beside(leftover: Leftover, residual: float, point: int) -> str:
    """Return how far data lie from the model at a point, such as ``12 MPa above it``."""
    read = leftover.protocol.read[leftover.quantity[point]]
    size = abs(residual) / leftover.weight[point]
    far = f"{size * read.display_factor:.2g} {read.display_unit}"
    return f"{far} {'above' if residual > 0 else 'below'} the model"


def _remedy(leftover: Leftover, point: int) -> str:
    """Return what to try where the shape is missed from a point on."""
    free = _free_parameters(leftover)
    along = leftover.group["constant_data"].to_dataset()
    known = leftover.protocol.remedy(free, along)
    if known is not None:
        return known
    laws = laws_to_try(free)
    steps = leftover.segment[-1] > leftover.segment[0]
    if steps or "segment" not in along:
        behind = "it lies behind a step of the rate: " if leftover.segment[point] > 0 else ""
        first = f"{behind}see whether the test was paused or unloaded there, and " + (
            f"try a law that answers changes of the rate otherwise ({laws})"
            if laws
            else "compare with other laws"
        )
    else:
        first = (
            "at one rate other laws hardly differ, so see whether the test was paused or unloaded "
            "there, and fit it together with tests at other rates"
        )
    # Where strain goes back and forth no residuals correlate along it.
    if "segment" not in along or CORRELATED in leftover.group.children:
        return first
    return f"{first}; {LET_CORRELATE}"


def _free_parameters(leftover: Leftover) -> Sequence[str]:
    return free_parameters(leftover.group) if "posterior" in leftover.group.children else ()
