"""What a manifest says of how its folder came about."""

import platform
from collections.abc import Iterable
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pyburgers.cmdstan.toolchain import find_cmdstan, toolchain
from pyburgers.common.atomic_files import sha256_of_file
from pyburgers.model.variants import variant_of
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.problem import Problem
from pyburgers.sampling.run_directory import RunDirectory

PACKAGES = ("pyburgers", "cmdstanpy", "arviz", "numpy", "scipy", "pandas", "xarray")


def problem_record(problem: Problem) -> dict[str, Any]:
    """Note what is fitted: tests, pooling, variant of the model, another source of the flow law."""
    priors = problem.given_priors
    return {
        "experiments": [experiment.id for experiment in problem.experiments],
        "pooling": problem.pooling.record(),
        "variant": variant_of(problem.priors[0], problem.experiments[0]).record(),
        "priors_from": None if priors.flow_law is None else priors.flow_law.source,
    }


def run_record(
    run: RunDirectory,
    *,
    name: str,
    data_kind: str,
    options: SamplerOptions,
    identity: str,
    use_likelihood: bool,
    command: str,
) -> dict[str, Any]:
    """Note what will run: command, settings, versions, hashes of the inputs.

    Parameters
    ----------
    run : RunDirectory
        With its inputs and Stan data.
    name, data_kind : str
        Experiment or table, and the kind of its provenance.
    options : SamplerOptions
        Settled settings.
    identity : str
        `fingerprint` of the run.
    use_likelihood : bool
        Whether data take part.
    command : str
        What regenerates the run.

    Returns
    -------
    dict
        Entries of the manifest.
    """
    return {
        "fingerprint": identity,
        "experiment": name,
        "data_kind": data_kind,
        **origin_record(run, command, (*files_in(run.inputs), run.stan_data_file)),
        "failures": [],
        "sampler": asdict(options),
        "use_likelihood": use_likelihood,
    }


def origin_record(run: RunDirectory, command: str, inputs: Iterable[Path]) -> dict[str, Any]:
    """Note what regenerates a folder: command, versions, hashes of the inputs; and that it runs.

    Parameters
    ----------
    run : RunDirectory
        The folder.
    command : str
        What regenerates it.
    inputs : iterable of Path
        Files in it.
    """
    return {
        "command": command,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "status": "sampling",
        "versions": software_versions(),
        "hashes": {file.relative_to(run.path).as_posix(): sha256_of_file(file) for file in inputs},
    }


def files_in(folder: Path) -> list[Path]:
    """Return all files below a folder, in order."""
    return sorted(file for file in folder.rglob("*") if file.is_file())


def software_versions() -> dict[str, str | None]:
    """Return the versions of what makes the draws, for manifests."""
    found = find_cmdstan()
    tools = toolchain(found) if found is not None else None
    return {
        "python": platform.python_version(),
        **{package: version(package) for package in PACKAGES},
        "cmdstan": tools.cmdstan_version if tools else None,
        "compiler": tools.compiler if tools else None,
    }
