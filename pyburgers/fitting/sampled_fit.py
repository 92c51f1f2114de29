"""What all finished runs have in common: files, draws, verdicts, tables, a tighter solver."""

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import pandas as pd
import xarray as xr

from pyburgers.checks.fit_checks import (
    CheckedDraws,
    CheckKind,
    CheckResult,
    check_solver,
    checks_record,
    run_checks,
)
from pyburgers.checks.registry import CHECKS
from pyburgers.common.atomic_files import write_json, write_text
from pyburgers.sampling.chains import ChainFailure, missing_chains
from pyburgers.sampling.run import tighten_solver
from pyburgers.sampling.run_directory import RunDirectory

logger = logging.getLogger(__name__)

MAX_REFITS = 2
"""Times that a run is repeated at a tighter tolerance of the solver."""


@dataclass(frozen=True, eq=False)
class SampledFit(ABC):
    """A finished run of chains: a fit of one test, of several, or of a table of peak stresses.

    Attributes
    ----------
    directory : RunDirectory
        Where its files are.
    posterior : DataTree
        Labelled draws.
    manifest : dict
        Command, seeds, versions, hashes, wall times.
    """

    directory: RunDirectory
    posterior: xr.DataTree
    manifest: dict[str, Any]

    @abstractmethod
    def summary(self) -> pd.DataFrame:
        """Table of the sampled quantities in SI units."""

    def checks(self) -> tuple[CheckResult, ...]:
        """Return the checks with their verdicts (`pyburgers.checks.registry.CHECKS`).

        Draws of the prior alone describe no data, so they are checked for their sampling.
        """
        fitted = self.manifest["use_likelihood"]
        asked = [one for one in CHECKS if fitted or one.kind is CheckKind.SAMPLING]
        return run_checks(self.checked_draws, asked)

    @property
    def checked_draws(self) -> CheckedDraws:
        """What the checks look at."""
        limit = self.manifest["sampler"]["max_treedepth"]
        return CheckedDraws(self.posterior, self.missing_chains(), limit)

    def missing_chains(self) -> tuple[ChainFailure, ...]:
        """Return the chains that were asked for and are not there, and why."""
        return missing_chains(
            self.posterior["posterior"]["chain"].to_numpy().tolist(), self.manifest
        )


AnyFit = TypeVar("AnyFit", bound=SampledFit)


def sample_until_solved(sample: Callable[[], AnyFit], run: RunDirectory) -> AnyFit:
    """Sample, and again at a tighter tolerance of the solver where its check fails.

    Parameters
    ----------
    sample : callable
        Runs missing chains and loads the fit.
    run : RunDirectory
        Where they are.
    """
    while True:
        result = sample()
        verdict = check_solver(result.checked_draws)
        n_refits = len(result.manifest["refits"])
        if verdict.passed or n_refits == MAX_REFITS or result.missing_chains():
            return result
        tight = tighten_solver(run, float(verdict.table["pareto_k"].iloc[0]))
        logger.info(f"{verdict.sentence} Sampling all chains again at a tolerance of {tight:g}.")


def write_tables(result: SampledFit) -> None:
    """Save the table and the verdicts, and note in the manifest that the run is complete."""
    run = result.directory
    write_text(run.summary_file, result.summary().to_csv())
    write_json(run.checks_file, checks_record(result.checks()))
    if not result.missing_chains():
        run.update_manifest({"status": "complete"})
