"""A finished run of chains, whatever was fitted: its checks, its tables, when it is done."""

import logging
import shutil
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, TypeVar, get_args

import pandas as pd
import xarray as xr
from markupsafe import escape

from pyburgers.checks.fit_checks import (
    Check,
    CheckedDraws,
    CheckKind,
    CheckResult,
    Outcome,
    run_checks,
)
from pyburgers.checks.prior_influence import (
    Influence,
    conflict_sentence,
    decision_columns,
    decision_sentences,
)
from pyburgers.checks.verdicts import CHECKS, Verdict, verdicts, verdicts_record
from pyburgers.common.atomic_files import json_text, write_text
from pyburgers.common.csv_tables import csv_text
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path
from pyburgers.common.scratch import scratch_folder
from pyburgers.kinds.experiment import Provenance
from pyburgers.posterior.labelled_draws import arviz_data, in_display_units
from pyburgers.sampling.manifest import COMPLETE, ChainFailure, missing_chains, recorded_modes
from pyburgers.sampling.repetitions import shortened
from pyburgers.sampling.run_directory import RunDirectory

logger = logging.getLogger(__name__)


_Units = Literal["display", "SI"]

A_FIT = "a fit, as of pyburgers.fit or pyburgers.Fit.load"
"""Words for an argument."""

PRIOR_ALONE = "prior alone"
ORIGINS: Mapping[str, str] = MappingProxyType(
    {
        "synthetic": "Synthetic data are behind the draws: they say nothing of nature.",
        PRIOR_ALONE: "The draws are of the prior alone: no data took part.",
    }
)
"""Sentences about draws that no measured data are behind, by a word of `SampledFit.draws_of`."""


@dataclass(frozen=True, eq=False, repr=False)
class SampledFit(ABC):
    """A finished run of chains: a fit of one test, of several, or of tables of rates.

    `directory`: where its files are.
    `posterior`: labelled draws.
    `manifest`: command, seeds, versions, hashes, wall times.
    """

    directory: RunDirectory
    posterior: xr.DataTree
    manifest: dict[str, Any]

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields: the rest is made again, and pickles take no functions of checks."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    @abstractmethod
    def provenance(self) -> Provenance:
        """Where the data of the one test, or the table, come from."""

    @property
    def part_name(self) -> str | None:
        """Name of the test where this is what a joint fit says of one; else None."""
        return None

    def influences(
        self, derived: Mapping[str, FloatArray] = MappingProxyType({})
    ) -> dict[str, dict[str, Influence]]:
        """Return who decides each quantity, by test or table; empty without likelihood.

        Parameters
        ----------
        derived : mapping of str to array, shape (n,)
            Draws of further quantities, chains one after the other.

        Returns
        -------
        dict of str to dict of str to Influence
            By name of the test or table, then of the quantity.

        Examples
        --------
        >>> stiffness = fit.posterior["posterior"]["maxwell_modulus"].to_numpy().ravel()
        >>> of_tests = fit.influences({"compliance": 1 / stiffness})
        """
        if not self.manifest["use_likelihood"]:
            return {}
        return self._influences_on(derived) if derived else self._influences

    @cached_property
    def _influences(self) -> dict[str, dict[str, Influence]]:
        """Those on the parameters, made once: tables, pages and exports ask again and again."""
        return self._influences_on({})

    @abstractmethod
    def _influences_on(self, derived: Mapping[str, FloatArray]) -> dict[str, dict[str, Influence]]:
        """Influences by test or table, and quantity."""

    def decisions(self) -> dict[str, Influence]:
        """Return who decides each row of `summary`.

        Examples
        --------
        >>> sorted(fit.decisions())
        ['activation_enthalpy', 'maxwell_modulus', 'reference_stress', 'stress_noise']
        """
        return self._decisions

    @cached_property
    def _decisions(self) -> dict[str, Influence]:
        """The decisions, made once as well."""
        return {name: one for found in self.influences().values() for name, one in found.items()}

    def prior_conflicts(self) -> tuple[str, ...]:
        """Return a sentence for each test in which prior and data disagree.

        Examples
        --------
        >>> for sentence in fit.prior_conflicts():
        ...     print(sentence)
        """
        said = {name: conflict_sentence(found) for name, found in self.influences().items()}
        return tuple(f"{name}: {text}" for name, text in said.items() if text is not None)

    def prior_decisions(self) -> tuple[str, ...]:
        """Return a sentence for each number that a bound or another quantity's prior decides.

        Others name unlikely priors, and those that were read off the data of the fit.

        Examples
        --------
        >>> sentences = fit.prior_decisions()
        """
        return (*self.prior_doubts, *decision_sentences(self.decisions()))

    @property
    def prior_doubts(self) -> tuple[str, ...]:
        """Sentences about priors that are unlikely.

        Examples
        --------
        >>> sentences = fit.prior_doubts
        """
        return ()

    @abstractmethod
    def si_summary(self) -> pd.DataFrame:
        """Table of the sampled quantities in SI units."""

    def summary(self, units: _Units = "display") -> pd.DataFrame:
        """Table of the sampled quantities.

        Parameters
        ----------
        units : {"display", "SI"}
            GPa, kJ/mol, um and so on, or SI as in ``summary.csv``; the column unit names them.

        Returns
        -------
        DataFrame
            As of `si_summary`, with a likelihood then decided_by
            (`pyburgers.checks.prior_influence.Origin`), by_prior_of (parameters whose priors take
            part) and prior_share (share of all priors in the variance).

        Raises
        ------
        InputError
            If other units are asked for.

        Examples
        --------
        >>> fit.summary().loc["maxwell_modulus", "unit"]
        'GPa'
        """
        if units not in get_args(_Units):
            raise InputError(f"units is {units!r}, expected 'display' or 'SI'.")
        table = self.si_summary()
        if found := self.decisions():
            rows = [decision_columns(found.get(str(name))) for name in table.index]
            table = table.join(pd.DataFrame(rows, index=table.index))
        return table if units == "SI" else in_display_units(table)

    def __repr__(self) -> str:
        """Return a line: of what the fit is, how many draws it has, where; nothing is checked."""
        sizes = self.posterior["posterior"].sizes
        fitted = self.manifest["experiment"]
        name = fitted if self.part_name is None else f"{self.part_name} in {fitted}"
        return (
            f"<{type(self).__name__} of {name}: {sizes['chain']} chains x {sizes['draw']} draws, "
            f"{self.directory.path}>"
        )

    def _repr_html_(self) -> str:
        """Return both verdicts and the table, for notebooks."""
        told = "<br>".join(
            escape(f"{one.kind.value} {one.outcome.value}. {one.sentence}")
            for one in self.verdicts().values()
        )
        table = self.summary().to_html(float_format="{:.4g}".format, na_rep="")
        return f"<p><b>{escape(self.manifest['experiment'])}</b><br>{told}</p>{table}"

    def to_arviz(self, *, prior_draws: int = 500, seed: int = 1) -> Any:
        """Return the draws as an object of ArviZ.

        Parameters
        ----------
        prior_draws : int
            Draws of the prior and the prior predictive; 0 leaves both out. A joint fit and tables
            of rates have none, a joint prior of the flow law has no prior predictive.
        seed : int
            Of these draws.

        Returns
        -------
        InferenceData or DataTree
            Of ArviZ 0.x or 1.x. Groups posterior (sampled quantities, SI), sample_stats,
            log_likelihood, log_prior, posterior_predictive, observed_data, constant_data, prior and
            prior_predictive. Attributes of each quantity: units, symbol, long_name.

        Examples
        --------
        >>> draws = fit.to_arviz(prior_draws=20)
        """
        if prior_draws < 0:
            raise InputError(f"prior_draws: found {prior_draws}, expected at least 0.")
        return arviz_data(self.posterior, self.prior_groups(prior_draws, seed))

    def prior_groups(self, draws: int, seed: int) -> dict[str, xr.Dataset]:
        """Return the groups of the prior of `to_arviz`."""
        return {}

    def save(self, path: str | Path) -> None:
        """Copy the run directory.

        Parameters
        ----------
        path : path
            New folder.

        Raises
        ------
        InputError
            If `path` exists.

        Examples
        --------
        >>> fit.save("kept")
        """
        path = given_path(path)
        if path.exists():
            raise InputError(f"{path}: exists already, expected a new folder.")
        shutil.copytree(self.directory.path, path, ignore=shutil.ignore_patterns(".*"))

    def asked_checks(self) -> Sequence[Check]:
        """Return the checks that are made (`pyburgers.checks.verdicts.CHECKS`).

        Draws of the prior alone describe no data, so they are checked for their sampling.

        Examples
        --------
        >>> names = [check.name for check in fit.asked_checks()]
        """
        fitted = self.manifest["use_likelihood"]
        return [one for one in CHECKS if fitted or one.kind is CheckKind.SAMPLING]

    def checks(self) -> tuple[CheckResult, ...]:
        """Return what the checks found.

        Examples
        --------
        >>> {check.outcome for check in fit.checks()} <= set(pyburgers.Outcome)
        True
        """
        return self._checks

    @cached_property
    def _checks(self) -> tuple[CheckResult, ...]:
        """The checks, made once: verdicts, tables and pages ask for them again and again."""
        return run_checks(self.checked_draws, self.asked_checks())

    def checks_record(self) -> dict[str, Any]:
        """Return verdicts, checks, and what priors do, as ``checks.json`` has them.

        Examples
        --------
        >>> record = fit.checks_record()
        """
        return {
            **verdicts_record(self.checks()),
            "prior_conflicts": list(self.prior_conflicts()),
            "prior_decisions": list(self.prior_decisions()),
        }

    def _usable(self, found: Mapping[str, Influence]) -> dict[str, Influence]:
        """Mark that nothing can be told from draws of no use."""
        usable = not any(one.unusable for one in self.checks())
        return {name: replace(one, usable=usable) for name, one in found.items()}

    def verdicts(self) -> dict[CheckKind, Verdict]:
        """Return both: was the posterior sampled well, does the model describe the data.

        Examples
        --------
        >>> [kind.value for kind in fit.verdicts()]
        ['Was the posterior sampled well?', 'Does the model describe the data?']
        """
        return verdicts(self.checks())

    @property
    def sampled_well(self) -> Outcome:
        """Whether the posterior was sampled well."""
        return self.verdicts()[CheckKind.SAMPLING].outcome

    @property
    def describes_data(self) -> Outcome:
        """Whether the model describes the data."""
        return self.verdicts()[CheckKind.DESCRIPTION].outcome

    @property
    def draws_of(self) -> str:
        """Kinds of the data that the draws were fitted to, joined, or that there were none."""
        return str(self.manifest["data_kind"]) if self.manifest["use_likelihood"] else PRIOR_ALONE

    @property
    def origins(self) -> tuple[str, ...]:
        """Sentences about the draws if no measured data are behind them."""
        return tuple(sentence for kind, sentence in ORIGINS.items() if kind in self.draws_of)

    @property
    def first_chain(self) -> str:
        """Beginning of the hash of the first chain's draws, as the manifest notes it.

        That of ``posterior.nc`` changes whenever the draws are gathered again.
        """
        records = [*self.manifest.get("chains", {}).values()]
        return str(records[0]["sha256"])[:12] if records else "unknown"

    @property
    def which_draws(self) -> str:
        """Sentence for what is made of the draws: how many there are, and of which chains."""
        sizes = self.posterior["posterior"].sizes
        return (
            f"Draws of the fit: {sizes['chain'] * sizes['draw']}; SHA-256 of its first chain: "
            f"{self.first_chain}."
        )

    @property
    def cautions(self) -> tuple[str, ...]:
        """Sentences on data that are synthetic or took no part, verdicts but a yes, odd priors."""
        found = self.verdicts().values()
        return (
            *self.origins,
            *(one.sentence for one in found if one.outcome is not Outcome.YES),
            *(f"Priors: {one}" for one in self.prior_doubts),
        )

    @property
    def checked_draws(self) -> CheckedDraws:
        """What the checks look at."""
        limit = self.manifest["sampler"]["max_treedepth"]
        before = tuple(one["divergences"] for one in shortened(self.manifest))
        modes = recorded_modes(self.manifest, self.part_name)
        return CheckedDraws(self.posterior, self.missing_chains(), limit, before, modes)

    def missing_chains(self) -> tuple[ChainFailure, ...]:
        """Return the chains that were asked for and are not there, and why.

        Examples
        --------
        >>> fit.missing_chains()
        ()
        """
        return missing_chains(
            self.posterior["posterior"]["chain"].to_numpy().tolist(), self.manifest
        )


def require_whole(one: SampledFit) -> None:
    """Refuse the result of a joint fit for one test: its draws know all tests."""
    if one.part_name is not None:
        raise InputError(
            f"{one.directory.path}: found what a joint fit says of {one.part_name}, expected the "
            "whole joint fit."
        )


FitT = TypeVar("FitT", bound=SampledFit)


def in_passing(fit_in: Callable[[Path], FitT]) -> FitT:
    """Fit in a temporary folder, which is removed when nothing needs the run directory."""
    with ExitStack() as folders:
        result = fit_in(folders.enter_context(scratch_folder()) / "run")
        weakref.finalize(result.directory, folders.pop_all().close)
    return result


def data_words(name: str, provenance: Provenance) -> str:
    """Return what says which data were fitted (`PriorSet.read_off`)."""
    return f"{name} {provenance.source} {provenance.doi}"


def write_tables(result: SampledFit) -> None:
    """Save the table and the verdicts, and note in the manifest that the run is complete."""
    run = result.directory
    for file, text in _tables(result).items():
        write_text(file, text)
    if not result.missing_chains():
        run.update_manifest({"status": COMPLETE})


DIFFERENT, MISSING = "differs from what the installed versions compute", "is missing"
"""Why a table is written again."""


def renew_tables(result: SampledFit) -> dict[str, str]:
    """Write the tables of a run again where the files hold others; return names, and why.

    No hash is noted of them: they follow from the draws, and nothing reads them but people.
    """
    renewed = {}
    for file, text in _tables(result).items():
        if file.is_file():
            why = "" if file.read_bytes() == text.encode() else DIFFERENT
        else:  # what a run that is not complete has not written yet is left to it
            why = MISSING if result.manifest["status"] == COMPLETE else ""
        if why:
            write_text(file, text)
            renewed[file.name] = why
    return renewed


def _tables(result: SampledFit) -> dict[Path, str]:
    """Return what is saved of a run for its readers, by file."""
    run = result.directory
    return {
        run.summary_file: csv_text(result.summary("SI"), index=True),
        run.checks_file: json_text(result.checks_record()),
    }
