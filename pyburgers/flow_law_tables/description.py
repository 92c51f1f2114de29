"""Checks of whether one flow law describes tables of rates: what is missed, and where.

Residuals of what was read, ln(rate) or ln(stress), are compared with those of replicated tables
that are fitted as the data were (`pyburgers.checks.discrepancies`). In the place of segments stand
the sources, or the groups of a single one. Along each condition residuals may hold neither slope
nor bend.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from pyburgers.checks.discrepancies import (
    ENOUGH,
    ENOUGH_FOR_SHARES,
    LARGEST,
    LEVEL,
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
    Check,
    CheckedDraws,
    CheckKind,
    Finding,
    Outcome,
    check,
)
from pyburgers.checks.residual_numbers import TINY, largest_residual, segment_parts, straight_line
from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.common.draws import TAIL, all_draws
from pyburgers.common.units import counted, number, rounded_to
from pyburgers.kinds.conditions import ENVIRONMENT_WORDS
from pyburgers.model.display import LENGTH_FACTOR, LENGTH_UNIT, STRESS_FACTOR, STRESS_UNIT
from pyburgers.model.parameters import ENVIRONMENT

Row: TypeAlias = "pd.Series[Any]"

LOG_READ = "log_read"
"""ln(rate s) or ln(stress/Pa), the one that was read, in the groups of draws."""

ALONG = ("temperature", "stress", "grain size", *ENVIRONMENT_WORDS)
"""Conditions along which residuals are looked at for a slope and a bend."""

MAY_BE_FEW = tuple(name for name in ALONG if name != "stress")
"""Those of which a table may have so few values that nothing is seen along them."""

MAY_BE_ZERO = ("pressure", "melt fraction")
"""Conditions that count as they are, all others by their logarithms."""

LEAST_VALUES = 3
"""Values of a condition that can show a bend along it."""

NARROW = "the widths are then too narrow"

OTHER_LAW = (
    "take a law with another mechanism or a premelting temperature, or fit a part of the rows"
)

DESCRIPTION = CheckKind.DESCRIPTION


@dataclass(frozen=True, eq=False)
class RateLeftover:
    """What a fit of rates leaves over of ln(rate); arrays have the shape (n,).

    Residuals are means over the draws, and weights make all uncertain alike. A stress that was
    read counts by the rate of the law under it; conditions have the stress of the law there.
    """

    residual: FloatArray
    weight: FloatArray
    source: IntArray
    sources: tuple[str, ...]
    group: IntArray
    groups: tuple[str, ...]
    conditions: pd.DataFrame
    judged: Judged

    @property
    def table(self) -> pd.DataFrame:
        """The numbers by discrepancy."""
        return self.judged.table.droplevel("test")

    def row(self, discrepancy: str) -> Row:
        """Return the row of a discrepancy."""
        return self.table.loc[[discrepancy]].iloc[0]

    def row_text(self, k: int) -> str:
        """Return which row it is."""
        stress, rate, temperature, size = self.conditions.iloc[k, :4]
        grains = "" if np.isnan(size) else f", {number(size * LENGTH_FACTOR)} {LENGTH_UNIT}"
        return (
            f"a row of {self.sources[self.source[k]]} ({stress * STRESS_FACTOR:.3g} {STRESS_UNIT}, "
            f"{rate:.2g} 1/s, {temperature:.1f} K{grains})"
        )


def beside(residual: float) -> str:
    """Return how far a rate lies from the law, such as ``at 1.4 times the rate of the law``."""
    return f"at {rounded_to(np.exp(residual))} times the rate of the law"


@lru_cache(maxsize=1)
def rate_leftover(draws: CheckedDraws) -> RateLeftover:
    """Compare what the fit leaves over with what fits of replicated tables do."""
    along = draws.posterior["constant_data"].to_dataset()
    left = draws.posterior["residuals"].to_dataset()
    residual, noise, deviation = (
        all_draws(left[name]) for name in ("residual", "residual_replicated", "deviation")
    )
    error = np.sqrt((deviation**2).mean(axis=0))
    weight = error.mean() / error
    observed, replicated = residual * weight, noise * weight
    model = residual.mean(axis=0) - residual  # of ln(rate), less its mean
    band = np.quantile(model + noise, (TAIL, 1.0 - TAIL), axis=0) * weight
    source, group = (along[name].to_numpy() for name in ("source", "group"))
    sources, names_of_groups = (
        tuple(json.loads(along[name].attrs["names"])) for name in ("source", "group")
    )
    names = ["stress", "strain_rate", "temperature", "grain_size", *ENVIRONMENT]
    conditions = pd.DataFrame({name: along[name].to_numpy() for name in names if name in along})
    # A stress that was read has the residual in itself: in its place stands that of the law.
    expected = np.exp(all_draws(draws.posterior["model_response"].to_dataset()[LOG_READ]).mean(0))
    was_read = along["stress_is_imposed"].to_numpy() == 0
    conditions["stress"] = np.where(was_read, expected, conditions["stress"])
    numbers = partial(_numbers, shapes=_shapes(conditions), group=group, conditions=conditions)
    pairs = data_and_refits(observed, replicated, band, numbers, correlated=False)
    return RateLeftover(
        residual=observed.mean(axis=0),
        weight=weight,
        source=source,
        sources=sources,
        group=group,
        groups=names_of_groups,
        conditions=conditions,
        judged=beside_replicates({(name, "the tables"): pair for name, pair in pairs.items()}),
    )


@check("coverage", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH_FOR_SHARES)
def check_rate_coverage(draws: CheckedDraws) -> Finding:
    """Predictive band of 90 % holds about 90 % of the readings."""
    left = rate_leftover(draws)
    share = inside_text(left.row(OUTSIDE), "readings")
    remedy = "look at the residuals before using the law"
    return _finding(left, OUTSIDE, f"{share}.", f"Only {share}", remedy)


@check("largest residual", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH)
def check_rate_outlier(draws: CheckedDraws) -> Finding:
    """No reading is too far off beside the others."""
    left = rate_leftover(draws)
    row, worst = left.row(LARGEST), int(np.abs(left.residual).argmax())
    far = (
        f"{left.row_text(worst)} lies {beside(left.residual[worst] / left.weight[worst])}, "
        f"{row['found']:.1f} times the root mean square of the others (at most "
        f"{row['at_most']:.1f} expected of a correct model)"
    )
    bad = f"A reading is an outlier: {far}; it alone makes the scatter larger and pulls the law"
    remedy = "look it up, and leave the row out if it was a mistake"
    return _finding(left, LARGEST, f"No outlier: {far}.", bad, remedy)


def _check_along(condition: str) -> Check:
    """Return the check that residuals have neither slope nor bend along a condition."""

    @check(f"along {condition}", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH)
    def check_along(draws: CheckedDraws) -> Finding:
        """Residuals have neither slope nor bend along the condition."""
        left, name = rate_leftover(draws), _along(condition)
        if name not in left.table.index:
            values = left.conditions.get(condition.replace(" ", "_"), pd.Series())
            few = (
                f"{counted(values.dropna().nunique(), 'value')} of the {condition} cannot show "
                "whether the law holds along it"
            )
            return Finding(Outcome.CANNOT_TELL, left.table.iloc[:0], few, "add tests at others")
        shape = _shapes(left.conditions)[condition]
        curve = np.exp(shape @ (shape.T @ left.residual))
        order = np.argsort(left.conditions[condition.replace(" ", "_")].to_numpy(), kind="stable")
        first, middle, last = (curve[order[k]] for k in (0, order.size // 2, -1))
        how = (
            f"from the least to the largest {condition} residuals go from {first:.2g} over "
            f"{middle:.2g} to {last:.2g} times the rate of the law, as much as "
            f"{_shares(left.row(name))}"
        )
        bad = f"The law misses how rates change with {condition}: {how}, and {NARROW}"
        return _finding(left, name, f"The law holds along {condition}: {how}.", bad, OTHER_LAW)

    return check_along


@check("groups", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH)
def check_rate_groups(draws: CheckedDraws) -> Finding:
    """No source, or group of a single one, is off, or tilts along stress, as a whole."""
    left = rate_leftover(draws)
    log_stress = np.log(left.conditions["stress"].to_numpy())
    trend, _ = segment_parts(left.residual[None], left.group, log_stress)
    worst = int(trend[:, 0].argmax())
    here = left.group == worst
    x = log_stress[here]
    line = straight_line(x, left.residual[here])
    least, largest = (beside(line[k]) for k in (x.argmin(), x.argmax()))
    along = f"lie {least} where the stress is least and {largest} where it is largest"
    far = (
        f"{left.groups[worst]} {along if x.size > 1 else f'lies {least}'}, as much as "
        f"{_shares(left.row(SEGMENT_TREND))}"
    )
    bad = f"A group is off as a whole: {far}: one law does not hold for it, and {NARROW}"
    return _finding(left, SEGMENT_TREND, f"No group is off as a whole: {far}.", bad, OTHER_LAW)


@check("size of residuals", DESCRIPTION, least_draws=LEAST_DRAWS, least_readings=ENOUGH)
def check_rate_scatter(draws: CheckedDraws) -> Finding:
    """No group scatters more than its scatter says."""
    left = rate_leftover(draws)
    size = np.sqrt(np.mean((left.residual / left.weight) ** 2))
    whole = f"Rates scatter about the law by a factor of {np.exp(size):.2g}"
    if SEGMENT_SPREAD not in left.table.index:
        return Finding(Outcome.YES, left.table.iloc[:0], f"{whole}; there is one group only.")
    log_stress = np.log(left.conditions["stress"].to_numpy())
    _, spread = segment_parts(left.residual[None], left.group, log_stress)
    worst, row = int(spread[:, 0].argmax()), left.row(SEGMENT_SPREAD)
    found = (
        f"residuals of {left.groups[worst]}, over their scatter, are {row['found']:.2f} times "
        f"those of all (at most {row['at_most']:.2f} expected of a correct model)"
    )
    bad = f"One group scatters more than the model allows: {found}, and {NARROW}"
    remedy = "state the reading errors of its rows, or fit it as a table of its own"
    return _finding(left, SEGMENT_SPREAD, f"{whole}; {found}.", bad, remedy)


RATE_CHECKS = (
    check_rate_coverage,
    check_rate_outlier,
    *(_check_along(condition) for condition in ALONG),
    check_rate_groups,
    check_rate_scatter,
)
"""What tables of rates are held against."""


def _finding(left: RateLeftover, name: str, good: str, bad: str, remedy: str) -> Finding:
    """Judge a discrepancy."""
    table = left.table.loc[[name]].reset_index()
    return left.judged.finding(left.row(name), table, good, bad, remedy)


def _shares(row: Row) -> str:
    """Return how many fits of a correct model have a discrepancy, or one as improbable."""
    here, somewhere = (
        rounded_to(100 * row[name]) for name in ("probability", "family_probability")
    )
    return (
        f"{here} % of fits of a correct model leave (and {somewhere} % somewhere; a no needs less "
        f"than {100 * LEVEL:g} %)"
    )


def _along(condition: str) -> str:
    """Name of the discrepancy of slope and bend along a condition."""
    return f"trend along {condition}"


def _numbers(
    residuals: FloatArray,
    *,
    shapes: Mapping[str, FloatArray],
    group: IntArray,
    conditions: pd.DataFrame,
) -> dict[str, FloatArray]:
    """Discrepancies that residuals alone say, each of shape (draws,)."""
    trend, spread = segment_parts(residuals, group, np.log(conditions["stress"].to_numpy()))
    mean_square = np.maximum((residuals**2).mean(axis=1), TINY)
    found = {LARGEST: largest_residual(residuals), SEGMENT_TREND: trend.max(axis=0)}
    for condition, shape in shapes.items():
        found[_along(condition)] = ((residuals @ shape) ** 2).sum(axis=1) / mean_square
    if len(spread) > 1:
        found[SEGMENT_SPREAD] = np.sqrt(spread.max(axis=0))
    return found


def _shapes(conditions: pd.DataFrame) -> dict[str, FloatArray]:
    """Return orthonormal slope and bend (n, 2), without level, by condition of enough values."""
    found = {}
    for name in ALONG:
        column = name.replace(" ", "_")
        values = conditions[column].to_numpy() if column in conditions else np.empty(0)
        here = np.isfinite(values)
        if np.unique(values[here]).size >= LEAST_VALUES:
            x = values[here] if name in MAY_BE_ZERO else np.log(values[here])
            powers = ((x - x.mean()) / x.std())[:, None] ** np.arange(3)
            shape = np.zeros((values.size, 2))
            shape[here] = np.linalg.qr(powers)[0][:, 1:]
            found[name] = shape
    return found
