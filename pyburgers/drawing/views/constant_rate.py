"""View of tests at imposed strain rate: figures of a fit with their captions, facts of a test."""

from collections.abc import Sequence

from markupsafe import Markup
from matplotlib.figure import Figure

from pyburgers.drawing.page_parts import recipe
from pyburgers.drawing.panels import (
    STRAIN_LABEL,
    STRESS_LABEL,
    FittedCurve,
    ReadCurve,
    curve_result,
    curve_with_residuals,
)
from pyburgers.drawing.view import View, curve_of, marks_text
from pyburgers.drawing.views.softening import (
    evolves,
    microstructure_facts,
    softened_text,
    softening_along,
    softening_caption,
)
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, rate_text
from pyburgers.kinds.experiment import of_kind
from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.likelihood import strains_of
from pyburgers.model.display import STRAIN_FACTOR, STRESS_FACTOR
from pyburgers.model.read_quantities import STRESS


@recipe(
    "stress_strain",
    "Stress-strain curve",
    lambda fit: (
        "Top: the stress-strain curve (circles), the predictive median (solid line), "
        "retrodictions, that is solutions for single draws from the posterior (thin lines), and "
        f"the band that should hold 90 % of new measurements. {marks_text([fit])}"
        "Bottom: data minus the predictive median, with the band that should hold 90 % of "
        "residuals if they were noise alone; a run of points on one side of zero is what the "
        "model misses."
    ),
    lambda fit: curve_result(fitted_curve(fit)),
)
def stress_strain(fit: FittedTest) -> Figure:
    """Draw data, retrodictions, predictive band and residuals along strain."""
    return curve_with_residuals(fitted_curve(fit))


def read_curve(experiment: ConstantRateExperiment) -> ReadCurve:
    """Gather the measured stress-strain curve."""
    return ReadCurve(
        position=experiment.strain * STRAIN_FACTOR,
        data=experiment.stress * STRESS_FACTOR,
        position_label=STRAIN_LABEL,
        label=STRESS_LABEL,
        heading=experiment.title,
        # The first rate is in the title.
        marks=[
            (segment.start_strain * STRAIN_FACTOR, f"then {rate_text(segment.strain_rate)}")
            for segment in experiment.segments[1:]
        ],
        limits=(0.0, 1.02 * experiment.final_strain * STRAIN_FACTOR),
    )


def fitted_curve(fit: FittedTest) -> FittedCurve:
    """Gather the stress-strain curve as measured and as a fit has it."""
    return curve_of(fit, read_curve(of_kind(fit.experiment, ConstantRateExperiment)), STRESS)


@recipe(
    "softening",
    "Softening by grain size and fabric",
    softening_caption("final strain"),
    lambda fit: f"at the final strain {softened_text(fit)}",
    suits=evolves,
)
def softening(fit: FittedTest) -> Figure:
    """Draw how grain size and fabric soften the material along strain."""
    experiment = of_kind(fit.experiment, ConstantRateExperiment)
    return softening_along(fit, strains_of(experiment.microstructure), STRAIN_LABEL)


def facts(experiment: ConstantRateExperiment) -> Sequence[tuple[str, str]]:
    """Return imposed rates, number of points and measured microstructure."""
    rates = [
        Markup("{} × 10<sup>{}</sup> s<sup>−1</sup> from {:.3g} % strain").format(
            *_mantissa_and_exponent(segment.strain_rate), segment.start_strain * STRAIN_FACTOR
        )
        for segment in experiment.segments
    ]
    end = experiment.final_strain * STRAIN_FACTOR
    return (
        ("Strain rate", Markup("; ").join(rates)),
        ("Points", f"{experiment.n_points}, test ends at {end:.3g} % strain"),
        *microstructure_facts(
            experiment.microstructure,
            lambda one: f"{(one.strain or 0.0) * STRAIN_FACTOR:.3g} % strain",
        ),
    )


def _mantissa_and_exponent(number: float) -> tuple[str, str]:
    mantissa, exponent = f"{number:.2e}".split("e")
    return mantissa, str(int(exponent)).replace("-", "−")


VIEW = View(
    figures=(stress_strain, softening),
    read=read_curve,
    curve=fitted_curve,
    facts=facts,
    reference_text=Markup(
        "The reference stress <i>S</i><sub>0</sub>, at which undeformed material would flow at the "
        "first imposed rate by its power law alone (without threshold, backstress, hyperbolic sine "
        "or further mechanism), follows from the other parameters, and so does its prior."
    ),
)
