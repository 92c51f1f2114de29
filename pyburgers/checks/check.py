"""What a check is: an object that looks at draws and gives a verdict with its reasons."""

import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple

import pandas as pd
import xarray as xr

from pyburgers.sampling.chains import ChainFailure


class CheckKind(Enum):
    """What a check asks."""

    SAMPLING = "can the draws be trusted"
    DESCRIPTION = "does the model describe the data"


@dataclass(frozen=True, eq=False)
class CheckedDraws:
    """What checks look at.

    Attributes
    ----------
    posterior : DataTree
        Labelled draws (`pyburgers.posterior.labelled_draws.build_posterior`).
    failures : tuple of ChainFailure
        Chains that did not finish.
    max_treedepth : int
        The sampler's limit.
    """

    posterior: xr.DataTree
    failures: tuple[ChainFailure, ...] = ()
    max_treedepth: int = 10


class Finding(NamedTuple):
    """What a check found: verdict, the numbers behind it, what they mean, and what to do.

    The meaning is a sentence for a non-specialist, without full stop where a remedy follows.
    """

    passed: bool
    table: pd.DataFrame
    meaning: str
    remedy: str = ""


@dataclass(frozen=True, eq=False)
class Check:
    """A check; called with draws it gives its result.

    Attributes
    ----------
    name : str
        Short name for people.
    kind : CheckKind
        What it asks.
    find : callable
        Looks at draws.
    """

    name: str
    kind: CheckKind
    find: Callable[[CheckedDraws], Finding]

    def __call__(self, draws: CheckedDraws) -> "CheckResult":
        """Look at draws."""
        return CheckResult(self, *self.find(draws))


@dataclass(frozen=True, eq=False)
class CheckResult:
    """What a check found: the check, and the parts of its `Finding`."""

    check: Check
    passed: bool
    table: pd.DataFrame
    meaning: str
    remedy: str = ""

    @property
    def name(self) -> str:
        """Name of the check."""
        return self.check.name

    @property
    def sentence(self) -> str:
        """What it means and, where it failed, the usual remedy."""
        return f"{self.meaning}; {self.remedy}." if self.remedy else self.meaning


def check(name: str, kind: CheckKind) -> Callable[[Callable[[CheckedDraws], Finding]], Check]:
    """Make a check of the function that looks at the draws."""
    return lambda find: Check(name, kind, find)


def checks_record(results: Iterable[CheckResult]) -> list[dict[str, Any]]:
    """Return checks with their numbers as what a JSON file holds."""
    return [
        {
            "name": result.name,
            "passed": result.passed,
            "sentence": result.sentence,
            "table": json.loads(result.table.reset_index().to_json(orient="records")),
        }
        for result in results
    ]
