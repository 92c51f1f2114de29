"""Discrepancies in words: what a number of the residuals says, where, and what to try."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.checks.discrepancies import Family, Leftover, discrepancies_of
from pyburgers.checks.fit_checks import CheckedDraws, Finding


class Told(NamedTuple):
    """A discrepancy in words: of a model that is right in it, and of one that misses something.

    The place is a segment, strain or time; it is empty if it is all of the test.
    """

    good: str
    bad: str
    remedy: str
    where: str


Row: TypeAlias = "pd.Series[Any]"
Tell = Callable[[Leftover, Family, Row], Told]
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
    told = tell(leftover, family, worst)
    table = table.assign(
        where=[tell(family.tests[row["test"]], family, row).where for _, row in table.iterrows()]
    )
    return family.finding(worst, table, told.good, told.bad, told.remedy)


def points_of_segment(leftover: Leftover, number: int) -> tuple[npt.NDArray[np.int64], str]:
    """Return the readings of a segment by its place among the segments, and where they lie."""
    segments = np.unique(leftover.segment)
    points = np.flatnonzero(leftover.segment == segments[number])
    place = leftover.place(int(points[0]), int(points[-1]))
    return points, place if segments.size == 1 else f"segment {segments[number] + 1} ({place})"


def beside(leftover: Leftover, residual: float, point: int) -> str:
    """Return how far data lie from the model at a point, such as ``12 MPa above it``."""
    read = leftover.likelihood.read[leftover.quantity[point]]
    size = abs(residual) / leftover.weight[point]
    far = f"{size * read.display_factor:.2g} {read.display_unit}"
    return f"{far} {'above' if residual > 0 else 'below'} the model"
