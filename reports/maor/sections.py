"""What the page of the study has beside the single fits.

The paper's statements, attenuation, the preparation of the olivine record and what its two
treatments change.
"""

import logging
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from pyburgers.common.processes import cores
from pyburgers.drawing.page_parts import PageFigure, PageSection, PageTable
from pyburgers.model.display import STRESS_FACTOR, STRESS_UNIT
from pyburgers.predictions import attenuation_figures
from pyburgers.predictions.assumptions import (
    elastic_modulus_sentence,
    frozen_sentence,
    pale_sentence,
)
from pyburgers.predictions.attenuation import predict_attenuation
from pyburgers.predictions.attenuation_tables import overview_table, quantile_table
from pyburgers.predictions.evolving import (
    evolving_attenuation,
    evolving_overview,
    evolving_sentence,
    evolving_table,
)
from pyburgers.predictions.material import fitted_material
from pyburgers.predictions.measured_attenuation import MeasuredAttenuation
from pyburgers.predictions.stress_cycles import PAPER_REGIMES
from pyburgers.protocols.protocol import FittedTest
from pyburgers.studies.maor import drawings
from pyburgers.studies.maor.attenuation import (
    AMPLITUDE_REGIMES,
    MICROSTRUCTURE_SENTENCE,
    Spectra,
    attenuation_statements,
    spectra_of,
)
from pyburgers.studies.maor.before_data import Datum, Knowledge, knowledge
from pyburgers.studies.maor.coverage import coverage_section, coverage_table
from pyburgers.studies.maor.elastic_modulus import (
    ELASTIC_MODULUS_SENTENCE,
    elastic_modulus_table,
    shown_elastic_modulus,
)
from pyburgers.studies.maor.flow_law import (
    STRESSES,
    flow_laws,
    flow_laws_table,
)
from pyburgers.studies.maor.ice import ice_statements
from pyburgers.studies.maor.ice_curves import PEAK_STRESS
from pyburgers.studies.maor.olivine import background_section, preparation_section
from pyburgers.studies.maor.olivine_statements import STRESS_AMPLITUDE, olivine_statements
from pyburgers.studies.maor.statements import (
    GROUNDS,
    VERDICTS_TEXT,
    Statement,
    Verdict,
    statements_table,
)
from pyburgers.studies.maor.stress_floor import stress_floor_section
from pyburgers.studies.maor.time_domain import shown_time_domain, time_domain_table

logger = logging.getLogger(__name__)

PRIOR_DRAWS = {"ice": 12_000, "olivine": 4_000}
"""Draws of the prior of each test, by material; a solution of an oscillation takes longer."""

PRIOR_SEED = 1
"""Of these draws."""

SYNTHETIC_SENTENCE = (
    "The data behind these posteriors are synthetic: a verdict tests the method, that is whether "
    "it would show what the paper saw, had the material been the one that made the data; it says "
    "nothing about nature."
)

WORDS_SENTENCE = (
    "Statements are the paper's in our words, beside the figure, table or material that they are "
    "about; words in quotation marks are the paper's own. Numbers in the rules are ours."
)

STATEMENTS_KEY, MODEL_KEY, ATTENUATION_KEY = "statements", "model", "attenuation"


FloatArray = npt.NDArray[np.float64]


def study_sections(
    ice_fits: Mapping[str, FittedTest],
    olivine_fits: Mapping[str, FittedTest],
    measured: MeasuredAttenuation | None = None,
) -> tuple[PageSection, ...]:
    """Predict attenuation, judge the paper's statements, and gather what the page shows of it.

    Parameters
    ----------
    ice_fits : mapping of str to FittedTest
        Fits of constant rate tests by sample, at least one; the first is looked at most closely.
    olivine_fits : mapping of str to FittedTest
        Fits of one forced oscillation test by treatment of the background; may be empty.
    measured : MeasuredAttenuation, optional
        Points to draw over the spectra.

    Returns
    -------
    tuple of PageSection
        In their order on the page.
    """
    logger.info("Solving draws of the priors, for what is known before the data.")
    # The solver is a process for each test, which threads can wait for side by side.
    with ThreadPoolExecutor(max_workers=cores()) as solving:
        of_ice = solving.map(partial(_known, datum=PEAK_STRESS), ice_fits.values())
        of_olivine = solving.map(partial(_known, datum=STRESS_AMPLITUDE), olivine_fits.values())
        ice = dict(zip(ice_fits, of_ice, strict=True))
        olivine = dict(zip(olivine_fits, of_olivine, strict=True))
    logger.info("Predicting attenuation.")
    spectra = {name: spectra_of(one) for name, one in ice.items()}
    logger.info("Comparing the paper's statements with the posterior.")
    statements = paper_statements(ice, spectra, olivine)
    is_synthetic = any(
        fit.experiment.provenance.kind == "synthetic"
        for fit in (*ice_fits.values(), *olivine_fits.values())
    )
    logger.info("Comparing attenuation with simulations in time.")
    sections = [
        statements_section(statements, is_synthetic=is_synthetic),
        coverage_section(
            coverage_table(ice_fits, olivine_fits, statements, has_points=measured is not None)
        ),
        model_section(next(iter(ice_fits.values()))),
        attenuation_section(ice_fits, {name: one.after for name, one in spectra.items()}, measured),
    ]
    if olivine_fits:
        logger.info("Comparing the two treatments of the olivine record.")
        sections += [
            preparation_section(olivine_fits),
            background_section(olivine_fits),
            stress_floor_section(olivine_fits),
        ]
    return tuple(sections)


def _known(fit: FittedTest, datum: Datum) -> Knowledge:
    n_draws = PRIOR_DRAWS[fit.experiment.material]
    return knowledge(fit, datum, n_draws=n_draws, seed=PRIOR_SEED)


def paper_statements(
    ice: Mapping[str, Knowledge],
    spectra: Mapping[str, Spectra],
    olivine: Mapping[str, Knowledge],
) -> tuple[Statement, ...]:
    """Judge the paper's statements that the given tests and spectra say something about.

    The parameters that a statement is about have to be free in the fits.

    Parameters
    ----------
    ice, olivine : mapping of str to Knowledge
        Ice by sample, and olivine by treatment of the background; each may be empty.
    spectra : mapping of str to Spectra
        Of the samples of ice.
    """
    return (
        *ice_statements(ice),
        *olivine_statements(olivine),
        *attenuation_statements(spectra),
    )


def statements_section(statements: tuple[Statement, ...], *, is_synthetic: bool) -> PageSection:
    """Return the table of the paper's statements.

    Parameters
    ----------
    statements : tuple of Statement
        What is shown.
    is_synthetic : bool
        Whether data behind the posteriors are synthetic.
    """
    verdicts = [statement.verdict for statement in statements]
    findings = sum(verdict.counts for verdict in verdicts)
    counted = ", ".join(f"{one} {verdicts.count(one)}" for one in Verdict if one in verdicts)
    table = statements_table(statements)
    return PageSection(
        key=STATEMENTS_KEY,
        title="The paper's statements and our posterior",
        paragraphs=(
            f"{findings} of {len(statements)} verdicts are findings of the data: {counted}.",
            *((SYNTHETIC_SENTENCE,) if is_synthetic else ()),
        ),
        details=(WORDS_SENTENCE, VERDICTS_TEXT, MICROSTRUCTURE_SENTENCE),
        tables=(
            PageTable(
                "table",
                "Statement by statement",
                table.drop(columns=[*GROUNDS, "effective draws"]),
                table,
                words=("paper", "verdict", "prior", "prior and one number", "posterior", "of"),
                sentences=("statement",),
                bad={"verdict": [verdict is Verdict.DISAGREES for verdict in verdicts]},
            ),
            PageTable(
                "grounds",
                "What the verdicts rest on",
                table[["statement", *GROUNDS]],
                table[["statement", *GROUNDS]],
                in_files=True,
            ),
        ),
    )


def model_section(fit: FittedTest) -> PageSection:
    """Return drawings of the model, and of its flow law beside others.

    Parameters
    ----------
    fit : FittedTest
        Of a test at constant rate.
    """
    name = fit.experiment.id
    peak = PEAK_STRESS.observed(fit)
    laws = flow_laws(fit, peak * STRESSES, shared_stress=peak)
    table = flow_laws_table(laws)
    return PageSection(
        key=MODEL_KEY,
        title="The model",
        paragraphs=(),
        tables=(
            PageTable(
                "flow_laws",
                f"Rate of the undeformed material by three flow laws, {name}",
                _shown_laws(table),
                table,
                folded=True,
            ),
        ),
        figures=(
            PageFigure("circuit", "The circuit", drawings.CIRCUIT_CAPTION, drawings.circuit),
            PageFigure(
                "strain_parts",
                f"What each element does in a test, {name}",
                drawings.STRAIN_PARTS_CAPTION,
                partial(drawings.strain_parts, fit),
            ),
            PageFigure(
                "mean_solution",
                f"The solution at the posterior mean, {name}",
                drawings.MEAN_SOLUTION_CAPTION,
                partial(drawings.mean_solution, fit),
            ),
            PageFigure(
                "flow_laws",
                f"Flow of the undeformed material, {name}",
                drawings.FLOW_LAWS_CAPTION,
                partial(drawings.flow_laws_figure, fit, laws),
            ),
        ),
        after_fits=True,
    )


def _shown_laws(table: pd.DataFrame) -> pd.DataFrame:
    """Return a `pyburgers.studies.maor.flow_law.flow_laws_table` as text."""
    shown = {f"stress ({STRESS_UNIT})": (table["stress_Pa"] * STRESS_FACTOR).map("{:.3g}".format)}
    for column in table.columns[1:]:
        shown[f"{column.removesuffix('_per_s').replace('_', ' ')} (1/s)"] = table[column].map(
            "{:.2e}".format
        )
    return pd.DataFrame(shown)


def attenuation_section(
    fits: Mapping[str, FittedTest],
    spectra: Mapping[str, xr.Dataset],
    measured: MeasuredAttenuation | None = None,
) -> PageSection:
    """Return figures and tables of attenuation.

    Of the first fit also single draws, amplitudes, and what an evolving microstructure changes.

    Parameters
    ----------
    fits : mapping of str to FittedTest
        At least one.
    spectra : mapping of str to Dataset
        Spectra of the same fits (`pyburgers.predictions.attenuation.predict_attenuation`).
    measured : MeasuredAttenuation, optional
        Points to draw over them.
    """
    first, fit = next(iter(fits.items()))
    evolving = evolving_attenuation(fitted_material(fit))
    return PageSection(
        key=ATTENUATION_KEY,
        title="Attenuation",
        paragraphs=(
            f"{first}: {pale_sentence(spectra[first])}",
            elastic_modulus_sentence(spectra[first]),
        ),
        details=(
            "What the fitted material would do under another load: stress cycles about a constant "
            "median stress. Strain lags stress by the angle δ, and tan δ is the attenuation 1/Q; "
            "every draw of the posterior gives a spectrum in closed form. Tables give the median "
            "and 5 and 95 % of the draws; the CSV files hold all frequencies.",
            f"{first}: {frozen_sentence(spectra[first])}",
            f"{first}, frozen and evolving side by side. {evolving_sentence(evolving)}",
            ELASTIC_MODULUS_SENTENCE,
        ),
        tables=_attenuation_tables(fits, spectra, evolving),
        figures=_attenuation_figures(fits, spectra, evolving, measured),
        after_fits=True,
    )


def _attenuation_tables(
    fits: Mapping[str, FittedTest], spectra: Mapping[str, xr.Dataset], evolving: xr.Dataset
) -> tuple[PageTable, ...]:
    """Return quantiles of every fit, and of the first one what its spectra take for granted."""
    first, fit = next(iter(fits.items()))
    modulus, check = elastic_modulus_table(fits), time_domain_table(fit)
    return (
        *(
            PageTable(
                f"{name}_quantiles",
                f"tan δ of {name}",
                overview_table(spectrum),
                quantile_table(spectrum),
                words=("regime",),
                sentences=("frozen microstructure",),
                in_files=name != first,
                folded=True,
            )
            for name, spectrum in spectra.items()
        ),
        PageTable(
            "evolving",
            f"Frozen and evolving microstructure, {first}",
            evolving_overview(evolving),
            evolving_table(evolving),
            words=("regime",),
        ),
        PageTable(
            "elastic_modulus",
            f"Elastic modulus and attenuation at {PAPER_REGIMES[0].label}",
            shown_elastic_modulus(modulus),
            modulus,
            words=("sample",),
        ),
        PageTable(
            "time_domain",
            f"Closed form against simulation in time, {first} at the median of its parameters",
            shown_time_domain(check),
            check,
            words=("regime",),
        ),
    )


def _attenuation_figures(
    fits: Mapping[str, FittedTest],
    spectra: Mapping[str, xr.Dataset],
    evolving: xr.Dataset,
    measured: MeasuredAttenuation | None,
) -> tuple[PageFigure, ...]:
    """Return spectra of every fit, and of the first one draws and amplitudes."""
    first, fit = next(iter(fits.items()))
    of_first = spectra[first]
    by_amplitude = predict_attenuation(fit, regimes=AMPLITUDE_REGIMES)
    return (
        *(
            PageFigure(
                f"{name}_spectrum",
                f"Attenuation of {name}",
                attenuation_figures.ATTENUATION_CAPTION,
                partial(
                    attenuation_figures.attenuation,
                    spectrum,
                    spectrum.attrs["title"],
                    evolving if name == first else None,
                    measured,
                ),
                frozen_sentence(spectrum),
            )
            for name, spectrum in spectra.items()
        ),
        PageFigure(
            f"{first}_draws",
            f"Attenuation of {first}, draw by draw",
            attenuation_figures.DRAWS_CAPTION,
            partial(attenuation_figures.attenuation_draws, of_first, of_first.attrs["title"]),
        ),
        PageFigure(
            f"{first}_amplitude",
            f"Attenuation of {first} and the amplitude of the cycles",
            attenuation_figures.AMPLITUDE_CAPTION,
            partial(
                attenuation_figures.amplitude_dependence,
                by_amplitude,
                by_amplitude.attrs["title"],
            ),
        ),
    )
