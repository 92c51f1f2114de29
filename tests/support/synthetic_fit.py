"""A made-up fit for tests of what comes after sampling: no Stan, random numbers, real classes."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import xarray as xr
from independent_table import TRUTHS

from pyburgers.common.array_types import FloatArray
from pyburgers.common.atomic_files import write_json
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, RateSegment
from pyburgers.kinds.constant_rate.likelihood import LIKELIHOOD as CONSTANT_RATE
from pyburgers.kinds.experiment import DataKind, Experiment, Provenance
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.stan_data import REFERENCE_STRESS
from pyburgers.model.parameters import PARAMETER_BY_NAME, PARAMETERS
from pyburgers.model.pooling import SEPARATE
from pyburgers.model.prior_families import Family, Prior
from pyburgers.model.priors import PriorSet, default_priors
from pyburgers.sampling.run_directory import RunDirectory

TRUTH = MappingProxyType({p.name: TRUTHS["fast"][p.name] for p in PARAMETERS})
SPREAD: Mapping[str, float] = MappingProxyType(
    {
        "maxwell_modulus": 0.3e9,
        "kelvin_modulus": 4e7,
        "kelvin_viscosity": 4e9,
        "stress_exponent": 0.3,
        "grain_size_exponent": 0.15,
        "activation_enthalpy": 1.5e3,
        "beta": 1e-6,
        "steady_state_grain_size": 40e-6,
        "steady_state_fabric_factor": 0.1,
        "critical_strain_grain_size": 0.02,
        "critical_strain_fabric": 0.1,
        "stress_noise": 8e3,
    }
)
FEW = (
    "maxwell_modulus",
    "kelvin_viscosity",
    "activation_enthalpy",
    "beta",
    "steady_state_fabric_factor",
    "critical_strain_fabric",
)
"""Parameters to fix, so that few are left to draw."""
INITIAL_GRAIN_SIZE = 230e-6
REFERENCE = 9.2e6


def make_prior(
    parameter: str,
    family: Family,
    location: float,
    scale: float,
    lower: float = -np.inf,
    upper: float = np.inf,
) -> Prior:
    unit = PARAMETER_BY_NAME[parameter].si_unit
    return Prior(parameter, family, location, scale, lower, upper, unit, "test")


def uniform(parameter: str, lower: float, upper: float) -> Prior:
    location, scale = 0.5 * (lower + upper), 0.5 * (upper - lower)
    return make_prior(parameter, "uniform", location, scale, lower, upper)


def make_priors(fixed: tuple[str, ...] = ()) -> PriorSet:
    """Priors like those of ice; the parameters named in `fixed` have their true value."""
    ice = default_priors("ice").resolved(8e6)
    priors = {
        name: make_prior(name, "fixed", TRUTH[name], 0.0)
        if name in fixed
        else make_prior(name, own.family, own.location, own.scale, own.lower, own.upper)
        for name, own in ice.priors.items()
    }
    return PriorSet("ice", "test priors", MappingProxyType(priors), "test")


def _curve(strain: FloatArray, reference: FloatArray, final: FloatArray) -> FloatArray:
    """Something that rises, peaks and weakens; shape (..., n_strains), Pa."""
    softening = final[..., None] + (1 - final[..., None]) * np.exp(-strain / 0.08)
    return reference[..., None] * softening * (1.0 - np.exp(-strain / 0.008))


def make_experiment(
    name: str,
    kind: DataKind,
    segments: tuple[tuple[float, float], ...],
    rng: np.random.Generator,
    **changes: Any,
) -> ConstantRateExperiment:
    strain = np.concatenate([np.linspace(0.0005, 0.04, 30), np.linspace(0.045, 0.2, 30)])
    clean = _curve(strain, np.array(REFERENCE), np.array(0.5))
    values: dict[str, Any] = {
        "id": name,
        "material": "ice",
        "temperature": 260.0,
        "initial_grain_size": INITIAL_GRAIN_SIZE,
        "segments": tuple(RateSegment(*segment) for segment in segments),
        "strain": strain,
        "stress": clean + rng.normal(0.0, TRUTH["stress_noise"], strain.size),
        "final_strain": 0.2,
        "provenance": Provenance(kind, "made up for a test", doi="10.1234/abc", licence="CC0"),
        "metadata": MappingProxyType({"operator": "nobody"}),
        "notices": ("3 points were sorted.",),
        "true_parameters": TRUTH if kind == "synthetic" else None,
    }
    return ConstantRateExperiment(**{**values, **changes})


def make_fit(
    path: Path,
    *,
    name: str = "PIL40",
    kind: DataKind = "synthetic",
    chains: int = 4,
    draws: int = 250,
    segments: tuple[tuple[float, float], ...] = ((0.0, 1.69e-4),),
    fixed: tuple[str, ...] = (),
    divergences: int = 0,
    apart: float = 0.0,
    stuck_chain: bool = False,
    command: str = "pyburgers fit PIL40.toml --out runs/PIL40",
    seed: int = 1,
    **changes: Any,
) -> Fit:
    """Make a fit with the groups of `pyburgers.posterior.build.build_posterior`.

    Of the run directory, only its manifest is written. `name`, `kind`, `segments` and `changes` are
    those of the experiment, `fixed` parameters that are not inferred. The first draws of the first
    chain diverged, which lies standard deviations `apart` from the others; a stuck last chain never
    moved.
    """
    rng = np.random.default_rng(seed)
    experiment = make_experiment(name, kind, segments, rng, **changes)
    priors = make_priors(fixed)
    posterior = _posterior(priors, (chains, draws), rng, apart, stuck_chain)
    at_points, on_grid = experiment.strain, CONSTANT_RATE.grid(experiment)
    reference, final = posterior[REFERENCE_STRESS].to_numpy(), _final(posterior)
    noise = posterior["stress_noise"].to_numpy()[..., None]
    model = _curve(at_points, reference, final)
    grid = _curve(on_grid, reference, final)
    dims, grid_dims = ("chain", "draw", "point"), ("chain", "draw", "strain")
    log_lik = -0.5 * ((experiment.stress - model) / noise) ** 2 - np.log(noise)
    grain_size, fabric = (_relaxation(posterior, k, on_grid) for k in (0, 1))
    exponent = posterior["grain_size_exponent"] / posterior["stress_exponent"]
    by_grains = (grain_size / INITIAL_GRAIN_SIZE) ** exponent.to_numpy()[..., None]
    predictions = {
        "stress": grid,
        "stress_replicated": grid + noise * rng.normal(size=grid.shape),
        "kelvin_strain": grid / TRUTH["kelvin_modulus"],
        "grain_size": grain_size,
        "fabric_factor": fabric,
        "grain_size_softening": by_grains,
        "fabric_softening": fabric,
    }
    diverging = np.zeros((chains, draws), dtype=bool)
    diverging[0, :divergences] = True
    shape = (chains, draws)
    stats = {
        "lp": rng.normal(size=shape),
        "acceptance_rate": rng.uniform(0.8, 1.0, shape),
        "step_size": np.broadcast_to(rng.uniform(0.1, 0.2, (chains, 1)), shape),
        "tree_depth": rng.integers(3, 6, shape),
        "n_steps": rng.integers(7, 63, shape),
        "diverging": diverging,
        "energy": rng.normal(size=shape),
        "solver_log_ratio": 1e-4 * rng.normal(size=shape),
    }
    points = {"point": np.arange(at_points.size)}
    smooth = CONSTANT_RATE.output_grid(experiment)
    tree = xr.DataTree.from_dict(
        {
            "posterior": posterior,
            "sample_stats": xr.Dataset(
                {key: (("chain", "draw"), value) for key, value in stats.items()},
                coords=dict(posterior.coords),
            ),
            "log_likelihood": xr.Dataset({"stress": (dims, log_lik)}, coords=points),
            "log_prior": xr.Dataset({"lprior": (("chain", "draw"), np.zeros(shape))}),
            "model_response": xr.Dataset({"stress": (dims, model)}, coords=points),
            "posterior_predictive": xr.Dataset(
                {"stress": (dims, model + noise * rng.normal(size=model.shape))}, coords=points
            ),
            "predictions": xr.Dataset(
                {key: (grid_dims, value.astype(np.float32)) for key, value in predictions.items()},
                coords={**posterior.coords, "strain": on_grid},
            ),
            "posterior_mean_solution": xr.Dataset(
                {"stress": ("strain", _curve(smooth, reference.mean(), final.mean()))},
                coords={"strain": smooth},
            ),
            "observed_data": xr.Dataset({"stress": ("point", experiment.stress)}, coords=points),
            "constant_data": xr.Dataset({"strain": ("point", at_points)}, coords=points),
        }
    )
    tree.attrs = {
        "experiment": name,
        "data_kind": kind,
        "chains": json.dumps([*range(1, chains + 1)]),
        "protocol": experiment.protocol,
    }
    manifest = _manifest(experiment, command, chains, draws, seed)
    path.mkdir(parents=True, exist_ok=True)
    run = RunDirectory(path)
    write_json(run.manifest_file, manifest)
    return Fit(run, tree, manifest, problem_of([experiment], priors))


def with_problem(fit: Fit, experiment: Experiment, priors: PriorSet) -> Fit:
    """Exchange what a fit is of."""
    return replace(fit, problem=problem_of([experiment], priors))


def _posterior(
    priors: PriorSet,
    shape: tuple[int, int],
    rng: np.random.Generator,
    apart: float,
    stuck_chain: bool,
) -> xr.Dataset:
    """Draws around the truth, reflected into the bounds of the priors."""
    values = {name: TRUTH[name] + SPREAD[name] * rng.normal(size=shape) for name in TRUTH}
    values[REFERENCE_STRESS] = REFERENCE + 5e4 * rng.normal(size=shape)
    for name, prior in priors.priors.items():
        values[name][0] += apart * SPREAD[name]
        values[name] = _folded(values[name], prior.lower, prior.upper)
        if prior.is_fixed:
            values[name] = np.full(shape, prior.location)
    if stuck_chain:
        for name in values:
            values[name][-1] = values[name][-1, 0]
    dataset = xr.Dataset(
        {name: (("chain", "draw"), value) for name, value in values.items()},
        coords={"chain": np.arange(1, shape[0] + 1), "draw": np.arange(shape[1])},
    )
    units = {**{p.name: p.si_unit for p in PARAMETERS}, REFERENCE_STRESS: "Pa"}
    for name, unit in units.items():
        is_fixed = name in priors.priors and priors[name].is_fixed
        dataset[name].attrs = {"units": unit, "fixed": int(is_fixed)}
    return dataset


def _folded(values: FloatArray, lower: float, upper: float) -> FloatArray:
    """Reflect values at the bounds until they lie inside."""
    inside = values if np.isinf(lower) else lower + np.abs(values - lower)
    if np.isfinite(upper):
        width = upper - lower
        inside = lower + width - np.abs((inside - lower) % (2 * width) - width)
    return inside


def _final(posterior: xr.Dataset) -> FloatArray:
    """A level of the final stress for each draw, shape (chains, draws)."""
    fabric: FloatArray = posterior["steady_state_fabric_factor"].to_numpy()
    return 0.5 + 0.05 * (fabric - TRUTH["steady_state_fabric_factor"])


def _relaxation(posterior: xr.Dataset, which: Literal[0, 1], strain: FloatArray) -> FloatArray:
    """Grain size (0) or fabric factor (1) along strain."""
    steady, critical, start = (
        ("steady_state_grain_size", "critical_strain_grain_size", INITIAL_GRAIN_SIZE),
        ("steady_state_fabric_factor", "critical_strain_fabric", 1.0),
    )[which]
    end = posterior[steady].to_numpy()[..., None]
    scale = posterior[critical].to_numpy()[..., None]
    values: FloatArray = end + (start - end) * np.exp(-strain / scale)
    return values


def _manifest(
    experiment: ConstantRateExperiment, command: str, chains: int, draws: int, seed: int
) -> dict[str, Any]:
    return {
        "fingerprint": "f" * 64,
        "experiment": experiment.id,
        "experiments": [experiment.id],
        "pooling": SEPARATE.record(),
        "data_kind": experiment.provenance.kind,
        "command": command,
        "started": "2025-01-01T00:00:00+00:00",
        "status": "complete",
        "sampler": {
            "chains": chains,
            "warmup": 500,
            "draws": draws,
            "seed": seed,
            "adapt_delta": 0.9,
            "max_treedepth": 12,
            "chain_timeout": None,
        },
        "coordinates": {"system": "plain", "reason": "asked for"},
        "solver": {"tolerance": 1e-6, "max_num_steps": 20000, "method": "bdf"},
        "use_likelihood": True,
        "versions": {"python": "3.11", "cmdstan": "2.27.0", "compiler": "g++ 12"},
        "hashes": {"inputs/experiment.toml": "a" * 64, "stan_data.json": "b" * 64},
        "failures": [],
        "chains": {
            str(chain): {"wall_seconds": 60.0 + chain, "sha256": "c" * 64}
            for chain in range(1, chains + 1)
        },
    }
