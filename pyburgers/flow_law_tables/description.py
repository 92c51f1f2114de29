"""Checks of whether one flow law describes a table of peak stresses: what is missed, and where.

What the fit leaves over of ln(peak stress) is compared with what fits of replicated tables leave,
as for curves (`pyburgers.checks.discrepancies`). A table has no clock: in its place stands
ln(strain rate), and in that of segments its groups of one grain size and about one temperature.
"""

from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from pyburgers.checks.discrepancies import (
    ENOUGH,
    ENOUGH_FOR_SHARES,
    LARGEST,
    OUTSIDE,
    SEGMENT_SPREAD,
    SEGMENT_TREND,
    Judged,
    beside_replicates,
    data_and_refits,
    inside_text,
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
    TINY,
    largest_residual,
    segment_parts,
    straight_line,
)
from pyburgers.common.array_types import IntArray
from pyburgers.common.draws import TAIL, FloatArray
from pyburgers.common.units import number
from pyburgers.flow_law_tables.inputs import (
    PeakStressData,
)
from pyburgers.model.display import LENGTH_FACTOR, LENGTH_UNIT

GROUP_TEMPERATURES = 2.0
"""Widest gap (K) between sorted temperatures of tests that are drawn together."""


GRID_STRESSES = 30
"""Stresses at which each group's flow law is drawn."""


GRID_MARGIN = 1.3
"""Factor by which the drawn stresses reach beyond those of a group."""


@dataclass(frozen=True, eq=False)
class Group:
    """Tests at one grain size (m) and about one temperature (harmonic mean, K) on one line.

    `points` (n,): positions in the table; `stress` (GRID_STRESSES,): Pa of the drawn line.
    """

    points: IntArray
    temperature: float
    grain_size: float
    stress: FloatArray


def groups(data: PeakStressData) -> tuple[Group, ...]:
    """Split a table by grain size, and at gaps of temperature wider than `GROUP_TEMPERATURES`."""
    found = []
    for grain_size in np.unique(data.grain_size):
        alike = np.flatnonzero(data.grain_size == grain_size)
        ordered = alike[np.argsort(data.temperature[alike], kind="stable")]
        gaps = np.flatnonzero(np.diff(data.temperature[ordered]) > GROUP_TEMPERATURES) + 1
        for points in np.split(ordered, gaps):
            stress = data.stress[points]
            found.append(
                Group(
                    points=points,
                    temperature=float(1 / np.mean(1 / data.temperature[points])),
                    grain_size=float(grain_size),
                    stress=np.geomspace(
                        stress.min() / GRID_MARGIN, stress.max() * GRID_MARGIN, GRID_STRESSES
                    ),
                )
            )
    return tuple(found)


Row: TypeAlias = "pd.Series[Any]"


DESCRIPTION = CheckKind.DESCRIPTION


LOG_STRESS = "log_stress"
"""ln(peak stress/Pa) in the groups of draws."""


BEND = "bend along the rate"


NARROW = "the widths that are handed on are then too narrow"


ONE_LAW = "see whether another mechanism rules there, and fit its tests as a table of their own"


@dataclass(frozen=True, eq=False)
class TableLeftover:
    """What the fit of a table leaves over of ln(peak stress); arrays have the shape (n,).

    Residuals are means over the draws, and weights make all uncertain alike. Rates are
    ln(strain rate s), conditions strain rate (1/s), temperature (K) and grain size (m).
    """

    residual: FloatArray
    weight: FloatArray
    log_rate: FloatArray
    group: IntArray
    conditions: pd.DataFrame
    judged: Judged

    @property
    def table(self) -> pd.DataFrame:
        """The numbers by discrepancy."""
        return self.judged.table.droplevel("test")

    def row(self, discrepancy: str) -> Row:
        """Return the row of a discrepancy."""
        return self.table.loc[[discrepancy]].iloc[0]

    def beside(self, residual: float) -> str:
        """Return how far a stress lies from the law, such as ``12 % above it``."""
        share = 100 * np.expm1(abs(residual)) if residual > 0 else -100 * np.expm1(residual)
        return f"{share:.2g} % {'above' if residual > 0 else 'below'} the flow law"

    def row_text(self, k: int) -> str:
        """Return which row it is."""
        rate, temperature, size = self.conditions.iloc[k]
        return (
            f"row {k + 1} ({rate:.2g} 1/s, {number(size * LENGTH_FACTOR)} {LENGTH_UNIT}, "
            f"{temperature:.1f} K)"
        )

    def group_text(self, k: int) -> str:
        """Return which group it is, with its number of tests."""
        here = self.conditions[self.group == k]
        size, temperature = here["grain_size"].iloc[0], here["temperature"].mean()
        tests = f"the {len(here)} tests" if len(here) > 1 else "the test"
        return (
            f"{tests} at {number(size * LENGTH_FACTOR)} {LENGTH_UNIT} and about {temperature:.0f} K"
        )


@lru_cache(maxsize=1)
def table_leftover(draws: CheckedDraws) -> TableLeftover:
    """Compare what the fit of a table leaves over with what fits of replicated tables do."""
    posterior = draws.posterior
    along = posterior["constant_data"].to_dataset()
    data = posterior["observed_data"].to_dataset()[LOG_STRESS].to_numpy()
    model, replicas = (
        posterior[part].to_dataset()[LOG_STRESS].to_numpy().reshape(-1, data.size)
        for part in ("model_response", "posterior_predictive")
    )
    scatter = posterior["posterior"].to_dataset()["stress_scatter"].to_numpy()
    error = np.sqrt((scatter**2).mean() + along["relative_stress_uncertainty"].to_numpy() ** 2)
    weight = error.mean() / error
    observed, replicated = (data - model) * weight, (replicas - model) * weight
    log_rate, group = np.log(along["strain_rate"].to_numpy()), along["group"].to_numpy()
    band = (np.quantile(replicas, (TAIL, 1.0 - TAIL), axis=0) - model.mean(axis=0)) * weight
    numbers = partial(_numbers, log_rate=log_rate, group=group)
    pairs = data_and_refits(observed, replicated, band, numbers, correlated=False)
    return TableLeftover(
        residual=observed.mean(axis=0),
        weight=weight,
        log_rate=log_rate,
        group=group,
        conditions=along[["strain_rate", "temperature", "grain_size"]].to_dataframe()[
            ["strain_rate", "temperature", "grain_size"]
        ],
        judged=beside_replicates({(name, "the table"): pair for name, pair in pairs.items()}),
    )


@check("coverage", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH_FOR_SHARES)
def check_table_coverage(draws: CheckedDraws) -> Finding:
    """Predictive band of 90 % holds about 90 % of the peak stresses."""
    left = table_leftover(draws)
    row = left.row(OUTSIDE)
    share = inside_text(row, "peak stresses")
    remedy = "look at the residuals before using the flow law"
    return _finding(left, OUTSIDE, f"{share}.", f"Only {share}", remedy)


@check("largest residual", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH)
def check_table_outlier(draws: CheckedDraws) -> Finding:
    """No peak stress is too far off beside the others."""
    left = table_leftover(draws)
    row, worst = left.row(LARGEST), int(np.abs(left.residual).argmax())
    far = (
        f"{left.row_text(worst)} lies {left.beside(left.residual[worst] / left.weight[worst])}, "
        f"{row['found']:.1f} times the root mean square of the others (at most "
        f"{row['at_most']:.1f} expected of a correct model)"
    )
    bad = f"A test is an outlier: {far}; it alone makes the scatter larger and pulls the law"
    remedy = "look it up, and leave the row out if it was a mistake"
    return _finding(left, LARGEST, f"No outlier: {far}.", bad, remedy)


@check("bend along the rate", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH)
def check_table_bend(draws: CheckedDraws) -> Finding:
    """One stress exponent holds at all rates: ln(peak stress) is straight in ln(strain rate)."""
    left = table_leftover(draws)
    if BEND not in left.table.index:
        rates = f"{np.unique(left.log_rate).size} strain rates cannot show whether n changes"
        remedy = "add tests at others"
        return Finding(Outcome.CANNOT_TELL, left.table.iloc[:0], rates, remedy)
    row, shape = left.row(BEND), _bend(left.log_rate)
    ends = shape[[left.log_rate.argmin(), left.log_rate.argmax()]].mean()
    depth = float(shape @ left.residual) * (shape.min() - ends)
    size = f"{100 * abs(np.expm1(depth)):.2g} % {'above' if depth > 0 else 'below'}"
    bend = (
        f"residuals at middle rates lie {size} a line through those at the ends, as much as "
        f"{_per_cent(row)} of fits of a correct model leave"
    )
    bad = f"The stress exponent changes with the rate: {bend}, and {NARROW}"
    good = f"One stress exponent at all rates: {bend}."
    return _finding(left, BEND, good, bad, ONE_LAW)


@check("groups", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH)
def check_table_groups(draws: CheckedDraws) -> Finding:
    """No group of one grain size and temperature is off, or tilts, as a whole."""
    left = table_leftover(draws)
    trend, _ = segment_parts(left.residual[None], left.group, left.log_rate)
    worst = int(trend[:, 0].argmax())
    here = left.group == worst
    x = left.log_rate[here]
    line = straight_line(x, left.residual[here])
    slow, fast = (left.beside(line[k]) for k in (x.argmin(), x.argmax()))
    far = f"lie {slow} where they are slowest and {fast} where they are fastest"
    offset = (
        f"{left.group_text(worst)} {far if x.size > 1 else f'lies {slow}'}, as much as "
        f"{_per_cent(left.row(SEGMENT_TREND))} of fits of a correct model leave"
    )
    bad = f"A group is off as a whole: {offset}: one flow law does not hold for it, and {NARROW}"
    return _finding(left, SEGMENT_TREND, f"No group is off as a whole: {offset}.", bad, ONE_LAW)


@check("size of residuals", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH)
def check_table_scatter(draws: CheckedDraws) -> Finding:
    """No group scatters more than the others."""
    left = table_leftover(draws)
    size = np.sqrt(np.mean((left.residual / left.weight) ** 2))
    whole = f"Peak stresses scatter by {100 * np.expm1(size):.2g} % about the flow law"
    if SEGMENT_SPREAD not in left.table.index:
        return Finding(Outcome.YES, left.table.iloc[:0], f"{whole}; there is one group only.")
    _, spread = segment_parts(left.residual[None], left.group, left.log_rate)
    worst, row = int(spread[:, 0].argmax()), left.row(SEGMENT_SPREAD)
    found = (
        f"residuals of {left.group_text(worst)} are {row['found']:.2f} times those of "
        f"the table (at most {row['at_most']:.2f} expected of a correct model)"
    )
    bad = f"One group scatters more than the others: {found}, and {NARROW}"
    remedy = "state the uncertainty of its stresses, or fit it as a table of its own"
    return _finding(left, SEGMENT_SPREAD, f"{whole}; {found}.", bad, remedy)


TABLE_CHECKS = (
    check_table_coverage,
    check_table_outlier,
    check_table_bend,
    check_table_groups,
    check_table_scatter,
)
"""What a table of peak stresses is held against."""


def _finding(left: TableLeftover, name: str, good: str, bad: str, remedy: str) -> Finding:
    """Judge a discrepancy."""
    table = left.table.loc[[name]].reset_index()
    return left.judged.finding(left.row(name), table, good, bad, remedy)


def _per_cent(row: Row) -> str:
    """Return the probability of a discrepancy."""
    return f"{100 * row['probability']:.2g} %"


def _numbers(
    residuals: FloatArray, *, log_rate: FloatArray, group: IntArray
) -> dict[str, FloatArray]:
    """Discrepancies that residuals alone say, each of shape (draws,)."""
    trend, spread = segment_parts(residuals, group, log_rate)
    found = {LARGEST: largest_residual(residuals), SEGMENT_TREND: trend.max(axis=0)}
    if np.unique(log_rate).size >= 3:
        mean_square = np.maximum((residuals**2).mean(axis=1), TINY)
        found[BEND] = (residuals @ _bend(log_rate)) ** 2 / mean_square
    if len(spread) > 1:
        found[SEGMENT_SPREAD] = np.sqrt(spread.max(axis=0))
    return found


def _bend(log_rate: FloatArray) -> FloatArray:
    """Parabola of unit length that has no part in a straight line, lowest in the middle."""
    x = log_rate - log_rate.mean()
    line = np.column_stack([np.ones_like(x), x])
    parabola = x**2 - line @ np.linalg.lstsq(line, x**2)[0]
    return np.asarray(parabola / np.linalg.norm(parabola))
