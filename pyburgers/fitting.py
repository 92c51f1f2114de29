"""Fit an experiment: run, gather, check, and keep it all in a run directory."""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, Self, TypeVar

import pandas as pd
import xarray as xr

from pyburgers.diagnostics import CheckResult, check_fit, check_solver, checks_record
from pyburgers.errors import InputError
from pyburgers.experiment import Experiment
from pyburgers.experiment_files import load_experiment
from pyburgers.posterior import build_posterior, load_posterior, summary_table
from pyburgers.priors import PriorSet, load_priors
from pyburgers.reporting import silent
from pyburgers.run_directory import RunDirectory, write_json, write_text
from pyburgers.sampling import (
    ChainFailure,
    SamplerOptions,
    missing_chains,
    run_chains,
    tighten_solver,
)
from pyburgers.stan_data import SolverOptions, default_solver
from pyburgers.variants import ModelVariant, variant_of

MAX_REFITS = 2
"""Times that a run is repeated at a tighter tolerance of the solver."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A finished fit.

    Attributes
    ----------
    directory : RunDirectory
        Where its files are.
    experiment : Experiment
        What was fitted.
    priors : PriorSet
        Priors in SI, the noise scale resolved.
    posterior : DataTree
        Labelled draws (groups and units: `pyburgers.posterior.build_posterior`).
    manifest : dict
        Command, seeds, versions, hashes, wall times.
    """

    directory: RunDirectory
    experiment: Experiment
    priors: PriorSet
    posterior: xr.DataTree
    manifest: dict[str, Any]

    @property
    def variant(self) -> ModelVariant:
        """Laws of the model's parts, told from the priors."""
        return variant_of(self.priors, self.experiment)

    def summary(self) -> pd.DataFrame:
        """Posterior table in SI units (`pyburgers.posterior.summary_table`)."""
        return summary_table(self.posterior, self.priors)

    def checks(self) -> tuple[CheckResult, ...]:
        """Return the checks with their verdicts (`pyburgers.diagnostics.check_fit`)."""
        return check_fit(
            self.posterior, self.missing_chains(), self.manifest["sampler"]["max_treedepth"]
        )

    def missing_chains(self) -> tuple[ChainFailure, ...]:
        """Return the chains that were asked for and are not there, and why."""
        return missing_chains(
            self.posterior["posterior"]["chain"].to_numpy().tolist(), self.manifest
        )

    def save(self, path: str | Path) -> None:
        """Copy the run directory.

        Raises
        ------
        InputError
            If `path` exists.
        """
        path = Path(path)
        if path.exists():
            raise InputError(f"{path}: exists already, expected a new folder.")
        shutil.copytree(self.directory.path, path, ignore=shutil.ignore_patterns(".*"))

    @classmethod
    def load(cls, path: str | Path, *, report: Callable[[str], None] = silent) -> Self:
        """Read a run directory.

        Raises
        ------
        InputError
            If it is not a run of one test or has no finished chain.
        """
        run = RunDirectory(Path(path))
        manifest = run.read_manifest()
        if is_joint(manifest):
            raise InputError(f"{path}: is a joint fit, expected a fit of one test.")
        run.require_a_chain()
        posterior = load_posterior(run)
        if posterior is None:
            posterior = build_posterior(run, report=report)
        return cls(
            directory=run,
            experiment=load_experiment(run.experiment_file),
            priors=load_priors(run.priors_file),
            posterior=posterior,
            # A killed process did not note the chains that it had finished.
            manifest={**manifest, "chains": run.chain_records()},
        )


def fit(
    experiment: Experiment,
    priors: PriorSet,
    *,
    out: str | Path,
    options: SamplerOptions | None = None,
    solver: SolverOptions | None = None,
    use_likelihood: bool = True,
    command: str = "pyburgers.fit(...)",
    report: Callable[[str], None] = silent,
) -> Fit:
    """Fit the nonlinear Burgers model to an experiment.

    Parameters
    ----------
    experiment : Experiment
        A test with data (`pyburgers.load_experiment`).
    priors : PriorSet
        Priors of every parameter (`pyburgers.load_priors`); they decide which variant of the model
        is fitted (`pyburgers.with_variant`).
    out : path
        Run directory. An earlier run with the same inputs there is continued: only missing
        chains are run.
    options : SamplerOptions, optional
        Chains, iterations, seed.
    solver : SolverOptions, optional
        Tolerance of the ODE solver while sampling, by default that of
        `pyburgers.stan_data.default_solver`. Where the draws, solved again at the reference
        tolerance, show it too loose (Pareto k), all chains are run again ten times tighter, at
        most `MAX_REFITS` times; the manifest notes it.
    use_likelihood : bool
        False samples the prior predictive distribution with the same program.
    command : str
        What regenerates the run, for the manifest.
    report : callable
        Receives progress sentences.

    Returns
    -------
    Fit
        Draws, table and checks. Chains that failed are named by the check "chains".

    Raises
    ------
    InputError
        If an input is wrong or `out` holds something else.
    SamplingError
        If no chain finished.
    """
    run = RunDirectory(Path(out))

    def sample() -> Fit:
        run_chains(
            experiment,
            priors,
            run.path,
            options=options or SamplerOptions(),
            solver=solver or default_solver(experiment),
            use_likelihood=use_likelihood,
            command=command,
            report=report,
        )
        return Fit.load(run.path, report=report)

    result = sample_until_solved(sample, run, report)
    write_tables(result)
    return replace(result, manifest=run.read_manifest())


def is_joint(manifest: Mapping[str, Any]) -> bool:
    """Tell from a manifest whether a run is a joint fit."""
    return "pooling" in manifest


class SampledFit(Protocol):
    """What fits of one and of several tests have in common."""

    @property
    def directory(self) -> RunDirectory:
        """Where its files are."""

    @property
    def posterior(self) -> xr.DataTree:
        """Labelled draws."""

    @property
    def manifest(self) -> dict[str, Any]:
        """Command, seeds, versions, hashes, wall times."""

    def summary(self) -> pd.DataFrame:
        """Posterior table in SI units."""

    def checks(self) -> tuple[CheckResult, ...]:
        """Return the checks with their verdicts."""

    def missing_chains(self) -> tuple[ChainFailure, ...]:
        """Return the chains that were asked for and are not there, and why."""


AnyFit = TypeVar("AnyFit", bound=SampledFit)


def sample_until_solved(
    sample: Callable[[], AnyFit], run: RunDirectory, report: Callable[[str], None]
) -> AnyFit:
    """Sample, and again at a tighter tolerance of the solver where its check fails.

    Parameters
    ----------
    sample : callable
        Runs missing chains and loads the fit.
    run : RunDirectory
        Where they are.
    report : callable
        Receives progress sentences.
    """
    while True:
        result = sample()
        verdict = check_solver(result.posterior)
        n_refits = len(result.manifest["refits"])
        if verdict.passed or n_refits == MAX_REFITS or result.missing_chains():
            return result
        tight = tighten_solver(run, float(verdict.table["pareto_k"].iloc[0]))
        report(f"{verdict.sentence} Sampling all chains again at a tolerance of {tight:g}.")


def write_tables(result: SampledFit) -> None:
    """Save the table and the verdicts, and note in the manifest that the run is complete."""
    run = result.directory
    write_text(run.summary_file, result.summary().to_csv())
    write_json(run.checks_file, checks_record(result.checks()))
    if not result.missing_chains():
        run.update_manifest({"status": "complete"})
