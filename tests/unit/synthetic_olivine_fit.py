"""A made-up fit of the olivine twin, and ways to change the draws of any made-up fit."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from synthetic_fit import make_fit

from pyburgers.fitting import Fit
from pyburgers.forced_oscillation import load_forced_oscillation, with_background
from pyburgers.oscillation import Background
from pyburgers.parameters import PARAMETERS
from pyburgers.priors import default_priors

FloatArray = npt.NDArray[np.float64]

OLIVINE = Path(__file__).parents[2] / "data" / "olivine" / "olivine_twin.toml"


def make_olivine_fit(path: Path, background: Background = "removed") -> Fit:
    """Make a fit with normal draws about the truth and predicted stresses that hardly vary.

    Parameters
    ----------
    path : Path
        Run directory; only its manifest is written.
    background : {"removed", "kept"}
        Treatment of the record, part of the name of the experiment.
    """
    experiment = with_background(load_forced_oscillation(OLIVINE), background)
    assert experiment.true_parameters is not None
    made = make_fit(path, draws=250, name=f"olivine_{background}")
    priors = default_priors("olivine").resolved(float(np.abs(experiment.stress).max()))
    draws = made.posterior["posterior"].to_dataset()
    rng = np.random.default_rng(2)
    for name in (parameter.name for parameter in PARAMETERS):
        prior = priors[name]
        spread = 0.0 if prior.is_fixed else 0.1 * float(prior.distribution().std())
        truth = experiment.true_parameters[name]
        draws[name] = draws[name].copy(data=rng.normal(truth, spread, draws[name].shape))
        draws[name].attrs["fixed"] = int(prior.is_fixed)
    changes: dict[str, Any] = {
        "experiment": replace(experiment, id=f"olivine_{background}"),
        "priors": priors,
        "posterior": xr.DataTree.from_dict({"posterior": draws}),
    }
    return oscillating(replace(made, **changes), amplitude_sd=0.01, phase_sd=0.01)


def redrawn(fit: Fit, **draws: FloatArray) -> Fit:
    """Exchange the draws of some parameters."""
    posterior = fit.posterior["posterior"].to_dataset()
    changed = {name: posterior[name].copy(data=values) for name, values in draws.items()}
    groups = {name: node.to_dataset() for name, node in fit.posterior.children.items()}
    groups["posterior"] = posterior.assign(changed)
    return replace(fit, posterior=xr.DataTree.from_dict(groups))


def normal(fit: Fit, mean: float, sd: float) -> FloatArray:
    """Draws of a normal distribution in the shape of a fit's."""
    shape = tuple(fit.posterior["posterior"].sizes[name] for name in ("chain", "draw"))
    return np.random.default_rng(3).normal(mean, sd, shape)


def oscillating(fit: Fit, *, amplitude_sd: float, phase_sd: float) -> Fit:
    """Give a fit of an oscillation predicted stresses whose amplitude and phase scatter."""
    period = load_forced_oscillation(OLIVINE).prepared.period
    time = np.linspace(0.0, 8 * period, 200)
    amplitude = normal(fit, 55e6, 55e6 * amplitude_sd)[..., None]
    phase = np.random.default_rng(4).normal(3.1, phase_sd, amplitude.shape)
    angle = 2 * np.pi * time / period + phase
    stress = 150e6 + 1e3 * time + amplitude * np.sin(angle) + 2e6 * np.sin(2 * angle)
    predictions = xr.Dataset({"stress": (("chain", "draw", "time"), stress)}, {"time": time})
    groups = {name: node.to_dataset() for name, node in fit.posterior.children.items()}
    return replace(fit, posterior=xr.DataTree.from_dict({**groups, "predictions": predictions}))
