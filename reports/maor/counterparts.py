"""Every figure, table and claim of the paper, with its place on the page."""

from collections.abc import Iterable, Mapping

import pandas as pd
from common import Fitted
from markupsafe import Markup

from maor.statements import Statement
from pyburgers import PageSection, PageTable

CLAIMS_PLACE = "Statement by statement"

APPENDIX = "appendix"
"""Note beside what is only in it."""

POSTERIOR = "Prior and posterior, Trade-offs between quantities, Agreement of the chains"
PRIORS = "table of parameters; How to read this page: sources"

ROWS = (
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
        "{ice}: Stress-strain curve; The model: the solution at the posterior mean",
        "curves are drawn with the predictive median; the paper's line is that at the mean",
    ),
    ("Fig. 4", "Chains and posteriors of the parameters", f"{{first}}: {POSTERIOR}", ""),
    ("Fig. 6", "Attenuation under stress", "Attenuation: figures of {ice}", ""),
    (
        "Fig. S3",
        "Attenuation by amplitude",
        "Attenuation: amplitude of the cycles, {first}",
        f"amplitudes are our choice; {APPENDIX}",
    ),
    ("Table 1", "Priors of ice", f"{{ice}}: {PRIORS}", ""),
    ("Table S2", "Posterior of ice in numbers", "{ice}: table of parameters", APPENDIX),
    ("Fig. S1", "Curves of the other samples", "{others}: Stress-strain curve", APPENDIX),
    ("Fig. S2", "Posteriors of the other samples", f"{{others}}: {POSTERIOR}", APPENDIX),
    ("Fig. 5", "Forced oscillation of olivine", "{olivine}; Preparation", ""),
    ("Fig. S5", "Chains and posteriors of olivine", f"{{olivine}}: {POSTERIOR}", APPENDIX),
    ("Table 2", "Priors of olivine", f"{{olivine}}: {PRIORS}", ""),
    ("Table S3", "Posterior of olivine in numbers", "{olivine}: table of parameters", APPENDIX),
)
"""What the paper has, what it shows, where that is on the page, and a note. A name in braces stands
for fits; a row about fits that are not there is left out."""

POINTS = {
    True: ("Attenuation: points over the spectra", "from the file that was given"),
    False: (
        "not on this page",
        "the points are not public; a file of them is drawn over the spectra with --measured",
    ),
}
"""Place and note of the measured points in Fig. 6, by whether there are some."""


def counterparts_table(
    ice_fits: Mapping[str, Fitted],
    olivine_fits: Mapping[str, Fitted],
    statements: Iterable[Statement],
    *,
    has_points: bool,
) -> pd.DataFrame:
    """List the paper's figures, tables, equations and claims with where they stand here.

    Fits of ice are by sample, at least one; those of olivine by treatment of the background. The
    columns are paper, shows or says, on this page, note.
    """
    ice, olivine = (
        [fit.experiment.id for fit in fits.values()] for fits in (ice_fits, olivine_fits)
    )
    named = {"ice": ice, "first": ice[:1], "others": ice[1:], "olivine": olivine}
    names = {name: ", ".join(ids) for name, ids in named.items()}
    missing = [f"{{{name}}}" for name, ids in named.items() if not ids]
    rows = [
        (paper, shows, place.format(**names), note)
        for paper, shows, place, note in ROWS
        if not any(name in place for name in missing)
    ]
    rows.append(
        ("Fig. 6", "Measured attenuation of ice (McCarthy and Cooper)", *POINTS[has_points])
    )
    rows += [(one.source, one.text, CLAIMS_PLACE, str(one.verdict)) for one in statements]
    return pd.DataFrame(rows, columns=["paper", "shows or says", "on this page", "note"])


def counterparts_section(table: pd.DataFrame) -> PageSection:
    """Return the list of a `counterparts_table` as a part of the page."""
    return PageSection(
        key="counterparts",
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
