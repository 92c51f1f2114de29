"""Every kind of test by its name, its files, and what a fit and a solution of any kind have."""

import typing
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import xarray as xr
from pydantic import ConfigDict, Field

from pyburgers.common.array_types import FloatArray
from pyburgers.common.atomic_files import write_text
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path
from pyburgers.common.tables_in_files import read_once
from pyburgers.common.toml_files import Table, checked, read_tables
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.experiment_file import Kind
from pyburgers.kinds.likelihood import NAMES, likelihood_of
from pyburgers.model.priors import PriorSet

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


def solution_columns(
    experiment: Experiment, draw: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Return the `COLUMNS` of a solution from the variables of the program."""
    known = experiment.known_columns(draw[f"grid_{likelihood_of(experiment).clock.name}"])
    return {
        column: known[column] if column in known else draw[variable]
        for column, variable in COLUMNS.items()
        if column in known or variable in draw
    }


class _ProtocolTable(Table):
    """The one key that tells how to read the others."""

    model_config = ConfigDict(extra="ignore")

    protocol: str = Field(description="the kind of test")


@cache
def kinds() -> Mapping[str, Kind[Any]]:
    """Return every kind of test by its name."""
    return {name: import_module(f"{__package__}.{name}.files").KIND for name in NAMES}


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
        # Tables of rates have commands of their own (`pyburgers.flow_law_tables`).
        hint = " pyburgers fit-rates fits a table of rates." * (name == "rates")
        raise InputError(
            f"{path}: key 'protocol': found {name!r}, expected {expected} (the kind of test).{hint}"
        )
    with read_once():
        experiment: Experiment = kinds()[name].load(path, tables)
    return experiment


def save_experiment(experiment: Experiment, directory: Path) -> Path:
    """Write `Experiment.file_texts` into an existing folder; return the one to load."""
    for name, text in experiment.file_texts().items():
        write_text(directory / name, text)
    return directory / "experiment.toml"
