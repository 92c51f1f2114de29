"""What a file of a kind of test is: how it is read, written and simulated; and every kind.

To add a kind: a folder with the modules ``files`` (``KIND``, a `Kind`), ``likelihood``
(``LIKELIHOOD``, `pyburgers.kinds.likelihood.Likelihood`) and ``new_file`` (``NEW_FILE``,
`pyburgers.kinds.new_file.NewFile`), and its name in `pyburgers.kinds.likelihood.NAMES`.
"""

import typing
from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, Generic

import numpy as np
import pandas as pd
import xarray as xr
from pydantic import ConfigDict, Field

from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.common.atomic_files import write_text
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path
from pyburgers.common.toml_files import Table, checked, read_tables
from pyburgers.kinds.experiment import E, Experiment
from pyburgers.kinds.likelihood import NAMES, likelihood_of
from pyburgers.model.priors import PriorSet
from pyburgers.model.residual_laws import residual_parts

COLUMNS: Mapping[str, str] = {
    "place": "grid_place",
    "is_modulus": "",
    "period_s": "",
    "temperature_K": "",
    "log_reading": "grid_log_reading",
    "time_s": "grid_time",
    "strain": "grid_strain",
    "stress_Pa": "grid_stress",
    "kelvin_strain": "grid_kelvin_strain",
    "grain_size_m": "grid_grain_size",
    "fabric_factor": "grid_fabric_factor",
}
"""Columns of solutions in their order, and the variables of programs that they show."""


@typing.runtime_checkable
class FittedTest(typing.Protocol):
    """A test with its posterior."""

    @property
    def experiment(self) -> Experiment:
        """The test."""

    @property
    def priors(self) -> PriorSet:
        """Its resolved priors."""

    @property
    def posterior(self) -> xr.DataTree:
        """Its labelled draws (`pyburgers.posterior.labelled_draws`)."""


class Kind(ABC, Generic[E]):
    """A kind of test, as in experiment files: how it is read, written and simulated."""

    @abstractmethod
    def load(self, path: Path, tables: Mapping[str, Any] | None = None) -> E:
        """Read and check an experiment file and its data files; `tables` stand for the file."""

    @abstractmethod
    def without_data(self, experiment: E) -> E:
        """Return a test as one to be simulated, if its program can; what drives it is known."""

    def known_columns(self, experiment: E, at: FloatArray) -> Mapping[str, FloatArray]:
        """Return columns of a solution at positions (SI) that are known without solving."""
        return {}

    def conditions_at(self, experiment: E, at: FloatArray) -> Mapping[str, FloatArray]:
        """Return columns that say what positions (SI) mean, where the clock does not."""
        return {}

    def solution(self, experiment: E, draw: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Return the `COLUMNS` of a solution from the variables of the program."""
        known = self.known_columns(experiment, draw[f"grid_{likelihood_of(experiment).clock.name}"])
        return {
            column: known[column] if column in known else draw[variable]
            for column, variable in COLUMNS.items()
            if column in known or variable in draw
        }

    def simulated_positions(self, experiment: E) -> FloatArray:
        """Return where (SI) a solution has to be given for `response_in`, not decreasing."""
        return np.unique(experiment.position)

    def response_in(self, experiment: E, solution: pd.DataFrame) -> FloatArray:
        """Return the response (SI), (n_points,), in a solution at `simulated_positions`."""
        likelihood = likelihood_of(experiment)
        clock, response = likelihood.clock.column, likelihood.response.column
        return np.asarray(np.interp(experiment.position, solution[clock], solution[response]))

    @abstractmethod
    def with_noise(
        self,
        experiment: E,
        response: FloatArray,
        values: Mapping[str, float],
        rng: np.random.Generator,
    ) -> E:
        """Return the test with the model's responses (SI), (n_points,), and noise for its own."""


def draw_residuals(
    experiment: Experiment,
    noise: FloatArray,
    part: IntArray,
    values: Mapping[str, float],
    rng: np.random.Generator,
) -> FloatArray:
    """Return residuals (SI), (n_points,), as `stan/statistics/residuals.stan` describes them.

    `noise`, `part` (n_points,): standard deviations (SI), and parts between which none correlates.
    """
    n, correlation_length = experiment.n_points, values.get(experiment.residual_correlation, 0.0)
    if correlation_length == 0:
        return np.asarray(noise * rng.standard_normal(n))
    whole, share = residual_parts(values)
    correlated: FloatArray = np.sqrt(share) * rng.standard_normal(n)
    step = np.diff(experiment.position) / correlation_length
    correlation, spread = np.exp(-step), np.sqrt(-np.expm1(-2 * step))
    for k in np.flatnonzero(np.diff(part) == 0):
        correlated[k + 1] = correlation[k] * correlated[k] + spread[k] * correlated[k + 1]
    return np.asarray(whole * noise * (correlated + np.sqrt(1 - share) * rng.standard_normal(n)))


class _ProtocolTable(Table):
    """The one key that tells how to read the others."""

    model_config = ConfigDict(extra="ignore")

    protocol: str = Field(description="the kind of test")


@cache
def kinds() -> Mapping[str, Kind[Any]]:
    """Return every kind of test by its name."""
    return {name: import_module(f"{__package__}.{name}.files").KIND for name in NAMES}


def kind_of(experiment: Experiment) -> Kind[Any]:
    """Return the kind of a test."""
    return kinds()[experiment.protocol]


def load_experiment(path: str | Path) -> Experiment:
    """Read and check an experiment file and the data files that it names.

    Parameters
    ----------
    path : str or Path
        The TOML file.

    Returns
    -------
    Experiment
        Of the class of its key `protocol`.

    Raises
    ------
    InputError
        If a file, key, unit or number is not what it has to be.

    Examples
    --------
    >>> test = pyburgers.load_experiment(data / "ice" / "PIL40.toml")
    """
    path = given_path(path)
    tables = read_tables(path)
    name = checked(path, tables, _ProtocolTable).protocol
    if name not in NAMES:
        expected = " or ".join(map(repr, NAMES))
        raise InputError(
            f"{path}: key 'protocol': found {name!r}, expected {expected} (the kind of test)."
        )
    experiment: Experiment = kinds()[name].load(path, tables)
    return experiment


def save_experiment(experiment: Experiment, directory: Path) -> Path:
    """Write `Experiment.file_texts` into an existing folder; return the one to load."""
    for name, text in experiment.file_texts().items():
        write_text(directory / name, text)
    return directory / "experiment.toml"
