"""Measured attenuation of olivine: one relaxation time, a band of them, and what both miss.

The table is that of specimen A1802 of Qu et al. (2024) that comes with the package
(`data/olivine`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, cast

import numpy as np
import pandas as pd
from common import (
    BLACK,
    BLUE,
    DATA,
    VERDICT_COLUMNS,
    VERMILION,
    Fitted,
    FloatArray,
    bad_verdicts,
    draw_band,
    flat,
    shown_verdicts,
)
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import pyburgers
from pyburgers import AttenuationExperiment, Experiment, Fit, PageFigure, PageSection, PageTable

SPECIMEN = "A1802"

BAND = "band"

LAWS: Mapping[str, tuple[str, str]] = {
    "one element": ("linear", VERMILION),
    BAND: ("extended", BLUE),
}
"""Laws of the Kelvin part that are fitted, by what the page calls them, with their colours."""

BAND_DRAWS = 1000
"""Of each chain of a fit of a band at least: fewer leave too few independent ones of its ends."""

QUANTITIES = ((0, r"$\tan\delta$ (–)", 1.0), (1, "shear modulus (GPa)", 1e-9))
"""What is read of a table: its number, its axis, and the factor from SI of what is drawn."""

MOSTLY_SHARED = 0.5
"""Share of the squares left over from which on whole temperatures are what is missed."""


def run_name(law: str, *, without_hottest: bool = False) -> str:
    """Return the name of the run of a fit, of all temperatures or all but the hottest."""
    name = f"{SPECIMEN}_{law.replace(' ', '_')}"
    return f"{name}_without_hottest" if without_hottest else name


def spectra_tasks(options: pyburgers.SamplerOptions) -> dict[str, pyburgers.Task]:
    """Return the fits of the measured spectra, by the names of their runs.

    Each law is fitted to all temperatures, and to all but the hottest, which it then predicts.
    All have the given options, those of a band at least `BAND_DRAWS` draws; they warm up as long
    as tables of attenuation need.
    """
    table = table_of(pyburgers.load_experiment(DATA / "olivine" / f"attenuation_{SPECIMEN}.toml"))
    priors = pyburgers.priors(table.material, table.protocol)
    colder = table.without_part(next(iter(table.parts)))
    tasks = {}
    for law, (kelvin, _) in LAWS.items():
        draws = max(options.draws, BAND_DRAWS) if law == BAND else options.draws
        settled = replace(options, warmup=None, draws=draws)
        own = pyburgers.with_variant(priors, table, {"kelvin": kelvin})
        for experiment in (table, colder):
            name = run_name(law, without_hottest=experiment is colder)
            tasks[name] = pyburgers.task_of([replace(experiment, id=name)], own, settled)
    return tasks


def table_of(experiment: Experiment) -> AttenuationExperiment:
    """Return a test as a table of attenuation, which all tests of this study are."""
    return cast(AttenuationExperiment, experiment)


def hottest_of(table: AttenuationExperiment) -> AttenuationExperiment:
    """Return the hottest spectrum of a table as a test of its own."""
    name = next(iter(table.parts))
    return replace(table.only_part(name), id=f"{SPECIMEN} at {name}")


@dataclass(frozen=True, eq=False)
class LawTried:
    """A law, its fit to all temperatures, and the hottest predicted from a fit to the others."""

    name: str
    fit: Fit
    prediction: pyburgers.Prediction

    @classmethod
    def of(cls, name: str, fits: Mapping[str, Fit]) -> "LawTried":
        """Predict the hottest temperature from the fit to the others."""
        fit = fits[run_name(name)]
        colder = fits[run_name(name, without_hottest=True)]
        return cls(name, fit, colder.predict(hottest_of(table_of(fit.experiment))))

    def row(self) -> dict[str, Any]:
        """Return how well it does: root mean squares of ln tan delta and ln modulus."""
        fitted, predicted = rms(self.fit), rms(self.prediction)
        return {
            "law": self.name,
            "sampled_well": self.fit.sampled_well.value,
            "describes_data": self.fit.describes_data.value,
            "rms_log_tan_delta": fitted[0],
            "rms_log_modulus": fitted[1],
            "predicted_rms_log_tan_delta": predicted[0],
            "predicted_rms_log_modulus": predicted[1],
        }

    def verdicts(self) -> str:
        """Say whether it was sampled well and describes the data."""
        said = (answer.sentence for answer in self.fit.verdicts().values())
        return f"{self.name.capitalize()}: {' '.join(said)}"

    def surprise(self) -> str:
        """Say whether its prediction of the hottest temperature is as good as it expects."""
        said = pyburgers.surprise_sentence(self.prediction, pyburgers.score_table(self.prediction))
        return f"{self.name.capitalize()}: {said}"

    def predicted(self) -> str:
        """Say how well it predicts the hottest temperature from the others."""
        scored = pyburgers.score_sentence(self.prediction, pyburgers.score_table(self.prediction))
        return f"{self.name.capitalize()}, {self.prediction.experiment.id}: {scored}"


def spectra_section(fits: Mapping[str, Fit]) -> PageSection:
    """Say what one relaxation time and a band of them make of the measured spectra.

    Fits are those of `spectra_tasks`, by the names of their runs.
    """
    tried = [LawTried.of(law, fits) for law in LAWS]
    table = table_of(tried[0].fit.experiment)
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
            remaining_sentence(left_over(last.fit)[1], table.conditions.temperature),
        ),
        tables=(
            PageTable(
                "laws",
                "How well the laws do",
                _shown(rows),
                rows,
                words=("law", *VERDICT_COLUMNS.values()),
                bad=bad_verdicts(rows),
            ),
        ),
        figures=(
            *(
                replace(
                    pyburgers.page_figure(one.fit, "master_curves"),
                    name=f"master_curves_{one.name.replace(' ', '_')}",
                    title=f"Attenuation and modulus, {one.name}",
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
            *(
                replace(one, title=f"{one.title}, {last.name}")
                for one in (
                    pyburgers.page_figure(last.fit, name)
                    for name in ("arrhenius", "relaxation_spectrum")
                )
            ),
        ),
    )


def left_over(fit: Fitted) -> tuple[FloatArray, FloatArray]:
    """Return recorded less median modelled ln reading, of attenuation and of modulus, by row."""
    modelled = fit.posterior["model_response"]["log_reading"].median(("chain", "draw"))
    left = fit.experiment.response - modelled.to_numpy()
    n_rows = table_of(fit.experiment).readings.tan_delta.size
    return left[:n_rows], left[n_rows:]


def rms(fit: Fitted) -> tuple[float, float]:
    """Root mean square of what is left over of attenuation, upper limits apart, and of modulus."""
    attenuation, modulus = left_over(fit)
    known = attenuation[~table_of(fit.experiment).readings.is_limit]
    of_attenuation, of_modulus = (float(np.sqrt(np.mean(one**2))) for one in (known, modulus))
    return of_attenuation, of_modulus


def remaining_sentence(residual: FloatArray, temperature: FloatArray) -> str:
    """Say how much of what is left over of ln modulus belongs to whole temperatures (K).

    Both arrays have the shape (n_points,).
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
            **shown_verdicts(rows),
            **numbers,
        }
    )


def _draw_hottest(tried: list[LawTried]) -> Figure:
    """Draw the hottest spectrum with what each law predicts of it."""
    table = table_of(tried[0].prediction.experiment)
    readings = (table.readings.tan_delta, table.readings.modulus)
    with pyburgers.style():
        figure = Figure(figsize=(8.6, 7.2), layout="constrained")
        panels = figure.subplots(2, 1, sharex=True)
        for axes, (quantity, label, factor) in zip(panels, QUANTITIES, strict=True):
            for one in tried:
                _draw_predicted(axes, one, quantity, factor)
            axes.plot(
                table.conditions.period,
                readings[quantity] * factor,
                linestyle="none",
                marker="o",
                markersize=4,
                markerfacecolor="white",
                markeredgecolor=BLACK,
                markeredgewidth=0.8,
                label=f"{table.provenance.kind} data",
            )
            axes.set_ylabel(label)
        upper, lower = panels
        upper.set_xscale("log")
        upper.set_yscale("log")
        lower.set_xlabel("period (s)")
        upper.legend(loc="best")
        figure.suptitle(table.title, fontsize=10)
    return figure


def _draw_predicted(axes: Axes, tried: LawTried, quantity: int, factor: float) -> None:
    """Draw the band of new readings of attenuation or of the modulus."""
    predictions = tried.prediction.posterior["predictions"].to_dataset()
    conditions = table_of(tried.prediction.experiment).conditions
    period, _, read = conditions.at(predictions["place"].to_numpy())
    own = read == quantity
    new = np.exp(flat(predictions["log_reading_replicated"])[:, own])
    draw_band(axes, period[own], new * factor, LAWS[tried.name][1], tried.name)
