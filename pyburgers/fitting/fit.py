"""Fit an experiment: run, gather, check, and keep it all in a run directory."""

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import pandas as pd

from pyburgers.common.errors import InputError
from pyburgers.fitting.sampled_fit import SampledFit, sample_until_solved, write_tables
from pyburgers.model.priors import PriorSet, load_priors
from pyburgers.model.variants import ModelVariant, variant_of
from pyburgers.posterior.labelled_draws import build_posterior, load_posterior, summary_table
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.registry import load_experiment
from pyburgers.protocols.stan_data import SolverOptions
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.run import run_chains
from pyburgers.sampling.run_directory import RunDirectory


@dataclass(frozen=True, eq=False)
class Fit(SampledFit):
    """A finished fit of one test.

    Attributes
    ----------
    directory, posterior, manifest
        As of every `SampledFit`; groups of the draws:
        `pyburgers.posterior.labelled_draws.build_posterior`.
    experiment : Experiment
        What was fitted.
    priors : PriorSet
        Priors in SI, the noise scale resolved.
    """

    experiment: Experiment
    priors: PriorSet

    @property
    def variant(self) -> ModelVariant:
        """Laws of the model's parts, told from the priors."""
        return variant_of(self.priors, self.experiment)

    def summary(self) -> pd.DataFrame:
        """Posterior table in SI units (`pyburgers.posterior.labelled_draws.summary_table`)."""
        return summary_table(self.posterior, self.priors)

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
    def load(cls, path: str | Path) -> Self:
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
            posterior = build_posterior(run)
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
        Tolerance of the ODE solver while sampling. Where the draws, solved again at the reference
        tolerance, show it too loose (Pareto k), all chains are run again ten times tighter, at
        most `pyburgers.fitting.sampled_fit.MAX_REFITS` times; the manifest notes it.
    use_likelihood : bool
        False samples the prior predictive distribution with the same program.
    command : str
        What regenerates the run, for the manifest.

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
            solver=solver or SolverOptions(),
            use_likelihood=use_likelihood,
            command=command,
        )
        return Fit.load(run.path)

    result = sample_until_solved(sample, run)
    write_tables(result)
    return replace(result, manifest=run.read_manifest())


def is_joint(manifest: Mapping[str, Any]) -> bool:
    """Tell from a manifest whether a run is a joint fit."""
    return "pooling" in manifest
