"""What the page of the study has beside the single fits.

The paper's statements, attenuation, the preparation of the olivine record and what its two
treatments change.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import get_args

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from pyburgers.common.draws import all_draws, central_band
from pyburgers.fitting.fit import Fit
from pyburgers.model.display import (
    LENGTH_FACTOR,
    LENGTH_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
    shown_quantity,
    unit_text,
)
from pyburgers.predictions import attenuation_figures
from pyburgers.predictions.attenuation import (
    PAPER_REGIMES,
    PARAMETER_NAMES,
    amplitude_regimes,
    attenuation_spectrum,
    overview_table,
    predict_attenuation,
    quantile_table,
)
from pyburgers.predictions.imposed_stress import simulated_phase_lag
from pyburgers.protocols.forced_oscillation import figures as oscillation_figures
from pyburgers.protocols.forced_oscillation.response import oscillation_of
from pyburgers.protocols.forward import REFERENCE_SOLVER, solve
from pyburgers.protocols.registry import protocol_of
from pyburgers.protocols.stan_data import REFERENCE_FLOW_RATE
from pyburgers.report.page import ExtraFigure, ExtraSection, ExtraTable
from pyburgers.studies.maor.statements import (
    MICROSTRUCTURE_SENTENCE,
    SYNTHETIC_SENTENCE,
    Statement,
    Verdict,
    paper_statements,
    statements_table,
)

logger = logging.getLogger(__name__)

AMPLITUDE_REGIMES = amplitude_regimes(2e6, (0.1e6, 0.5e6, 1e6, 1.9e6))
"""Stress cycles (Pa) of the test of amplitudes: our choice, the paper's Fig. S3 is not public."""

CHECKED_FREQUENCIES = (1e-4, 1e-3, 1e-2)
"""Where the closed form is compared with simulations in time, Hz."""

STATEMENTS_KEY, COUNTERPARTS_KEY = "statements", "counterparts"
ATTENUATION_KEY, PREPARATION_KEY, BACKGROUND_KEY = "attenuation", "preparation", "background"

COMPARED_PARAMETERS = (
    "kelvin_modulus",
    "kelvin_viscosity",
    "maxwell_modulus",
    "stress_exponent",
    "grain_size_exponent",
    "critical_strain_grain_size",
)
"""Parameters of olivine that the two treatments of the background are compared by."""

FloatArray = npt.NDArray[np.float64]


def study_sections(
    ice_fits: Mapping[str, Fit], olivine_fits: Mapping[str, Fit]
) -> tuple[ExtraSection, ...]:
    """Predict attenuation, judge the paper's statements, and gather what the page shows of it.

    Parameters
    ----------
    ice_fits : mapping of str to Fit
        Fits of constant rate tests by sample, at least one; the first is looked at most closely.
    olivine_fits : mapping of str to Fit
        Fits of one forced oscillation test by treatment of the background; may be empty.

    Returns
    -------
    tuple of ExtraSection
        In their order on the page.
    """
    logger.info("Predicting attenuation.")
    spectra = {name: predict_attenuation(fit) for name, fit in ice_fits.items()}
    logger.info("Comparing the paper's statements with the posterior.")
    statements = paper_statements(ice_fits, spectra, olivine_fits)
    is_synthetic = any(
        fit.experiment.provenance.kind == "synthetic"
        for fit in (*ice_fits.values(), *olivine_fits.values())
    )
    logger.info("Comparing attenuation with simulations in time.")
    sections = [
        statements_section(statements, is_synthetic=is_synthetic),
        counterparts_section(ice_fits, olivine_fits),
        attenuation_section(ice_fits, spectra),
    ]
    if olivine_fits:
        logger.info("Comparing the two treatments of the olivine record.")
        sections += [
            preparation_section(olivine_fits),
            background_section(olivine_fits),
        ]
    return tuple(sections)


def statements_section(statements: tuple[Statement, ...], *, is_synthetic: bool) -> ExtraSection:
    """Return the table of the paper's statements.

    Parameters
    ----------
    statements : tuple of Statement
        What is shown.
    is_synthetic : bool
        Whether data behind the posteriors are synthetic.
    """
    verdicts = [statement.verdict for statement in statements]
    overall = ", ".join(f"{verdict} {verdicts.count(verdict)}" for verdict in get_args(Verdict))
    table = statements_table(statements)
    return ExtraSection(
        key=STATEMENTS_KEY,
        title="The paper's statements and our posterior",
        paragraphs=(
            *((SYNTHETIC_SENTENCE,) if is_synthetic else ()),
            f"Verdicts: {overall}. Every verdict is computed from the draws by "
            f"the rule beside it. {MICROSTRUCTURE_SENTENCE}",
        ),
        tables=(
            ExtraTable(
                "table",
                "Statement by statement",
                table,
                table,
                words=("paper", "verdict"),
                sentences=("statement", "our posterior", "rule"),
            ),
        ),
    )


def counterparts_section(
    ice_fits: Mapping[str, Fit], olivine_fits: Mapping[str, Fit]
) -> ExtraSection:
    """Return the list of the paper's figures and tables with where their counterparts are.

    Parameters
    ----------
    ice_fits, olivine_fits : mapping of str to Fit
        As for `study_sections`.
    """
    ice = ", ".join(fit.experiment.id for fit in ice_fits.values())
    olivine = ", ".join(fit.experiment.id for fit in olivine_fits.values())
    first = next(iter(ice_fits))
    rows = [
        ("Fig. 3", "Stress-strain curves of ice and solutions", f"{ice}: Stress-strain curve"),
        (
            "Fig. 4",
            "Chains and posteriors of the parameters",
            f"{ice}: Prior and posterior, Trade-offs between quantities, Agreement of the chains",
        ),
        ("Fig. 6", "Attenuation under stress", f"Attenuation: figures of {ice}"),
        ("Fig. S3", "Attenuation by amplitude", f"Attenuation: amplitude of the cycles, {first}"),
        ("Table 1", "Priors of ice", f"{ice}: Priors and their sources, below Parameters"),
    ]
    if olivine_fits:
        rows[2:2] = [("Fig. 5", "Forced oscillation of olivine", f"{olivine}; Preparation")]
        rows.append(
            (
                "Table 2",
                "Priors of olivine",
                f"{olivine}: Priors and their sources, below Parameters",
            )
        )
    table = pd.DataFrame(rows, columns=["paper", "shows", "on this page"])
    return ExtraSection(
        key=COUNTERPARTS_KEY,
        title="The paper's figures and tables on this page",
        paragraphs=(),
        tables=(
            ExtraTable(
                "table",
                "Counterparts",
                table,
                table,
                words=("paper", "shows"),
                sentences=("on this page",),
            ),
        ),
    )


def attenuation_section(fits: Mapping[str, Fit], spectra: Mapping[str, xr.Dataset]) -> ExtraSection:
    """Return figures and tables of attenuation; single draws and amplitudes of the first fit.

    Parameters
    ----------
    fits : mapping of str to Fit
        At least one.
    spectra : mapping of str to Dataset
        Spectra of the same fits (`pyburgers.predictions.attenuation.predict_attenuation`).
    """
    first, fit = next(iter(fits.items()))
    by_amplitude = predict_attenuation(fit, regimes=AMPLITUDE_REGIMES)
    check = time_domain_table(fit)
    return ExtraSection(
        key=ATTENUATION_KEY,
        title="Attenuation",
        paragraphs=(
            "What the fitted material would do under another load: stress cycles about a constant "
            "median stress. Strain lags stress by the angle δ, and tan δ is the attenuation 1/Q; "
            "every draw of the posterior gives a spectrum in closed form. Tables give the median "
            "and 5 and 95 % of the draws; the CSV files hold all frequencies.",
            MICROSTRUCTURE_SENTENCE,
        ),
        tables=(
            *(
                ExtraTable(
                    f"{name}_quantiles",
                    f"tan δ of {name}",
                    overview_table(spectrum),
                    quantile_table(spectrum),
                    words=("regime",),
                )
                for name, spectrum in spectra.items()
            ),
            ExtraTable(
                "time_domain",
                f"Closed form against simulation in time, {first} at the median of its parameters",
                _shown_check(check),
                check,
                words=("regime",),
            ),
        ),
        figures=(
            *(
                ExtraFigure(
                    f"{name}_spectrum",
                    f"Attenuation of {name}",
                    attenuation_figures.ATTENUATION_CAPTION,
                    partial(attenuation_figures.attenuation, spectrum, spectrum.attrs["title"]),
                )
                for name, spectrum in spectra.items()
            ),
            ExtraFigure(
                f"{first}_draws",
                f"Attenuation of {first}, draw by draw",
                attenuation_figures.DRAWS_CAPTION,
                partial(
                    attenuation_figures.attenuation_draws,
                    spectra[first],
                    spectra[first].attrs["title"],
                ),
            ),
            ExtraFigure(
                f"{first}_amplitude",
                f"Attenuation of {first} and the amplitude of the cycles",
                attenuation_figures.AMPLITUDE_CAPTION,
                partial(
                    attenuation_figures.amplitude_dependence,
                    by_amplitude,
                    by_amplitude.attrs["title"],
                ),
            ),
        ),
        after_fits=True,
    )


def time_domain_table(fit: Fit) -> pd.DataFrame:
    """Compare the closed form of attenuation with phase lags of simulated records.

    Parameters
    ----------
    fit : Fit
        The median of each parameter is taken, with the initial microstructure.

    Returns
    -------
    DataFrame
        Columns regime, frequency_Hz, closed_form, simulated, relative_difference; a row for each
        of the paper's regimes and each of `CHECKED_FREQUENCIES`.

    Raises
    ------
    SamplingError
        If the solver finds no solution.
    """
    draws = fit.posterior["posterior"].to_dataset()
    median = {name: float(draws[name].median()) for name in PARAMETER_NAMES}
    temperature, grain_size = fit.experiment.temperature, fit.experiment.initial_grain_size
    closed = attenuation_spectrum(
        median, CHECKED_FREQUENCIES, PAPER_REGIMES, temperature=temperature, grain_size=grain_size
    )
    rows = []
    for regime, of_regime in zip(PAPER_REGIMES, closed["tan_delta"].to_numpy(), strict=True):
        for frequency, expected in zip(CHECKED_FREQUENCIES, of_regime, strict=True):
            lag = simulated_phase_lag(
                median, regime, frequency, temperature=temperature, grain_size=grain_size
            )
            rows.append(
                {
                    "regime": regime.label,
                    "frequency_Hz": frequency,
                    "closed_form": float(expected),
                    "simulated": lag.tan_delta,
                    "relative_difference": lag.tan_delta / float(expected) - 1,
                }
            )
    return pd.DataFrame(rows)


def _shown_check(check: pd.DataFrame) -> pd.DataFrame:
    """Return a `time_domain_table` as text."""
    return pd.DataFrame(
        {
            "regime": check["regime"],
            "frequency (Hz)": check["frequency_Hz"].map("{:.0e}".format),
            "tan δ, closed form": check["closed_form"].map("{:#.5g}".format),
            "tan δ, simulated": check["simulated"].map("{:#.5g}".format),
            "relative difference": check["relative_difference"].map("{:+.0e}".format),
        }
    )


def preparation_section(fits: Mapping[str, Fit]) -> ExtraSection:
    """Return the figures of how the record of a forced oscillation test was prepared.

    Parameters
    ----------
    fits : mapping of str to Fit
        Fits of forced oscillation tests by treatment of the background.
    """
    experiments = [oscillation_of(fit) for fit in fits.values()]
    return ExtraSection(
        key=PREPARATION_KEY,
        title="Preparation of the olivine record",
        paragraphs=(
            "The record of strain and stress is treated in two ways. With the background removed, "
            "as in the paper, only the oscillating parts drive the model and are compared with it; "
            "with the background kept, bias stress and background strain rate take part.",
        ),
        figures=tuple(
            ExtraFigure(
                experiment.id,
                f"From the record to the model, {experiment.id}",
                oscillation_figures.PREPARATION_CAPTION,
                partial(
                    oscillation_figures.preparation,
                    experiment.prepared,
                    experiment.record,
                    f"{experiment.id}: {experiment.provenance.kind} data",
                ),
            )
            for experiment in experiments
        ),
        after_fits=True,
    )


@dataclass(frozen=True, eq=False)
class _Compared:
    """A quantity, its draws (SI) by treatment, and its true value where that is known."""

    label: str
    si_unit: str
    unit: str
    factor: float
    draws: Mapping[str, FloatArray]
    truth: float | None


def background_section(fits: Mapping[str, Fit]) -> ExtraSection:
    """Return what the treatment of the background changes in the posterior, and why.

    Parameters
    ----------
    fits : mapping of str to Fit
        Fits of one forced oscillation test by treatment of the background.

    Raises
    ------
    SamplingError
        If the solver finds no solution at the true parameters.
    """
    prepared = oscillation_of(next(iter(fits.values()))).prepared
    bias = float(np.mean(prepared.stress_fit.trend(prepared.time))) * STRESS_FACTOR
    amplitude = prepared.stress_fit.amplitude()[0] * STRESS_FACTOR
    compared = _compared(fits)
    return ExtraSection(
        key=BACKGROUND_KEY,
        title="What removing the background changes",
        paragraphs=(
            f"The stress of this record oscillates by {amplitude:.0f} {STRESS_UNIT} about a bias "
            f"of {bias:.0f} {STRESS_UNIT}. With the background kept, the model does the same. With "
            "the background removed, model and data oscillate about zero, which is another state "
            "of the material, for two reasons.",
            "First, stress passes through zero twice in each cycle. There the piezometer asks for "
            "huge grains, and grain size follows it for as long as strain goes on: grains grow "
            "where under the bias they hardly change, and coarse grains flow more slowly.",
            "Second, the dashpot is a power law. Under a bias it flows all the time, and a small "
            "oscillation changes its rate in proportion, n times the mean rate over the bias; "
            "about zero it flows at the peaks of stress alone, at the n-th power of the "
            "amplitude. What it contributes to the strain of a cycle differs, so the Kelvin "
            "element has to make up for another part of the observed amplitude and phase lag.",
            "The table gives the median and, in brackets, 5 and 95 % of the draws. True values are "
            "those behind the synthetic record; for the rate and the grain size they are what the "
            "model with its background has at the true parameters.",
        ),
        tables=(
            ExtraTable(
                "comparison",
                "The same record, treated in two ways",
                _shown_comparison(compared),
                _saved_comparison(compared),
                words=("quantity", "unit"),
            ),
        ),
        after_fits=True,
    )


def _compared(fits: Mapping[str, Fit]) -> list[_Compared]:
    """Gather what the table of `background_section` compares."""
    truths = next(iter(fits.values())).experiment.true_parameters or {}
    rows = []
    for name in COMPARED_PARAMETERS:
        quantity = shown_quantity(name)
        draws = {
            key: all_draws(fit.posterior["posterior"].to_dataset()[name])
            for key, fit in fits.items()
        }
        rows.append(
            _Compared(
                quantity.label,
                quantity.si_unit,
                unit_text(quantity),
                quantity.display_factor,
                draws,
                truths.get(name),
            )
        )
    rates, grains = {}, {}
    for key, fit in fits.items():
        predictions = fit.posterior["predictions"].to_dataset()
        rates[key] = np.abs(all_draws(predictions["dashpot_rate"])).max(axis=1)
        grains[key] = all_draws(predictions["grain_size"])[:, -1]
    true_rate = true_grain = None
    if truths and "kept" in fits:
        experiment = fits["kept"].experiment
        grid = protocol_of(experiment).prediction_grid(experiment)
        solution = solve(experiment, truths, grid, solver=REFERENCE_SOLVER)
        true_rate = float(np.abs(solution["grid_dashpot_rate"]).max())
        true_grain = float(solution["grid_grain_size"][-1])
    rate = shown_quantity(REFERENCE_FLOW_RATE)
    label = "largest rate of the dashpot"
    rows.append(
        _Compared(label, rate.si_unit, unit_text(rate), rate.display_factor, rates, true_rate)
    )
    label = "grain size at the end"
    rows.append(_Compared(label, "m", LENGTH_UNIT, LENGTH_FACTOR, grains, true_grain))
    return rows


def _shown_comparison(compared: list[_Compared]) -> pd.DataFrame:
    """Return the comparison as text in display units."""
    rows = []
    for row in compared:
        shown = {}
        for key, draws in row.draws.items():
            low, median, high = (end * row.factor for end in central_band(draws))
            shown[f"background {key}"] = f"{median:.3g} [{low:.3g}, {high:.3g}]"
        truth = "" if row.truth is None else f"{row.truth * row.factor:.3g}"
        rows.append({"quantity": row.label, "unit": row.unit, **shown, "true value": truth})
    return pd.DataFrame(rows)


def _saved_comparison(compared: list[_Compared]) -> pd.DataFrame:
    """Return the comparison as numbers in SI units."""
    rows = []
    for row in compared:
        numbers: dict[str, float] = {}
        for key, draws in row.draws.items():
            low, median, high = central_band(draws)
            numbers |= {f"{key}_median": median, f"{key}_q5": low, f"{key}_q95": high}
        rows.append({"quantity": row.label, "unit": row.si_unit, **numbers, "truth": row.truth})
    return pd.DataFrame(rows)
