"""Figure of how a forced oscillation record is prepared for the model."""

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pyburgers.display import STRAIN_FACTOR, STRAIN_UNIT, STRESS_FACTOR, STRESS_UNIT
from pyburgers.figures import BLACK, BLUE, GREY, ORANGE, SKY_BLUE, VERMILION, style
from pyburgers.harmonics import HarmonicFit
from pyburgers.oscillation import OscillationRecord, PreparedOscillation

FloatArray = npt.NDArray[np.float64]

CURVE_POINTS_PER_CYCLE = 100
RATE_FACTOR = 1e5
"""Strain rates are shown in 1e-5 per second."""

PREPARATION_CAPTION = (
    "From the raw record to what the model takes. (a) Strain as measured, with a fit of the "
    "oscillation and its second and third harmonics plus a polynomial trend (dashed). (b) Strain "
    "without the trend and the oscillation alone: readings that leave the line in step with the "
    "period would call for more harmonics. (c) The strain rate that drives the model. (d) Stress "
    "as measured, with the same kind of fit. (e) The stress that the model is compared with. "
    "Vertical bars are one standard deviation of a reading either way; where none is seen, it is "
    "shorter than the symbol."
)


def preparation(prepared: PreparedOscillation, record: OscillationRecord, title: str) -> Figure:
    """Draw each step from a raw record to the model's input.

    Parameters
    ----------
    prepared : PreparedOscillation
        The prepared record.
    record : OscillationRecord
        The raw record that it was made from.
    title : str
        Heading.
    """
    time = _curve_times(record.strain_time, prepared.period)
    stress_time = _curve_times(prepared.time, prepared.period)
    of_strain, of_stress = prepared.strain_fit, prepared.stress_fit
    kept = prepared.background == "kept"
    with style():
        figure = Figure(figsize=(8.0, 11.0), layout="constrained")
        raw_strain, detrended, rate, raw_stress, compared = figure.subplots(5, 1, sharex=True)

        _draw_readings(
            raw_strain,
            record.strain_time,
            record.strain * STRAIN_FACTOR,
            record.strain_uncertainty * STRAIN_FACTOR,
            "measured strain",
        )
        _draw_fit(raw_strain, time, of_strain, STRAIN_FACTOR)
        _label(raw_strain, "(a) strain as measured", f"axial strain ({STRAIN_UNIT})")

        _draw_readings(
            detrended,
            record.strain_time,
            (record.strain - of_strain.trend(record.strain_time)) * STRAIN_FACTOR,
            record.strain_uncertainty * STRAIN_FACTOR,
            "strain without trend",
        )
        detrended.plot(
            time,
            of_strain.periodic(time) * STRAIN_FACTOR,
            color=BLUE,
            linewidth=1.3,
            label="oscillation",
        )
        _label(detrended, "(b) oscillating part of the strain", f"axial strain ({STRAIN_UNIT})")

        rate.plot(
            time,
            prepared.strain_rate(time) * RATE_FACTOR,
            color=BLUE,
            linewidth=1.3,
            label="driving strain rate",
        )
        if kept:
            rate.plot(
                time,
                of_strain.trend_rate(time) * RATE_FACTOR,
                color=VERMILION,
                linestyle="--",
                linewidth=1.3,
                label="background rate",
            )
        rate.axhline(0.0, color=GREY, linewidth=0.8, zorder=0)
        _label(
            rate,
            f"(c) strain rate that drives the model, background {prepared.background}",
            r"strain rate (10$^{-5}$ s$^{-1}$)",
        )

        _draw_readings(
            raw_stress,
            record.stress_time,
            record.stress * STRESS_FACTOR,
            record.stress_uncertainty * STRESS_FACTOR,
            "measured stress",
        )
        _draw_fit(raw_stress, stress_time, of_stress, STRESS_FACTOR)
        _label(raw_stress, "(d) stress as measured", f"differential stress ({STRESS_UNIT})")

        _draw_readings(
            compared,
            prepared.time,
            prepared.stress * STRESS_FACTOR,
            prepared.uncertainty * STRESS_FACTOR,
            "stress for the model",
        )
        trend = of_stress.trend(stress_time) if kept else 0.0
        compared.plot(
            stress_time,
            (of_stress.periodic(stress_time) + trend) * STRESS_FACTOR,
            color=BLUE,
            linewidth=1.3,
            label="fit" if kept else "oscillation",
        )
        _label(
            compared,
            "(e) stress that the model is compared with, bias and drift "
            + ("kept" if kept else "removed"),
            f"differential stress ({STRESS_UNIT})",
        )
        compared.set_xlabel("time on the record's clock (s)")
        figure.align_ylabels()
        figure.suptitle(title, fontsize=10)
    return figure


def _curve_times(readings: FloatArray, period: float) -> FloatArray:
    """Return times (s) for a curve over a series of readings."""
    first, last = readings[0], readings[-1]
    count = int(CURVE_POINTS_PER_CYCLE * (last - first) / period) + 2
    times: FloatArray = np.linspace(first, last, count)
    return times


def _draw_readings(
    axes: Axes, time: FloatArray, value: FloatArray, uncertainty: FloatArray, label: str
) -> None:
    """Draw readings with their standard deviations, all in display units."""
    axes.errorbar(
        time,
        value,
        yerr=uncertainty,
        linestyle="none",
        marker="o",
        markersize=2.5,
        color=BLACK,
        ecolor=SKY_BLUE,
        elinewidth=0.9,
        zorder=1,
        label=label,
    )


def _draw_fit(axes: Axes, time: FloatArray, fit: HarmonicFit, factor: float) -> None:
    """Draw a fit and its trend."""
    axes.plot(
        time,
        (fit.trend(time) + fit.periodic(time)) * factor,
        color=ORANGE,
        linewidth=1.3,
        label="fit",
    )
    axes.plot(
        time,
        fit.trend(time) * factor,
        color=VERMILION,
        linestyle="--",
        linewidth=1.3,
        label=f"trend of degree {fit.degree}",
    )


def _label(axes: Axes, title: str, label: str) -> None:
    """Give a panel its title, its axis label and a legend beside it."""
    axes.set_title(title, loc="left")
    axes.set_ylabel(label)
    handles, labels = axes.get_legend_handles_labels()
    # Readings, which matplotlib puts last, come first.
    order = sorted(range(len(labels)), key=lambda k: isinstance(handles[k], Line2D))
    axes.legend(
        [handles[k] for k in order],
        [labels[k] for k in order],
        loc="center left",
        bbox_to_anchor=(1.0, 0.5),
    )
