"""The part of a page about a flow law from a table of peak stresses."""

from functools import partial

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.common.numbers import with_error
from pyburgers.drawing.page_parts import PageFigure, PageSection, PageTable
from pyburgers.flow_law_tables.figures import FLOW_LAW_CAPTION, flow_law
from pyburgers.flow_law_tables.fit import PeakStressFit
from pyburgers.flow_law_tables.inputs import least_squares
from pyburgers.model.display import shown_quantity
from pyburgers.report.tables import checks_page_table, flow_law_table

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
