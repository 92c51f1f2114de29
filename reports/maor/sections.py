"""What the page of the study has beside the single fits and their comparisons.

The paper's statements, attenuation, the preparation of the olivine record and what its two
treatments change.
"""

import logging
import os
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial

import pandas as pd
from common import Fitted, central, flat, interval

import pyburgers
from maor import drawings
from maor.attenuation import (
    AMPLITUDE_REGIMES,
    MICROSTRUCTURE_SENTENCE,
    Spectra,
    attenuation_statements,
    spectra_of,
)
from maor.before_data import Datum, Knowledge, knowledge
from maor.counterparts import counterparts_section, counterparts_table
from maor.flow_law import STRESSES, flow_laws, flow_laws_table
from maor.ice import ice_statements
from maor.ice_curves import PEAK_STRESS
from maor.olivine import background_section, preparation_section
from maor.olivine_statements import STRESS_AMPLITUDE, olivine_statements
from maor.statements import GROUNDS, VERDICTS_TEXT, Statement, Verdict, statements_table
from maor.stress_floor import stress_floor_section
from pyburgers import Fit, MeasuredAttenuation, PageFigure, PageSection, PageTable, Regime

logger = logging.getLogger("pyburgers.study")

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

ICE_MODULUS = 9.3e9
"""Young's modulus of polycrystalline ice, Pa: 9.33 GPa at -16 °C (Gammon, Kiefte, Clouter and
Denner 1983, Journal of Glaciology 29, 433)."""

MODULUS_REGIME, MODULUS_FREQUENCIES = Regime(1e6, 0.17e6), (1e-2, 1.0)
"""Stress cycles and frequencies (Hz) that show the effect of the elastic modulus."""

ELASTIC_MODULUS_SENTENCE = (
    f"With {ICE_MODULUS * 1e-9:g} GPa, Young's modulus of ice, in place of each "
    "fit's own E_M the samples differ by what the tests say of Kelvin element and dashpot; what "
    "they differ by beyond that is mostly the apparatus."
)


def study_sections(
    ice_fits: Mapping[str, Fit],
    olivine_fits: Mapping[str, Fit],
    measured: MeasuredAttenuation | None = None,
) -> tuple[PageSection, ...]:
    """Judge the paper's statements and gather what the page shows of it, in the order of the page.

    Fits of ice are by sample, at least one, the first looked at most closely; those of olivine by
    treatment of the background, which may be none. Measured points are drawn over the spectra.
    """
    logger.info("Solving draws of the priors, for what is known before the data.")
    # The solver is a process for each test, which threads can wait for side by side.
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as solving:
        of_ice = solving.map(partial(_known, datum=PEAK_STRESS), ice_fits.values())
        of_olivine = solving.map(partial(_known, datum=STRESS_AMPLITUDE), olivine_fits.values())
        ice = dict(zip(ice_fits, of_ice, strict=True))
        olivine = dict(zip(olivine_fits, of_olivine, strict=True))
    logger.info("Comparing the paper's statements with the posterior.")
    spectra = {name: spectra_of(one) for name, one in ice.items()}
    statements = paper_statements(ice, spectra, olivine)
    fits = (*ice_fits.values(), *olivine_fits.values())
    is_synthetic = any(fit.provenance.kind == "synthetic" for fit in fits)
    logger.info("Predicting attenuation.")
    sections = [
        statements_section(statements, is_synthetic=is_synthetic),
        counterparts_section(
            counterparts_table(ice_fits, olivine_fits, statements, has_points=measured is not None)
        ),
        model_section(next(iter(ice_fits.values()))),
        ice_attenuation_section(ice_fits, measured),
    ]
    if olivine_fits:
        logger.info("Comparing the two treatments of the olivine record.")
        sections += [
            preparation_section(olivine_fits),
            background_section(olivine_fits),
            stress_floor_section(olivine_fits),
        ]
    return tuple(sections)


def _known(fit: Fitted, datum: Datum) -> Knowledge:
    n_draws = PRIOR_DRAWS[fit.experiment.material]
    return knowledge(fit, datum, n_draws=n_draws, seed=PRIOR_SEED)


def paper_statements(
    ice: Mapping[str, Knowledge],
    spectra: Mapping[str, Spectra],
    olivine: Mapping[str, Knowledge],
) -> tuple[Statement, ...]:
    """Judge the paper's statements that the given tests and spectra say something about.

    The parameters that a statement is about have to be free in the fits.
    """
    return (
        *ice_statements(ice),
        *olivine_statements(olivine),
        *attenuation_statements(spectra),
    )


def statements_section(statements: tuple[Statement, ...], *, is_synthetic: bool) -> PageSection:
    """Return the table of the paper's statements."""
    verdicts = [statement.verdict for statement in statements]
    findings = sum(verdict.counts for verdict in verdicts)
    counted = ", ".join(f"{one} {verdicts.count(one)}" for one in Verdict if one in verdicts)
    table = statements_table(statements)
    return PageSection(
        key="statements",
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


def model_section(fit: Fit) -> PageSection:
    """Return drawings of the model in a test at constant rate, and of its flow law."""
    name = fit.experiment.id
    peak = PEAK_STRESS.observed(fit)
    laws = flow_laws(fit, peak * STRESSES, shared_stress=peak)
    table = flow_laws_table(laws)
    return PageSection(
        key="model",
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
    """Return a `maor.flow_law.flow_laws_table` as text."""
    rates = {
        f"{column.removesuffix('_per_s').replace('_', ' ')} (1/s)": table[column].map(
            "{:.2e}".format
        )
        for column in table.columns[1:]
    }
    return pd.DataFrame({"stress (MPa)": (table["stress_Pa"] * 1e-6).map("{:.3g}".format), **rates})


def ice_attenuation_section(
    fits: Mapping[str, Fit], measured: MeasuredAttenuation | None = None
) -> PageSection:
    """Return figures and tables of attenuation, with one elastic modulus for all samples too."""
    section = pyburgers.attenuation_section(fits, AMPLITUDE_REGIMES, measured)
    saved, shown = elastic_modulus_tables(fits)
    modulus = PageTable(
        "elastic_modulus",
        f"Elastic modulus and attenuation at {MODULUS_REGIME.label}",
        shown,
        saved,
        words=("sample",),
    )
    return replace(
        section,
        details=(*section.details, ELASTIC_MODULUS_SENTENCE),
        tables=(*section.tables, modulus),
    )


def elastic_modulus_tables(fits: Mapping[str, Fit]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Attenuation with E_M of each fit and with the modulus of ice, as numbers and as text.

    A row for each sample and frequency. Numbers have the columns sample, maxwell_modulus_GPa
    (median), frequency_Hz, own_q5, own_q50, own_q95, ice_q5, ice_q50, ice_q95; the text ends with
    how far the samples are apart.
    """
    saved: list[dict[str, object]] = []
    shown: list[tuple[str, ...]] = []
    for name, fit in fits.items():
        modulus = float(fit.posterior["posterior"]["maxwell_modulus"].median()) * 1e-9
        spectra = {
            whose: flat(
                pyburgers.predict_attenuation(
                    fit, MODULUS_FREQUENCIES, [MODULUS_REGIME], elastic_modulus=given
                )["tan_delta"].transpose(..., "regime", "frequency")
            )[:, 0]
            for whose, given in (("own", None), ("ice", ICE_MODULUS))
        }
        for k, frequency in enumerate(MODULUS_FREQUENCIES):
            row = {"sample": name, "maxwell_modulus_GPa": modulus, "frequency_Hz": frequency}
            for whose, draws in spectra.items():
                quantiles = zip((5, 50, 95), central(draws[:, k]), strict=True)
                row |= {f"{whose}_q{share}": value for share, value in quantiles}
            saved.append(row)
            texts = (interval(draws[:, k], ".3g") for draws in spectra.values())
            shown.append((name, f"{modulus:.3g}", f"{frequency:.3g}", *texts))
    table = pd.DataFrame(saved)
    if len(fits) > 1:
        for label, rows in table.groupby("frequency_Hz"):
            apart = (rows[name].max() / rows[name].min() for name in ("own_q50", "ice_q50"))
            ratios = (f"{one:.3g}" for one in apart)
            shown.append(("largest over smallest", "", f"{label:.3g}", *ratios))
    text = pd.DataFrame(
        shown,
        columns=[
            *("sample", "E_M (GPa)", "frequency (Hz)"),
            *("tan δ, E_M of the fit", "tan δ, modulus of ice"),
        ],
    )
    return table, text
