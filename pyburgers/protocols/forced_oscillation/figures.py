"""Figures of forced oscillation tests: how a record is prepared, and what a fit of it says.

Beside each figure stands how to read it. All refuse the fit of another kind of test (`InputError`).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy import stats

from pyburgers.common.draws import TAIL, all_draws, central_band
from pyburgers.drawing.page_parts import FigureRecipe
from pyburgers.drawing.panels import (
    LINES_AND_AREAS,
    MEDIAN_LABEL,
    FittedCurve,
    curve_with_residuals,
    draw_band_panel,
    draw_data,
    draw_retrodictions,
    result_of,
)
from pyburgers.drawing.style import BLACK, BLUE, GREEN, GREY, ORANGE, SKY_BLUE, VERMILION, style
from pyburgers.model.display import (
    LENGTH_FACTOR,
    LENGTH_UNIT,
    STRAIN_FACTOR,
    STRAIN_UNIT,
    STRESS_FACTOR,
    STRESS_UNIT,
    shown_quantity,
    unit_text,
)
from pyburgers.protocols.coordinates import REFERENCE_FLOW_RATE
from pyburgers.protocols.forced_oscillation.figure_results import grains_result, lag_result
from pyburgers.protocols.forced_oscillation.harmonics import HarmonicFit
from pyburgers.protocols.forced_oscillation.preparation import (
    OscillationRecord,
    PreparedOscillation,
)
from pyburgers.protocols.forced_oscillation.response import (
    observed_response,
    oscillation_of,
    predicted_response,
    replicated_response,
)
from pyburgers.protocols.protocol import FittedTest

FloatArray = npt.NDArray[np.float64]

STRESS_LABEL = f"differential stress ({STRESS_UNIT})"
TIME_LABEL = "time on the record's clock (s)"

CURVE_POINTS_PER_CYCLE = 100
RATE_FACTOR = 1e5
"""Strain rates are shown in 1e-5 per second."""

PREPARATION_CAPTION = (
    "From the raw record to what the model takes: (a) strain readings, with a fit of the "
    "oscillation, its second and third harmonics and a polynomial trend (dashed); (b) strain "
    "without the trend; (c) the strain rate that drives the model; (d) stress readings, with "
    "the same kind of fit; (e) the stress that the model is compared with. Bars are one "
    "standard deviation of a reading."
)


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
    with style():
        figure = Figure(figsize=(8.0, 11.0), layout="constrained")
        panels = figure.subplots(5, 1, sharex=True)
        strain_label = (f"axial strain ({STRAIN_UNIT})", STRAIN_FACTOR)
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
        figure.suptitle(heading, fontsize=10)
    return figure


def preparation_of(fit: FittedTest) -> Figure:
    """Draw the preparation of the record of a fit."""
    experiment = oscillation_of(fit)
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


STRESS_TIME_CAPTION = (
    "Top: the stress that the model is compared with (circles, bars are one standard "
    "deviation), the predictive median (solid line), up to 1000 retrodictions (thin lines), and "
    "the band that should hold 90 % of new readings of typical uncertainty. Bottom: data minus "
    "the predictive median over the noise of each reading, with the band that should hold 90 % "
    "of residuals if they were noise alone; a run on one side of zero, or an oscillation, is "
    "what the model misses."
)


def stress_time(fit: FittedTest) -> Figure:
    """Draw data, retrodictions, predictive band and residuals along time."""
    return curve_with_residuals(fitted_curve(fit))


def fitted_curve(fit: FittedTest) -> FittedCurve:
    """Gather the stress along time as measured and as a fit has it."""
    experiment = oscillation_of(fit)
    prepared = experiment.prepared
    predictions = fit.posterior["predictions"].to_dataset()
    time = predictions["time"].to_numpy()
    solutions = all_draws(predictions["stress"]) * STRESS_FACTOR
    predicted = fit.posterior["model_response"]["stress"].median(("chain", "draw")).to_numpy()
    noise = float(fit.posterior["posterior"]["stress_noise"].mean())
    return FittedCurve(
        grid=time,
        solutions=solutions,
        replicated=all_draws(predictions["stress_replicated"]) * STRESS_FACTOR,
        position=prepared.time,
        data=prepared.stress * STRESS_FACTOR,
        residuals=(prepared.stress - predicted) / (noise * prepared.relative_uncertainty),
        error=prepared.uncertainty * STRESS_FACTOR,
        data_label=f"{experiment.provenance.kind} data",
        noise_band=float(stats.norm.ppf(1.0 - TAIL)),
        position_label=TIME_LABEL,
        label=STRESS_LABEL,
        residual_label="residual / noise (–)",
        heading=experiment.title,
    )


STRESS_LOOP_CAPTION = (
    "Stress against the strain that drives the model: loops of single draws (thin lines, up to "
    "1000) and the predictive median (solid line). Their area is the work that is lost, their "
    "slope the stiffness at this period. Circles are the data, coloured by time. With the "
    "background kept, loops move along with the strain."
)


def stress_loop(fit: FittedTest) -> Figure:
    """Draw stress against driving strain: data and retrodictions."""
    curve, prepared = fitted_curve(fit), oscillation_of(fit).prepared
    strain, at_data = (
        prepared.strain(time) * STRAIN_FACTOR for time in (curve.grid, curve.position)
    )
    with style():
        figure = Figure(figsize=(8.2, 5.6), layout="constrained")
        axes = figure.subplots()
        draw_retrodictions(axes, strain, curve.solutions)
        axes.plot(strain, curve.median, color=VERMILION, linewidth=1.2, label=MEDIAN_LABEL)
        draw_data(axes, at_data, curve.data, curve.error, curve.data_label)
        coloured = axes.scatter(
            at_data,
            curve.data,
            c=curve.position,
            cmap="cividis",
            s=26.0,
            edgecolors=BLACK,
            linewidths=0.6,
            zorder=3,
        )
        figure.colorbar(coloured, ax=axes, label=TIME_LABEL)
        axes.set_xlabel(f"driving strain ({STRAIN_UNIT})")
        axes.set_ylabel(STRESS_LABEL)
        figure.legend(loc="outside upper center", ncols=3, title=curve.heading)
    return figure


AMPLITUDE_PHASE_CAPTION = (
    "Amplitude of the stress and the phase lag, by which strain follows stress. The cross is "
    "the record, with one standard error. Blue dots are solutions for single draws, orange dots "
    "replicated data, that is solutions with noise, treated like the record. Dashed lines "
    "enclose 90 % of the replicated amplitudes and lags: a model that describes the record has "
    "the cross inside both pairs, nine times out of ten at least."
)


def amplitude_phase(fit: FittedTest) -> Figure:
    """Draw amplitude and phase lag of the stress: observed, predicted and replicated."""
    experiment = oscillation_of(fit)
    observed = observed_response(experiment)
    predicted, replicated = predicted_response(fit), replicated_response(fit)
    with style():
        figure = Figure(figsize=(8.2, 5.2), layout="constrained")
        axes = figure.subplots()
        for response, colour, label in (
            (replicated, ORANGE, "replicated data"),
            (predicted, BLUE, "solutions"),
        ):
            axes.scatter(
                response.amplitude * STRESS_FACTOR,
                np.degrees(response.lag),
                s=6.0,
                color=colour,
                alpha=0.6,
                linewidths=0,
                rasterized=True,
                label=f"{response.lag.size} {label}",
            )
        for position, draw_line in (
            (replicated.amplitude * STRESS_FACTOR, axes.axvline),
            (np.degrees(replicated.lag), axes.axhline),
        ):
            low, _, high = central_band(position)
            for end in (low, high):
                draw_line(end, color=VERMILION, linestyle="--", linewidth=1.2)
        axes.plot([], [], color=VERMILION, linestyle="--", label="90 % of replicated data")
        axes.errorbar(
            observed.amplitude * STRESS_FACTOR,
            np.degrees(observed.lag),
            xerr=observed.amplitude_standard_error * STRESS_FACTOR,
            yerr=np.degrees(observed.lag_standard_error),
            color=BLACK,
            linewidth=1.4,
            marker="o",
            markersize=4,
            linestyle="none",
            label=f"{experiment.provenance.kind} data ± standard error",
        )
        axes.set_xlabel(f"amplitude of the stress ({STRESS_UNIT})")
        axes.set_ylabel("phase lag of the strain (degrees)")
        figure.legend(loc="outside upper center", ncols=2, markerscale=2.0, title=experiment.title)
    return figure


MICROSTRUCTURE_CAPTION = (
    "What the record does not show directly, in the model's solutions: (a) mean grain size, (b) "
    "strain rate of the dashpot; lines are medians over the posterior, areas hold 90 % of draws. "
    "Grains approach the size that the piezometer gives for the current stress, over strains of "
    "the order of the critical strain; near zero stress the piezometer asks for very large ones. "
    "The dashpot follows stress by a power law, so it flows mainly while stress is high."
)


def microstructure(fit: FittedTest) -> Figure:
    """Draw grain size and the dashpot's strain rate along time."""
    experiment = oscillation_of(fit)
    predictions = fit.posterior["predictions"].to_dataset()
    time = predictions["time"].to_numpy()
    rate = shown_quantity(REFERENCE_FLOW_RATE)
    with style():
        figure = Figure(figsize=(8.0, 5.6), layout="constrained")
        grains, dashpot = figure.subplots(2, 1, sharex=True)
        draw_band_panel(
            grains,
            time,
            [(all_draws(predictions["grain_size"]) * LENGTH_FACTOR, BLUE, "median")],
            heading="(a) mean grain size",
            label=f"grain size ({LENGTH_UNIT})",
            level=(experiment.initial_grain_size * LENGTH_FACTOR, "at the start of the record"),
        )
        draw_band_panel(
            dashpot,
            time,
            [(all_draws(predictions["dashpot_rate"]) * rate.display_factor, GREEN, "median")],
            heading="(b) dashpot",
            label=f"strain rate ({unit_text(rate)})",
        )
        dashpot.axhline(0.0, color=GREY, linewidth=0.8, zorder=0)
        dashpot.set_xlabel(TIME_LABEL)
        dashpot.margins(x=0.01)
        figure.align_ylabels()
        figure.suptitle(f"{experiment.title}\n{LINES_AND_AREAS}", fontsize=10)
    return figure


OSCILLATION_FIGURES = (
    FigureRecipe(
        "stress_time",
        "Stress along time",
        STRESS_TIME_CAPTION,
        stress_time,
        result_of(fitted_curve),
    ),
    FigureRecipe(
        "stress_loop",
        "Stress against strain",
        STRESS_LOOP_CAPTION,
        stress_loop,
        result_of(fitted_curve),
    ),
    FigureRecipe(
        "amplitude_phase",
        "Amplitude and phase lag of the stress",
        AMPLITUDE_PHASE_CAPTION,
        amplitude_phase,
        lag_result,
    ),
    FigureRecipe(
        "microstructure",
        "Grain size and dashpot",
        MICROSTRUCTURE_CAPTION,
        microstructure,
        grains_result,
    ),
    FigureRecipe(
        "preparation",
        "From the record to the model",
        PREPARATION_CAPTION,
        preparation_of,
        lambda _: "",
        on_every_page=False,
    ),
)
"""What the report of such a fit shows beside the figures of its posterior."""
