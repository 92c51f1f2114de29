"""The part of a page about a joint fit: its parameters test by test, and what pooling bought."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pyburgers.checks.fit_checks import CheckKind
from pyburgers.checks.prior_influence import decision_columns, decision_text
from pyburgers.common.array_types import FloatArray
from pyburgers.common.draws import BAND, TAIL, all_draws, value_text
from pyburgers.common.units import number
from pyburgers.comparison.same_data import fits_alone
from pyburgers.drawing.page_parts import PageFigure, PageSection, PageTable
from pyburgers.drawing.panels import draw_curve, figure_of
from pyburgers.drawing.style import BLUE, VERMILION, few_ticks, few_ticks_of_decades
from pyburgers.drawing.view import marks_text, view_of, views
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.stan_data import CENTRE, SPREAD
from pyburgers.model.display import axis_label, shown_quantity, symbol_text
from pyburgers.page import tables
from pyburgers.page.decades import Panels, spans_decades
from pyburgers.page.names import joint_key, page_keys, page_names
from pyburgers.page.overview import joint_entry
from pyburgers.page.posterior_figures import posterior_figures
from pyburgers.posterior.labelled_draws import own_name


def pooling_table(joint: Fit, separate: Sequence[Fit] = ()) -> pd.DataFrame:
    """Return mean and standard deviation (SI) of each parameter in each test.

    Pooling is `Problem.kind`, or "derived" for the reference. Separate columns are about the first
    separate fit of the same data, NaN where there is none. `quoted` and `separate_quoted` are texts
    in display units (`quoted_or_prior`).
    """
    tests, alone = joint.tests(), fits_alone(joint, separate)
    problem, reference = joint.problem, joint.problem.likelihood.reference.name
    influences, common = joint.influences(), joint.decisions()
    texts = {name: tables.quoted_or_prior(fit) for name, fit in tests.items()}
    alone_texts = {name: tables.quoted_or_prior(fit) for name, fit in alone.items()}
    rows = []
    for quantity in (*problem.free, reference):
        kind = "derived" if quantity == reference else problem.kind(quantity)
        for e, (name, fit) in enumerate(tests.items()):
            if not problem.has_effect(quantity, e):
                continue
            mean, sd = _moments(fit, quantity)
            deciders = common if kind == "shared" else influences.get(name, {})
            decided = decision_columns(deciders.get(quantity))
            alone_mean, alone_sd = _moments(alone[name], quantity)
            if alone_sd == 0:  # taken as known there
                alone_mean, alone_sd = np.nan, np.nan
            rows.append(
                {
                    "quantity": quantity,
                    "test": name,
                    "pooling": kind,
                    "mean": mean,
                    "sd": sd,
                    **{key: decided[key] for key in ("decided_by", "by_prior_of")},
                    "separate_mean": alone_mean,
                    "separate_sd": alone_sd,
                    "sd_ratio": sd / alone_sd,
                    "quoted": texts[name].get(quantity, ""),
                    "separate_quoted": alone_texts[name].get(quantity, ""),
                }
            )
    return pd.DataFrame(rows)


def sd_ratios(table: pd.DataFrame) -> pd.Series:
    """Return mean standard deviations in the joint fit over those in separate fits, by quantity."""
    both = table.dropna(subset="separate_sd").groupby("quantity", sort=False)
    ratios: pd.Series = both["sd"].mean() / both["separate_sd"].mean()
    return ratios


def _moments(fit: Fit | None, quantity: str) -> tuple[float, float]:
    """Return mean and standard deviation of draws (SI), NaN of no fit."""
    if fit is None:
        return np.nan, np.nan
    draws = fit.posterior["posterior"][quantity]
    return float(draws.mean()), float(draws.std(ddof=1))


def shown_pooling_table(table: pd.DataFrame) -> pd.DataFrame:
    """Return `pooling_table` in display units: for a quantity a row, and one of separate fits."""
    tests = list(dict.fromkeys(table["test"]))
    ratios = {str(name): float(ratio) for name, ratio in sd_ratios(table).items()}
    rows = []
    for name, group in table.groupby("quantity", sort=False):
        quantity = shown_quantity(str(name))
        by_test = group.set_index("test")
        pooling = group["pooling"].iloc[0]
        joint = {str(test): text for test, text in by_test["quoted"].items()}
        if pooling == "shared":
            joint |= dict.fromkeys(tests[1:], tables.THE_SAME)
        row = {
            **tables.named(quantity),
            "pooling": pooling,
            tables.DECISION: _decided(str(name), group),
        }
        if name not in ratios:
            rows.append({**row, **joint})
            continue
        rows.append(
            {**row, "fit": "joint", **joint, "sd joint / alone": f"{ratios[str(name)]:.2f}"}
        )
        alone = by_test["separate_quoted"][np.isfinite(by_test["separate_sd"])].to_dict()
        rows.append({"fit": "alone", **alone})
    return pd.DataFrame(rows).fillna("")


def _decided(name: str, rows: pd.DataFrame) -> str:
    """Say who decides a quantity: once where that is the same in all tests, else by test."""
    by_test = {
        test: decision_text(name, decided, priors)
        for test, decided, priors in zip(
            rows["test"], rows["decided_by"], rows["by_prior_of"], strict=True
        )
    }
    if len(set(by_test.values())) == 1:
        return next(iter(by_test.values()))
    return ", ".join(f"{test}: {text}" for test, text in by_test.items())


def shown_pooled_table(joint: Fit) -> pd.DataFrame:
    """Return centres and spreads of the partially pooled parameters as text in display units."""
    summary, draws = joint.summary("SI"), joint.posterior["posterior"].to_dataset()

    def shown(name: str, owner: str, factor: float) -> str:
        return value_text(all_draws(draws[own_name(name, owner)]) * factor)

    rows = []
    for name in joint.problem.partial:
        quantity, centre = shown_quantity(name), own_name(name, CENTRE)
        rows.append(
            {
                **tables.named(quantity),
                CENTRE: shown(name, CENTRE, quantity.display_factor),
                tables.DECISION: tables.decided_cell(centre, summary.loc[centre].to_dict()) or "",
                "spread on the real line": shown(name, SPREAD, 1.0),
                "scale of its prior": number(joint.problem.pooling.spread_scales[name]),
            }
        )
    return pd.DataFrame(rows)


def joint_sections(joints: Sequence[Fit], separate: Sequence[Fit]) -> tuple[PageSection, ...]:
    """Return the parts of a page about joint fits, each beside the fits of single tests.

    Parameters
    ----------
    joints : sequence of Fit
        Joint fits.
    separate : sequence of Fit
        Fits of single tests; those of the same data as a test of a joint fit are set beside it.

    Examples
    --------
    >>> sections = pyburgers.joint_sections([joint], [fit, other])
    """
    named = zip(page_keys(joints), page_names(joints), joints, strict=True)
    return tuple(joint_section(joint_key(key), name, joint, separate) for key, name, joint in named)


def joint_section(key: str, name: str, joint: Fit, separate: Sequence[Fit]) -> PageSection:
    """Return the part of a page about a joint fit, by its key and name on the page."""
    checks, table = joint.checks(), pooling_table(joint, separate)
    entry = joint_entry(key, name, joint)
    told = " ".join(line for kind in CheckKind for line in entry.doubts(kind))
    partial_names = joint.problem.partial
    pooled = [own_name(name, owner) for name in partial_names for owner in (CENTRE, SPREAD)]
    astray = strayed(table)
    alarms = () if astray is None else (astray,)
    return PageSection(
        key=key,
        title=f"Joint fit {name}",
        paragraphs=(told, *_bought(table), *alarms),
        details=(
            f"{', '.join(joint.tests())}, fitted together (run {joint.directory.path.name}, model "
            f"{joint.variant.short_text}). A shared parameter has one value for all of them; a "
            "partially pooled one has a value in each, normal around a common centre on the real "
            "line behind its bounds, with a spread of half-normal prior; separate ones know "
            "nothing of each other. The sections of the tests hold what the joint fit says about "
            "each; their priors of partially pooled parameters are those of the common centre. "
            "Figures of shared parameters stand here once; those of a test show its own.",
        ),
        tables=(
            PageTable(
                "pooling",
                "Values, test by test",
                shown_pooling_table(table),
                table,
                words=("quantity", "unit", "pooling", tables.DECISION, "fit"),
            ),
            *(
                (
                    PageTable(
                        "spreads",
                        "Common centres and spreads",
                        shown_pooled_table(joint),
                        joint.summary("SI").loc[pooled].reset_index(),
                        words=("quantity", "unit", tables.DECISION),
                    ),
                )
                if pooled
                else ()
            ),
            tables.checks_page_table("Checks of the joint fit", checks),
        ),
        figures=(
            PageFigure(
                "curves",
                "All tests",
                f"{CURVES_CAPTION} {marks_text([*joint.tests().values()])}".strip(),
                partial(all_curves, joint),
                told,
            ),
            PageFigure(
                "intervals",
                "Parameters test by test",
                INTERVALS_CAPTION,
                partial(intervals, joint, separate),
                " ".join((*_bought(table), *alarms)),
            ),
            *shared_figures(joint),
            *views()[joint.problem.likelihood.name].joint_figures(
                [
                    one
                    for one in joint.tests().values()
                    if one.experiment.protocol == joint.problem.likelihood.name
                ]
            ),
        ),
        alarms=tuple(f"{name}: {alarm}" for alarm in alarms),
    )


def shared_figures(joint: Fit) -> tuple[PageFigure, ...]:
    """Return figures of the posterior of the shared parameters, whose draws all tests have."""
    tests = [*joint.tests().values()]
    shown = Panels(f"shared parameters of {len(tests)} tests", joint.problem.shared)
    return tuple(
        replace(one, title=f"{one.title}, shared parameters")
        for one in posterior_figures(tests[0], shown)
    )


def strayed(table: pd.DataFrame) -> str | None:
    """Say which quantities a joint fit moves `STRAYED` or more sd from a test's own fit."""
    distance = (table["mean"] - table["separate_mean"]) / table["separate_sd"]
    far = table.assign(distance=distance)[distance.abs() >= STRAYED]
    if far.empty:
        return None
    ordered = far.sort_values("distance", key=lambda values: -values.abs())
    listed = ", ".join(
        f"{shown_quantity(str(row.quantity)).label} of {row.test} ({row.distance:+.1f} sd)"
        for row in ordered.itertuples()
    )
    return (
        f"The joint fit is {STRAYED:g} or more standard deviations away from the fit of a test "
        f"alone in {listed}: the tests do not agree on what they share, or the model is wrong in "
        "one of them."
    )


def _bought(table: pd.DataFrame) -> tuple[str, ...]:
    """Say for which shared parameters pooling narrowed the posterior, and by how much."""
    shared = table[table["pooling"] == "shared"]
    ratios = sd_ratios(shared)
    if not len(ratios):
        return ()
    listed = ", ".join(
        f"{symbol_text(shown_quantity(str(name)))} {ratio:.2f}" for name, ratio in ratios.items()
    )
    alone = list(dict.fromkeys(shared.dropna(subset="separate_sd")["test"]))
    others = (
        "the mean of those in the fits of single tests"
        if alone[1:]
        else f"that of {alone[0]} alone"
    )
    return (
        "Standard deviation of each shared parameter in the joint fit over "
        f"{others}: {listed}. Pooling narrows a parameter whose number is below 1.",
    )


STRAYED = 2.0
"""Standard deviations of the fit of a test alone from which a joint fit disagrees with it."""

CURVES_CAPTION = (
    "Every test of the joint fit with all its segments: data (circles), predictive median (solid "
    "line), retrodictions (thin lines) and the band that should hold 90 % of new measurements."
)
INTERVALS_CAPTION = (
    f"Median, central 50 % (thick) and {BAND:.0%} (thin) of every parameter in every test: in the "
    "joint fit (blue) and, where there is one, in the fit of the test alone (orange). A shared "
    "parameter has one joint posterior, shown as a band across all tests."
)
COLUMNS = 3
QUANTILES = (TAIL, 0.25, 0.5, 0.75, 1.0 - TAIL)
SHIFT = 0.14
"""Distance of the two fits of a test from its line; tests are 1 apart."""


def all_curves(joint: Fit) -> Figure:
    """Draw data, solutions and predictive bands of every test."""
    curves = [view_of(fit.experiment).curve(fit) for fit in joint.tests().values()]
    with figure_of(8.0, 3.2 * len(curves) + 0.6) as figure:
        panels = list(figure.subplots(len(curves), 1, squeeze=False)[:, 0])
        for axes, curve in zip(panels, curves, strict=True):
            draw_curve(axes, curve)
        panels[-1].set_xlabel(curves[-1].position_label)
        shown = panels[0].get_legend_handles_labels()
        figure.legend(*shown, loc="outside upper center", ncols=3)
    return figure


def intervals(joint: Fit, separate: Sequence[Fit]) -> Figure:
    """Draw intervals of every parameter in every test, joint and in fits of the same data alone."""
    tests = joint.tests()
    alone = fits_alone(joint, separate)
    quantities = (*joint.problem.free, joint.problem.likelihood.reference.name)
    n_rows = -(-len(quantities) // COLUMNS)
    with figure_of(9.0, n_rows * (0.9 + 0.28 * len(tests)) + 0.5) as figure:
        panels = figure.subplots(n_rows, COLUMNS, sharey=True, squeeze=False)
        for axes, quantity in zip(panels.flat, quantities, strict=False):
            shared = quantity in joint.problem.shared
            for line, (name, fit) in enumerate(tests.items()):
                if not joint.problem.has_effect(quantity, line):
                    continue
                if not shared:
                    _bar(axes, line - SHIFT, fit, quantity, BLUE)
                elif line == 0:
                    _across(axes, fit, quantity)
                other = alone[name]
                if other is not None:
                    _bar(axes, line + SHIFT, other, quantity, VERMILION)
            everything = np.concatenate([_draws_of(fit, quantity) for fit in tests.values()])
            if spans_decades(everything):
                axes.set_xscale("log")
                few_ticks_of_decades(axes)
            else:
                axes.xaxis.set_major_locator(few_ticks(4))
            axes.set_xlabel(axis_label(shown_quantity(quantity)))
            axes.set_yticks(range(len(tests)), list(tests))
            axes.set_ylim(len(tests) - 0.5, -0.5)
        for axes in panels.flat[len(quantities) :]:
            axes.set_axis_off()
        shown = {"joint fit": BLUE}
        if any(alone.values()):
            shown["test alone"] = VERMILION
        lines = [Line2D([], [], color=colour, linewidth=3.5) for colour in shown.values()]
        figure.legend(lines, list(shown), loc="outside upper center", ncols=2)
    return figure


def _draws_of(fit: Fit, quantity: str) -> FloatArray:
    """Return draws (SI)."""
    return all_draws(fit.posterior["posterior"].to_dataset()[quantity])


def _quantiles(fit: Fit, quantity: str) -> list[float]:
    """Quantiles of `QUANTILES` in display units."""
    draws = _draws_of(fit, quantity)
    factor = shown_quantity(quantity).display_factor
    return [float(value) for value in np.quantile(draws, QUANTILES) * factor]


def _bar(axes: Axes, line: float, fit: Fit, quantity: str, colour: str) -> None:
    low, lower, median, upper, high = _quantiles(fit, quantity)
    axes.hlines(line, low, high, colors=colour, linewidth=1.2)
    axes.hlines(line, lower, upper, colors=colour, linewidth=3.5)
    axes.plot([median], [line], "o", color="white", markeredgecolor=colour, markersize=4)


def _across(axes: Axes, fit: Fit, quantity: str) -> None:
    low, lower, median, upper, high = _quantiles(fit, quantity)
    axes.axvspan(low, high, color=BLUE, alpha=0.16, linewidth=0)
    axes.axvspan(lower, upper, color=BLUE, alpha=0.25, linewidth=0)
    axes.axvline(median, color=BLUE, linewidth=1.2)
