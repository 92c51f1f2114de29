"""Files that CmdStan writes: draws of chains, and of runs without sampling."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import stanio
import xarray as xr
from cmdstanpy.utils import stancsv

from pyburgers.common.draws import FloatArray


@dataclass(frozen=True, eq=False)
class Draws:
    """All columns that chains have written, shape (n_chains, n_draws, n_columns), and their names.

    `variables` says where each variable of the program and of the sampler is in `values`.
    """

    variables: Mapping[str, stanio.Variable]
    values: FloatArray

    def __contains__(self, name: str) -> bool:
        """Tell whether there is a variable, which takes one number at least."""
        return name in self.variables

    def __getitem__(self, name: str) -> FloatArray:
        """Return the draws of a variable, shape (n_chains, n_draws, its own...)."""
        # In the order that files keep, so that sums over draws read back have the same digits.
        found: FloatArray = np.ascontiguousarray(self.variables[name].extract_reshape(self.values))
        return found

    def at(self, draw: int) -> dict[str, FloatArray]:
        """Return all variables of the program at one draw of the first chain."""
        return {name: self[name][0, draw] for name in self.variables if not name.endswith("__")}

    def finite_in(self, names: Iterable[str]) -> tuple["Draws", npt.NDArray[np.bool_]]:
        """Return the draws of one chain that are finite in all of some variables, and which."""
        finite = np.all([np.isfinite(self[name][0]).all(axis=-1) for name in names], axis=0)
        return Draws(self.variables, self.values[:, finite]), finite

    def dataset(self, names: Iterable[str]) -> xr.Dataset:
        """Return variables with dimensions chain, draw, and NAME_dim_K for their own."""
        n_chains, n_draws, _ = self.values.shape
        labels = {"chain": np.arange(1, n_chains + 1), "draw": np.arange(n_draws)}
        found = {}
        for name in names:
            own = (f"{name}_dim_{k}" for k in range(len(self.variables[name].dimensions)))
            found[name] = (("chain", "draw", *own), self[name])
        return xr.Dataset(found, labels)


def read_draws(files: Sequence[Path]) -> Draws:
    """Read chains of equal length; raise ValueError if a row or a file is cut short."""
    header, values = "", []
    for file in files:
        header, rows = _header_and_rows(file)
        none = np.empty((0, header.count(",") + 1))
        values.append(np.loadtxt(rows, delimiter=",", ndmin=2) if rows else none)
    return Draws(stanio.parse_header(header), np.stack(values))


@dataclass(frozen=True, eq=False)
class Adaptation:
    """Step size and inverse mass matrix, shape (n, n), that a chain has ended its warm-up with."""

    step_size: float
    metric: FloatArray


OFF_DIAGONAL = 1 - 1e-4
"""Factor on the elements of a metric off its diagonal. With the six digits of a file, a matrix may
not be positive definite. With any that is, the draws are of the same posterior."""


def adaptation_of(file: Path) -> Adaptation:
    """Read the step size and the dense metric that a chain has ended its warm-up with."""
    comments, *_ = stancsv.parse_comments_header_and_draws(file)
    step_size, metric = stancsv.parse_hmc_adaptation_lines(comments)
    if step_size is None or metric is None:
        raise ValueError(f"{file} has no step size and metric, expected the file of a chain.")
    weights = np.where(np.eye(len(metric), dtype=bool), 1.0, OFF_DIAGONAL)
    return Adaptation(step_size, weights * (metric + metric.T) / 2)


def join_draws(first: Path, second: Path, joined: Path) -> None:
    """Write a file of draws, with all else in it, that goes on with the draws of another."""
    lines = first.read_bytes().splitlines(keepends=True)
    end = max(k for k, line in enumerate(lines) if not line.startswith(b"#")) + 1
    _, more = _header_and_rows(second)
    joined.write_bytes(b"".join([*lines[:end], *more, *lines[end:]]))


def rows_of_draws(file: Path) -> int:
    """Return how many draws there are in a file."""
    _, rows = _header_and_rows(file)
    return len(rows)


def _header_and_rows(file: Path) -> tuple[str, list[bytes]]:
    _, header, rows = stancsv.parse_comments_header_and_draws(file)
    if header is None:
        raise ValueError(f"{file} is empty, expected a file of draws.")
    return header, rows
