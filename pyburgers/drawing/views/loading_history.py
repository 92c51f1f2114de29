"""View of loading histories: figures of a fit with their captions, and facts of a test."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pyburgers.common.draws import FloatArray, central_band
from pyburgers.drawing.page_parts import recipe
from pyburgers.drawing.panels import (
    LINES_AND_AREAS,
    STRAIN_LABEL,
    STRESS_LABEL,
    FittedCurve,
    ReadCurve,
    band_text,
    curve_result,
    draw_band,
    draw_curve,
    draw_dots,
    draw_residuals,
    figure_of,
)
from pyburgers.drawing.style import BLUE, GREY, ORANGE, PURPLE, VERMILION
from pyburgers.drawing.view import View, curve_of, positions, predicted
from pyburgers.drawing.views.creep import isochronous_figure, minimum_rate_table
from pyburgers.drawing.views.softening import (
    evolves,
    microstructure_facts,
    softened_text,
    softening_along,
    softening_caption,
)
from pyburgers.kinds.experiment import MeasuredMicrostructure, of_kind
from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.likelihood import strains_of, times_of
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stan_data import stage_of_times
from pyburgers.model.display import STRAIN_FACTOR, STRESS_FACTOR, time_unit
from pyburgers.model.read_quantities import STRAIN, STRESS, ReadQuantity

STAGE_COLOURS = (BLUE, VERMILION, "#009E73", PURPLE, ORANGE, "#56B4E9")
_LABELS = {"stress": STRESS_LABEL, "strain": STRAIN_LABEL}


@recipe(
    "history",
    "Stress and strain along time",
    "The test along time, its stages shaded in turn. Stress and strain: readings (circles) where "
    "one of them was read, the predictive median (solid line), solutions for single draws (thin "
    "lines) and the band that should hold 90 % of new readings, noise included; what is imposed "
    "has no band. Below each: readings minus the predictive median, with the band that should hold "
    "90 % of residuals if they were noise alone; a run on one side of zero means that the model "
    "misses something there, or that the readings drift.",
    lambda fit: curve_result(fitted_curve(fit)),
)
def history(fit: FittedTest) -> Figure:
    """Draw stress, strain and residuals along time."""
    experiment = of_kind(fit.experiment, HistoryExperiment)
    curves = {shown.name: _curve(fit, shown) for shown in (STRESS, STRAIN)}
    panels = [(name, part) for name in curves for part in ("curve", "residuals")]
    panels = [(n, part) for n, part in panels if part == "curve" or curves[n].position.size > 0]
    heights = [3.0 if part == "curve" else 1.2 for _, part in panels]
    with figure_of(8.0, 1.2 + 0.95 * sum(heights)) as figure:
        axes = figure.subplots(len(panels), 1, sharex=True, height_ratios=heights)
        for panel, (name, part) in zip(axes, panels, strict=True):
            _shade_stages(panel, experiment)
            shown = replace(curves[name], heading="", marks=(), position_label="")
            if part == "curve":
                draw_curve(panel, shown, is_read=shown.position.size > 0)
            else:
                draw_residuals(panel, shown)
        axes[-1].set_xlabel(curves["stress"].position_label)
        axes[0].set_title(experiment.title, loc="left")
        main = axes[[name for name, _ in panels].index(_main(experiment).name)]
        shown_there = main.get_legend_handles_labels()
        figure.legend(*shown_there, loc="outside upper center", ncols=3)
    return figure


def fitted_curve(fit: FittedTest) -> FittedCurve:
    """Gather what was read along time, and as a fit has it; of two quantities that read more."""
    return _curve(fit, _main(of_kind(fit.experiment, HistoryExperiment)))


RECOVERY_SHOWN = 1e-3
"""Slowest rate of recovery that is drawn, over the slowest forward one: it dies away by decades."""


@recipe(
    "response",
    "How the material answers",
    lambda fit: (
        "The same solutions as the field draws them; lines are posterior medians, areas hold 90 % "
        "of draws, a colour for each stage. (a) Stress against strain. (b) Strain rate against "
        "strain on a logarithmic scale"
        + ": a minimum is where the Kelvin element is exhausted and softening wins"
        * evolves(fit)
        + "; rates of recovery, which run backwards, are drawn dashed down to a thousandth of the "
        "slowest forward one. (c) Readings of each stage, against the time since the stage began "
        "on a logarithmic scale, over its value at the end of the stage: relaxation and transient "
        "creep are seen from their first readings on."
    ),
    lambda fit: response_result(fit),
)
def response(fit: FittedTest) -> Figure:
    """Draw stress against strain, the rate against strain, and stages on logarithmic time."""
    experiment = of_kind(fit.experiment, HistoryExperiment)
    time = positions(fit)
    values = {name: predicted(fit, name) for name in ("stress", "strain", "strain_rate")}
    middle = {name: np.nanmedian(draws, axis=0) for name, draws in values.items()}
    stage_of = stage_of_times(experiment, time)
    with figure_of(8.6, 7.6, f"{experiment.title}\n{LINES_AND_AREAS}") as figure:
        places = figure.subplot_mosaic([["curve", "rate"], ["log", "log"]])
        for number, stage in enumerate(experiment.stages):
            here = np.flatnonzero(stage_of == number)
            colour = STAGE_COLOURS[number % len(STAGE_COLOURS)]
            strain = STRAIN_FACTOR * middle["strain"][here]
            places["curve"].plot(
                strain, STRESS_FACTOR * middle["stress"][here], color=colour, linewidth=1.6
            )
            _draw_rate(places["rate"], strain, values["strain_rate"][:, here], colour)
            name = "strain" if stage.driven == "stress" else "stress"
            end = np.nanmedian(values[name][:, here[-1]])
            if end != 0:
                later = here[time[here] > stage.start_time]
                over_end = values[name][:, later] / end
                label = f"stage {number + 1}: {name}"
                draw_band(places["log"], time[later] - stage.start_time, over_end, colour, label)
            read = experiment.reading_stage == number
            if read.any():
                since = experiment.time[read] - stage.start_time
                over_end = experiment.reading[read][since > 0] / end
                draw_dots(places["log"], since[since > 0], over_end, size=2.5)
        forward = middle["strain_rate"][middle["strain_rate"] > 0]
        if forward.size:
            slowest = RECOVERY_SHOWN * float(forward.min())
            places["rate"].set_ylim(bottom=max(places["rate"].get_ylim()[0], slowest))
        _label_response(places)
    return figure


def _main(experiment: HistoryExperiment) -> ReadQuantity:
    return STRAIN if 2 * experiment.response_is_strain.sum() >= experiment.n_points else STRESS


def read_curve(experiment: HistoryExperiment) -> ReadCurve:
    """Gather what was read along time; of two quantities that of which there are more readings."""
    return _read(experiment, _main(experiment))


def _read(experiment: HistoryExperiment, shown: ReadQuantity) -> ReadCurve:
    """Gather a quantity along time as read."""
    unit, seconds = time_unit(experiment.end_time)
    is_read = experiment.response_is_strain == (shown is STRAIN)
    return ReadCurve(
        position=experiment.time[is_read] / seconds,
        data=experiment.reading[is_read] * shown.display_factor,
        position_label=f"time ({unit})",
        label=_LABELS[shown.name],
        heading=experiment.title,
        marks=[(stage.start_time / seconds, "") for stage in experiment.stages[1:]],
        limits=(0.0, 1.01 * experiment.end_time / seconds),
    )


def _curve(fit: FittedTest, shown: ReadQuantity) -> FittedCurve:
    """Gather a quantity along time as read and as a fit has it, in display units."""
    experiment = of_kind(fit.experiment, HistoryExperiment)
    imposed = np.array([stage.driven == shown.name for stage in experiment.stages])
    is_read = experiment.response_is_strain == (shown is STRAIN)
    curve = curve_of(fit, _read(experiment, shown), shown, rows=is_read)
    # What is imposed has no reading error.
    is_imposed = imposed[stage_of_times(experiment, positions(fit))]
    return replace(curve, replicated=np.where(is_imposed, curve.solutions, curve.replicated))


def _shade_stages(axes: Axes, experiment: HistoryExperiment) -> None:
    _, seconds = time_unit(experiment.end_time)
    for stage in experiment.stages[1::2]:
        ends = stage.start_time / seconds, stage.end_time / seconds
        axes.axvspan(*ends, color=GREY, alpha=0.18, linewidth=0)


def _draw_rate(axes: Axes, strain: FloatArray, rates: FloatArray, colour: str) -> None:
    """Draw the magnitude of strain rates (1/s), those that run backwards dashed."""
    low, middle, high = central_band(rates)
    for sign, line in ((1, "-"), (-1, "--")):
        runs = sign * middle > 0
        if not runs.any():
            continue
        shown, one, other = (
            np.where(runs, np.maximum(sign * each, 1e-30), np.nan) for each in (middle, low, high)
        )
        bottom, top = np.fmin(one, other), np.fmax(one, other)
        axes.fill_between(
            strain, np.maximum(bottom, 0.1 * shown), top, color=colour, alpha=0.22, linewidth=0
        )
        axes.plot(strain, shown, linestyle=line, color=colour, linewidth=1.6)
    axes.set_yscale("log")


def _label_response(places: dict[str, Axes]) -> None:
    for name, title, x, y in (
        ("curve", "(a) stress against strain", STRAIN_LABEL, STRESS_LABEL),
        ("rate", "(b) strain rate", STRAIN_LABEL, "strain rate (1/s)"),
        (
            "log",
            "(c) stages on logarithmic time",
            "time since the start of the stage (s)",
            "response / response at the end (–)",
        ),
    ):
        places[name].set_title(title, loc="left")
        places[name].set(xlabel=x, ylabel=y)
    places["log"].set_xscale("log")
    places["log"].legend(loc="best", ncols=2)


def response_result(fit: FittedTest) -> str:
    """Say where the solutions end."""
    ends = (
        f"{shown.name} of {band_text(predicted(fit, shown.name)[:, -1] * shown.display_factor, '')}"
        f" in the unit of {_LABELS[shown.name]}"
        for shown in (STRAIN, STRESS)
    )
    return f"the history ends at {' and '.join(ends)}."


@recipe(
    "softening",
    "Softening by grain size and fabric",
    f"{softening_caption('end')} A measurement at a path strain stands where the median "
    "solution reaches that strain.",
    lambda fit: f"at the end {softened_text(fit)}",
    suits=evolves,
)
def softening(fit: FittedTest) -> Figure:
    """Draw how grain size and fabric soften the material along time."""
    experiment = of_kind(fit.experiment, HistoryExperiment)
    path_strain = np.nanmedian(predicted(fit, "path_strain"), axis=0)
    sections = experiment.microstructure
    measured = np.where(
        [one.time is None for one in sections],
        np.interp(strains_of(sections), path_strain, positions(fit)),
        times_of(sections),
    )
    return softening_along(fit, measured)


def facts(experiment: HistoryExperiment) -> Sequence[tuple[str, str]]:
    """Return stages and number of readings."""
    n_strain = int(experiment.response_is_strain.sum())
    read = [
        f"{number} of {name}"
        for number, name in ((n_strain, "strain"), (experiment.n_points - n_strain, "stress"))
        if number > 0
    ]
    return (
        (
            "Stages",
            f"{len(experiment.stages)}, solved in {len(experiment.legs)} parts over which what "
            "is imposed is linear in time",
        ),
        ("Readings", f"{' and '.join(read)}, of {experiment.n_readings_in_file} in the file"),
        *microstructure_facts(experiment.microstructure, partial(_place, experiment)),
    )


def _place(experiment: HistoryExperiment, section: MeasuredMicrostructure) -> str:
    """Say where a microstructure was measured."""
    if section.time is None:
        return f"a path strain of {(section.strain or 0.0) * STRAIN_FACTOR:.3g} %"
    unit, seconds = time_unit(experiment.end_time)
    return f"{section.time / seconds:.3g} {unit}"


VIEW = View(
    figures=(history, response, softening),
    read=read_curve,
    curve=fitted_curve,
    facts=facts,
    reference_text=Markup(
        "The reference flow rate <i>ε̇</i><sub>0</sub>, at which undeformed material would flow "
        "under the largest stress of the test without threshold, backstress or further mechanism "
        "(with a hyperbolic sine, the material after its largest strain), follows from the other "
        "parameters, and so does its prior."
    ),
    tables=minimum_rate_table,
    joint_figures=isochronous_figure,
)
