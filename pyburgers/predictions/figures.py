"""Figures of predictions: attenuation spectra and other tests, and beside some how to read them."""

import textwrap
from collections.abc import Sequence
from itertools import cycle
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pyburgers.common.draws import FloatArray, evenly_spaced
from pyburgers.common.errors import require_type
from pyburgers.common.units import rounded_to
from pyburgers.drawing.panels import draw_dots, draw_thin_lines, figure_of
from pyburgers.drawing.style import BLACK, BLUE, GREEN, ORANGE, PURPLE, SKY_BLUE, VERMILION
from pyburgers.drawing.view import shown_clock
from pyburgers.fitting.prediction import Prediction
from pyburgers.model.read_quantities import ReadQuantity
from pyburgers.predictions import other_tests
from pyburgers.predictions.attenuation import evolving_quantiles, flat_draws
from pyburgers.predictions.material import likely_fails
from pyburgers.predictions.measured_attenuation import MeasuredAttenuation

Handle = Patch | Line2D | ErrorbarContainer
"""What a legend names."""

FREQUENCY_LABEL = "frequency (Hz)"
ATTENUATION_LABEL = r"attenuation $\tan\delta = Q^{-1}$ (–)"
REGIME_TITLE = "axial median stress ± amplitude"
BAND_QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
FEW_FREQUENCIES = 10
"""Number of frequencies below which each is marked, and seen if it is the only one."""

DRAWN = 150
"""Curves of single draws in a panel."""

THICK, THIN, PALE = 1.8, 1.0, 0.7
"""Widths of the medians, and the opacity of those where the assumption fails."""

HOLDING_LABEL = "_holding"
EVOLVING_LABEL = "evolving, median and 90 %"
BEYOND_LABEL = "evolving, lag over a quarter"
FAILING_LABEL = "frozen microstructure fails"

_COLOURS = (BLUE, GREEN, ORANGE, VERMILION, PURPLE, SKY_BLUE, BLACK)
_MARKERS = "osD^v"
_DASHES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (6, 1, 1, 1, 1, 1)))

ATTENUATION_CAPTION = (
    "Attenuation of axial stress cycles about a median stress, predicted from the posterior: lines "
    "are medians over draws, dark and light areas hold 50 % and 90 % of them. The Kelvin part "
    "gives a peak or a band. The dashpot gives a background that falls with frequency, and rises "
    "with stress unless it is linear. The microstructure is frozen as the title says; where that "
    "fails in most draws, lines are thin and pale. Diamonds were solved in time with a "
    "microstructure that evolves; triangles stand for strain that lags by more than a quarter of a "
    "cycle."
)

DRAWS_CAPTION = (
    "The same spectra as curves of single draws (thin, at most 150) with their median (thick). "
    "Curves that run parallel differ in amplitude; curves that cross or bend at different "
    "frequencies would differ in where the peak is. The dashed line is the median of the first "
    "panel. In the grey part frozen microstructure fails in most draws."
)

AMPLITUDE_CAPTION = (
    "Effect of the amplitude of the cycles at one median stress. Left: attenuation, median and "
    "90 % of draws. Right: attenuation over that of the smallest amplitude, draw by draw, so that "
    "what all amplitudes share drops out. A linear material would have the ratio one throughout. "
    "Lines are thin and pale where frozen microstructure fails in most draws."
)


def attenuation(
    spectrum: xr.Dataset,
    comparison: xr.Dataset | None = None,
    measured: MeasuredAttenuation | None = None,
) -> Figure:
    """Draw bands of attenuation by regime, a solution in time and measured points over them."""
    spectrum = spectrum.sortby("frequency")
    with figure_of(8.0, 5.6) as figure:
        axes = figure.subplots()
        lines = _draw_bands(axes, spectrum, flat_draws(spectrum["tan_delta"]), (0.18, 0.3))
        axes.set_yscale("log")
        axes.set_ylabel(ATTENUATION_LABEL)
        shown = [one["frequency"] for one in (spectrum, comparison) if one is not None]
        every = np.concatenate([*shown, [] if measured is None else measured.frequency])
        if np.ptp(every) == 0:  # matplotlib finds no limits around bars at one place
            axes.set_xlim(0.1 * every[0], 10 * every[0])
        solved = [] if comparison is None else _draw_evolving(axes, comparison)
        areas = [
            Patch(color=BLACK, alpha=0.43, label="50 % of draws"),
            Patch(color=BLACK, alpha=0.18, label="90 % of draws"),
        ]
        points = [] if measured is None else _draw_measured(axes, measured)
        handles: list[Handle] = [*lines, *areas, *_failing_handles(spectrum), *solved, *points]
        cautions = spectrum.attrs.get("cautions", "").splitlines()
        _legend_above(figure, handles, _wrapped(spectrum.attrs["title"], *cautions))
    return figure


def _draw_measured(axes: Axes, measured: MeasuredAttenuation) -> list[ErrorbarContainer]:
    """Draw measured points with their bars, a marker for each series; return them."""
    drawn = []
    for marker, series in zip(cycle(_MARKERS), dict.fromkeys(measured.series), strict=False):
        own = np.array([name == series for name in measured.series])
        drawn.append(
            axes.errorbar(
                measured.frequency[own],
                measured.tan_delta[own],
                measured.standard_deviation[own],
                fmt=marker,
                color=BLACK,
                markerfacecolor="white",
                markersize=5.0,
                linewidth=1.0,
                label=series,
                zorder=10,
            )
        )
    return drawn


def attenuation_draws(spectrum: xr.Dataset) -> Figure:
    """Draw single draws of attenuation against frequency, a panel for each regime."""
    spectrum = spectrum.sortby("frequency")
    tan_delta = flat_draws(spectrum["tan_delta"])
    shown = evenly_spaced(tan_delta, DRAWN)
    frequency = spectrum["frequency"].to_numpy()
    medians = np.median(tan_delta, axis=0)
    fails = likely_fails(spectrum)
    n_regimes = len(medians)
    columns = min(2, n_regimes)
    rows = -(-n_regimes // columns)
    with figure_of(4.2 * columns, 2.9 * rows + 0.9) as figure:
        # The labels at the ends of two neighbouring axes need room.
        figure.set_layout_engine("constrained", wspace=0.06)
        panels = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for axes in panels.flat[n_regimes:]:
            axes.remove()
        for k, axes in enumerate(panels.flat[:n_regimes]):
            colour = _COLOURS[k % len(_COLOURS)]
            draw_thin_lines(axes, frequency, shown[:, k], colour, alpha=0.25)
            if k > 0:
                axes.loglog(frequency, medians[0], color=BLACK, linestyle="--", linewidth=1.0)
            axes.loglog(frequency, medians[k], color=BLACK, linewidth=1.8)
            n_failing = int(fails[k].sum())  # from some frequency downwards, or all
            if n_failing > 0 and frequency.size > 1:
                end = frequency[min(n_failing, frequency.size - 1)]
                axes.axvspan(frequency[0], end, color=BLACK, alpha=0.1, lw=0)
            axes.set_title(f"{REGIME_TITLE}: {spectrum['regime'].to_numpy()[k]}", loc="left")
            axes.margins(x=0.0)
        figure.supxlabel(FREQUENCY_LABEL, fontsize=10)
        figure.supylabel(ATTENUATION_LABEL, fontsize=10)
        first = spectrum["regime"].to_numpy()[0]
        figure.legend(
            handles=[
                Line2D([], [], color="#777777", linewidth=0.8, label=f"{len(shown)} single draws"),
                Line2D([], [], color=BLACK, linewidth=1.8, label="median"),
                Line2D([], [], color=BLACK, linestyle="--", label=f"median at {first}"),
                *([Patch(color=BLACK, alpha=0.1, label=FAILING_LABEL)] if fails.any() else []),
            ],
            loc="outside upper center",
            ncols=2 if fails.any() else 3,
            title=spectrum.attrs["title"],
        )
    return figure


def amplitude_dependence(spectrum: xr.Dataset) -> Figure:
    """Draw spectra of one median stress, and their ratios to that of the smallest amplitude."""
    spectrum = spectrum.sortby("frequency")
    tan_delta = flat_draws(spectrum["tan_delta"])
    smallest = int(spectrum["amplitude"].to_numpy().argmin())
    with figure_of(9.0, 4.6) as figure:
        left, right = figure.subplots(1, 2)
        lines = _draw_bands(left, spectrum, tan_delta, (0.2,))
        _draw_bands(right, spectrum, tan_delta / tan_delta[:, [smallest]], (0.2,))
        left.set_yscale("log")
        left.set_ylabel(ATTENUATION_LABEL)
        right.set_ylabel(
            rf"$\tan\delta$ over that at {spectrum['regime'].to_numpy()[smallest]} (–)"
        )
        left.set_title("(a) attenuation", loc="left")
        right.set_title("(b) relative to the smallest amplitude", loc="left")
        areas = [Patch(color=BLACK, alpha=0.2, label="90 % of draws")]
        handles: list[Handle] = [*lines, *areas, *_failing_handles(spectrum)]
        _legend_above(figure, handles, spectrum.attrs["title"])
    return figure


def _draw_evolving(axes: Axes, comparison: xr.Dataset) -> list[Line2D]:
    """Draw bands of what was solved in time, infinite medians as triangles; return the legend."""
    frequency = comparison["frequency"].to_numpy()
    quantiles = evolving_quantiles(comparison["tan_delta_evolving"])
    finite = quantiles[np.isfinite(quantiles)]
    above = 3.0 * max(axes.get_ylim()[1], finite.max(initial=0.0))
    shown = np.where(np.isfinite(quantiles), quantiles, above)
    given: dict[str, Any] = {"linestyle": "none", "markeredgecolor": BLACK}
    diamond, triangle = (
        {**given, "marker": marker, "markersize": size} for marker, size in (("D", 5.0), ("^", 8.0))
    )
    for k in range(comparison["regime"].size):
        low, median, high = shown[:, k]
        colour = _COLOURS[k % len(_COLOURS)]
        # Side by side, so that regimes with the same value are seen.
        at = frequency * (1.0 + 0.06 * k)
        axes.vlines(at, low, high, color=colour, linewidth=1.2)
        beyond = np.isinf(quantiles[1, k])
        for marks, some in ((diamond, ~beyond), (triangle, beyond)):
            if some.any():
                axes.plot(at[some], median[some], **marks, color=colour, label="_evolving")
    handles = [Line2D([], [], **diamond, color="#bbbbbb", label=EVOLVING_LABEL)]
    if np.isinf(quantiles[1]).any():
        handles.append(Line2D([], [], **triangle, color="#bbbbbb", label=BEYOND_LABEL))
    return handles


def _legend_above(figure: Figure, handles: Sequence[Handle], title: str) -> None:
    """Put the heading, what the lines are and the legend above the panels."""
    legend = figure.legend(
        handles=list(handles),
        loc="outside upper center",
        ncols=min(4, -(-len(handles) // 2)),
        title=f"{title}\nlines: {REGIME_TITLE}",
    )
    legend.get_title().set_multialignment("center")


def _failing_handles(spectrum: xr.Dataset) -> list[Line2D]:
    """Legend of what is drawn where frozen microstructure fails, if it does anywhere."""
    if not likely_fails(spectrum).any():
        return []
    return [Line2D([], [], color=BLACK, linewidth=THIN, alpha=PALE, label=FAILING_LABEL)]


def _draw_bands(
    axes: Axes, spectrum: xr.Dataset, values: FloatArray, opacities: Sequence[float]
) -> list[Line2D]:
    """Draw medians, pale where frozen microstructure fails, and bands; return the legend.

    Values (n_draws, n_regimes, n_frequencies); opacities are of the 90 % band, and of the 50 % one.
    """
    frequency = spectrum["frequency"].to_numpy()
    marker = "o" if frequency.size < FEW_FREQUENCIES else ""
    quantiles = np.quantile(values, BAND_QUANTILES, axis=0)
    fails = likely_fails(spectrum)
    handles = []
    for k, label in enumerate(spectrum["regime"].to_numpy()):
        colour, dashes = _COLOURS[k % len(_COLOURS)], _DASHES[k % len(_DASHES)]
        for band, opacity in enumerate(opacities):
            low, high = quantiles[band, k], quantiles[-1 - band, k]
            axes.fill_between(frequency, low, high, color=colour, alpha=opacity, linewidth=0)
        line: dict[str, Any] = {"color": colour, "linestyle": dashes, "marker": marker}
        axes.plot(frequency, quantiles[2, k], **line, linewidth=THIN, alpha=PALE, label=str(label))
        holding = np.where(fails[k], np.nan, quantiles[2, k])
        axes.plot(frequency, holding, **line, linewidth=THICK, label=HOLDING_LABEL)
        handles.append(Line2D([], [], **line, linewidth=THICK, label=str(label)))
    axes.set_xscale("log")
    if not marker:
        axes.margins(x=0.0)
    axes.set_xlabel(FREQUENCY_LABEL)
    return handles


TITLE_WIDTH = 95
"""Letters in a line above the panel."""


def prediction_figure(prediction: Prediction) -> Figure:
    """Draw bands of the solution and of new readings, data where the test has some, and cautions.

    Each quantity that the test answers with has a panel. The title has the cautions.

    Parameters
    ----------
    prediction : Prediction
        Of `Fit.predict`.

    Examples
    --------
    >>> figure = pyburgers.prediction_figure(fit.predict(test))
    """
    require_type("prediction", prediction, Prediction, "a prediction, as of Fit.predict")
    shown = other_tests.answers(prediction)
    with figure_of(8.0, 1.6 + 3.6 * len(shown)) as figure:
        # Tables of cycles have each quantity at places of its own.
        sharex = len({one.name for one in shown}) == len(shown)
        panels = figure.subplots(len(shown), 1, sharex=sharex, squeeze=False)[:, 0]
        for axes, quantity in zip(panels, shown, strict=True):
            _draw(axes, prediction, quantity)
        figure.legend(
            *panels[0].get_legend_handles_labels(),
            loc="outside upper left",
            ncols=3,
            title=_wrapped(prediction.title, *prediction.cautions),
            alignment="left",
        )
        panels[-1].set_xlabel(_clock_label(prediction, shown[-1]))
    return figure


def _wrapped(*sentences: str) -> str:
    """Return lines no longer than a figure is wide, each sentence on lines of its own."""
    return "\n".join(line for text in sentences for line in textwrap.wrap(text, TITLE_WIDTH))


def _clock_label(prediction: Prediction, quantity: ReadQuantity) -> str:
    """Return what the clock of a test shows; of tables of cycles, spectra and their periods (s)."""
    experiment = prediction.experiment
    period = experiment.conditions_at(other_tests.clock_of(prediction, quantity)).get("period_s")
    if period is None:
        return shown_clock(experiment).label
    periods = " to ".join(map(rounded_to, (period.min(), period.max())))
    return f"temperature (K) of spectra over periods of {periods} s (logarithmic)"


def _draw(axes: Axes, prediction: Prediction, quantity: ReadQuantity) -> None:
    """Draw bands of a quantity, and data where there are some."""
    experiment = prediction.experiment
    clock, factor = shown_clock(experiment), quantity.shown.display_factor
    places = other_tests.clock_of(prediction, quantity)
    # Lines end with a spectrum: the next one begins at its shortest period.
    conditions = experiment.conditions_at(places)
    period = conditions.get("period_s", places)
    ends = np.flatnonzero(np.diff(period) < 0) + 1
    position = np.insert(places * clock.display_factor, ends, np.nan)
    solved, new = (
        np.insert(factor * draws, ends, np.nan, axis=1)
        for draws in other_tests.shown_draws(prediction, quantity)
    )
    for draws, percent, colour, opacity, label in (
        (new, 90, ORANGE, 0.35, "90 % of new readings"),
        (solved, 90, BLUE, 0.25, "90 % of solutions"),
        (solved, 50, BLUE, 0.6, "50 % of solutions"),
    ):
        tail = (1 - percent / 100) / 2
        low, high = np.quantile(draws, [tail, 1 - tail], axis=0)
        # The colour that the opacity gives on white.
        tint = tuple(1 - opacity * (1 - part) for part in to_rgb(colour))
        axes.fill_between(position, low, high, color=tint, linewidth=0, label=label)
    median = np.median(solved, axis=0)
    axes.plot(position, median, color=VERMILION, linewidth=1.6, label="predictive median")
    own = np.array([one == quantity for one in other_tests.read_quantities(experiment)], dtype=bool)
    limit = other_tests.is_upper_limit(experiment)
    for some, marker, label in (
        (own & ~limit, "o", f"{experiment.provenance.kind} data"),
        (own & limit, "v", "upper limits"),
    ):
        if some.any():
            measured = other_tests.as_shown(quantity, experiment.response[some]) * factor
            at = experiment.position[some] * clock.display_factor
            draw_dots(axes, at, measured, marker=marker, label=label)
    if "temperature_K" in conditions:
        spectra, first = np.unique(np.floor(places), return_index=True)
        temperature = conditions["temperature_K"][first]
        axes.set_xticks(spectra + 0.5, [f"{one:.4g}" for one in temperature], rotation=45)
    axes.margins(x=0.01)
    axes.set(
        ylabel=quantity.shown.label, yscale="linear" if quantity.logarithm_of is None else "log"
    )
