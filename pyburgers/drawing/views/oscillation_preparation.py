"""Figure of how the record of an oscillation is prepared for the model."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pyburgers.common.draws import FloatArray
from pyburgers.drawing.page_parts import recipe
from pyburgers.drawing.panels import STRAIN_LABEL, STRESS_LABEL, figure_of
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
    strain_time = _curve_times(record.strain_time, prepared.period)
    stress_time = _curve_times(prepared.time, prepared.period)
    strain_fit, stress_fit = prepared.strain_fit, prepared.stress_fit
    kept = prepared.background == "kept"
    rates = [_Line(strain_time, prepared.strain_rate(strain_time), "driving strain rate", BLUE)]
    if kept:
        trend_rate = strain_fit.trend_rate(strain_time)
        rates.append(_Line(strain_time, trend_rate, "background rate", VERMILION, "--"))
    trend = stress_fit.trend(stress_time) if kept else 0.0
    compared = _Line(
        stress_time,
        stress_fit.periodic(stress_time) + trend,
        "fit" if kept else "oscillation",
        BLUE,
    )
    strain_errors = (record.strain_time, record.strain_uncertainty)
    detrended = record.strain - strain_fit.trend(record.strain_time)
    oscillation = strain_fit.periodic(strain_time)
    with figure_of(8.0, 11.0, heading) as figure:
        panels = figure.subplots(5, 1, sharex=True)
        strain_label = (STRAIN_LABEL, STRAIN_FACTOR)
        stress_label = (STRESS_LABEL, STRESS_FACTOR)
        _draw_panel(
            panels[0],
            "(a) strain readings",
            strain_label,
            _fit_lines(strain_time, strain_fit),
            _Readings(*strain_errors, record.strain, "strain readings"),
        )
        _draw_panel(
            panels[1],
            "(b) oscillating part of the strain",
            strain_label,
            [_Line(strain_time, oscillation, "oscillation", BLUE)],
            _Readings(*strain_errors, detrended, "strain without trend"),
        )
        _draw_panel(
            panels[2],
            f"(c) strain rate that drives the model, background {prepared.background}",
            (r"strain rate (10$^{-5}$ s$^{-1}$)", RATE_FACTOR),
            rates,
        )
        panels[2].axhline(0.0, color=GREY, linewidth=0.8, zorder=0)
        _draw_panel(
            panels[3],
            "(d) stress readings",
            stress_label,
            _fit_lines(stress_time, stress_fit),
            _Readings(
                record.stress_time, record.stress_uncertainty, record.stress, "stress readings"
            ),
        )
        _draw_panel(
            panels[4],
            "(e) stress that the model is compared with, bias and drift "
            + ("kept" if kept else "removed"),
            stress_label,
            [compared],
            _Readings(prepared.time, prepared.uncertainty, prepared.stress, "stress for the model"),
        )
        panels[4].set_xlabel(TIME_LABEL)
        figure.align_ylabels()
    return figure


@recipe(
    "preparation",
    "From the record to the model",
    "From the raw record to what the model takes: (a) strain readings, with a fit of the "
    "oscillation, its second and third harmonics and a polynomial trend (dashed); (b) strain "
    "without the trend; (c) the strain rate that drives the model; (d) stress readings, with "
    "the same kind of fit; (e) the stress that the model is compared with. Bars are one "
    "standard deviation of a reading.",
    lambda _: "",
    on_every_page=False,
)
def preparation_of(fit: FittedTest) -> Figure:
    """Draw the preparation of the record of a fit."""
    experiment = of_kind(fit.experiment, OscillationExperiment)
    heading = f"{experiment.id}: {experiment.provenance.kind} data"
    return preparation(experiment.prepared, experiment.record, heading)


class _Line(NamedTuple):
    """A curve along time (s), in SI units."""

    time: FloatArray
    values: FloatArray
    label: str
    colour: str
    dashes: str = "-"


class _Readings(NamedTuple):
    """Readings at times (s) with their standard deviations, in SI units."""

    time: FloatArray
    uncertainty: FloatArray
    values: FloatArray
    label: str


def _curve_times(readings: FloatArray, period: float) -> FloatArray:
    """Return times (s) for a curve over a series of readings."""
    first, last = readings[0], readings[-1]
    count = int(CURVE_POINTS_PER_CYCLE * (last - first) / period) + 2
    times: FloatArray = np.linspace(first, last, count)
    return times


def _fit_lines(time: FloatArray, fit: HarmonicFit) -> list[_Line]:
    """Return a fit and its trend."""
    trend = fit.trend(time)
    return [
        _Line(time, trend + fit.periodic(time), "fit", ORANGE),
        _Line(time, trend, f"trend of degree {fit.degree}", VERMILION, "--"),
    ]


def _draw_panel(
    axes: Axes,
    heading: str,
    label: tuple[str, float],
    lines: Sequence[_Line],
    readings: _Readings | None = None,
) -> None:
    """Draw readings and lines with a legend beside them; the label has the factor from SI."""
    text, factor = label
    if readings is not None:
        axes.errorbar(
            readings.time,
            readings.values * factor,
            yerr=readings.uncertainty * factor,
            linestyle="none",
            marker="o",
            markersize=2.5,
            color=BLACK,
            ecolor=SKY_BLUE,
            elinewidth=0.9,
            zorder=1,
            label=readings.label,
        )
    for line in lines:
        axes.plot(
            line.time,
            line.values * factor,
            color=line.colour,
            linestyle=line.dashes,
            linewidth=1.3,
            label=line.label,
        )
    axes.set_title(heading, loc="left")
    axes.set_ylabel(text)
    handles, labels = axes.get_legend_handles_labels()
    # Readings, which matplotlib puts last, come first.
    order = sorted(range(len(labels)), key=lambda k: isinstance(handles[k], Line2D))
    axes.legend(
        [handles[k] for k in order],
        [labels[k] for k in order],
        loc="center left",
        bbox_to_anchor=(1.0, 0.5),
    )
