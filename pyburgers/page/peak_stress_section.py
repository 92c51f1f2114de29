"""The part of a page about a flow law from a table of peak stresses: figure, tables, text."""

from functools import partial

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter

from pyburgers.common.draws import FloatArray, all_draws
from pyburgers.common.units import number, with_error
from pyburgers.drawing.page_parts import PageFigure, PageSection, PageTable
from pyburgers.drawing.panels import draw_band, draw_dots, figure_of
from pyburgers.drawing.style import BLUE, GREEN, MARKERS, ORANGE, PURPLE, VERMILION
from pyburgers.flow_law_tables.description import GROUP_TEMPERATURES, groups
from pyburgers.flow_law_tables.fit import (
    FLOW_RATE_OF_TEST,
    PEAK_SOFTENING,
    PeakStressFit,
)
from pyburgers.flow_law_tables.inputs import FLOW_LAW_PARAMETERS, least_squares
from pyburgers.kinds.stan_data import REFERENCE_FLOW_RATE
from pyburgers.model.arrhenius import log_slowdown
from pyburgers.model.display import (
    LENGTH_FACTOR,
    LENGTH_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
    shown_quantity,
)
from pyburgers.model.parameters import REFERENCE_FLOW_RATE_QUANTITY
from pyburgers.page.tables import checks_page_table, fixed_row, posterior_row

PEAK_STRESS_KEY = "peak_stress"


def peak_stress_section(fit: PeakStressFit, key: str = PEAK_STRESS_KEY) -> PageSection:
    """Return figure, posterior, comparison with least squares, and checks of a fit.

    Parameters
    ----------
    fit : PeakStressFit
        The fit.
    key : str
        Name of the files and the anchor of the part, unique on the page.

    Returns
    -------
    PageSection
        A part of a page, behind the fits.

    Examples
    --------
    >>> section = pyburgers.peak_stress_section(peaks)
    """
    data = fit.data
    comparison = least_squares_table(fit)
    compared = _table(
        "least_squares",
        "Exponents, against least squares",
        _shown_least_squares(comparison),
        comparison.reset_index(),
    )
    return PageSection(
        key=key,
        title=f"Flow law of {data.material} from peak stresses",
        paragraphs=(_hand_over_text(fit),),
        details=(
            f"{data.n_points} tests ({data.provenance.kind} data: {data.provenance.source}), one "
            "point each: the rate is imposed, the peak stress is measured. Fitted is "
            "ln(peak stress) = ln S_0 - h with normal scatter between tests, S_0 being the stress "
            "at which undeformed material flows at the imposed rate, n ln S_0 = ln(strain rate) + "
            "p ln(grain size) - Q_M (beta - 1/(R T)), and h the softening up to the peak.",
            _softening_text(fit),
            _temperature_text(fit),
            "Least squares of ln(peak stress) on ln(strain rate) and ln(grain size) knows neither "
            "softening nor temperature: its exponents are those across peaks. If softening "
            "grows with the rate, the exponent of the flow law is smaller. A table at about one "
            "temperature says one number of Q_M and beta, the rate. It ties them to each other; "
            "the width of each comes from the priors of both.",
        ),
        tables=(
            _table("posterior", "Posterior", flow_law_table(fit), fit.summary("SI").reset_index()),
            *(() if comparison.empty else (compared,)),
            checks_page_table("Checks of this fit", fit.checks()),
        ),
        figures=(
            PageFigure(
                "flow_law",
                "Flow law",
                FLOW_LAW_CAPTION,
                partial(flow_law, fit),
                _exponent_text(fit),
            ),
        ),
        after_fits=True,
    )


def _softening_text(fit: PeakStressFit) -> str:
    """Say how much weaker than undeformed material the peaks are taken to be, and why."""
    predictions = fit.posterior["predictions"].to_dataset()
    softening = all_draws(predictions[PEAK_SOFTENING])
    exponent = all_draws(fit.posterior["posterior"].to_dataset()["stress_exponent"])
    low, middle, high = (number(100 * strain) for strain in fit.softening.peak_strain.round(4))
    stated = fit.data.peak_strain
    where = (
        "The table does not state at what strain the peaks are"
        if stated is None
        else f"The table states peaks at {100 * stated.mean:.1f} ± {100 * stated.sd:.1f} % strain"
    )
    return (
        f"{where}; the peaks simulated with the priors of a curve are at {middle} % ({low} to "
        f"{high} %, 90 %). Of the softening the table tells nothing by itself: h and its change "
        "with rate, stress and grain size are parameters, with those simulations as prior. At the "
        f"mean conditions h = {_mean_and_sd(softening)}, in ln(strain rate) n h = "
        f"{_mean_and_sd(exponent * softening)}."
    )


def _temperature_text(fit: PeakStressFit) -> str:
    """State by how much rates are corrected for temperature within the table."""
    enthalpy = all_draws(fit.posterior["posterior"].to_dataset()["activation_enthalpy"])
    mean, temperature = fit.data.mean_conditions.temperature, fit.data.temperature
    coldest, warmest = (
        _mean_and_sd(log_slowdown(enthalpy, at, mean))
        for at in (temperature.min(), temperature.max())
    )
    return (
        f"The tests were at {temperature.min():.2f} to {temperature.max():.2f} K. The activation "
        f"enthalpy brings them to {mean:.2f} K: ln(strain rate) changes by {coldest} for the "
        f"coldest and {warmest} for the warmest."
    )


def _hand_over_text(fit: PeakStressFit) -> str:
    """Say how well the flow rate is known, of all tests and of another one."""
    log_rate = np.log(all_draws(fit.posterior["posterior"].to_dataset()[REFERENCE_FLOW_RATE]))
    of_test = all_draws(fit.posterior["predictions"].to_dataset()[FLOW_RATE_OF_TEST])
    return (
        f"At the mean conditions ln(flow rate · s) is {_mean_and_sd(log_rate)} for the tests as a "
        f"whole and {_mean_and_sd(of_test)} for another single one, which scatters about them: "
        "the latter is what a curve can take as its prior."
    )


def _exponent_text(fit: PeakStressFit) -> str:
    """State the slope of the flow law."""
    exponent = all_draws(fit.posterior["posterior"].to_dataset()["stress_exponent"])
    return f"strain rate grows with stress to the power {_mean_and_sd(exponent)}."


def _mean_and_sd(draws: FloatArray) -> str:
    return with_error(float(np.mean(draws)), float(np.std(draws)))


def flow_law_table(fit: PeakStressFit) -> pd.DataFrame:
    """Return posterior beside prior of a flow law as text, with the columns of `posterior_row`.

    The reference flow rate is that at the mean conditions of the table; it has no prior of its own.
    """
    summary, rows = fit.summary("SI"), []
    for quantity in (*FLOW_LAW_PARAMETERS, REFERENCE_FLOW_RATE_QUANTITY):
        prior = fit.priors.priors.get(quantity.name)
        rows.append(
            fixed_row(quantity, prior)
            if prior is not None and prior.is_fixed
            else posterior_row(quantity, summary.loc[quantity.name].to_dict(), prior)
        )
    return pd.DataFrame(rows).fillna("")


def least_squares_table(fit: PeakStressFit) -> pd.DataFrame:
    """Return exponents by least squares and by the fit, of parameters that the table can tell.

    Index parameter; columns least_squares, standard_error, mean, sd.
    """
    summary = fit.summary("SI")
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

FLOW_LAW_CAPTION = (
    "Strain rate against peak stress, both on logarithmic axes, one point for each test. Lines are "
    "posterior medians at the grain size and mean temperature of each group of tests (temperatures "
    f"with no gap wider than {GROUP_TEMPERATURES:g} K): full ones, with bands that hold 90 % of "
    "the draws, of the rate at which tests peak at a stress; broken ones of the rate at which "
    "undeformed material flows under it. The distance between the two is the softening up to the "
    "peak; the slope of the broken ones is the stress exponent n. Bands show how well the peaks "
    "are known, not how far single tests scatter about them, which is the scatter in the table."
)


def flow_law(fit: PeakStressFit) -> Figure:
    """Draw points, peaks with their 90 % band and the flow law, by grain size and temperature."""
    data = fit.data
    predictions = fit.posterior["predictions"].to_dataset()
    rates, of_peaks = (all_draws(predictions[name]) for name in ("strain_rate", "peak_strain_rate"))
    with figure_of(6.4, 4.8) as figure:
        axes = figure.subplots()
        for k, group in enumerate(groups(data)):
            colour = GROUP_COLOURS[k % len(GROUP_COLOURS)]
            draw_band(
                axes,
                group.stress * STRESS_FACTOR,
                of_peaks[:, k],
                colour,
                f"{number(round(group.grain_size * LENGTH_FACTOR, 3))} {LENGTH_UNIT}, "
                f"{group.temperature:.1f} K: peaks, 90 %",
            )
            axes.plot(
                group.stress * STRESS_FACTOR,
                np.median(rates[:, k], axis=0),
                linestyle="--",
                color=colour,
                label="undeformed",
            )
            spread = data.relative_stress_uncertainty[group.points]
            stress = data.stress[group.points] * STRESS_FACTOR
            draw_dots(
                axes,
                stress,
                data.strain_rate[group.points],
                xerr=stress * spread if np.any(spread > 0) else None,
                colour=colour,
                face=colour,
                size=5.0,
                marker=MARKERS[k % len(MARKERS)],
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
