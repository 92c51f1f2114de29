"""The outcome of one data set of a calibration, and the file that keeps it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pydantic import ConfigDict

from pyburgers.common.toml_files import Table, read_json_table
from pyburgers.sampling.run_directory import RunDirectory

SIMULATIONS = "simulations"
"""Folder of the data sets."""


@dataclass(frozen=True)
class Replication:
    """One data set of a calibration.

    Attributes
    ----------
    seed : int
        Of this data set.
    ranks : mapping of str to int
        Number of thinned draws below the true value, for each free parameter, the reference
        quantity and the log likelihood; of several tests those of one as NAME[TEST]. Empty where
        the fit failed or did not converge.
    n_draws : int
        Thinned draws; ranks go from 0 to this.
    n_unsolvable, n_outside : int
        See `pyburgers.sbc.data_sets.Simulated`.
    n_refits : int
        Longer fits after the first.
    failure : str or None
        Why there is no fit.
    failed_checks : tuple of str
        Names of the checks of convergence that the last fit failed.
    divergences : int
        Of the last fit.
    rhat, least_ess : float or None
        Largest R-hat and least bulk effective sample size of the last fit.
    coordinates : str or None
        Coordinates of the fit.
    """

    seed: int
    ranks: Mapping[str, int]
    n_draws: int
    n_unsolvable: int
    n_outside: int = 0
    n_refits: int = 0
    failure: str | None = None
    failed_checks: tuple[str, ...] = ()
    divergences: int = 0
    rhat: float | None = None
    least_ess: float | None = None
    coordinates: str | None = None


class _ReplicationTable(Table):
    """A `Replication` in its file."""

    model_config = ConfigDict(allow_inf_nan=True)

    seed: int
    ranks: dict[str, int]
    n_draws: int
    n_unsolvable: int
    n_outside: int
    n_refits: int
    failure: str | None
    failed_checks: list[str]
    divergences: int
    rhat: float | None
    least_ess: float | None
    coordinates: str | None


def simulation_file(run: RunDirectory, seed: int) -> Path:
    """Return where the outcome of one data set is."""
    return run.path / SIMULATIONS / f"simulation_{seed:06d}.json"


def scratch_of(file: Path) -> Path:
    """Folder in which a data set is made; one that is left was not cleared by a killed process."""
    return file.parent / f".{file.stem}"


def read_replication(file: Path) -> Replication:
    """Return what a file keeps.

    Raises
    ------
    InputError
        If it was damaged.
    """
    content = read_json_table(file, _ReplicationTable).model_dump()
    return Replication(**{**content, "failed_checks": tuple(content["failed_checks"])})


def next_fit(file: Path, refits: int) -> int | None:
    """Return which fit of a data set is to be made: 0, a repetition, or None where it is done.

    Raises
    ------
    InputError
        If its file was damaged.
    """
    if not file.is_file():
        return 0
    done = read_replication(file)
    return done.n_refits + 1 if done.failed_checks and done.n_refits < refits else None
