"""View of forced oscillations: figures of a fit with their captions, and facts of a test."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pyburgers.common.draws import FloatArray, central_band
from pyburgers.drawing.page_parts import recipe
from pyburgers.drawing.panels import (
    HALF_WIDTH,
    LINES_AND_AREAS,
    MEDIAN_LABEL,
    STRAIN_LABEL,
    STRESS_LABEL,
    FittedCurve,
    ReadCurve,
    curve_result,
    curve_with_residuals,
    draw_band_panel,
    draw_data,
    draw_dots,
    draw_retrodictions,
    figure_of,
)
from pyburgers.drawing.style import BLACK, BLUE, GREEN, GREY, ORANGE, SKY_BLUE, VERMILION
from pyburgers.drawing.view import View, curve_of, positions, predicted
from pyburgers.drawing.views import oscillation_response
from pyburgers.drawing.views.softening import evolves
from pyburgers.kinds.experiment import of_kind
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.forced_oscillation.harmonics import HarmonicFit
from pyburgers.kinds.forced_oscillation.preparation import (
    NEGLIGIBLE_SHARE,
    OscillationRecord,
    PreparedOscillation,
    strain_shares,
)
from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.stan_data import REFERENCE_FLOW_RATE
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
from pyburgers.model.read_quantities import STRESS

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
        panels = figure.subplots(5, 1, sharex=True)
        raw_strain = _Panel(panels[0], "(a) strain readings", *strain)
        oscillation = _Panel(panels[1], "(b) oscillating part of the strain", *strain)
        driving = f"(c) strain rate that drives the model, background {prepared.background}"
        rate = _Panel(panels[2], driving, r"strain rate (10$^{-5}$ s$^{-1}$)", RATE_FACTOR)
        raw_stress = _Panel(panels[3], "(d) stress readings", *stress)
        aim = "(e) stress that the model is compared with, bias and drift "
        compared = _Panel(panels[4], aim + ("kept" if kept else "removed"), *stress)
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
        for axes in panels:
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
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
    return np.asarray(np.linspace(first, last, count))


@recipe(
    "stress_time",
    "Stress along time",
    "Top: the stress that the model is compared with (circles, bars are one standard "
    "deviation), the predictive median (solid line), retrodictions (thin lines), and "
    "the band that should hold 90 % of new readings of typical uncertainty. Bottom: data minus "
    "the predictive median over the noise of each reading, with the band that should hold 90 % "
    "of residuals if they were noise alone; a run on one side of zero, or an oscillation, is "
    "what the model misses.",
    lambda fit: curve_result(fitted_curve(fit)),
)
def stress_time(fit: FittedTest) -> Figure:
    """Draw data, retrodictions, predictive band and residuals along time."""
    return curve_with_residuals(fitted_curve(fit))


def read_curve(experiment: OscillationExperiment) -> ReadCurve:
    """Gather the stress along time as measured, and as it is compared with the model."""
    prepared = experiment.prepared
    return ReadCurve(
        position=prepared.time,
        data=prepared.stress * STRESS_FACTOR,
        error=prepared.uncertainty * STRESS_FACTOR,
        position_label=TIME_LABEL,
        label=STRESS_LABEL,
        heading=experiment.title,
    )


def fitted_curve(fit: FittedTest) -> FittedCurve:
    """Gather the stress along time as measured and as a fit has it."""
    experiment = of_kind(fit.experiment, OscillationExperiment)
    curve = curve_of(fit, read_curve(experiment), STRESS, "residual / noise (–)")
    noise = curve.noise_band / HALF_WIDTH * experiment.prepared.relative_uncertainty
    return replace(curve, residuals=curve.residuals / noise, noise_band=HALF_WIDTH)


@recipe(
    "stress_loop",
    "Stress against strain",
    "Stress against the strain that drives the model: loops of single draws (thin lines) "
    "and the predictive median (solid line). Their area is the work that is lost, their "
    "slope the stiffness at this period. Circles are the data, coloured by time. With the "
    "background kept, loops move along with the strain.",
    lambda fit: curve_result(fitted_curve(fit)),
)
def stress_loop(fit: FittedTest) -> Figure:
    """Draw stress against driving strain: data and retrodictions."""
    curve, prepared = fitted_curve(fit), of_kind(fit.experiment, OscillationExperiment).prepared
    strain, at_data = (
        prepared.strain(time) * STRAIN_FACTOR for time in (curve.grid, curve.position)
    )
    with figure_of(8.2, 5.6) as figure:
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
        axes.set(xlabel=f"driving strain ({STRAIN_UNIT})", ylabel=STRESS_LABEL)
        figure.legend(loc="outside upper center", ncols=3, title=curve.heading)
    return figure


@recipe(
    "amplitude_phase",
    "Amplitude and phase lag of the stress",
    "Amplitude of the stress and the phase lag, by which strain follows stress. The cross is "
    "the record, with one standard error. Blue dots are solutions for single draws, orange dots "
    "replicated data, that is solutions with noise, treated like the record. Dashed lines "
    "enclose 90 % of the replicated amplitudes and lags: a model that describes the record has "
    "the cross inside both pairs, nine times out of ten at least.",
    oscillation_response.lag_result,
)
def amplitude_phase(fit: FittedTest) -> Figure:
    """Draw amplitude and phase lag of the stress: observed, predicted and replicated."""
    experiment = of_kind(fit.experiment, OscillationExperiment)
    observed = oscillation_response.observed_response(experiment)
    predicted = oscillation_response.predicted_response(fit)
    replicated = oscillation_response.replicated_response(fit)
    with figure_of(8.2, 5.2) as figure:
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
        draw_dots(
            axes,
            np.array([observed.amplitude]) * STRESS_FACTOR,
            np.degrees([observed.lag]),
            xerr=np.array([observed.amplitude_standard_error]) * STRESS_FACTOR,
            yerr=np.degrees([observed.lag_standard_error]),
            face=BLACK,
            elinewidth=1.4,
            label=f"{experiment.provenance.kind} data ± standard error",
        )
        axes.set_xlabel(f"amplitude of the stress ({STRESS_UNIT})")
        axes.set_ylabel("phase lag of the strain (degrees)")
        figure.legend(loc="outside upper center", ncols=2, markerscale=2.0, title=experiment.title)
    return figure


@recipe(
    "microstructure",
    "Grain size and dashpot",
    lambda fit: (
        "Two quantities that the record does not show directly: (a) mean grain size, (b) strain "
        "rate of the dashpot; lines are medians over the posterior, areas hold 90 % of draws. "
        + (
            "Grains approach the size that the piezometer gives for the current stress, over "
            "strains of the order of the critical strain; near zero stress the piezometer asks for "
            "very large ones. "
        )
        * evolves(fit)
        + "The dashpot flows fastest while stress is high."
    ),
    oscillation_response.grains_result,
)
def microstructure(fit: FittedTest) -> Figure:
    """Draw grain size and the dashpot's strain rate along time."""
    experiment = of_kind(fit.experiment, OscillationExperiment)
    time = positions(fit)
    rate = shown_quantity(REFERENCE_FLOW_RATE)
    with figure_of(8.0, 5.6, f"{experiment.title}\n{LINES_AND_AREAS}") as figure:
        grains, dashpot = figure.subplots(2, 1, sharex=True)
        draw_band_panel(
            grains,
            time,
            [(predicted(fit, "grain_size") * LENGTH_FACTOR, BLUE, "median")],
            heading="(a) mean grain size",
            label=f"grain size ({LENGTH_UNIT})",
            level=(experiment.initial_grain_size * LENGTH_FACTOR, "at the start of the record"),
        )
        draw_band_panel(
            dashpot,
            time,
            [(predicted(fit, "dashpot_rate") * rate.display_factor, GREEN, "median")],
            heading="(b) dashpot",
            label=f"strain rate ({unit_text(rate)})",
        )
        dashpot.axhline(0.0, color=GREY, linewidth=0.8, zorder=0)
        dashpot.set_xlabel(TIME_LABEL)
        dashpot.margins(x=0.01)
        figure.align_ylabels()
    return figure


def facts(experiment: OscillationExperiment) -> Sequence[tuple[str, str]]:
    """Return period, amplitude, treatment of the background, cycles and number of points."""
    prepared = experiment.prepared
    degrees = prepared.strain_fit.degree, prepared.stress_fit.degree
    background = (
        f"kept: the rate of the strain's trend (polynomial of degree {degrees[0]}) drives the "
        "model too, and the stress keeps its bias and drift"
        if prepared.background == "kept"
        else f"removed: polynomial trends of strain (degree {degrees[0]}) and stress (degree "
        f"{degrees[1]}), constants included, are subtracted"
    )
    cycles = (prepared.time[-1] - prepared.start) / prepared.period
    amplitude, _ = prepared.strain_fit.amplitude()
    return (
        ("Period", f"{prepared.period:g} s"),
        ("Strain amplitude", f"{amplitude * STRAIN_FACTOR:.3g} %"),
        ("Errors of the strain", _strain_error_text(prepared)),
        ("Background", background),
        ("Cycles", f"{cycles:.1f} on record, {experiment.spin_up_cycles} of spin-up ahead of it"),
        (
            "Points",
            f"{experiment.n_points} stresses; {experiment.record.strain.size} strains give the "
            "driving strain rate",
        ),
    )


def _strain_error_text(prepared: PreparedOscillation) -> str:
    """Say which errors of the driving strain take part."""
    shares = strain_shares(prepared.strain_fit, prepared.stress_fit)
    parts = ["oscillation", "background"] if prepared.background == "kept" else ["oscillation"]
    said = [
        f"of its {part} {'left out' if share < NEGLIGIBLE_SHARE else 'inferred'} ({share:.2g} of "
        "the variance of the stress)"
        for part, share in zip(parts, shares, strict=False)
    ]
    return ", ".join(said)


VIEW = View(
    figures=(stress_time, stress_loop, amplitude_phase, microstructure, preparation_of),
    read=read_curve,
    curve=fitted_curve,
    facts=facts,
    reference_text=Markup(
        "The reference flow rate <i>ε̇</i><sub>0</sub>, at which the dashpot would flow by its "
        "power law alone at the grain size of the start and at the bias or the amplitude of the "
        "stress, whichever is larger (at the amplitude where the background is removed), follows "
        "from the other parameters, and so does its prior."
    ),
    tables=lambda fit: (oscillation_response.response_page_table(fit),),
)
