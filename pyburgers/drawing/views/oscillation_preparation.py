"""Figure of how the record of an oscillation is prepared for the model."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pyburgers.common.draws import FloatArray
from pyburgers.drawing.page_parts import recipe
from pyburgers.drawing.panels import STRAIN_LABEL, STRESS_LABEL, draw_dots, figure_of
from pyburgers.drawing.style import BLACK, BLUE, GREY, ORANGE, SKY_BLUE, VERMILION
from pyburgers.kinds.experiment import of_kind
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.forced_oscillation.harmonics import HarmonicFit
from pyburgers.kinds.forced_oscillation.preparation import (
    OscillationRecord,
    PreparedOscillation,
)
from pyburgers.kinds.kind import FittedTest
from pyburgers.model.display import (
    STRAIN_FACTOR,
    STRESS_FACTOR,
)

TIME_LABEL = "time on the record's clock (s)"

CURVE_POINTS_PER_CYCLE = 100
RATE_FACTOR = 1e5
"""Strain rates are shown in 1e-5 per second."""


def preparation(prepared: PreparedOscillation, record: OscillationRecord, heading: str) -> Figure:
    """Draw each step from a raw record to the model's input, below a heading."""
    strain_fit, stress_fit = prepared.strain_fit, prepared.stress_fit
    of_strain = _curve_times(record.strain_time, prepared.period)
    of_stress = _curve_times(prepared.time, prepared.period)
    kept = prepared.background == "kept"
    strain, stress = (STRAIN_LABEL, STRAIN_FACTOR), (STRESS_LABEL, STRESS_FACTOR)
    strain_bars = record.strain_time, record.strain_uncertainty
    with figure_of(8.0, 11.0, heading) as figure:
        panels = [
            _Panel(axes, title, *label)
            for axes, (title, label) in zip(
                figure.subplots(5, 1, sharex=True),
                (
                    ("(a) strain readings", strain),
                    ("(b) oscillating part of the strain", strain),
                    (
                        f"(c) strain rate that drives the model, background {prepared.background}",
                        (r"strain rate (10$^{-5}$ s$^{-1}$)", RATE_FACTOR),
                    ),
                    ("(d) stress readings", stress),
                    (
                        "(e) stress that the model is compared with, bias and drift "
                        + ("kept" if kept else "removed"),
                        stress,
                    ),
                ),
                strict=True,
            )
        ]
        raw_strain, oscillation, rate, raw_stress, compared = panels
        raw_strain.dots(*strain_bars, record.strain, "strain readings")
        raw_strain.fit(of_strain, strain_fit)
        detrended = record.strain - strain_fit.trend(record.strain_time)
        oscillation.dots(*strain_bars, detrended, "strain without trend")
        oscillation.line(of_strain, strain_fit.periodic(of_strain), "oscillation")
        rate.line(of_strain, prepared.strain_rate(of_strain), "driving strain rate")
        if kept:
            trend_rate = strain_fit.trend_rate(of_strain)
            rate.line(of_strain, trend_rate, "background rate", VERMILION, "--")
        rate.axes.axhline(0.0, color=GREY, linewidth=0.8, zorder=0)
        stress_bars = record.stress_time, record.stress_uncertainty
        raw_stress.dots(*stress_bars, record.stress, "stress readings")
        raw_stress.fit(of_stress, stress_fit)
        compared.dots(prepared.time, prepared.uncertainty, prepared.stress, "stress for the model")
        drift = stress_fit.trend(of_stress) if kept else 0.0
        label = "fit" if kept else "oscillation"
        compared.line(of_stress, stress_fit.periodic(of_stress) + drift, label)
        for panel in panels:
            panel.axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        compared.axes.set_xlabel(TIME_LABEL)
        figure.align_ylabels()
    return figure


@dataclass(frozen=True)
class _Panel:
    """A panel of quantities along time (s); the factor turns SI units into those of its label."""

    axes: Axes
    title: str
    label: str
    factor: float

    def __post_init__(self) -> None:
        """Write title and label."""
        self.axes.set_title(self.title, loc="left")
        self.axes.set_ylabel(self.label)

    def dots(
        self, time: FloatArray, uncertainty: FloatArray, values: FloatArray, label: str
    ) -> None:
        """Draw readings with their standard deviations."""
        error, scaled = uncertainty * self.factor, values * self.factor
        look: dict[str, Any] = {"face": BLACK, "size": 2.5, "ecolor": SKY_BLUE, "zorder": 1}
        draw_dots(self.axes, time, scaled, yerr=error, label=label, **look)

    def line(
        self,
        time: FloatArray,
        values: FloatArray,
        label: str,
        colour: str = BLUE,
        dashes: str = "-",
    ) -> None:
        """Draw a curve."""
        look: dict[str, Any] = {"color": colour, "linestyle": dashes, "linewidth": 1.3}
        self.axes.plot(time, values * self.factor, label=label, **look)

    def fit(self, time: FloatArray, fit: HarmonicFit) -> None:
        """Draw a fit and its trend."""
        trend = fit.trend(time)
        self.line(time, trend + fit.periodic(time), "fit", ORANGE)
        self.line(time, trend, f"trend of degree {fit.degree}", VERMILION, "--")


@recipe(
    "preparation",
    "From the record to the model",
    "From the raw record to what the model takes: (a) strain readings, with a fit of the "
    "oscillation, its second and third harmonics and a polynomial trend (dashed); (b) strain "
    "without the trend; (c) the strain rate that drives the model; (d) stress readings, with "
    "the same kind of fit; (e) the stress that the model is compared with. Bars are one "
    "standard deviation of a reading.",
    lambda _: "",
    suits=lambda _: False,
)
def preparation_of(fit: FittedTest) -> Figure:
    """Draw the preparation of the record of a fit."""
    experiment = of_kind(fit.experiment, OscillationExperiment)
    heading = f"{experiment.id}: {experiment.provenance.kind} data"
    return preparation(experiment.prepared, experiment.record, heading)


def _curve_times(readings: FloatArray, period: float) -> FloatArray:
    """Return times (s) for a curve over a series of readings."""
    first, last = readings[0], readings[-1]
    count = int(CURVE_POINTS_PER_CYCLE * (last - first) / period) + 2
    times: FloatArray = np.linspace(first, last, count)
    return times
