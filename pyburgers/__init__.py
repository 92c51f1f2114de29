"""Bayesian inference of nonlinear Burgers viscoelasticity from deformation experiments."""

from pyburgers.attenuation import Regime, attenuation_spectrum, predict_attenuation
from pyburgers.constant_rate import ConstantRateExperiment
from pyburgers.errors import InputError, PyburgersError, SamplingError, ToolchainError
from pyburgers.experiment import Experiment
from pyburgers.experiment_files import load_experiment
from pyburgers.fitting import Fit, fit
from pyburgers.forced_oscillation import OscillationExperiment
from pyburgers.priors import PriorSet, default_priors, load_priors
from pyburgers.sampling import SamplerOptions
from pyburgers.simulation import load_parameters, simulate
from pyburgers.stan_data import SolverOptions

__all__ = [
    "ConstantRateExperiment",
    "Experiment",
    "Fit",
    "InputError",
    "OscillationExperiment",
    "PriorSet",
    "PyburgersError",
    "Regime",
    "SamplerOptions",
    "SamplingError",
    "SolverOptions",
    "ToolchainError",
    "attenuation_spectrum",
    "default_priors",
    "fit",
    "load_experiment",
    "load_parameters",
    "load_priors",
    "predict_attenuation",
    "simulate",
]
