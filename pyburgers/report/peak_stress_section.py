"""The part of a page about a flow law from a table of peak stresses: figure, tables, text."""

from functools import partial

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from pyburgers.common.draws import all_draws
from pyburgers.common.units import number, with_error
from pyburgers.drawing.page_parts import PageFigure, PageSection, PageTable
from pyburgers.drawing.panels import draw_band
from pyburgers.drawing.style import BLUE, GREEN, ORANGE, PURPLE, VERMILION, style
from pyburgers.flow_law_tables.fit import GROUP_TEMPERATURES, PeakStressFit, groups
from pyburgers.flow_law_tables.inputs import FLOW_LAW_PARAMETERS, least_squares
from pyburgers.model.display import (
    LENGTH_FACTOR,
    LENGTH_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
    shown_quantity,
)
from pyburgers.model.parameters import REFERENCE_FLOW_RATE_QUANTITY
from pyburgers.report.tables import checks_page_table, fixed_row, posterior_row

FloatArray = npt.NDArray[np.float64]

PEAK_STRESS_KEY = "peak_stress"


def peak_stress_section(fit: PeakStressFit) -> PageSection:
    """Return figure, posterior, comparison with least squares, and checks of a fit.

    Parameters
    ----------
    fit : PeakStressFit
        Fit of a table of peak stresses.
    """
    data = fit.data
    comparison = least_squares_table(fit)
    return PageSection(
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
            checks_page_table("Checks of this fit", fit.checks()),
        ),
        figures=(PageFigure("flow_law", "Flow law", FLOW_LAW_CAPTION, partial(flow_law, fit)),),
        after_fits=True,
    )


def flow_law_table(fit: PeakStressFit) -> pd.DataFrame:
    """Posterior beside prior of a flow law, a row for each sampled quantity and fixed parameter.

    Returns
    -------
    DataFrame
        Text. Columns of `pyburgers.report.tables.parameter_table` up to sd / prior sd. The reference flow rate is that at
        the mean conditions of the table and has no prior of its own.
    """
    summary, rows = fit.summary(), []
    for quantity in (*FLOW_LAW_PARAMETERS, REFERENCE_FLOW_RATE_QUANTITY):
        prior = fit.priors.priors.get(quantity.name)
        rows.append(
            fixed_row(quantity, prior)
            if prior is not None and prior.is_fixed
            else posterior_row(quantity, summary.loc[quantity.name].to_dict(), prior)
        )
    return pd.DataFrame(rows).fillna("")


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


def _table(name: str, title: str, shown: pd.DataFrame, saved: pd.DataFrame) -> PageTable:
    return PageTable(name, title, shown, saved, words=("symbol", "quantity", "unit", "prior"))


GROUP_COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE)
GROUP_MARKERS = ("o", "s", "^", "D", "v")

FLOW_LAW_CAPTION = (
    "Strain rate against peak stress, both on logarithmic axes, one point for each test. Lines are "
    "the posterior median of the flow law at the grain size and mean temperature of each group of "
    f"tests (temperatures with no gap wider than {GROUP_TEMPERATURES:g} K), bands hold 90 % of its "
    "draws: they show how well the law is known, not how far single tests scatter about it, which "
    "is the scatter in the table. The slope is the stress exponent n, the distance between groups "
    "of different grain size the grain size exponent p."
)


def flow_law(fit: PeakStressFit) -> Figure:
    """Draw points, and the flow law with its 90 % band, by grain size and temperature."""
    data = fit.data
    rates = all_draws(fit.posterior["predictions"].to_dataset()["strain_rate"])
    with style():
        figure = Figure(figsize=(6.4, 4.8), layout="constrained")
        axes = figure.subplots()
        for k, group in enumerate(groups(data)):
            colour = GROUP_COLOURS[k % len(GROUP_COLOURS)]
            draw_band(
                axes,
                group.stress * STRESS_FACTOR,
                rates[:, k],
                colour,
                f"{number(round(group.grain_size * LENGTH_FACTOR, 3))} {LENGTH_UNIT}, "
                f"{group.temperature:.1f} K: flow law, 90 %",
            )
            spread = data.relative_stress_uncertainty[group.points]
            stress = data.stress[group.points] * STRESS_FACTOR
            axes.errorbar(
                stress,
                data.strain_rate[group.points],
                xerr=stress * spread if np.any(spread > 0) else None,
                linestyle="none",
                marker=GROUP_MARKERS[k % len(GROUP_MARKERS)],
                markersize=5,
                markeredgecolor="white",
                markeredgewidth=0.6,
                color=colour,
                label=f"tests ({group.points.size})",
            )
        axes.set_xscale("log")
        axes.set_yscale("log")
        low, high = axes.get_xlim()
        axes.set_xticks([tick for tick in _ROUND_STRESSES if low <= tick <= high])
        axes.xaxis.set_major_formatter(FuncFormatter(_plain))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel(f"peak stress ({STRESS_UNIT})")
        axes.set_ylabel("strain rate (1/s)")
        axes.set_title(
            f"{data.id}: {data.material}, {data.n_points} tests, {data.provenance.kind} data",
            loc="left",
        )
        axes.legend(loc="upper left")
    return figure


_ROUND_STRESSES = tuple(m * 10.0**e for e in range(-3, 5) for m in (1, 2, 3, 5, 7))
"""Ticks (MPa) that a decade of stresses or less can be read off at."""


def _plain(value: float, _: int) -> str:
    """Label a tick without an exponent; not a lambda, which could not travel between processes."""
    return number(value)
