"""Parts of a page about flow laws: from peak stresses, and by source of a curve's."""

from collections.abc import Mapping
from functools import partial

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.figure import Figure

from pyburgers.common.draws import all_draws
from pyburgers.common.numbers import with_error
from pyburgers.drawing.style import BLUE, GREEN, VERMILION, few_ticks, style
from pyburgers.fitting.fit import Fit
from pyburgers.flow_law_tables.figures import FLOW_LAW_CAPTION, flow_law, flow_law_table
from pyburgers.flow_law_tables.fit import PeakStressFit
from pyburgers.flow_law_tables.table import least_squares
from pyburgers.model.display import (
    LENGTH_FACTOR,
    LENGTH_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
    axis_label,
    shown_quantity,
    unit_text,
)
from pyburgers.model.flow_law_prior import FlowLawPrior
from pyburgers.model.priors import FLOW_LAW
from pyburgers.report.page import ExtraFigure, ExtraSection, ExtraTable
from pyburgers.report.tables import checks_table

FloatArray = npt.NDArray[np.float64]

PEAK_STRESS_KEY = "peak_stress"

LOG_RATE = "log_flow_rate"
"""Row of the table of a flow law beside its parameters."""

DISAGREEMENT = 3.0
"""Joint standard deviations from which two sources of a flow law are said to disagree."""

SOURCE_COLOURS = (GREEN, BLUE, VERMILION)
SHOWN_SHARE = 0.995
"""Share of the draws of every source, by its ends, that a panel reaches to."""

BINS = 40

COMBINED_CAPTION = (
    "Distribution of each part of the flow law as the other source alone, the curve alone and both "
    "together have it. The last panel is the logarithm of the flow rate at the mean conditions of "
    "the other source, which it knows best."
)


def peak_stress_section(fit: PeakStressFit) -> ExtraSection:
    """Return figure, posterior, comparison with least squares, and checks of a fit.

    Parameters
    ----------
    fit : PeakStressFit
        Fit of a table of peak stresses.
    """
    data, checks = fit.data, checks_table(fit.checks())
    comparison = least_squares_table(fit)
    return ExtraSection(
        key=PEAK_STRESS_KEY,
        title=f"Flow law of {data.material} from peak stresses",
        paragraphs=(
            f"{data.n_points} tests ({data.provenance.kind} data: {data.provenance.source}), one "
            "point each: at its peak stress undeformed material flows at the imposed rate. Fitted "
            "is ln(strain rate) = n ln(stress) - p ln(grain size) + Q_M (beta - 1/(R T)) with "
            "normal scatter.",
            "Least squares has neither temperature nor priors: where it agrees with the posterior, "
            "the table and not the prior decides the exponents. Q_M and beta are another matter "
            "where all tests are at about one temperature: their widths are then those of their "
            "priors, tied to each other by the measured rates.",
        ),
        tables=(
            _table("posterior", "Posterior", flow_law_table(fit), fit.summary().reset_index()),
            _table(
                "least_squares",
                "Exponents, against least squares",
                _shown_least_squares(comparison),
                comparison.reset_index(),
            ),
            ExtraTable(
                "checks",
                "Checks of this fit",
                checks,
                checks,
                words=("check", "verdict"),
                sentences=("sentence",),
            ),
        ),
        figures=(ExtraFigure("flow_law", "Flow law", FLOW_LAW_CAPTION, partial(flow_law, fit)),),
        after_fits=True,
    )


def least_squares_table(fit: PeakStressFit) -> pd.DataFrame:
    """Exponents by least squares and by the fit.

    Returns
    -------
    DataFrame
        Index parameter; columns least_squares, standard_error, mean, sd. Without fixed
        parameters and those that the table cannot tell.
    """
    summary = fit.summary()
    rows = {
        name: {
            "least_squares": value,
            "standard_error": error,
            "mean": float(summary["mean"][name]),
            "sd": float(summary["sd"][name]),
        }
        for name, (value, error) in least_squares(fit.data).items()
        if name in summary.index
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")


def _shown_least_squares(table: pd.DataFrame) -> pd.DataFrame:
    """Return `least_squares_table` as text."""
    rows = []
    for name, row in table.iterrows():
        quantity = shown_quantity(str(name))
        rows.append(
            {
                "quantity": quantity.label,
                "least squares": with_error(row["least_squares"], row["standard_error"]),
                "posterior": with_error(row["mean"], row["sd"]),
                "difference (sd)": f"{(row['mean'] - row['least_squares']) / row['sd']:+.2f}",
            }
        )
    return pd.DataFrame(rows)


def _table(name: str, title: str, shown: pd.DataFrame, saved: pd.DataFrame) -> ExtraTable:
    return ExtraTable(name, title, shown, saved, words=("symbol", "quantity", "unit", "prior"))


def flow_law_source_section(fits: Mapping[str, Fit]) -> tuple[ExtraSection, ...]:
    """Return what a flow law from another source adds to a curve, where a fit has one.

    Parameters
    ----------
    fits : mapping of str to Fit
        Fits of the same data by their names on the page.

    Returns
    -------
    tuple of ExtraSection
        One about the first fit with a joint prior of the flow law and the first without, none
        where one of the two is missing.
    """
    laws = {name: fit.priors.flow_law for name, fit in fits.items()}
    alone = next((name for name, law in laws.items() if law is None), None)
    both, law = next(((name, law) for name, law in laws.items() if law is not None), (None, None))
    if alone is None or both is None or law is None:
        return ()
    draws = _flow_law_draws(law, fits[alone], fits[both])
    table = flow_law_sources_table(draws)
    experiment, at = fits[alone].experiment, law.conditions
    rate = (
        f"the flow rate at {at.temperature:.1f} K, {at.stress * STRESS_FACTOR:.2f} {STRESS_UNIT} "
        f"and {at.grain_size * LENGTH_FACTOR:.0f} {LENGTH_UNIT}"
    )
    synthetic = (
        f"{experiment.id} is synthetic: that it is combined with other data shows the method and "
        "says nothing about nature.",
    )
    section = ExtraSection(
        key=f"flow_law_{both}",
        title=f"Flow law of {alone}, with another source and without",
        paragraphs=(
            f"The other source is {law.source}. {alone} is the fit of the curve alone with the "
            f"material's own priors; {both} has the other source as a joint prior of n, p, "
            f"{rate}, and beta in their place.",
            "Mean ± standard deviation. Where both together are wider than the curve alone, the "
            "curve's number was that of its own prior, which the other source replaces.",
            _agreement(draws["other source alone"][LOG_RATE], draws["curve alone"][LOG_RATE]),
            *(synthetic if experiment.provenance.kind == "synthetic" else ()),
        ),
        tables=(
            ExtraTable(
                "sources",
                "What each source knows",
                _shown_sources(table),
                table.reset_index(),
                words=("quantity", "unit"),
            ),
        ),
        figures=(
            ExtraFigure(
                "sources",
                "Flow law by source",
                COMBINED_CAPTION,
                partial(combined_flow_law, draws),
            ),
        ),
        after_fits=True,
    )
    return (section,)


def _flow_law_draws(law: FlowLawPrior, alone: Fit, both: Fit) -> dict[str, dict[str, FloatArray]]:
    """Return draws (SI) of the flow law by source and quantity."""
    found = {}
    for name, fit in (("curve alone", alone), ("both", both)):
        dataset = fit.posterior["posterior"].to_dataset()
        found[name] = {quantity: all_draws(dataset[quantity]) for quantity in FLOW_LAW}
    rng = np.random.default_rng(1)
    n_draws = found["both"][FLOW_LAW[0]].size
    drawn = [law.sample(rng) for _ in range(n_draws)]
    other = {name: np.array([draw[name] for draw in drawn]) for name in FLOW_LAW}
    by_source = {"other source alone": other, **found}
    return {
        name: {**values, LOG_RATE: law.log_flow_rate(values)} for name, values in by_source.items()
    }


def _agreement(other: FloatArray, alone: FloatArray) -> str:
    """Say how far draws of two sources are from each other."""
    distance = abs(np.mean(alone) - np.mean(other)) / np.hypot(np.std(alone), np.std(other))
    if distance < DISAGREEMENT:
        return (
            f"The two sources agree on the flow rate: they are {distance:.1f} of their joint "
            "standard deviations apart."
        )
    return (
        f"The two sources disagree on the flow rate: they are {distance:.1f} of their joint "
        "standard deviations apart, so that both together bend other parameters of the curve."
    )


def flow_law_sources_table(draws: Mapping[str, Mapping[str, FloatArray]]) -> pd.DataFrame:
    """Mean and standard deviation (SI) of each quantity by source.

    Parameters
    ----------
    draws : mapping
        By source and quantity.

    Returns
    -------
    DataFrame
        Index quantity; columns ``SOURCE mean`` and ``SOURCE sd``.
    """
    quantities = next(iter(draws.values()))
    rows = {
        quantity: {
            f"{source} {name}": float(number)
            for source, values in draws.items()
            for name, number in (
                ("mean", np.mean(values[quantity])),
                ("sd", np.std(values[quantity], ddof=1)),
            )
        }
        for quantity in quantities
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("quantity")


def _shown_sources(table: pd.DataFrame) -> pd.DataFrame:
    """Return `flow_law_sources_table` as text in display units."""
    columns = [str(column) for column in table]
    sources = [column.removesuffix(" mean") for column in columns if column.endswith(" mean")]
    rows = []
    for name, row in table.iterrows():
        label, unit, factor = "ln(flow rate)", "–", 1.0
        if name != LOG_RATE:
            quantity = shown_quantity(str(name))
            label, unit, factor = quantity.label, unit_text(quantity), quantity.display_factor
        shown = {}
        for source in sources:
            mean, sd = (row[f"{source} {key}"] * factor for key in ("mean", "sd"))
            shown[source] = with_error(mean, sd)
        share = row["both sd"] / row["curve alone sd"]
        rows.append(
            {"quantity": label, "unit": unit, **shown, "sd both / curve alone": f"{share:.2f}"}
        )
    return pd.DataFrame(rows)


def combined_flow_law(draws: Mapping[str, Mapping[str, FloatArray]]) -> Figure:
    """Draw the distributions of n, p, Q_M and the flow rate by source.

    Parameters
    ----------
    draws : mapping
        SI values by source and quantity; the last quantity is ln(flow rate s).
    """
    *parameters, log_rate = (name for name in next(iter(draws.values())) if name != "beta")
    with style():
        figure = Figure(figsize=(9.0, 2.8), layout="constrained")
        panels = figure.subplots(1, len(parameters) + 1)
        for axes, name in zip(panels, [*parameters, log_rate], strict=True):
            factor = 1.0 if name == log_rate else shown_quantity(name).display_factor
            shown = {source: values[name] * factor for source, values in draws.items()}
            low = min(float(np.quantile(v, 1 - SHOWN_SHARE)) for v in shown.values())
            high = max(float(np.quantile(v, SHOWN_SHARE)) for v in shown.values())
            for (source, values), colour in zip(shown.items(), SOURCE_COLOURS, strict=True):
                axes.hist(
                    values,
                    bins=BINS,
                    range=(low, high),
                    density=True,
                    histtype="step",
                    linewidth=1.4,
                    color=colour,
                    label=source,
                )
            axes.set_xlabel(
                "ln(flow rate · s)" if name == log_rate else axis_label(shown_quantity(name))
            )
            axes.set_yticks([])
            axes.spines["left"].set_visible(False)
            axes.xaxis.set_major_locator(few_ticks(4))
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper left", ncols=3)
    return figure
