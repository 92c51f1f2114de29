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
from pyburgers.model.relaxation import KelvinPart, kelvin_part

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
    part = _part(fit, experiment.temperature)
    elastic = 1 / part.values["maxwell_modulus"]
    seen = _seen_times(fit, part)
    log_time = np.log(10) * np.linspace(
        np.log10(seen[0]) - DECADES_BEYOND, np.log10(seen[1]) + DECADES_BEYOND, TIMES
    )
    density = np.log(10) * part.spectrum(log_time) / elastic[:, np.newaxis]
    with figure_of(8.0, 5.2, f"{experiment.title}\n{LINES_AND_AREAS}") as figure:
        axes = figure.subplots()
        axes.axvspan(*seen, color="#e6e6e6", linewidth=0, label="seen by the periods")
        if density.any():
            draw_band(axes, np.exp(log_time), density, BLUE, "per decade")
        else:
            _draw_elements(axes, part, elastic)
        axes.set(xscale="log", yscale="log")
        least, most = axes.get_ylim()
        axes.set_ylim(min(max(least, LEAST), 0.1), max(most, 1.0))
        axes.set_xlabel(f"relaxation time at {experiment.temperature:g} K (s)")
        axes.set_ylabel("compliance / elastic compliance (–)")
        axes.legend(loc="best")
    return figure


def _part(fit: FittedTest, temperature: float) -> KelvinPart:
    """Return the Kelvin part of some draws at a temperature (K)."""
    draws = fit.posterior["posterior"].to_dataset()
    values = {
        name: evenly_spaced(all_draws(draws[name]).astype(np.float64), DRAWS)
        for name in fit.priors.priors
        if name in draws
    }
    grain_size = np.full_like(values["kelvin_modulus"], fit.experiment.initial_grain_size)
    return kelvin_part(values, temperature, grain_size)


def _seen_times(fit: FittedTest, part: KelvinPart) -> tuple[float, float]:
    """Return the range of 1/omega of all rows (s), moved to the temperature of a part."""
    conditions = of_kind(fit.experiment, AttenuationExperiment).conditions
    times = []
    for temperature in np.unique(conditions.temperature):
        period = conditions.period[conditions.temperature == temperature]
        slower = np.median(part.longest_time / _part(fit, float(temperature)).longest_time)
        times += [slower * period.min() / (2 * np.pi), slower * period.max() / (2 * np.pi)]
    return min(times), max(times)


def _draw_elements(axes: Axes, part: KelvinPart, elastic: FloatArray) -> None:
    """Draw elements of one time as dots with bars."""
    for time, compliance in part.elements():
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


def spectrum_result(fit: FittedTest) -> str:
    """Say how long the longest relaxation time is."""
    part = _part(fit, fit.experiment.temperature)
    return (
        f"the longest relaxation time at {fit.experiment.temperature:g} K is "
        f"{band_text(part.longest_time, 's')}."
    )
