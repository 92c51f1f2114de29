"""Which figures the report of a fit holds."""

from pyburgers.drawing.style import FigureRecipe
from pyburgers.fitting.fit import Fit
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.forced_oscillation.experiment import OscillationExperiment
from pyburgers.report.constant_rate_figures import CONSTANT_RATE_FIGURES
from pyburgers.report.oscillation_figures import OSCILLATION_FIGURES
from pyburgers.report.posterior_figures import PAIRS, PRIOR_POSTERIOR, RANK


def figures_for(experiment: Experiment) -> tuple[FigureRecipe[Fit], ...]:
    """Return the figures of a fit, in their order on the page.

    Parameters
    ----------
    experiment : Experiment
        What was fitted.
    """
    is_oscillation = isinstance(experiment, OscillationExperiment)
    first, *others = OSCILLATION_FIGURES if is_oscillation else CONSTANT_RATE_FIGURES
    return (first, PRIOR_POSTERIOR, *others, PAIRS, RANK)
