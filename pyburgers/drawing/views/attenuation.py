"""View of tables of attenuation and modulus: figures and tables of a fit, facts of a test."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib import colormaps
from matplotlib.figure import Figure

from pyburgers.common.array_types import IntArray
from pyburgers.common.draws import FloatArray
from pyburgers.drawing.page_parts import PageTable, recipe, text_table
from pyburgers.drawing.panels import (
    HALF_WIDTH,
    LINES_AND_AREAS,
    FittedCurve,
    ReadCurve,
    draw_band,
    draw_dots,
    figure_of,
)
from pyburgers.drawing.style import BLACK, BLUE, VERMILION
from pyburgers.drawing.view import View, curve_of, positions, predicted, reading_errors
from pyburgers.drawing.view import residuals as residuals_of
from pyburgers.drawing.views.relaxation_spectrum import is_endless, relaxation_spectrum
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment, range_text
from pyburgers.kinds.attenuation.table import ATTENUATION, MODULUS, CycleConditions
from pyburgers.kinds.experiment import of_kind
from pyburgers.kinds.kind import FittedTest
from pyburgers.model.display import cycles_text
from pyburgers.model.read_quantities import LOG_TAN_DELTA

GPA = 1e-9
PERIOD_LABEL = "period (s)"
PLACE_LABEL = "spectra of attenuation, then of modulus, each along log period"
TAN_DELTA_LABEL = r"$\tan\delta$ (–)"
LINES = ("-", "--", ":", "-.")
"""Of the stresses of a table, in rising order."""

MODULUS_NAMES = {"axial": "Young's modulus", "shear": "shear modulus"}


@dataclass(frozen=True, eq=False)
class _Spectrum:
    """One temperature and stress, as measured and as a fit has it."""

    label: str  # of its lines and dots
    colour: str
    linestyle: str
    period: FloatArray  # s, of the predictions, shape (n,)
    tan_delta: FloatArray  # of draws, shape (n_draws, n)
    modulus: FloatArray  # Pa, of draws, shape (n_draws, n)
    rows: IntArray  # of the table


def _stresses(conditions: CycleConditions) -> tuple[IntArray, list[str]]:
    """Return which stress each spectrum was read under, and words on each; none on a single one."""
    both = np.stack([conditions.median_stress, conditions.amplitude])[:, conditions.first_rows]
    each, number_of = np.unique(both, axis=1, return_inverse=True)
    words = [f", {cycles_text(*one)}" for one in each.T]
    return number_of.ravel(), words if len(words) > 1 else [""]


def _spectra(fit: FittedTest) -> list[_Spectrum]:
    conditions = of_kind(fit.experiment, AttenuationExperiment).conditions
    period, spectrum, quantity = conditions.at(positions(fit))
    solutions = np.exp(predicted(fit, "log_reading"))
    temperature = conditions.temperature[conditions.first_rows]
    coolest, span = temperature.min(), float(np.ptp(temperature)) or 1.0
    of_spectrum, stresses = _stresses(conditions)
    found = []
    for k, own in enumerate(temperature):
        here = {q: (spectrum == k) & (quantity == q) for q in (ATTENUATION, MODULUS)}
        # Yellow, beyond, is too pale for a line on white.
        shade = colormaps["plasma"](0.05 + 0.6 * float((own - coolest) / span))
        found.append(
            _Spectrum(
                f"{own:.0f} K{stresses[of_spectrum[k]]}",
                "#" + "".join(f"{round(255 * part):02x}" for part in shade[:3]),
                LINES[of_spectrum[k] % len(LINES)],
                period[here[ATTENUATION]],
                solutions[:, here[ATTENUATION]],
                solutions[:, here[MODULUS]],
                np.flatnonzero(conditions.spectrum == k),
            )
        )
    return found


@recipe(
    "master_curves",
    "Attenuation and modulus",
    "Attenuation tan δ (the same as 1/Q) and modulus against period, one colour for each "
    "temperature: circles are readings, triangles upper limits, lines posterior medians of the "
    "model and areas 90 % of draws, without the scatter of readings. Bars are stated errors e: "
    "readings of tan δ lie about √(tan²δ + e²), above a line that is below e. If other circles "
    "leave a line in step with the period or with temperature, the relaxation follows another law.",
    lambda fit: rms_result(fit),
)
def master_curves(fit: FittedTest) -> Figure:
    """Draw attenuation and modulus against period by temperature."""
    experiment = of_kind(fit.experiment, AttenuationExperiment)
    readings, period = experiment.readings, experiment.conditions.period
    with figure_of(8.6, 8.6, f"{experiment.title}\n{LINES_AND_AREAS}") as figure:
        upper, lower = figure.subplots(2, 1, sharex=True)
        for own in _spectra(fit):
            look = own.colour, own.label, own.linestyle
            draw_band(upper, own.period, own.tan_delta, *look)
            draw_band(lower, own.period, own.modulus * GPA, *look)
            limit = readings.is_limit[own.rows]
            for which, marker in ((~limit, "o"), (limit, "v")):
                rows = own.rows[which]
                recorded = np.maximum(readings.tan_delta, readings.limit)[rows]
                error = np.where(readings.is_limit, 0.0, readings.tan_delta_error)[rows]
                draw_dots(
                    upper, period[rows], recorded, yerr=error, colour=own.colour, marker=marker
                )
            if readings.modulus.size:
                moduli, errors = (
                    values[own.rows] * GPA for values in (readings.modulus, readings.modulus_error)
                )
                draw_dots(lower, period[own.rows], moduli, yerr=errors, colour=own.colour)
        upper.set(xscale="log", yscale="log", ylabel=TAN_DELTA_LABEL)
        modulus = MODULUS_NAMES[experiment.elasticity.deformation]
        lower.set(xlabel=PERIOD_LABEL, ylabel=f"{modulus} (GPa)")
        # Bars can lie anywhere in the panel.
        figure.legend(*upper.get_legend_handles_labels(), loc="outside lower center", ncols=5)
    return figure


@recipe(
    "cole_cole",
    "Loss against storage compliance",
    "Loss against storage compliance, one colour for each temperature: circles are readings of tan "
    "δ and modulus together, lines posterior medians over the periods of the table. One relaxation "
    "time gives half a circle, a band of them a flat arc, a dashpot a line that rises steeply.",
    lambda fit: rms_result(fit),
)
def cole_cole(fit: FittedTest) -> Figure:
    """Draw loss against storage compliance."""
    experiment = of_kind(fit.experiment, AttenuationExperiment)
    readings = experiment.readings
    with figure_of(8.0, 5.6, experiment.title) as figure:
        axes = figure.subplots()
        for own in _spectra(fit):
            solved = compliances(own.tan_delta, own.modulus * GPA)
            medians = (np.median(values, axis=0) for values in solved)
            axes.plot(
                *medians, color=own.colour, linewidth=1.6, linestyle=own.linestyle, label=own.label
            )
            if readings.modulus.size:
                rows = own.rows[~readings.is_limit[own.rows]]
                measured = compliances(readings.tan_delta[rows], readings.modulus[rows] * GPA)
                draw_dots(axes, *measured, colour=own.colour)
        axes.set(xscale="log", yscale="log")
        axes.set(xlabel="storage compliance (1/GPa)", ylabel="loss compliance (1/GPa)")
        axes.legend(loc="best", ncols=2)
    return figure


def compliances(tan_delta: FloatArray, modulus: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return storage and loss compliance of tan(delta) and the modulus 1/|J|, of any shape."""
    storage = 1 / (modulus * np.hypot(1.0, tan_delta))
    return storage, np.asarray(storage * tan_delta)


@recipe(
    "arrhenius",
    "Relaxation times",
    "Relaxation time η_K/E_K of the Kelvin part against inverse temperature, unless it has no "
    "longest one, and the Maxwell time of the dashpot, which is the flow law's: lines are "
    "posterior medians, areas 90 % of draws. The slope of a line is its activation enthalpy. "
    "Beyond the periods of the table a time is what the law makes of it, not what was seen.",
    lambda fit: relaxation_result(fit),
)
def arrhenius(fit: FittedTest) -> Figure:
    """Draw relaxation times against inverse temperature."""
    experiment = of_kind(fit.experiment, AttenuationExperiment)
    conditions = experiment.conditions
    _, spectrum, quantity = conditions.at(positions(fit))
    first = np.unique(spectrum[quantity == ATTENUATION], return_index=True)[1]
    temperature = conditions.temperature[conditions.first_rows]
    of_spectrum, stresses = _stresses(conditions)
    with figure_of(8.0, 5.2, f"{experiment.title}\n{LINES_AND_AREAS}") as figure:
        axes = figure.subplots()
        seen = conditions.period.min(), conditions.period.max()
        axes.axhspan(*seen, color="#e6e6e6", linewidth=0, label="periods of the table")
        # Without a longest time η_K/E_K is one by convention.
        for name, colour, label in (
            ("log_relaxation_time", BLUE, "Kelvin part"),
            ("log_maxwell_time", VERMILION, "Maxwell time of the dashpot"),
        )[is_endless(fit) :]:
            times = np.exp(predicted(fit, name)[:, first])
            for k, stress in enumerate(stresses):
                here = np.flatnonzero(of_spectrum == k)
                here = here[np.argsort(temperature[here])]
                look = colour, label + stress, LINES[k % len(LINES)]
                draw_band(axes, 1e4 / temperature[here], times[:, here], *look)
        axes.set(yscale="log", xlabel=r"$10^4/T$ (1/K)", ylabel="time (s)")
        axes.legend(loc="best")
    return figure


@recipe(
    "residuals",
    "Residuals against period",
    "Residuals of the fit: ln of the reading less the predictive median of the model, over the "
    "standard deviation of the reading by its stated error and the fitted scatter; of attenuation "
    "above and of modulus below, against period, one colour for each temperature. The dotted lines "
    "hold 90 % of readings if the model is right; upper limits are left out. A slope or a bow that "
    "temperatures share is a law that is missing.",
    lambda fit: rms_result(fit),
)
def residuals(fit: FittedTest) -> Figure:
    """Draw residuals against period by temperature."""
    experiment = of_kind(fit.experiment, AttenuationExperiment)
    period, is_limit = experiment.conditions.period, experiment.readings.is_limit
    left = np.split(residuals_of(fit) / reading_errors(fit), [is_limit.size])
    parts = zip(left, (~is_limit, True | is_limit), ("tan δ", "modulus"), strict=True)
    with figure_of(8.6, 6.4, experiment.title) as figure:
        panels = figure.subplots(2, 1, sharex=True)
        for axes, (values, counts, label) in zip(panels, parts, strict=True):
            axes.axhline(0.0, color=BLACK, linewidth=0.8)
            for level in (-HALF_WIDTH, HALF_WIDTH):
                axes.axhline(level, color=BLACK, linestyle=":", linewidth=0.8)
            for own in _spectra(fit) if values.size else ():
                rows = own.rows[counts[own.rows]]
                look = {"color": own.colour, "linestyle": own.linestyle, "label": own.label}
                dots = {"marker": "o", "markersize": 3.5, "linewidth": 0.8}
                axes.plot(period[rows], values[rows], **look, **dots)
            axes.set_ylabel(f"residual of ln {label} / its sd")
        panels[0].set_xscale("log")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right center")
        panels[1].set_xlabel(PERIOD_LABEL)
    return figure


def rms_by_temperature(fit: FittedTest) -> pd.DataFrame:
    """Return the rms of ln(reading), limits left out, about the model's median by temperature."""
    experiment = of_kind(fit.experiment, AttenuationExperiment)
    temperature, is_limit = experiment.conditions.temperature, experiment.readings.is_limit
    of_tan_delta, of_modulus = np.split(residuals_of(fit) ** 2, [is_limit.size])
    squares = pd.DataFrame(
        {
            "tan_delta": np.where(is_limit, np.nan, of_tan_delta),
            "modulus": of_modulus if of_modulus.size else np.nan,
        }
    )
    parts = {f"{one:g}": squares[temperature == one] for one in np.unique(temperature)[::-1]}
    rows = {
        name: {
            "attenuations": part["tan_delta"].count(),
            "rms_log_tan_delta": np.sqrt(part["tan_delta"].mean()),
            "moduli": part["modulus"].count(),
            "rms_log_modulus": np.sqrt(part["modulus"].mean()),
        }
        for name, part in {**parts, "all": squares}.items()
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("temperature_K")


def rms_table(fit: FittedTest) -> PageTable:
    """Return `rms_by_temperature` as what a page shows."""
    table = rms_by_temperature(fit).reset_index()
    columns = {
        "temperature (K)": "{temperature_K}",
        "attenuations": "{attenuations:.0f}",
        "rms of ln tan δ": "{rms_log_tan_delta:.3f}",
        "moduli": "{moduli:.0f}",
        "rms of ln modulus": "{rms_log_modulus:.4f}",
    }
    return PageTable(
        "left_over",
        "Residuals by temperature",
        text_table(table, columns),
        table,
        text=Markup(
            "Root mean square of ln(reading) less the median of the model; upper limits do not "
            "count."
        ),
        words=("temperature (K)",),
    )


def read_curve(experiment: AttenuationExperiment) -> ReadCurve:
    """Gather the attenuation along the period, or the limits of it."""
    readings = experiment.readings
    recorded = np.maximum(readings.tan_delta, readings.limit)
    return ReadCurve(
        position=experiment.conditions.period[: recorded.size],
        data=recorded,
        position_label=PERIOD_LABEL,
        label=TAN_DELTA_LABEL,
        heading=experiment.title,
        scale="log",
    )


def fitted_curve(fit: FittedTest) -> FittedCurve:
    """Gather all readings along their places, measured and as a fit has them."""
    experiment = of_kind(fit.experiment, AttenuationExperiment)
    read = ReadCurve(
        position=experiment.position,
        data=experiment.response,
        position_label=PLACE_LABEL,
        label="ln tan δ, ln(modulus/Pa)",
        heading=experiment.title,
    )
    curve = curve_of(fit, read, LOG_TAN_DELTA, "residual / its sd")
    # Attenuation and modulus have noises of their own, and readings stated errors.
    return replace(curve, residuals=curve.residuals / reading_errors(fit), noise_band=HALF_WIDTH)


def rms_result(fit: FittedTest) -> str:
    """Say how far readings are from the model."""
    in_all = rms_by_temperature(fit).loc["all"]
    said = f"the model leaves a root mean square of {in_all['rms_log_tan_delta']:.3f} in ln tan δ"
    if in_all["moduli"]:
        said += f" and of {in_all['rms_log_modulus']:.4f} in the ln of the modulus"
    return f"{said}."


def relaxation_result(fit: FittedTest) -> str:
    """Say between which relaxation times of the Kelvin part, or Maxwell times, the rows lie."""
    name, what = ("maxwell", "Maxwell") if is_endless(fit) else ("relaxation", "relaxation")
    median = np.exp(np.median(predicted(fit, f"log_{name}_time"), axis=0))
    return f"median {what} times go from {median.min():.2g} to {median.max():.2g} s."


def facts(experiment: AttenuationExperiment) -> Sequence[tuple[str, str]]:
    """Return cycles, stresses, temperatures and number of readings."""
    conditions, readings = experiment.conditions, experiment.readings
    elasticity = experiment.elasticity
    constants = {
        "Poisson's ratio": elasticity.poisson_ratio,
        "bulk modulus (Pa)": elasticity.bulk_modulus,
    }
    related = "".join(
        f", turned from axial quantities with {name} {value:g}"
        for name, value in constants.items()
        if value is not None
    )
    stress = (
        f"median {range_text(conditions.median_stress, digits=4)} Pa, amplitude "
        f"{range_text(conditions.amplitude, digits=4)} Pa"
        if experiment.amplitude_is_stated
        else "not stated: taken as so small that the dashpot is linear"
    )
    return (
        ("Cycles", f"{elasticity.deformation}{related}"),
        ("Stress", stress),
        (
            "Temperatures",
            f"{range_text(conditions.temperature, digits=4)} K, {conditions.n_spectra} spectra",
        ),
        ("Periods", f"{range_text(conditions.period, digits=4)} s"),
        (
            "Readings",
            f"{readings.tan_delta.size} attenuations ({int(readings.is_limit.sum())} of them "
            f"upper limits), {readings.modulus.size} moduli",
        ),
    )


VIEW = View(
    figures=(master_curves, residuals, cole_cole, arrhenius, relaxation_spectrum),
    read=read_curve,
    curve=fitted_curve,
    facts=facts,
    reference_text=Markup(
        "The reference flow rate <i>ε̇</i><sub>0</sub>, at which the dashpot would flow by its "
        "power law alone at the temperature of the file's head and the largest stress of the table "
        "(1 MPa where none is stated), follows from the other parameters, and so does its prior."
    ),
    tables=lambda fit: (rms_table(fit),),
)
