"""What the page of the study says about the olivine record.

Its preparation, and what the two treatments of its background change.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.common.draws import all_draws, central_band
from pyburgers.drawing.page_parts import PageFigure, PageSection, PageTable
from pyburgers.drawing.views import oscillation_preparation
from pyburgers.model.display import (
    LENGTH_FACTOR,
    LENGTH_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
    shown_quantity,
    unit_text,
)
from pyburgers.protocols.coordinates import REFERENCE_FLOW_RATE
from pyburgers.protocols.experiment import of_kind
from pyburgers.protocols.forced_oscillation.experiment import OscillationExperiment
from pyburgers.protocols.program_data import solve
from pyburgers.protocols.protocol import FittedTest, protocol_of
from pyburgers.protocols.stan_data import REFERENCE_SOLVER

FloatArray = npt.NDArray[np.float64]

PREPARATION_KEY, BACKGROUND_KEY = "preparation", "background"

COMPARED_PARAMETERS = (
    "kelvin_modulus",
    "kelvin_viscosity",
    "maxwell_modulus",
    "stress_exponent",
    "grain_size_exponent",
    "critical_strain_grain_size",
)
"""Parameters of olivine that the two treatments of the background are compared by."""


def preparation_section(fits: Mapping[str, FittedTest]) -> PageSection:
    """Return the figures of how the record of a forced oscillation test was prepared.

    Parameters
    ----------
    fits : mapping of str to FittedTest
        Fits of forced oscillation tests by treatment of the background.
    """
    experiments = [of_kind(fit.experiment, OscillationExperiment) for fit in fits.values()]
    return PageSection(
        key=PREPARATION_KEY,
        title="Preparation of the olivine record",
        paragraphs=(
            "The record of strain and stress is treated in two ways. With the background removed, "
            "as in the paper, only the oscillating parts drive the model and are compared with it; "
            "with the background kept, bias stress and background strain rate take part.",
        ),
        figures=tuple(
            PageFigure(
                experiment.id,
                f"From the record to the model, {experiment.id}",
                oscillation_preparation.PREPARATION_CAPTION,
                partial(
                    oscillation_preparation.preparation,
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


def background_section(fits: Mapping[str, FittedTest]) -> PageSection:
    """Return what the treatment of the background changes in the posterior, and why.

    Parameters
    ----------
    fits : mapping of str to FittedTest
        Fits of one forced oscillation test by treatment of the background.

    Raises
    ------
    SamplingError
        If the solver finds no solution at the true parameters.
    """
    prepared = of_kind(next(iter(fits.values())).experiment, OscillationExperiment).prepared
    bias = float(np.mean(prepared.stress_fit.trend(prepared.time))) * STRESS_FACTOR
    amplitude = prepared.stress_fit.amplitude()[0] * STRESS_FACTOR
    compared = _compared(fits)
    return PageSection(
        key=BACKGROUND_KEY,
        title="What removing the background changes",
        paragraphs=(
            f"The stress of this record oscillates by {amplitude:.0f} {STRESS_UNIT} about a bias "
            f"of {bias:.0f} {STRESS_UNIT}. With the background kept, the model does the same. With "
            "the background removed, model and data oscillate about zero, which is another state "
            "of the material, for two reasons.",
        ),
        details=(
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
            PageTable(
                "comparison",
                "The same record, treated in two ways",
                _shown_comparison(compared),
                _saved_comparison(compared),
                words=("quantity", "unit"),
            ),
        ),
        after_fits=True,
    )


def _compared(fits: Mapping[str, FittedTest]) -> list[_Compared]:
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
