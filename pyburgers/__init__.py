"""Bayesian inference of nonlinear Burgers viscoelasticity from deformation experiments.

What takes long tells of its progress through `logging`: to the logger ``pyburgers``, at level INFO.
"""

import logging

from pyburgers.attenuation import Regime, attenuation_spectrum, predict_attenuation
from pyburgers.comparison import Comparison, compare
from pyburgers.constant_rate import ConstantRateExperiment
from pyburgers.errors import InputError, PyburgersError, SamplingError, ToolchainError
from pyburgers.experiment import Experiment
from pyburgers.experiment_files import load_experiment
from pyburgers.fitting import Fit, fit
from pyburgers.forced_oscillation import OscillationExperiment
from pyburgers.joint_fitting import JointFit, fit_jointly
from pyburgers.leave_one_test_out import ComparisonByTest, compare_by_test
from pyburgers.marginal_likelihood import log_marginal_likelihood
from pyburgers.peak_stress import PeakStressData, load_peak_stress
from pyburgers.peak_stress_fit import PeakStressFit, fit_peak_stress, flow_law_prior
from pyburgers.peak_stress_priors import default_peak_stress_priors, load_peak_stress_priors
from pyburgers.priors import PriorSet, default_priors, load_priors, with_flow_law
from pyburgers.sampler_options import SamplerOptions
from pyburgers.simulation import load_parameters, simulate
from pyburgers.stan_data import SolverOptions
from pyburgers.variants import ModelVariant, variant_of, with_variant

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
    "PeakStressData",
    "PeakStressFit",
    "PriorSet",
    "PyburgersError",
    "Regime",
    "SamplerOptions",
    "SamplingError",
    "SolverOptions",
    "ToolchainError",
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
