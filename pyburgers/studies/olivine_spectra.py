"""Measured attenuation of olivine: one relaxation time, a band of them, and what both miss.

The table is that of specimen A1802 of Qu et al. (2024) that comes with the package
(`data/olivine`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pyburgers.checks.fit_checks import CheckKind
from pyburgers.common.draws import all_draws
from pyburgers.drawing.page_parts import PageFigure, PageSection, PageTable
from pyburgers.drawing.panels import draw_band, draw_data
from pyburgers.drawing.style import BLUE, VERMILION, style
from pyburgers.drawing.views.attenuation import (
    ARRHENIUS_CAPTION,
    MASTER_CAPTION,
    MODULUS_NAMES,
    PERIOD_LABEL,
    arrhenius,
    left_over,
    master_curves,
    relaxation_result,
    rms_by_temperature,
    rms_result,
)
from pyburgers.drawing.views.relaxation_spectrum import (
    SPECTRUM_CAPTION,
    relaxation_spectrum,
    spectrum_result,
)
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.prediction import Prediction
from pyburgers.fitting.side_by_side import Task, task_of
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import with_variant
from pyburgers.predictions.other_tests import score_sentence, score_table, surprise_sentence
from pyburgers.protocols.attenuation.experiment import AttenuationExperiment
from pyburgers.protocols.attenuation.files import load_attenuation
from pyburgers.protocols.attenuation.table import ATTENUATION, MODULUS
from pyburgers.protocols.experiment import of_kind
from pyburgers.sampling.options import SamplerOptions

FloatArray = npt.NDArray[np.float64]

SPECIMEN = "A1802"

BAND = "band"

LAWS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {"one element": ("linear", VERMILION), BAND: ("extended", BLUE)}
)
"""Laws of the Kelvin part that are fitted, by what the page calls them, with their colours."""

BAND_DRAWS = 1000
"""Of each chain of a fit of a band at least: fewer leave too few independent ones of its ends."""

GPA = 1e-9

MOSTLY_SHARED = 0.5
"""Share of the squares left over from which on whole temperatures are what is missed."""


def run_name(law: str, *, without_hottest: bool = False) -> str:
    """Return the name of the run of a fit, of all temperatures or all but the hottest."""
    name = f"{SPECIMEN}_{law.replace(' ', '_')}"
    return f"{name}_without_hottest" if without_hottest else name


def spectra_tasks(folder: Path, options: SamplerOptions) -> dict[str, Task]:
    """Return the fits of the measured spectra, by the names of their runs.

    Each law is fitted to all temperatures, and to all but the hottest, which it then predicts.

    Parameters
    ----------
    folder : Path
        Of the shipped tables.
    options : SamplerOptions
        Of every fit, those of a band with `BAND_DRAWS` at least; they warm up as long as their
        protocol needs.
    """
    table = load_attenuation(folder / f"attenuation_{SPECIMEN}.toml")
    priors = default_priors(table.material, table.protocol)
    colder = table.without_part(next(iter(table.parts)))
    tasks = {}
    for law, (kelvin, _) in LAWS.items():
        draws = max(options.draws, BAND_DRAWS) if law == BAND else options.draws
        settled = replace(options, warmup=None, draws=draws)
        own = with_variant(priors, table, {"kelvin": kelvin})
        for experiment in (table, colder):
            name = run_name(law, without_hottest=experiment is colder)
            tasks[name] = task_of([replace(experiment, id=name)], own, settled)
    return tasks


def hottest_of(table: AttenuationExperiment) -> AttenuationExperiment:
    """Return the hottest spectrum of a table as a test of its own."""
    name = next(iter(table.parts))
    return replace(table.only_part(name), id=f"{SPECIMEN} at {name}")


@dataclass(frozen=True, eq=False)
class LawTried:
    """What one law says of the measured spectra.

    Attributes
    ----------
    name : str
        A key of `LAWS`.
    fit : Fit
        To all temperatures.
    prediction : Prediction
        Of the hottest, from a fit to the others.
    """

    name: str
    fit: Fit
    prediction: Prediction

    @classmethod
    def of(cls, name: str, fits: Mapping[str, Fit]) -> "LawTried":
        """Predict the hottest temperature from the fit to the others."""
        fit = fits[run_name(name)]
        colder = fits[run_name(name, without_hottest=True)]
        return cls(
            name, fit, colder.predict(hottest_of(of_kind(fit.experiment, AttenuationExperiment)))
        )

    def row(self) -> dict[str, Any]:
        """Return how well it does: root mean squares of ln tan delta and ln modulus."""
        fitted, predicted = (
            rms_by_temperature(one).to_dict("index")["all"] for one in (self.fit, self.prediction)
        )
        return {
            "law": self.name,
            "sampled_well": self.fit.sampled_well.value,
            "describes_data": self.fit.describes_data.value,
            "rms_log_tan_delta": fitted["rms_log_tan_delta"],
            "rms_log_modulus": fitted["rms_log_modulus"],
            "predicted_rms_log_tan_delta": predicted["rms_log_tan_delta"],
            "predicted_rms_log_modulus": predicted["rms_log_modulus"],
        }

    def verdicts(self) -> str:
        """Say whether it was sampled well and describes the data."""
        answers = self.fit.verdicts()
        said = (answers[kind].sentence for kind in (CheckKind.SAMPLING, CheckKind.DESCRIPTION))
        return f"{self.name.capitalize()}: {' '.join(said)}"

    def surprise(self) -> str:
        """Say whether its prediction of the hottest temperature is as good as it expects."""
        said = surprise_sentence(self.prediction, score_table(self.prediction))
        return f"{self.name.capitalize()}: {said}"

    def predicted(self) -> str:
        """Say how well it predicts the hottest temperature from the others."""
        scored = score_sentence(self.prediction, score_table(self.prediction))
        return f"{self.name.capitalize()}, {self.prediction.experiment.id}: {scored}"


def spectra_section(fits: Mapping[str, Fit]) -> PageSection:
    """Say what one relaxation time and a band of them make of the measured spectra.

    Parameters
    ----------
    fits : mapping of str to Fit
        Those of `spectra_tasks`, by the names of their runs.
    """
    tried = [LawTried.of(law, fits) for law in LAWS]
    table = of_kind(tried[0].fit.experiment, AttenuationExperiment)
    rows = pd.DataFrame([one.row() for one in tried])
    *_, last = tried
    return PageSection(
        key="olivine_spectra",
        title=f"Measured attenuation: {table.material} {SPECIMEN}",
        details=(
            f"Measured: {table.provenance.source}. Attenuation and shear modulus at "
            f"{len(table.parts)} temperatures, one activation enthalpy for all relaxation times. "
            f"{table.provenance.notes}",
            *(one.verdicts() for one in tried),
            *(one.predicted() for one in tried),
        ),
        paragraphs=(
            "The hottest temperature, predicted from a fit to the colder ones. "
            + " ".join(one.surprise() for one in tried),
            remaining_sentence(
                left_over(last.fit)[MODULUS],
                of_kind(last.fit.experiment, AttenuationExperiment).conditions.temperature,
            ),
        ),
        tables=(
            PageTable(
                "laws",
                "How well the laws do",
                _shown(rows),
                rows,
                words=("law", "sampled well?", "describes the data?"),
            ),
        ),
        figures=(
            *(
                PageFigure(
                    f"master_curves_{one.name.replace(' ', '_')}",
                    f"Attenuation and modulus, {one.name}",
                    MASTER_CAPTION,
                    partial(master_curves, one.fit),
                    rms_result(one.fit),
                )
                for one in reversed(tried)
            ),
            PageFigure(
                "hottest",
                "The hottest temperature, predicted from the others",
                "Attenuation and modulus against period at the hottest temperature, which took no "
                "part in these fits: circles are readings, lines predictive medians, areas hold "
                "90 % of new readings as each fit has them.",
                partial(_draw_hottest, tried),
                " ".join(one.predicted() for one in tried),
            ),
            PageFigure(
                "arrhenius",
                f"Relaxation times, {last.name}",
                ARRHENIUS_CAPTION,
                partial(arrhenius, last.fit),
                relaxation_result(last.fit),
            ),
            PageFigure(
                "relaxation_spectrum",
                f"Spectrum of relaxation times, {last.name}",
                SPECTRUM_CAPTION,
                partial(relaxation_spectrum, last.fit),
                spectrum_result(last.fit),
            ),
        ),
    )


def remaining_sentence(residual: FloatArray, temperature: FloatArray) -> str:
    """Say how much of what a fit of a table leaves over belongs to whole temperatures.

    Parameters
    ----------
    residual : array, shape (n_points,)
        What is left over of the logarithm of the modulus.
    temperature : array, shape (n_points,)
        Of each reading (K).
    """
    means = {own: float(residual[temperature == own].mean()) for own in np.unique(temperature)}
    common = np.array([means[own] for own in temperature])
    share = float(np.sum(common**2) / np.sum(residual**2))
    worst = max(means, key=lambda own: abs(means[own]))
    told = (
        f"Of what remains of the modulus {100 * share:.0f} % of the squares are means over all "
        f"periods of a temperature ({100 * len(means) / residual.size:.0f} % if readings err each "
        f"for itself), up to {100 * means[worst]:+.1f} % (at {worst:.0f} K)."
    )
    if share < MOSTLY_SHARED:
        return told
    return (
        f"{told} That is an error that readings of a temperature share, or an elastic modulus that "
        "is not linear in temperature; neither is in the model, so that intervals are too narrow "
        "by it."
    )


def _shown(rows: pd.DataFrame) -> pd.DataFrame:
    names = {
        "rms_log_tan_delta": "rms of ln tan δ",
        "rms_log_modulus": "rms of ln modulus",
        "predicted_rms_log_tan_delta": "hottest predicted: ln tan δ",
        "predicted_rms_log_modulus": "hottest predicted: ln modulus",
    }
    numbers = {shown: rows[name].map("{:.3f}".format) for name, shown in names.items()}
    return pd.DataFrame(
        {
            "law": rows["law"],
            "sampled well?": rows["sampled_well"],
            "describes the data?": rows["describes_data"],
            **numbers,
        }
    )


def _draw_hottest(tried: list[LawTried]) -> Figure:
    """Draw the hottest spectrum with what each law predicts of it."""
    table = of_kind(tried[0].prediction.experiment, AttenuationExperiment)
    with style():
        figure = Figure(figsize=(8.6, 7.2), layout="constrained")
        panels = figure.subplots(2, 1, sharex=True)
        for axes, quantity in zip(panels, (ATTENUATION, MODULUS), strict=True):
            for one in tried:
                _draw_predicted(axes, one, quantity)
        period = table.conditions.period
        readings = (table.readings.tan_delta, table.readings.modulus * GPA)
        for axes, values in zip(panels, readings, strict=True):
            draw_data(axes, period, values, None, f"{table.provenance.kind} data")
        upper, lower = panels
        upper.set_xscale("log")
        upper.set_yscale("log")
        upper.set_ylabel(r"$\tan\delta$ (–)")
        lower.set_ylabel(f"{MODULUS_NAMES[table.elasticity.deformation]} (GPa)")
        lower.set_xlabel(PERIOD_LABEL)
        upper.legend(loc="best")
        figure.suptitle(table.title, fontsize=10)
    return figure


def _draw_predicted(axes: Axes, tried: LawTried, quantity: int) -> None:
    """Draw the band of new readings of attenuation or of the modulus."""
    predictions = tried.prediction.posterior["predictions"].to_dataset()
    conditions = of_kind(tried.prediction.experiment, AttenuationExperiment).conditions
    period, _, read = conditions.at(predictions["place"].to_numpy())
    own = read == quantity
    new = np.exp(all_draws(predictions["log_reading_replicated"])[:, own].astype(np.float64))
    _, colour = LAWS[tried.name]
    scale = GPA if quantity == MODULUS else 1.0
    draw_band(axes, period[own], new * scale, colour, tried.name)
