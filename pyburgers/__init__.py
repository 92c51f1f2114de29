"""Bayesian inference of nonlinear Burgers viscoelasticity from deformation experiments.

What takes long tells of its progress through `logging`: to the logger ``pyburgers``, at level INFO.
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
    from pyburgers.comparison.by_points import compare
    from pyburgers.comparison.by_tests import compare_by_test
    from pyburgers.comparison.marginal_likelihood import log_marginal_likelihood
    from pyburgers.comparison.results import Comparison, ComparisonByTest
    from pyburgers.fitting.fit import Fit, JointFit, fit, fit_jointly
    from pyburgers.fitting.prediction import Prediction
    from pyburgers.flow_law_tables.fit import PeakStressFit, fit_peak_stress, flow_law_prior
    from pyburgers.flow_law_tables.inputs import (
        PeakStressData,
        default_peak_stress_priors,
        load_peak_stress,
        load_peak_stress_priors,
    )
    from pyburgers.model.priors import PriorSet, default_priors, load_priors, with_flow_law
    from pyburgers.model.variants import ModelVariant, variant_of, with_variant
    from pyburgers.predictions.attenuation import attenuation_spectrum, predict_attenuation
    from pyburgers.predictions.stress_cycles import Regime
    from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment
    from pyburgers.protocols.experiment import Experiment
    from pyburgers.protocols.forced_oscillation.experiment import OscillationExperiment
    from pyburgers.protocols.forward import load_parameters, simulate
    from pyburgers.protocols.protocol import load_experiment
    from pyburgers.protocols.stan_data import SolverOptions
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
    "comparison.by_points": ("Comparison", "compare"),
    "comparison.by_tests": ("ComparisonByTest", "compare_by_test"),
    "comparison.marginal_likelihood": ("log_marginal_likelihood",),
    "fitting.fit": ("Fit", "JointFit", "fit", "fit_jointly"),
    "fitting.prediction": ("Prediction",),
    "flow_law_tables.fit": ("PeakStressFit", "fit_peak_stress", "flow_law_prior"),
    "flow_law_tables.inputs": (
        "PeakStressData",
        "default_peak_stress_priors",
        "load_peak_stress",
        "load_peak_stress_priors",
    ),
    "model.priors": ("PriorSet", "default_priors", "load_priors", "with_flow_law"),
    "model.variants": ("ModelVariant", "variant_of", "with_variant"),
    "predictions.attenuation": ("attenuation_spectrum", "predict_attenuation"),
    "predictions.stress_cycles": ("Regime",),
    "protocols.constant_rate.experiment": ("ConstantRateExperiment",),
    "protocols.experiment": ("Experiment",),
    "protocols.protocol": ("load_experiment",),
    "protocols.forced_oscillation.experiment": ("OscillationExperiment",),
    "protocols.forward": ("load_parameters", "simulate"),
    "protocols.stan_data": ("SolverOptions",),
    "sampling.options": ("SamplerOptions",),
}
"""Where the public names are; they are imported when they are asked for."""

_MODULE_OF = {name: module for module, names in _NAMES.items() for name in names}

logging.getLogger(__name__).addHandler(logging.NullHandler())

__all__ = [
    "Comparison",
    "ComparisonByTest",
    "ConstantRateExperiment",
    "Experiment",
    "Fit",
    "InputError",
    "JointFit",
    "ModelVariant",
    "OscillationExperiment",
    "Outcome",
    "PeakStressData",
    "PeakStressFit",
    "Prediction",
    "PriorSet",
    "PyburgersError",
    "Regime",
    "SamplerOptions",
    "SamplingError",
    "SolverOptions",
    "SystemFailureError",
    "ToolchainError",
    "Workers",
    "attenuation_spectrum",
    "compare",
    "compare_by_test",
    "default_peak_stress_priors",
    "default_priors",
    "fit",
    "fit_jointly",
    "fit_peak_stress",
    "flow_law_prior",
    "load_experiment",
    "load_parameters",
    "load_peak_stress",
    "load_peak_stress_priors",
    "load_priors",
    "log_marginal_likelihood",
    "predict_attenuation",
    "simulate",
    "variant_of",
    "with_flow_law",
    "with_variant",
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
