"""The outcome of one data set of a calibration, the file that keeps it, and the table of many."""

import csv
from collections.abc import Container, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
from pydantic import ConfigDict, Field

from pyburgers.common.atomic_files import write_json
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table, read_json_table
from pyburgers.sampling.run_directory import RunDirectory

SIMULATIONS = "simulations"
"""Folder of the data sets."""

RANKS = "ranks.csv"
"""Table of the data sets that were done when results were last written."""


class Replication(Table):
    """The outcome of one data set of a calibration; the numbers of fits are those of the last."""

    model_config = ConfigDict(allow_inf_nan=True)

    seed: int
    ranks: dict[str, int] = Field(default_factory=dict)
    """Number of thinned draws below the true value, for each free parameter, the reference quantity
    and the log likelihood; of several tests as NAME[TEST]. Empty if no fit has converged."""
    n_draws: int
    """Thinned draws; ranks go from 0 to this."""
    n_unsolvable: int
    n_outside: int = 0
    """Draws without a solution, and data sets outside their ranges, before this one."""
    n_refits: int = 0
    """Longer fits after the first."""
    n_shortened: int = 0
    """How often the fit went on with shorter steps because a few trajectories diverged."""
    failure: str | None = None
    """Why there is no fit."""
    failed_checks: tuple[str, ...] = Field(default=(), strict=False)
    divergences: int = 0
    rhat: float | None = None
    least_ess: float | None = None
    coordinates: str | None = None

    def is_done(self, refits: int) -> bool:
        """Tell whether so many longer fits leave nothing to repeat."""
        return not self.failed_checks or self.n_refits >= refits


def simulation_file(run: RunDirectory, seed: int) -> Path:
    """Return the file of the outcome of one data set."""
    return run.path / SIMULATIONS / f"simulation_{seed:06d}.json"


def scratch_of(file: Path) -> Path:
    """Folder in which a data set is made; one that is left was not cleared by a killed process."""
    return file.parent / f".{file.stem}"


_COLUMNS = {
    "seed": "seed",
    "n_unsolvable": "unsolvable_draws",
    "n_outside": "outside_draws",
    "n_refits": "refits",
    "n_shortened": "shortened",
    "coordinates": "coordinates",
    "divergences": "divergences",
    "rhat": "rhat",
    "least_ess": "least_ess",
    "failed_checks": "failed_checks",
    "failure": "failure",
}
"""Column of each attribute of a `Replication`; behind them those of the ranks."""

_SEPARATOR = "; "


def replication_table(replications: Iterable[Replication], ranked: Sequence[str]) -> pd.DataFrame:
    """Return every data set: seed, outcome, and the rank of each quantity, missing without one."""
    return pd.DataFrame(
        [
            {
                **{column: getattr(one, name) for name, column in _COLUMNS.items()},
                _COLUMNS["failed_checks"]: _SEPARATOR.join(one.failed_checks),
                **{name: one.ranks.get(name) for name in ranked},
            }
            for one in replications
        ]
    )


def read_replication_table(file: Path, n_draws: int) -> tuple[Replication, ...]:
    """Return the data sets of a table that `replication_table` has made."""
    try:
        with file.open(encoding="utf-8", newline="") as lines:
            return tuple(_of_row(row, n_draws) for row in csv.DictReader(lines))
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{file}: found no table of data sets ({error}), expected what `pyburgers sbc` has "
            "written; without it every data set is made anew."
        ) from error


def _of_row(row: Mapping[str, str], n_draws: int) -> Replication:
    # Tables of fits that never went on with shorter steps do not say so.
    row = {"shortened": "0", **row}
    cells: dict[str, Any] = {name: row[column] for name, column in _COLUMNS.items()}
    cells["failed_checks"] = tuple(filter(None, cells["failed_checks"].split(_SEPARATOR)))
    # Quantities are in their order in the table; numbers beside missing ones have a point.
    ranks = {name: row[name] for name in row if name not in _COLUMNS.values() and row[name]}
    known = {name: cell for name, cell in cells.items() if cell}
    return Replication.model_validate({**known, "ranks": ranks, "n_draws": n_draws}, strict=False)


def replications(run: RunDirectory, seeds: Iterable[int], n_draws: int) -> tuple[Replication, ...]:
    """Read the data sets that are done, of those without a file what the table of results has."""
    seeds = tuple(seeds)
    done = {one.seed: one for one in _tabled(run, n_draws)}
    files = {seed: simulation_file(run, seed) for seed in seeds}
    done |= {
        seed: read_json_table(file, Replication) for seed, file in files.items() if file.is_file()
    }
    return tuple(done[seed] for seed in seeds if seed in done)


def take_from_table(run: RunDirectory, seeds: Container[int], n_draws: int) -> None:
    """Write the files of data sets that only the table of results, perhaps elsewhere made, has."""
    for one in _tabled(run, n_draws):
        file = simulation_file(run, one.seed)
        if one.seed in seeds and not file.exists():
            write_json(file, one.model_dump())


def _tabled(run: RunDirectory, n_draws: int) -> tuple[Replication, ...]:
    """Read the data sets of the table of results, if there is one."""
    table = run.path / RANKS
    return read_replication_table(table, n_draws) if table.is_file() else ()
