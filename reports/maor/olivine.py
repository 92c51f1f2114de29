"""What the page says about the olivine record: preparation and treatments of its background."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
from common import Fitted, FloatArray, central, interval, parameter_draws, prediction_draws

import pyburgers
from maor.olivine_statements import oscillation_of
from pyburgers import Fit, PageSection, PageTable

COMPARED_PARAMETERS = (
    "kelvin_modulus",
    "kelvin_viscosity",
    "maxwell_modulus",
    "stress_exponent",
    "grain_size_exponent",
    "critical_strain_grain_size",
)
"""Parameters of olivine that the two treatments of the background are compared by."""


def preparation_section(fits: Mapping[str, Fit]) -> PageSection:
    """Return the figures of how the record was prepared, by treatment of the background."""
    return PageSection(
        key="preparation",
        title="Preparation of the olivine record",
        paragraphs=(
            "The record of strain and stress is treated in two ways. With the background removed, "
            "as in the paper, only the oscillating parts drive the model and are compared with it; "
            "with the background kept, bias stress and background strain rate take part.",
        ),
        figures=tuple(
            replace(
                pyburgers.page_figure(fit, "preparation"),
                name=fit.experiment.id,
                title=f"From the record to the model, {fit.experiment.id}",
            )
            for fit in fits.values()
        ),
        after_fits=True,
    )


def background_section(fits: Mapping[str, Fit]) -> PageSection:
    """Return what the treatment of the background changes in the posterior, and why."""
    prepared = oscillation_of(next(iter(fits.values()))).prepared
    bias = float(np.mean(prepared.stress_fit.trend(prepared.time))) * 1e-6
    amplitude = prepared.stress_fit.amplitude()[0] * 1e-6
    return PageSection(
        key="background",
        title="What removing the background changes",
        paragraphs=(
            f"The stress of this record oscillates by {amplitude:.0f} MPa about a bias "
            f"of {bias:.0f} MPa. With the background kept, the model does the same. With "
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
                *_compared(fits),
                words=("quantity", "unit"),
            ),
        ),
        after_fits=True,
    )


def _compared(fits: Mapping[str, Fit]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the table of `background_section` as text in display units, and as numbers in SI."""
    truths = next(iter(fits.values())).experiment.true_parameters or {}
    shown, saved = [], []

    def add(
        label: str,
        si_unit: str,
        unit: str,
        factor: float,
        drawn: Callable[[Fitted], FloatArray],
        truth: float | None,
    ) -> None:
        draws = {key: drawn(fit) for key, fit in fits.items()}
        cells = {f"background {key}": interval(factor * x, ".3g") for key, x in draws.items()}
        text = "" if truth is None else f"{truth * factor:.3g}"
        shown.append({"quantity": label, "unit": unit, **cells, "true value": text})
        numbers = {
            f"{key}_{name}": value
            for key, x in draws.items()
            for name, value in zip(("median", "q5", "q95"), central(x)[[1, 0, 2]], strict=True)
        }
        saved.append({"quantity": label, "unit": si_unit, **numbers, "truth": truth})

    for name in COMPARED_PARAMETERS:
        one = pyburgers.shown_quantity(name)
        units = (one.si_unit, pyburgers.unit_text(one), one.display_factor)
        add(one.label, *units, partial(parameter_draws, name=name), truths.get(name))
    true_rate, true_grain = (
        _true_state(fits["kept"], truths) if "kept" in fits and truths else (None, None)
    )
    rate = pyburgers.shown_quantity("reference_flow_rate")
    units = (rate.si_unit, pyburgers.unit_text(rate), rate.display_factor)
    add("largest rate of the dashpot", *units, _largest_rate, true_rate)
    add("grain size at the end", "m", "µm", 1e6, _last_grains, true_grain)
    return pd.DataFrame(shown), pd.DataFrame(saved)


def _largest_rate(fit: Fitted) -> FloatArray:
    return np.asarray(np.abs(prediction_draws(fit, "dashpot_rate")).max(axis=1))


def _last_grains(fit: Fitted) -> FloatArray:
    return prediction_draws(fit, "grain_size")[:, -1]


def _true_state(fit: Fitted, truths: Mapping[str, float]) -> tuple[float, float]:
    """Largest rate of the dashpot (1/s) and last grain size (m) at the true parameters."""
    times = fit.posterior["predictions"]["time"].to_numpy()
    solution = pyburgers.simulate(fit.experiment, truths, at=times)
    rates = pyburgers.flow_rate(
        truths,
        solution["stress_Pa"],
        temperature=fit.experiment.temperature,
        grain_size=solution["grain_size_m"],
        fabric_factor=solution["fabric_factor"],
    )
    return float(np.abs(rates).max()), float(solution["grain_size_m"].iloc[-1])
