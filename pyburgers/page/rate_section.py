"""The part of a page about a flow law from tables of steady rates: figures, tables, text."""

from functools import partial

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pyburgers.common.draws import all_draws
from pyburgers.common.units import counted, with_error
from pyburgers.drawing.page_parts import PageFigure, PageSection, PageTable
from pyburgers.drawing.panels import draw_band, draw_dots, figure_of
from pyburgers.drawing.style import BLUE, GREEN, MARKERS, ORANGE, PURPLE, VERMILION
from pyburgers.flow_law_tables.mechanism_maps import NEAR_FACTOR
from pyburgers.flow_law_tables.rate_data import lines
from pyburgers.flow_law_tables.rate_fit import RateFit
from pyburgers.model.display import LENGTH_FACTOR, LENGTH_UNIT, STRESS_FACTOR, STRESS_UNIT
from pyburgers.model.parameters import REFERENCE_FLOW_RATE_QUANTITY
from pyburgers.page.mechanism_figures import map_caption, mechanism_figure
from pyburgers.page.tables import checks_page_table, fixed_row, posterior_row

RATE_KEY = "rates"

COLOURS = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, "black")

LAW_CAPTION = (
    "Strain rate against stress in axial equivalents. Each band holds 90 % of the draws of the law "
    "at the mean temperature and grain size of the rows of a range of temperatures. Points are "
    "tests, one each, brought to that temperature and grain size by the law, without the bias of "
    "their source: the distance from the line is the residual. Sources that were held out are not "
    "shown."
)

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
        paragraphs=(_law_text(fit),),
        details=(
            f"{counted(fit.used.n_rows, 'test')} of {counted(len(fit.used.sources), 'source')} "
            f"({data.provenance.kind} data: {data.provenance.source}). Stress or strain rate is "
            "imposed, the other is read. Shear is turned to the axial equivalents: sqrt(3) times "
            "the shear stress, the shear strain rate over sqrt(3).",
            "Specimens differ by a factor of their rate, sources by a factor and by an error of "
            "temperature. Each source has a scatter of its own.",
        ),
        tables=(
            PageTable(
                "posterior",
                "Posterior",
                law_table(fit),
                fit.summary("SI").reset_index(),
                words=("symbol", "quantity", "unit", "prior"),
            ),
            *(() if held_out.empty else (predicted,)),
            checks_page_table("Checks of this fit", fit.checks()),
        ),
        figures=(
            *mechanism_figures(fit),
            PageFigure("flow_law", "Flow law", LAW_CAPTION, partial(law_figure, fit), ""),
            PageFigure(
                "residuals", "Residuals", RESIDUAL_CAPTION, partial(residual_figure, fit), ""
            ),
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
    return (PageFigure("mechanisms", "Leading mechanism", caption, drawn, ""),)


def _law_text(fit: RateFit) -> str:
    """Say which mechanisms there are, with n and Q (kJ/mol) of each, and who decided these."""
    summary = fit.summary("SI")
    draws = fit.posterior["posterior"].to_dataset()

    def shown(name: str, factor: float = 1.0, unit: str = "") -> str:
        values = all_draws(draws[name]) * factor
        if name not in summary.index:
            return f"{values[0]:g}{unit} (given)"
        decided = str(summary.at[name, "decided_by"])
        number = with_error(float(np.mean(values)), float(np.std(values))) + unit
        return number if decided == "data" else f"{number} (decided by: {decided})"

    parts = [
        f"{one.name.replace('_', ' ')} has n = {shown(f'stress_exponent[{one.name}]')} and "
        f"Q = {shown(f'activation_enthalpy[{one.name}]', 1e-3, ' kJ/mol')}"
        for one in fit.law.mechanisms
    ]
    return f"{fit.law.priors.title}: {'; '.join(parts)}."


def law_table(fit: RateFit) -> pd.DataFrame:
    """Return posterior beside prior of a law as text, with the columns of `posterior_row`."""
    summary, rows = fit.summary("SI"), []
    there = fit.posterior["posterior"].to_dataset()
    for quantity in (*fit.law.parameters, REFERENCE_FLOW_RATE_QUANTITY):
        prior = fit.law.priors.priors.get(quantity.name)
        if quantity.name in summary.index:
            rows.append(posterior_row(quantity, summary.loc[quantity.name].to_dict(), prior))
        elif prior is not None and quantity.name in there:
            rows.append(fixed_row(quantity, prior))
    return pd.DataFrame(rows).fillna("")


def held_out_shown(fit: RateFit) -> pd.DataFrame:
    """Return `RateFit.held_out_table` as text."""
    table = fit.held_out_table()
    return pd.DataFrame(
        {
            "source": table.index,
            "rows": table["rows"].astype(str),
            "inside the 90 % band": [f"{100 * one:.0f} %" for one in table["inside_90"]],
            "mean residual": [f"{one:+.2f}" for one in table["mean_residual"]],
            "log density": [f"{one:.1f}" for one in table["log_density"]],
        }
    )


def law_figure(fit: RateFit) -> Figure:
    """Draw rates against stress with the 90 % band of the law, by temperature."""
    data, used = fit.data, ~np.isin(fit.data.source, fit.manifest["held_out"])
    log_rates = all_draws(fit.posterior["predictions"].to_dataset()["log_strain_rate"])
    residual = np.full(data.n_rows, np.nan)
    residual[used] = all_draws(fit.posterior["residuals"].to_dataset()["residual"]).mean(axis=0)
    with figure_of(6.4, 5.2) as figure:
        axes = figure.subplots()
        for k, line in enumerate(lines(data)):
            colour = COLOURS[k % len(COLOURS)]
            grains = (
                ""
                if np.isnan(line.grain_size)
                else f", {line.grain_size * LENGTH_FACTOR:.3g} {LENGTH_UNIT}"
            )
            draw_band(
                axes,
                line.stress * STRESS_FACTOR,
                np.exp(log_rates[:, k]),
                colour,
                f"{line.temperature:.0f} K{grains}",
            )
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
    biases = (
        fit.posterior["driving_errors"].to_dataset()
        if "driving_errors" in fit.posterior.children
        else None
    )
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
