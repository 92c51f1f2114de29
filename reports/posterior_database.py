"""Draws of a fit in the form of posteriordb: posterior, model, data and reference draws."""

import json
import re
import zipfile
from pathlib import Path
from typing import Any

import arviz as az
import numpy as np
import pandas as pd
from common import write_json

from pyburgers import Fit, shipped_folder

COORDINATE = "coordinate"
"""The parameter of the programs: all free parameters on the sampler's scale."""

WANTED = {"draws": 10_000, "chains": 4, "rhat": 1.01, "efmi": 0.2}
"""Limits that posteriordb has for reference draws."""

INCLUDE = re.compile(r"^#include (\S+)$", re.MULTILINE)


def write_posterior(fit: Fit, name: str, out: Path) -> Path:
    """Write the posterior of a fit of one test below a folder, and return the folder.

    The draws are of the vector `coordinate` of the program. The data choose Stan's own solver, so
    that the model needs no other file.
    """
    program = fit.problem.likelihood.program
    model, draws = f"burgers_{program.stem}", chains_of(fit)
    origin, today = fit.provenance, fit.manifest["started"][:10]
    added = {"added_by": "pyburgers", "added_date": today}
    posterior = f"{name}-{model}"
    data = {**fit.directory.read_stan_data(), "solver": 0}
    _zip(out / "data" / "data" / f"{name}.json.zip", data)
    code = out / "models" / "stan" / f"{model}.stan"
    code.parent.mkdir(parents=True, exist_ok=True)
    code.write_text(whole_program(program), encoding="utf-8")
    files: dict[str, dict[str, Any]] = {
        f"data/info/{name}.info.json": {
            "name": name,
            "title": fit.experiment.title,
            "description": f"{origin.source}. Laws: {fit.variant.text}.",
            "urls": f"https://doi.org/{origin.doi}",
            "data_file": f"data/data/{name}.json",
            "keywords": ["ODE", fit.experiment.material],
        },
        f"models/info/{model}.info.json": {
            "name": model,
            "title": "Nonlinear Burgers viscoelasticity",
            "description": "A Maxwell element and a Kelvin element in series, with evolving grain "
            "size and fabric. The data choose laws, priors and coordinates.",
            "keywords": ["ODE", "rheology"],
            "model_implementations": {"stan": {"model_code": f"models/stan/{model}.stan"}},
        },
        f"posteriors/{posterior}.json": {
            "name": posterior,
            "model_name": model,
            "data_name": name,
            "reference_posterior_name": posterior,
            "keywords": ["ODE", "rheology"],
            "dimensions": {COORDINATE: len(draws[0])},
        },
        f"reference_posteriors/draws/info/{posterior}.info.json": _info(fit, posterior, draws),
    }
    for file, about in files.items():
        write_json(out / file, about | added)
    _zip(out / f"reference_posteriors/draws/draws/{posterior}.json.zip", draws)
    return out


def whole_program(program: Path) -> str:
    """Return a program with the text of all files that it includes."""
    folder = shipped_folder("stan")

    def included(match: re.Match[str]) -> str:
        return whole_program(folder / match[1]).rstrip("\n")

    return INCLUDE.sub(included, program.read_text(encoding="utf-8"))


def chains_of(fit: Fit) -> list[dict[str, list[float]]]:
    """Return the draws of each chain of a fit, by parameter: ``coordinate[1]`` on."""
    tables = (
        pd.read_csv(file, comment="#", usecols=lambda name: str(name).startswith(f"{COORDINATE}."))
        for file in fit.directory.draws_files()
    )
    return [
        {f"{COORDINATE}[{k + 1}]": table.iloc[:, k].tolist() for k in range(table.shape[1])}
        for table in tables
    ]


def _info(fit: Fit, posterior: str, chains: list[dict[str, list[float]]]) -> dict[str, Any]:
    """Return how the draws were made, their diagnostics, and which limits they keep."""
    sampler = fit.manifest["sampler"]
    values = {name: np.array([chain[name] for chain in chains]) for name in chains[0]}
    draws = az.convert_to_dataset(values)
    rhat, bulk, tail = (
        [float(found[name]) for name in values]
        for found in (az.rhat(draws), az.ess(draws), az.ess(draws, method="tail"))
    )
    stats = fit.posterior["sample_stats"].to_dataset()
    energy = stats["energy"]
    efmi = (energy.diff("draw") ** 2).mean("draw") / energy.var("draw")
    divergent = stats["diverging"].sum("draw")
    n_chains, n_draws = next(iter(values.values())).shape
    return {
        "name": posterior,
        "inference": {
            "method": "stan_sampling",
            "method_arguments": {
                "chains": n_chains,
                "iter": n_draws + sampler["warmup"],
                "warmup": sampler["warmup"],
                "thin": 1,
                "seed": sampler["seed"],
                "control": {"adapt_delta": sampler["adapt_delta"]},
            },
        },
        "diagnostics": {
            "diagnostic_information": {"names": list(values)},
            "ndraws": n_chains * n_draws,
            "nchains": n_chains,
            "effective_sample_size_bulk": bulk,
            "effective_sample_size_tail": tail,
            "r_hat": rhat,
            "divergent_transitions": divergent.to_numpy().tolist(),
            "expected_fraction_of_missing_information": efmi.to_numpy().tolist(),
        },
        "checks_made": {
            "ndraws_is_10k": n_chains * n_draws == WANTED["draws"],
            "nchains_is_gte_4": n_chains >= WANTED["chains"],
            "r_hat_below_1_01": max(rhat) < WANTED["rhat"],
            "efmi_above_0_2": bool((efmi > WANTED["efmi"]).all()),
        },
        "comments": " ".join(verdict.sentence for verdict in fit.verdicts().values()),
        "versions": fit.manifest["versions"],
    }


def _zip(file: Path, content: object) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(file.stem, json.dumps(content))
