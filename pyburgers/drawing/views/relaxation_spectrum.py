"""Figure of the relaxation times that a fit of attenuation finds."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pyburgers.common.draws import FloatArray, all_draws, central_band, evenly_spaced
from pyburgers.drawing.page_parts import recipe
from pyburgers.drawing.panels import LINES_AND_AREAS, band_text, draw_band, draw_dots, figure_of
from pyburgers.drawing.style import BLUE, VERMILION
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.experiment import of_kind
from pyburgers.kinds.kind import FittedTest
from pyburgers.model.arrhenius import log_slowdown
from pyburgers.model.closed_forms import closed_forms
from pyburgers.model.laws import KELVIN_LAWS
from pyburgers.model.parameters import STANDARD_VALUES
from pyburgers.model.variants import variant_of

DRAWS = 1000
"""Draws at most that are drawn from."""

TIMES, DECADES_BEYOND = 400, 2.0
"""Number of times, and how far they go beyond what the table sees."""

LEAST = 1e-4
"""Compliance over the elastic one below which nothing is drawn."""


@recipe(
    "relaxation_spectrum",
    "Spectrum of relaxation times",
    "Relaxation times of the Kelvin part at the temperature of the file's head: compliance for "
    "each decade of the time, over the elastic one. A band of times is a ramp with two ends, a "
    "peak a bell, Andrade creep a line without ends; an element of one time is a dot at its "
    "strength, with 90 % of draws as bars. The periods of the table see the grey times, moved to "
    "that temperature as the fit has it: beyond them a spectrum is what law and prior make of it.",
    lambda fit: spectrum_result(fit),
)
def relaxation_spectrum(fit: FittedTest) -> Figure:
    """Draw the compliance of relaxation times with its band."""
    experiment = of_kind(fit.experiment, AttenuationExperiment)
    values = _draws(fit)
    seen = _seen_times(experiment, values)
    log_time = np.log(10) * np.linspace(
        np.log10(seen[0]) - DECADES_BEYOND, np.log10(seen[1]) + DECADES_BEYOND, TIMES
    )
    part = _kelvin_part(experiment, values, log_time)
    elastic = 1 / values["maxwell_modulus"]
    density = np.log(10) * part["time_density"] / elastic[:, np.newaxis]
    with figure_of(8.0, 5.2, f"{experiment.title}\n{LINES_AND_AREAS}") as figure:
        axes = figure.subplots()
        axes.axvspan(*seen, color="#e6e6e6", linewidth=0, label="seen by the periods")
        if density.any():
            draw_band(axes, np.exp(log_time), density, BLUE, "per decade")
        else:
            _draw_elements(axes, part["elements"], elastic)
        axes.set(xscale="log", yscale="log")
        least, most = axes.get_ylim()
        axes.set_ylim(min(max(least, LEAST), 0.1), max(1.5 * most, 1.0))
        axes.set_xlabel(f"relaxation time at {experiment.temperature:g} K (s)")
        axes.set_ylabel("compliance / elastic compliance (–)")
        axes.legend(loc="best", frameon=True, framealpha=1.0)  # the key of an area lies on it
    return figure


def _draws(fit: FittedTest) -> dict[str, FloatArray]:
    """Return some draws of the parameters (SI)."""
    draws = fit.posterior["posterior"].to_dataset()
    return {
        name: evenly_spaced(all_draws(draws[name]).astype(np.float64), DRAWS)
        for name in fit.priors.priors
        if name in draws
    }


def _kelvin_part(
    experiment: AttenuationExperiment, values: dict[str, FloatArray], log_time: FloatArray
) -> dict[str, FloatArray]:
    """Return the Kelvin part at the temperature of the file's head, its density at ln(s)."""
    grain_size = np.full_like(values["kelvin_modulus"], experiment.initial_grain_size)
    asked = {"n_times": log_time.size, "log_time": log_time.tolist()}
    return closed_forms(values, grain_size, temperature=experiment.temperature, asked=asked)


def _seen_times(
    experiment: AttenuationExperiment, values: dict[str, FloatArray]
) -> tuple[float, float]:
    """Return the range of 1/omega of all rows (s), moved to the temperature of the file's head."""
    conditions = experiment.conditions
    enthalpy, volume = (
        values.get(name, np.array(STANDARD_VALUES[name]))
        for name in ("kelvin_activation_enthalpy", "kelvin_activation_volume")
    )
    enthalpy = enthalpy + experiment.environment.get("pressure", 0.0) * volume
    times = []
    for temperature in np.unique(conditions.temperature):
        period = conditions.period[conditions.temperature == temperature]
        slower = np.exp(np.median(log_slowdown(enthalpy, experiment.temperature, temperature)))
        times += [slower * period.min() / (2 * np.pi), slower * period.max() / (2 * np.pi)]
    return float(min(times)), float(max(times))


def _draw_elements(axes: Axes, elements: FloatArray, elastic: FloatArray) -> None:
    """Draw elements of one time (s, 1/Pa; shape (n_draws, n, 2)) as dots with bars."""
    for time, compliance in elements.transpose(1, 2, 0):
        (low, middle, high), (least, strength, most) = (
            central_band(values) for values in (time, compliance / elastic)
        )
        draw_dots(
            axes,
            middle,
            strength,
            xerr=np.array([[middle - low], [high - middle]]),
            yerr=np.array([[strength - least], [most - strength]]),
            colour=VERMILION,
            face=VERMILION,
            label="of one time",
        )


def is_endless(fit: FittedTest) -> bool:
    """Whether the Kelvin part has relaxation times without end."""
    law = KELVIN_LAWS[variant_of(fit.priors, fit.experiment).kelvin]
    return any(one.spread == "endless" for one in law.times)


def spectrum_result(fit: FittedTest) -> str:
    """Say how long the longest relaxation time is, if there is one."""
    if is_endless(fit):
        return "Andrade creep has no longest relaxation time."
    experiment = of_kind(fit.experiment, AttenuationExperiment)
    part = _kelvin_part(experiment, _draws(fit), np.empty(0))
    return (
        f"the longest relaxation time at {fit.experiment.temperature:g} K is "
        f"{band_text(part['longest_time'], 's')}."
    )
