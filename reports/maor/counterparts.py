"""Every figure, table and claim of the paper, with its place on the page."""

from collections.abc import Iterable, Mapping, Sequence

import pandas as pd
from markupsafe import Markup

from pyburgers.drawing.page_parts import PageSection, PageTable
from pyburgers.protocols.protocol import FittedTest
from pyburgers.studies.maor.statements import Statement

COUNTERPARTS_KEY, CLAIMS_PLACE = "counterparts", "Statement by statement"

APPENDIX = "appendix"
"""Note beside what is only in it."""

_POSTERIOR = "Prior and posterior, Trade-offs between quantities, Agreement of the chains"


def coverage_table(
    ice_fits: Mapping[str, FittedTest],
    olivine_fits: Mapping[str, FittedTest],
    statements: Iterable[Statement],
    *,
    has_points: bool,
) -> pd.DataFrame:
    """List the paper's figures, tables, equations and claims with where they stand here.

    Parameters
    ----------
    ice_fits, olivine_fits : mapping of str to FittedTest
        Fits of the page: ice by sample, at least one, and olivine by treatment of the background.
    statements : iterable of Statement
        Claims that were judged.
    has_points : bool
        Whether measured attenuation is drawn over the spectra.

    Returns
    -------
    DataFrame
        Columns paper, shows or says, on this page, note.
    """
    ids = [fit.experiment.id for fit in ice_fits.values()]
    rows = [
        *_ice_rows(ids),
        *(_olivine_rows([fit.experiment.id for fit in olivine_fits.values()])),
        _points_row(has_points=has_points),
        *((one.source, one.text, CLAIMS_PLACE, str(one.verdict)) for one in statements),
    ]
    return pd.DataFrame(rows, columns=["paper", "shows or says", "on this page", "note"])


def _ice_rows(ids: Sequence[str]) -> list[tuple[str, str, str, str]]:
    """Rows of figures, tables and equations about the model and ice."""
    ice, first, others = ", ".join(ids), ids[0], ", ".join(ids[1:])
    rows = [
        (
            "Fig. 1",
            "What the elements stand for in a test",
            "The model: what each element does in a test",
            "our drawing, from the fit",
        ),
        ("Fig. 2", "The circuit", "The model: the circuit", "our drawing"),
        ("Eqs. 1, 3-5", "Flow law and microstructure", "docs/model.md; The model", ""),
        (
            "Eq. 2",
            "Hyperbolic sine and its linear limit",
            "The model: flow of the undeformed material",
            "fitted as a variant: --variant maxwell=hyperbolic_sine",
        ),
        (
            "Fig. 3",
            "Stress-strain curves of ice and solutions",
            f"{ice}: Stress-strain curve; The model: the solution at the posterior mean",
            "curves are drawn with the predictive median; the paper's line is that at the mean",
        ),
        ("Fig. 4", "Chains and posteriors of the parameters", f"{first}: {_POSTERIOR}", ""),
        ("Fig. 6", "Attenuation under stress", f"Attenuation: figures of {ice}", ""),
        (
            "Fig. S3",
            "Attenuation by amplitude",
            f"Attenuation: amplitude of the cycles, {first}",
            f"amplitudes are our choice; {APPENDIX}",
        ),
        (
            "Table 1",
            "Priors of ice",
            f"{ice}: table of parameters; How to read this page: sources",
            "",
        ),
        ("Table S2", "Posterior of ice in numbers", f"{ice}: table of parameters", APPENDIX),
    ]
    if others:
        rows += [
            ("Fig. S1", "Curves of the other samples", f"{others}: Stress-strain curve", APPENDIX),
            ("Fig. S2", "Posteriors of the other samples", f"{others}: {_POSTERIOR}", APPENDIX),
        ]
    return rows


def _olivine_rows(ids: Sequence[str]) -> list[tuple[str, str, str, str]]:
    """Rows of figures and tables about olivine."""
    if not ids:
        return []
    olivine = ", ".join(ids)
    return [
        ("Fig. 5", "Forced oscillation of olivine", f"{olivine}; Preparation", ""),
        ("Fig. S5", "Chains and posteriors of olivine", f"{olivine}: {_POSTERIOR}", APPENDIX),
        (
            "Table 2",
            "Priors of olivine",
            f"{olivine}: table of parameters; How to read this page: sources",
            "",
        ),
        (
            "Table S3",
            "Posterior of olivine in numbers",
            f"{olivine}: table of parameters",
            APPENDIX,
        ),
    ]


def _points_row(*, has_points: bool) -> tuple[str, str, str, str]:
    """Row of the measured points in Fig. 6."""
    shown = "Fig. 6", "Measured attenuation of ice (McCarthy and Cooper)"
    if has_points:
        return *shown, "Attenuation: points over the spectra", "from the file that was given"
    return (
        *shown,
        "not on this page",
        "the points are not public; a file of them is drawn over the spectra with --measured",
    )


def coverage_section(table: pd.DataFrame) -> PageSection:
    """Return the list of a `coverage_table` as a part of the page."""
    return PageSection(
        key=COUNTERPARTS_KEY,
        title="The paper's figures, tables and claims on this page",
        paragraphs=(),
        tables=(
            PageTable(
                "table",
                "Counterparts",
                table[table["on this page"] != CLAIMS_PLACE],
                table,
                words=("paper",),
                sentences=("shows or says", "on this page", "note"),
                text=Markup(
                    f"{APPENDIX}: it is not public, and this is what we take the reference in the "
                    "paper's text to mean."
                ),
            ),
        ),
    )
