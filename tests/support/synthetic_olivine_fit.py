"""A made-up fit of the olivine twin, and ways to change the draws of any made-up fit."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy import stats
from synthetic_fit import make_fit

from pyburgers.common.array_types import FloatArray
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.experiment import of_kind
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment, with_background
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.forced_oscillation.likelihood import LIKELIHOOD as FORCED_OSCILLATION
from pyburgers.kinds.forced_oscillation.preparation import Background
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.stan_data import REFERENCE_FLOW_RATE, REFERENCE_STRESS
from pyburgers.model.parameters import PARAMETERS
from pyburgers.model.priors import default_priors

OLIVINE = Path(__file__).parents[2] / "data" / "olivine" / "olivine_twin.toml"


def make_olivine_fit(
    path: Path, background: Background = "removed", *, chains: int = 4, draws: int = 250
) -> Fit:
    """Make a fit with normal draws about the truth and predicted stresses that hardly vary.

    Of the run directory, only its manifest is written. The name of the experiment has its
    background.
    """
    experiment = with_background(load_forced_oscillation(OLIVINE), background)
    assert experiment.true_parameters is not None
    made = make_fit(path, chains=chains, draws=draws, name=f"olivine_{background}")
    priors = default_priors("olivine").resolved(float(np.abs(experiment.stress).max()))
    posterior = made.posterior["posterior"].to_dataset()
    rng = np.random.default_rng(2)
    for name in (parameter.name for parameter in PARAMETERS):
        prior = priors[name]
        spread = 0.0 if prior.is_fixed else 0.1 * float(prior.distribution().std())
        truth = experiment.true_parameters[name]
        values = rng.normal(truth, spread, posterior[name].shape)
        posterior[name] = posterior[name].copy(data=values)
        posterior[name].attrs["fixed"] = int(prior.is_fixed)
    rate = posterior[REFERENCE_STRESS].copy(data=rng.lognormal(-14.0, 0.3, (chains, draws)))
    rate.attrs = {"units": "1/s", "fixed": 0}
    posterior = posterior.drop_vars(REFERENCE_STRESS).assign({REFERENCE_FLOW_RATE: rate})
    groups = {name: node.to_dataset() for name, node in made.posterior.children.items()}
    for name in ("log_likelihood", "model_response", "posterior_mean_solution", "constant_data"):
        del groups[name]
    observed = xr.Dataset({"stress": ("point", experiment.stress)})
    kind = xr.Dataset(attrs={"protocol": experiment.protocol})
    groups |= {"/": kind, "posterior": posterior, "observed_data": observed}
    tree = xr.DataTree.from_dict(groups)
    changes: dict[str, Any] = {
        "problem": problem_of([replace(experiment, id=f"olivine_{background}")], priors),
        "posterior": tree,
    }
    return oscillating(replace(made, **changes), amplitude_sd=0.01, phase_sd=0.01)


def redrawn(fit: Fit, **draws: FloatArray) -> Fit:
    """Exchange the draws of some parameters."""
    posterior = fit.posterior["posterior"].to_dataset()
    changed = {name: posterior[name].copy(data=values) for name, values in draws.items()}
    groups = {name: node.to_dataset() for name, node in fit.posterior.children.items()}
    groups["posterior"] = posterior.assign(changed)
    groups["/"] = xr.Dataset(attrs={"protocol": fit.experiment.protocol})
    return replace(fit, posterior=xr.DataTree.from_dict(groups))


def normal(fit: Fit, mean: float, sd: float) -> FloatArray:
    """Draws of a normal distribution in the shape of a fit's."""
    shape = tuple(fit.posterior["posterior"].sizes[name] for name in ("chain", "draw"))
    return np.random.default_rng(3).normal(mean, sd, shape)


def oscillating(
    fit: Fit,
    *,
    amplitude_sd: float,
    phase_sd: float,
    amplitude_factor: float = 1.0,
    phase_shift: float = 0.0,
    noise: float = 4e6,
) -> Fit:
    """Give a fit of an oscillation predicted stresses whose amplitude and phase scatter.

    They scatter about those of the record, or about what is shifted from them.
    """
    experiment = of_kind(fit.experiment, OscillationExperiment)
    prepared = experiment.prepared
    observed, _ = prepared.stress_fit.amplitude()
    phase, _ = prepared.stress_fit.phase()
    amplitude = observed * amplitude_factor * (1.0 + normal(fit, 0.0, amplitude_sd)[..., None])
    shift = np.random.default_rng(4).normal(phase_shift, phase_sd, amplitude.shape)
    rng = np.random.default_rng(6)

    def stress_at(time: FloatArray) -> FloatArray:
        angle = prepared.stress_fit.angular_frequency * time + phase + shift
        trend = prepared.stress_fit.trend(time) if prepared.background == "kept" else 0.0
        stress: FloatArray = amplitude * np.sin(angle) + trend
        return stress

    def with_noise(stress: FloatArray) -> FloatArray:
        return stress + noise * rng.normal(size=stress.shape)

    time = FORCED_OSCILLATION.grid(experiment)
    stress = stress_at(time)
    growth = normal(fit, 2.0, 0.3)[..., None]
    predictions = {
        "stress": stress,
        "stress_replicated": with_noise(stress),
        "kelvin_strain": stress / 25e9,
        "grain_size": experiment.initial_grain_size * (1.0 + growth * time / time[-1]),
        "dashpot_rate": 1e-6 * (stress / 100e6) ** 3,
    }
    groups = {name: node.to_dataset() for name, node in fit.posterior.children.items()}
    groups["predictions"] = xr.Dataset(
        {
            name: (("chain", "draw", "time"), values.astype(np.float32))
            for name, values in predictions.items()
        },
        {**groups["posterior"].coords, "time": time},
    )
    dims = ("chain", "draw", "point")
    model = stress_at(prepared.time)
    groups["model_response"] = xr.Dataset({"stress": (dims, model)})
    groups["posterior_predictive"] = xr.Dataset({"stress": (dims, with_noise(model))})
    log_lik = stats.norm.logpdf(experiment.stress, model, noise)
    groups["log_likelihood"] = xr.Dataset({"stress": (dims, log_lik)})
    groups["constant_data"] = xr.Dataset(
        {
            "strain": ("point", prepared.strain(prepared.time)),
            "time": ("point", prepared.time),
        }
    )
    groups["/"] = xr.Dataset(attrs={"protocol": fit.experiment.protocol})
    return replace(fit, posterior=xr.DataTree.from_dict(groups))
