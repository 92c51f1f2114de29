"""Bayesian inference of nonlinear Burgers viscoelasticity from deformation experiments.

Long calls report their progress to the logger ``pyburgers`` of `logging`, at level INFO.
"""

import logging
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pyburgers.checks.fit_checks import Outcome
    from pyburgers.common.errors import (
        InputError,
        PyburgersError,
        SamplingError,
        SystemFailureError,
        ToolchainError,
    )
    from pyburgers.common.tasks import Workers
    from pyburgers.common.units import rounded
    from pyburgers.comparison.by_points import compare
    from pyburgers.comparison.by_tests import compare_by_test
    from pyburgers.comparison.marginal_likelihood import log_marginal_likelihood
    from pyburgers.comparison.results import Comparison, ComparisonByTest
    from pyburgers.drawing.page_parts import PageFigure, PageSection, PageTable
    from pyburgers.drawing.style import style
    from pyburgers.fitting.fit import Fit, JointFit, fit, fit_jointly
    from pyburgers.fitting.prediction import Prediction
    from pyburgers.fitting.prior_draws import PriorDraws, prior_draws
    from pyburgers.fitting.side_by_side import Task, fit_side_by_side, task_of
    from pyburgers.flow_law_tables.fit import PeakStressFit, fit_peak_stress, flow_law_prior
    from pyburgers.flow_law_tables.inputs import (
        PeakStressData,
        default_peak_stress_priors,
        load_peak_stress,
        load_peak_stress_priors,
        with_curve_flow_law,
        without_test,
    )
    from pyburgers.model.display import shown_quantity, symbol_text, unit_text
    from pyburgers.model.prior_families import Prior
    from pyburgers.model.priors import PriorSet, default_priors, load_priors, with_flow_law
    from pyburgers.model.variants import ModelVariant, variant_of, with_variant
    from pyburgers.predictions.attenuation import attenuation_spectrum, predict_attenuation
    from pyburgers.predictions.closed_forms import flow_rate
    from pyburgers.predictions.measured_attenuation import (
        MeasuredAttenuation,
        load_measured_attenuation,
    )
    from pyburgers.predictions.other_test_figures import prediction_figure
    from pyburgers.predictions.other_tests import score_sentence, score_table, surprise_sentence
    from pyburgers.predictions.stress_cycles import Regime
    from pyburgers.protocols.attenuation.experiment import AttenuationExperiment
    from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment
    from pyburgers.protocols.experiment import Experiment
    from pyburgers.protocols.forced_oscillation.experiment import (
        OscillationExperiment,
        with_background,
    )
    from pyburgers.protocols.forced_oscillation.response import predicted_response
    from pyburgers.protocols.forward import load_parameters, simulate
    from pyburgers.protocols.loading_history.experiment import LoadingHistory
    from pyburgers.protocols.protocol import load_experiment
    from pyburgers.protocols.stan_data import SolverOptions
    from pyburgers.report.attenuation_section import attenuation_section
    from pyburgers.report.comparison_sections import comparison_sections
    from pyburgers.report.joint_section import joint_sections
    from pyburgers.report.page import write_report
    from pyburgers.report.peak_stress_section import peak_stress_section
    from pyburgers.report.posterior_figures import page_figure
    from pyburgers.sampling.options import SamplerOptions

    __version__: str

_NAMES = {
    "checks.fit_checks": ("Outcome",),
    "common.errors": (
        "InputError",
        "PyburgersError",
        "SamplingError",
        "SystemFailureError",
        "ToolchainError",
    ),
    "common.tasks": ("Workers",),
    "common.units": ("rounded",),
    "comparison.by_points": (
        "Comparison",
        "compare",
    ),
    "comparison.by_tests": (
        "ComparisonByTest",
        "compare_by_test",
    ),
    "comparison.conclusions": (),
    "comparison.marginal_likelihood": ("log_marginal_likelihood",),
    "drawing.page_parts": (
        "PageFigure",
        "PageSection",
        "PageTable",
    ),
    "drawing.style": ("style",),
    "fitting.fit": (
        "Fit",
        "JointFit",
        "fit",
        "fit_jointly",
    ),
    "fitting.prediction": ("Prediction",),
    "fitting.prior_draws": (
        "PriorDraws",
        "prior_draws",
    ),
    "fitting.side_by_side": (
        "Task",
        "fit_side_by_side",
        "task_of",
    ),
    "flow_law_tables.fit": (
        "PeakStressFit",
        "fit_peak_stress",
        "flow_law_prior",
    ),
    "flow_law_tables.inputs": (
        "PeakStressData",
        "default_peak_stress_priors",
        "load_peak_stress",
        "load_peak_stress_priors",
        "with_curve_flow_law",
        "without_test",
    ),
    "model.display": (
        "shown_quantity",
        "symbol_text",
        "unit_text",
    ),
    "model.prior_families": ("Prior",),
    "model.priors": (
        "PriorSet",
        "default_priors",
        "load_priors",
        "with_flow_law",
    ),
    "model.variants": (
        "ModelVariant",
        "variant_of",
        "with_variant",
    ),
    "predictions.attenuation": (
        "attenuation_spectrum",
        "predict_attenuation",
    ),
    "predictions.closed_forms": ("flow_rate",),
    "predictions.measured_attenuation": (
        "MeasuredAttenuation",
        "load_measured_attenuation",
    ),
    "predictions.other_test_figures": ("prediction_figure",),
    "predictions.other_tests": (
        "score_sentence",
        "score_table",
        "surprise_sentence",
    ),
    "predictions.stress_cycles": ("Regime",),
    "protocols.attenuation.experiment": ("AttenuationExperiment",),
    "protocols.constant_rate.experiment": ("ConstantRateExperiment",),
    "protocols.experiment": ("Experiment",),
    "protocols.forced_oscillation.experiment": (
        "OscillationExperiment",
        "with_background",
    ),
    "protocols.forced_oscillation.response": ("predicted_response",),
    "protocols.forward": (
        "load_parameters",
        "simulate",
    ),
    "protocols.loading_history.experiment": ("LoadingHistory",),
    "protocols.protocol": ("load_experiment",),
    "protocols.stan_data": ("SolverOptions",),
    "report.attenuation_section": ("attenuation_section",),
    "report.comparison_sections": ("comparison_sections",),
    "report.joint_section": ("joint_sections",),
    "report.page": ("write_report",),
    "report.peak_stress_section": ("peak_stress_section",),
    "report.posterior_figures": ("page_figure",),
    "sampling.options": ("SamplerOptions",),
}
"""Where the public names are; they are imported when they are asked for."""

_MODULE_OF = {name: module for module, names in _NAMES.items() for name in names}

logging.getLogger(__name__).addHandler(logging.NullHandler())

__all__ = [
    "AttenuationExperiment",
    "Comparison",
    "ComparisonByTest",
    "ConstantRateExperiment",
    "Experiment",
    "Fit",
    "InputError",
    "JointFit",
    "LoadingHistory",
    "MeasuredAttenuation",
    "ModelVariant",
    "OscillationExperiment",
    "Outcome",
    "PageFigure",
    "PageSection",
    "PageTable",
    "PeakStressData",
    "PeakStressFit",
    "Prediction",
    "Prior",
    "PriorDraws",
    "PriorSet",
    "PyburgersError",
    "Regime",
    "SamplerOptions",
    "SamplingError",
    "SolverOptions",
    "SystemFailureError",
    "Task",
    "ToolchainError",
    "Workers",
    "attenuation_section",
    "attenuation_spectrum",
    "compare",
    "compare_by_test",
    "comparison_sections",
    "default_peak_stress_priors",
    "default_priors",
    "fit",
    "fit_jointly",
    "fit_peak_stress",
    "fit_side_by_side",
    "flow_law_prior",
    "flow_rate",
    "joint_sections",
    "load_experiment",
    "load_measured_attenuation",
    "load_parameters",
    "load_peak_stress",
    "load_peak_stress_priors",
    "load_priors",
    "log_marginal_likelihood",
    "page_figure",
    "peak_stress_section",
    "predict_attenuation",
    "predicted_response",
    "prediction_figure",
    "prior_draws",
    "rounded",
    "score_sentence",
    "score_table",
    "shown_quantity",
    "simulate",
    "style",
    "surprise_sentence",
    "symbol_text",
    "task_of",
    "unit_text",
    "variant_of",
    "with_background",
    "with_curve_flow_law",
    "with_flow_law",
    "with_variant",
    "without_test",
    "write_report",
]


def __getattr__(name: str) -> object:
    """Import a public name, or look up the version."""
    if name == "__version__":
        return import_module("importlib.metadata").version(__name__)
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    return globals()[name]


def __dir__() -> list[str]:
    """Return the public names, imported or not, and those of modules."""
    return sorted({*globals(), *__all__, "__version__"})
