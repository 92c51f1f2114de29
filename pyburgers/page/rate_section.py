"""The part of a page about a flow law from tables of steady rates: figures, tables, text."""

from functools import partial

import numpy as np
import pandas as pd
from markupsafe import escape
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from pyburgers.common.draws import all_draws, value_text
from pyburgers.common.units import counted, number, with_error
from pyburgers.drawing.page_parts import PageFigure, PageSection, PageTable, text_table
from pyburgers.drawing.panels import draw_band, draw_dots, figure_of
from pyburgers.drawing.style import MARKERS
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.flow_law_tables.laws import TABLE_PARAMETERS, has_environment
from pyburgers.flow_law_tables.mechanism_maps import NEAR_FACTOR
from pyburgers.flow_law_tables.posterior import FLOW_RATE_OF_TEST, SOFTENING
from pyburgers.flow_law_tables.program_data import lines
from pyburgers.flow_law_tables.softening import SofteningPrior, least_squares
from pyburgers.kinds.stan_data import REFERENCE_FLOW_RATE
from pyburgers.model.arrhenius import log_slowdown
from pyburgers.model.display import (
    LENGTH_FACTOR,
    LENGTH_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
    shown_quantity,
    symbol_text,
    unit_after_number,
)
from pyburgers.model.reference_quantities import REFERENCE_FLOW_RATE_QUANTITY
from pyburgers.page.mechanism_figures import MECHANISM_COLOURS, map_caption, mechanism_figure
from pyburgers.page.tables import (
    DECISION,
    checks_page_table,
    decided_cell,
    fixed_row,
    not_by_data,
    posterior_row,
)
from pyburgers.posterior.labelled_draws import own_name

RATE_KEY = "rates"

COLOURS = (*MECHANISM_COLOURS, "black")

LAW_CAPTION = (
    "Strain rate against stress in axial equivalents. Each band holds 90 % of the draws of the law "
    "at the mean temperature and grain size of the rows of a range of temperatures. Points are "
    "tests, one each, brought to that temperature and grain size by the law, without the bias of "
    "their source: the distance from the line is the residual. Sources that were held out are not "
    "shown."
)

SOFTENED_CAPTION = (
    " The bands are of tests, which are softer than undeformed material. Broken lines are medians "
    "of undeformed material. The distance between both is the softening; the slope of the broken "
    "lines is the stress exponent n."
)

STEADY_CAPTION = " Lines are of least rates: points of steady rates are divided by E."

SOURCES = (
    ", sources by a factor and by an error of temperature. Each source has a scatter of its own"
)

ENVIRONMENT_CAPTION = " Pressure, water fugacity and melt fraction are the means {}."

RESIDUAL_CAPTION = (
    "Rates over those of the law by source, with its bias taken off: one point for each test, the "
    "mean over the draws. Black bars hold 90 % of the draws of the bias of each source."
)


def rate_section(fit: RateFit, key: str = RATE_KEY) -> PageSection:
    """Return figures, posterior, sources, predictions of held-out sources, and checks of a fit.

    Parameters
    ----------
    fit : RateFit
        The fit.
    key : str
        Name of the files and the anchor of the part, unique on the page.

    Returns
    -------
    PageSection
        A part of a page, behind the fits.

    Examples
    --------
    >>> section = pyburgers.rate_section(creep)
    """
    data, held_out = fit.data, fit.held_out_table()
    shown = law_table(fit)
    held_out_too = "" if held_out.empty else ", held-out ones among them"
    predicted = PageTable(
        "held_out",
        "Sources that were predicted",
        held_out_shown(fit),
        held_out.reset_index(),
        words=("source",),
    )
    return PageSection(
        key=key,
        title=f"Flow law of {data.material} from steady rates",
        paragraphs=(
            " ".join((*fit.cautions, _law_text(fit))),
            *([] if fit.softening is None else [_hand_over_text(fit)]),
        ),
        details=(
            # An author may be called as a technical word is.
            escape(
                f"{counted(fit.used.n_rows, 'test')} of {counted(len(fit.used.sources), 'source')} "
                f"({data.provenance.kind} data: {data.provenance.source}{held_out_too})."
            ),
            "Stress or strain rate is imposed, the other is read. Shear is turned to the axial "
            "equivalents: sqrt(3) times the shear stress, the shear strain rate over sqrt(3).",
            _reference_text(fit),
            "Specimens differ by a factor of their rate" + SOURCES * (len(data.sources) > 1) + ".",
            *(
                []
                if fit.softening is None
                else [_softening_text(fit, fit.softening), _temperature_text(fit)]
            ),
        ),
        tables=(
            PageTable(
                "posterior",
                "Posterior",
                shown,
                fit.summary("SI").reset_index(),
                words=("symbol", "quantity", "unit", "prior", DECISION),
                bad=not_by_data(shown),
            ),
            *(() if held_out.empty else (predicted,)),
            *(() if fit.softening is None else (_least_squares_page_table(fit),)),
            checks_page_table("Checks of this fit", fit.checks()),
        ),
        figures=(
            *mechanism_figures(fit),
            PageFigure(
                "flow_law",
                "Flow law",
                LAW_CAPTION
                + SOFTENED_CAPTION * (fit.softening is not None)
                + STEADY_CAPTION * bool(fit.law.enhancements)
                + ENVIRONMENT_CAPTION.format("of the same rows") * has_environment(fit.law),
                partial(law_figure, fit),
            ),
            PageFigure("residuals", "Residuals", RESIDUAL_CAPTION, partial(residual_figure, fit)),
        ),
        after_fits=True,
    )


def mechanism_figures(fit: RateFit) -> tuple[PageFigure, ...]:
    """Return maps of the leading mechanism over temperature and over grain size, of several."""
    if len(fit.law.mechanisms) == 1:
        return ()

    def drawn() -> Figure:
        sizes = fit.used.grain_size[np.isfinite(fit.used.grain_size)]
        maps = [fit.mechanism_map()]
        if sizes.size and sizes.max() > NEAR_FACTOR * sizes.min():
            across = np.geomspace(sizes.min() / NEAR_FACTOR, sizes.max() * NEAR_FACTOR, 45)
            at = float(np.median(fit.used.temperature))
            maps.append(fit.mechanism_map(grain_size=across, temperature=at))
        return mechanism_figure(fit.used, maps)

    caption = map_caption(fit.data.material)
    caption += ENVIRONMENT_CAPTION.format("of all tests") * has_environment(fit.law)
    return (PageFigure("mechanisms", "Leading mechanism", caption, drawn),)


def _reference_text(fit: RateFit) -> str:
    """Say at which conditions the rates of a law are."""
    at = fit.law.reference
    return (
        f"The reference conditions of a rate are {number(at.temperature)} K, "
        f"{number(at.stress * STRESS_FACTOR)} {STRESS_UNIT} and "
        f"{number(at.grain_size * LENGTH_FACTOR)} {LENGTH_UNIT}. The reference flow rate is "
        "that of the law at the mean conditions of the tests."
    )


def _law_text(fit: RateFit) -> str:
    """Say which mechanisms there are, with n, Q and what else each has, and who decided these."""
    summary = fit.summary("SI")
    draws = fit.posterior["posterior"].to_dataset()

    def shown(parameter: str, mechanism: str) -> str:
        name, quantity = own_name(parameter, mechanism), shown_quantity(parameter)
        values = all_draws(draws[name]) * quantity.display_factor
        unit = unit_after_number(quantity)
        # Without the M of the Maxwell dashpot: a mechanism is of the material.
        symbol = f"{symbol_text(quantity).removesuffix('_M')} = "
        if name not in summary.index:
            return f"{symbol}{values[0]:g}{unit} (given)"
        decided = decided_cell(name, summary.loc[name].to_dict())
        return f"{symbol}{value_text(values)}{unit}" + f" (decided by {decided})" * bool(decided)

    parts = []
    for one in fit.law.mechanisms:
        parameters = ("stress_exponent", "activation_enthalpy", *one.environment)
        *others, last = (shown(parameter, one.name) for parameter in parameters)
        parts.append(f"{one.name.replace('_', ' ')} has {', '.join(others)} and {last}")
    return f"{fit.law.priors.title}: {'; '.join(parts)}."


def _hand_over_text(fit: RateFit) -> str:
    """Say how well the flow rate is known, of all tests and of another one."""
    log_rate = np.log(all_draws(fit.posterior["posterior"].to_dataset()[REFERENCE_FLOW_RATE]))
    of_test = all_draws(fit.posterior["predictions"].to_dataset()[FLOW_RATE_OF_TEST])
    return (
        "At the mean conditions ln(flow rate · s) of undeformed material is "
        f"{value_text(log_rate)} for the tests as a whole and {value_text(of_test)} for "
        "another single one, which scatters about them: the latter is what a curve can take as its "
        "prior."
    )


def _softening_text(fit: RateFit, softening: SofteningPrior) -> str:
    """Say how much weaker than undeformed material the tests are taken to be, and why."""
    h = all_draws(fit.posterior["predictions"].to_dataset()[SOFTENING])[:, 0]
    n_h = fit.power_law()["stress_exponent"] * h
    low, middle, high = (number(100 * strain) for strain in softening.peak_strain.round(4))
    stated = fit.data.peak_strain
    where = (
        "No strain of the peaks is stated that holds for all tests"
        if stated is None
        else f"Peaks are stated at {100 * stated.mean:.1f} ± {100 * stated.sd:.1f} % strain"
    )
    return (
        f"{where}; the peaks simulated with the priors of a curve are at {middle} % ({low} to "
        f"{high} %, 90 %). Of the softening the table tells nothing by itself: h and its change "
        "with rate, stress and grain size are parameters, with those simulations as prior. At the "
        f"mean conditions h = {value_text(h)}, in ln(strain rate) n h = {value_text(n_h)}."
    )


def _temperature_text(fit: RateFit) -> str:
    """State by how much rates are corrected for temperature within the table."""
    enthalpy, at = fit.power_law()["activation_enthalpy"], fit.used.temperature
    mean = fit.used.mean_conditions.temperature
    coldest, warmest = (
        value_text(log_slowdown(enthalpy, one, mean)) for one in (at.min(), at.max())
    )
    return (
        f"The tests were at {at.min():.2f} to {at.max():.2f} K. The activation enthalpy brings "
        f"them to {mean:.2f} K: ln(strain rate) changes by {coldest} for the coldest and {warmest} "
        "for the warmest."
    )


def least_squares_table(fit: RateFit) -> pd.DataFrame:
    """Return least_squares, standard_error, and mean and sd of the fit, by parameter."""
    draws = fit.power_law()
    rows = {
        name: {
            "least_squares": value,
            "standard_error": error,
            "mean": float(draws[name].mean()),
            "sd": float(draws[name].std()),
        }
        for name, (value, error) in least_squares(fit.used).items()
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")


def _least_squares_page_table(fit: RateFit) -> PageTable:
    """Show the exponents of the law beside those across the tests."""
    table, draws = least_squares_table(fit), fit.power_law()
    shown = pd.DataFrame(
        {
            "quantity": [shown_quantity(str(name)).label for name in table.index],
            "across the tests, by least squares": [
                with_error(*pair) for pair in table[["least_squares", "standard_error"]].to_numpy()
            ],
            "posterior": [value_text(draws[str(name)]) for name in table.index],
        }
    )
    title = "Exponents of undeformed material, beside those across the tests"
    return PageTable("least_squares", title, shown, table.reset_index(), words=("quantity",))


def law_table(fit: RateFit) -> pd.DataFrame:
    """Return posterior beside prior of what rows can tell as text, columns of `posterior_row`."""
    summary, rows = fit.summary("SI"), []
    there = fit.posterior["posterior"].to_dataset()
    for quantity in (*fit.law.parameters, REFERENCE_FLOW_RATE_QUANTITY):
        prior = fit.law.priors.priors.get(quantity.name)
        if quantity.name in summary.index:
            rows.append(posterior_row(quantity, summary.loc[quantity.name].to_dict(), prior))
        elif prior is not None and quantity.name in there and quantity.name not in TABLE_PARAMETERS:
            rows.append(fixed_row(quantity, prior))
    return pd.DataFrame(rows).fillna("")


def held_out_shown(fit: RateFit) -> pd.DataFrame:
    """Return `RateFit.held_out_table` as text."""
    table = fit.held_out_table()
    return text_table(
        table.assign(source=table.index, inside=100 * table["inside_90"]),
        {
            "source": "{source}",
            "rows": "{rows}",
            "inside the 90 % band": "{inside:.0f} %",
            "mean residual": "{mean_residual:+.2f}",
            "log density": "{log_density:.1f}",
        },
    )


def law_figure(fit: RateFit) -> Figure:
    """Draw rates against stress with the 90 % band of the law, by temperature."""
    data = fit.used
    predictions = fit.posterior["predictions"].to_dataset()
    log_rates = undeformed = all_draws(predictions["log_strain_rate"])
    left = all_draws(fit.posterior["residuals"].to_dataset()["residual"])
    if fit.softening is not None:
        log_rates = all_draws(predictions["log_test_rate"])
        # A residual counts the stress that is undeformed at the rate of the test, not of the line.
        by_rate = all_draws(predictions[SOFTENING])[:, 1:2]
        left = left / (1 - fit.power_law()["stress_exponent"][:, None] * by_rate)
    residual = left.mean(axis=0)
    with figure_of(6.4, 5.2) as figure:
        axes = figure.subplots()
        for k, line in enumerate(lines(data)):
            colour = COLOURS[k % len(COLOURS)]
            label = f"{line.temperature:.0f} K"
            if not np.isnan(line.grain_size):
                label += f", {line.grain_size * LENGTH_FACTOR:.3g} {LENGTH_UNIT}"
            along = line.stress * STRESS_FACTOR
            draw_band(axes, along, np.exp(log_rates[:, k]), colour, label)
            if fit.softening is not None:
                median = np.exp(np.median(undeformed[:, k], axis=0))
                axes.plot(along, median, "--", color=colour, label="undeformed")
            stress = data.stress[line.rows]
            middle = np.interp(
                np.log(stress), np.log(line.stress), np.median(log_rates[:, k], axis=0)
            )
            draw_dots(
                axes,
                stress * STRESS_FACTOR,
                np.exp(middle + residual[line.rows]),
                colour=colour,
                face=colour,
                size=3.0,
                marker=MARKERS[k % len(MARKERS)],
                label=counted(line.rows.size, "test"),
            )
        axes.set_xscale("log")
        axes.set_yscale("log")
        low, high = axes.get_xlim()
        if high < 10 * low:
            axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
            axes.xaxis.set_minor_formatter(StrMethodFormatter("{x:g}"))
        axes.set_xlabel(f"stress ({STRESS_UNIT})")
        axes.set_ylabel("strain rate (1/s)")
        axes.set_title(
            f"{data.id}: {data.material}, {counted(data.n_rows, 'test')}, "
            f"{data.provenance.kind} data",
            loc="left",
        )
        axes.legend(loc="upper left", fontsize="x-small")
    return figure


def residual_figure(fit: RateFit) -> Figure:
    """Draw residuals of ln(rate) by source, and the bias of each source."""
    used = fit.used
    residual = all_draws(fit.posterior["residuals"].to_dataset()["residual"]).mean(axis=0)
    children = fit.posterior.children
    biases = children["driving_errors"].to_dataset() if "driving_errors" in children else None
    rng = np.random.default_rng(0)
    with figure_of(6.4, 1.2 + 0.24 * len(used.sources)) as figure:
        axes = figure.subplots()
        for k, source in enumerate(used.sources):
            here = used.source == source
            height = k + rng.uniform(-0.25, 0.25, int(here.sum()))
            colour = COLOURS[k % len(COLOURS)]
            axes.plot(np.exp(residual[here]), height, ".", color=colour, markersize=3)
            if biases is not None:
                draws = all_draws(biases[f"source_rate[{source}]"])
                low, high = np.exp(np.quantile(draws, (0.05, 0.95)))
                axes.plot([low, high], [k, k], "-", color="black", linewidth=1.5)
        axes.axvline(1.0, color="0.6", linewidth=0.8)
        axes.set_xscale("log")
        axes.set_yticks(range(len(used.sources)), used.sources)
        axes.invert_yaxis()
        axes.set_xlabel("rate over that of the law")
    return figure
