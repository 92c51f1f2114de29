"""Bayesian inference of nonlinear Burgers viscoelasticity from deformation experiments."""

from pyburgers.errors import InputError, PyburgersError, SamplingError, ToolchainError
from pyburgers.experiment import Experiment, load_experiment
from pyburgers.fitting import Fit, fit
from pyburgers.priors import PriorSet, default_priors, load_priors
from pyburgers.sampling import SamplerOptions
from pyburgers.simulation import load_parameters, simulate
from pyburgers.stan_data import SolverOptions

__all__ = [
    "Experiment",
    "Fit",
    "InputError",
    "PriorSet",
    "PyburgersError",
    "SamplerOptions",
    "SamplingError",
    "SolverOptions",
    "ToolchainError",
    "default_priors",
    "fit",
    "load_experiment",
    "load_parameters",
    "load_priors",
    "simulate",
]
