"""Figures of the model itself: its circuit, what its elements do in a test, and its flow law."""

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pyburgers.common.draws import central_band
from pyburgers.drawing.panels import (
    LINES_AND_AREAS,
    draw_band_panel,
    draw_curve,
    legend_above,
)
from pyburgers.drawing.style import BLACK, BLUE, GREEN, ORANGE, PURPLE, VERMILION, style
from pyburgers.drawing.views.constant_rate import fitted_curve
from pyburgers.model.display import STRAIN_FACTOR, STRAIN_UNIT, STRESS_FACTOR, STRESS_UNIT
from pyburgers.protocols.protocol import FittedTest
from pyburgers.studies.maor.before_data import parameter_draws, prediction_draws
from pyburgers.studies.maor.flow_law import FlowLaws

FloatArray = npt.NDArray[np.float64]

CIRCUIT_CAPTION = (
    "The nonlinear Burgers model, a series circuit under one stress σ: a spring E_M (elastic "
    "strain), a Kelvin-Voigt element, that is a spring E_K beside a dashpot η_K (strain that is "
    "delayed and recovered), and a dashpot that flows as a power law of stress (strain that "
    "stays). Grain size d and fabric factor F act on the power-law dashpot alone, and relax with "
    "strain towards their steady states. Drawn for this page."
)

STRAIN_PARTS_CAPTION = (
    "What each element does in a test at constant strain rate: (a) the stress, (b) the strain "
    "of each element, whose sum is the imposed strain. Stress peaks where the dashpot carries "
    "almost the whole imposed rate while grain size and fabric have begun to weaken it. Lines "
    "are posterior medians, areas hold 90 % of draws."
)

MEAN_SOLUTION_CAPTION = (
    "The line of the paper's Fig. 3: the solution at the posterior mean of all parameters "
    "(dashed) over data, retrodictions and predictive band. The means of all parameters need not "
    "be a good combination: where parameters trade off along a bent ridge, the line leaves the "
    "band although the fit is good. The table of statements says by how much."
)

FLOW_LAWS_CAPTION = (
    "Flow of the undeformed material: the power law of the fit, and beside it the hyperbolic sine "
    "of the paper's Eq. 2, a rate proportional to sinh(σ/σ_L), that has the same rate and slope at "
    "the peak stress of the test, with its linear limit at low stress (medians and 90 % of "
    "draws). One test at one rate sees the laws only near its own stress (dotted), where they "
    "agree; attenuation at low stress depends on which of them holds."
)


def circuit() -> Figure:
    """Draw the circuit of the model."""
    with style():
        figure = Figure(figsize=(8.6, 3.0), layout="constrained")
        axes = figure.subplots()
        for start, end in ((0.0, 0.4), (2.0, 2.6), (4.6, 5.2), (7.2, 7.6)):
            axes.plot([start, end], [0, 0], color=BLACK, linewidth=1.4)
        _spring(axes, 0.4, 2.0, 0.0, BLUE)
        for at in (2.6, 4.6):
            axes.plot([at, at], [-0.5, 0.5], color=BLACK, linewidth=1.4)
        _spring(axes, 2.6, 4.6, 0.5, GREEN)
        _dashpot(axes, 2.6, 4.6, -0.5, GREEN)
        _dashpot(axes, 5.2, 7.2, 0.0, VERMILION)
        for x, y, text in (
            (1.2, 0.42, "$E_M$"),
            (3.6, 0.92, "$E_K$"),
            (3.6, -1.12, r"$\eta_K$"),
            (6.2, 0.45, r"$\dot\varepsilon=(\sigma/F)^n\,d^{-p}\,e^{Q_M(\beta-1/RT)}$"),
            (
                6.2,
                -0.62,
                r"$d\to d_{ss}$ over $\varepsilon_{c1}$,  $F\to F_{ss}$ over "
                r"$\varepsilon_{c2}$",
            ),
            (1.2, -1.5, "elastic strain"),
            (3.6, -1.5, "delayed strain"),
            (6.2, -1.5, "permanent strain"),
        ):
            axes.text(x, y, text, ha="center", va="center", fontsize=10)
        for x, head in ((0.0, -0.45), (7.6, 0.45)):
            axes.annotate(
                "", (x, 0), (x + head, 0), arrowprops={"arrowstyle": "->", "linewidth": 1.4}
            )
            axes.text(x + 1.4 * head, 0, r"$\sigma$", ha="center", va="center", fontsize=11)
        axes.set_xlim(-0.8, 8.4)
        axes.set_ylim(-1.8, 1.2)
        axes.set_axis_off()
    return figure


def _spring(axes: Axes, start: float, end: float, height: float, colour: str) -> None:
    """Draw a spring as a zigzag."""
    turns = np.linspace(start + 0.25, end - 0.25, 12)
    zigzag = height + 0.16 * np.where(np.arange(12) % 2, 1.0, -1.0)
    x = np.concatenate([[start, turns[0] - 0.05], turns, [turns[-1] + 0.05, end]])
    y = np.concatenate([[height] * 2, zigzag, [height] * 2])
    axes.plot(x, y, color=colour, linewidth=1.6)


def _dashpot(axes: Axes, start: float, end: float, height: float, colour: str) -> None:
    """Draw a dashpot: a piston in a pot."""
    middle = (start + end) / 2
    pot = ([middle + 0.4, middle - 0.35, middle - 0.35, middle + 0.4], (-0.2, -0.2, 0.2, 0.2))
    axes.plot(pot[0], height + np.array(pot[1]), color=colour, linewidth=1.6)
    axes.plot([start, middle - 0.35], [height, height], color=colour, linewidth=1.6)
    axes.plot([middle + 0.05, end], [height, height], color=colour, linewidth=1.6)
    piston = [height - 0.15, height + 0.15]
    axes.plot([middle + 0.05] * 2, piston, color=colour, linewidth=2.6)


def strain_parts(fit: FittedTest) -> Figure:
    """Draw stress, and the strain of each element, along a test at constant rate."""
    strain = fit.posterior["predictions"]["strain"].to_numpy()
    stress, kelvin = (prediction_draws(fit, name) for name in ("stress", "kelvin_strain"))
    elastic = stress / parameter_draws(fit, "maxwell_modulus")[:, np.newaxis]
    flow = strain - elastic - kelvin
    with style():
        figure = Figure(figsize=(8.6, 4.2), layout="constrained")
        above, below = figure.subplots(1, 2)
        position = strain * STRAIN_FACTOR
        draw_band_panel(
            above,
            position,
            [(stress * STRESS_FACTOR, BLACK, "stress")],
            heading="(a) stress",
            label=f"differential stress ({STRESS_UNIT})",
        )
        draw_band_panel(
            below,
            position,
            [
                (elastic * STRAIN_FACTOR, BLUE, "spring $E_M$"),
                (kelvin * STRAIN_FACTOR, GREEN, "Kelvin element"),
                (flow * STRAIN_FACTOR, VERMILION, "power-law dashpot"),
            ],
            heading="(b) strain of each element",
            label=f"strain of the element ({STRAIN_UNIT})",
        )
        for axes in (above, below):
            axes.set_xlabel(f"imposed strain ({STRAIN_UNIT})")
            axes.set_xscale("log")
        below.set_yscale("log")
        below.set_ylim(bottom=1e-3)
        figure.suptitle(f"{fit.experiment.title}\n{LINES_AND_AREAS}", fontsize=10)
    return figure


def mean_solution(fit: FittedTest) -> Figure:
    """Draw the solution at the posterior mean over data and predictive band."""
    solution = fit.posterior["posterior_mean_solution"].to_dataset()["stress"]
    with style():
        figure = Figure(figsize=(8.0, 5.0), layout="constrained")
        axes = figure.subplots()
        curve = fitted_curve(fit)
        draw_curve(axes, curve)
        axes.plot(
            solution["strain"] * STRAIN_FACTOR,
            solution * STRESS_FACTOR,
            color=PURPLE,
            linestyle="--",
            linewidth=1.6,
            label="solution at the posterior mean",
        )
        axes.set_xlabel(curve.position_label)
        legend_above(figure, [axes])
    return figure


def flow_laws_figure(fit: FittedTest, laws: FlowLaws) -> Figure:
    """Draw the three laws (`pyburgers.studies.maor.flow_law.flow_laws`)."""
    stress = laws.stress * STRESS_FACTOR
    breakdown = np.median(laws.breakdown_stress) * STRESS_FACTOR
    name = rf"hyperbolic sine, $\sigma_L$ = {breakdown:.2g} {STRESS_UNIT}"
    with style():
        figure = Figure(figsize=(6.4, 4.6), layout="constrained")
        axes = figure.subplots()
        for rates, colour, label, dashes in (
            (laws.power_law, BLUE, "power law of the fit", "-"),
            (laws.sinh, VERMILION, name, "--"),
            (laws.linear, ORANGE, "its linear limit", "-."),
        ):
            low, median, high = central_band(rates)
            axes.fill_between(stress, low, high, color=colour, alpha=0.25, linewidth=0)
            axes.loglog(stress, median, color=colour, linestyle=dashes, label=label)
        axes.axvline(
            laws.shared_stress * STRESS_FACTOR,
            color=BLACK,
            linestyle=":",
            linewidth=1.0,
            label="peak stress of the test",
        )
        axes.set_xlabel(f"stress ({STRESS_UNIT})")
        axes.set_ylabel("strain rate of the dashpot (1/s)")
        axes.legend(loc="best")
        axes.set_title(f"{fit.experiment.id}: flow of the undeformed material", loc="left")
    return figure
