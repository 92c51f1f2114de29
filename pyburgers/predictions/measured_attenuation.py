"""Measured attenuation from a file of one's own, to be drawn over a predicted spectrum."""

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path
from pyburgers.common.toml_files import read_text

NEEDED, OPTIONAL = ("frequency_Hz", "tan_delta"), ("tan_delta_sd", "series")
UNNAMED = "measured"
"""Series of points without one."""


@dataclass(frozen=True, eq=False)
class MeasuredAttenuation:
    """Points of attenuation, all arrays of one length.

    Attributes
    ----------
    frequency : array
        Hz.
    tan_delta, standard_deviation : array
        Attenuation, and its standard deviation, 0 where none is given.
    series : tuple of str
        Series of each point, for the legend.

    Examples
    --------
    >>> measured = pyburgers.MeasuredAttenuation(
    ...     frequency=np.array([0.1]), tan_delta=np.array([0.05]),
    ...     standard_deviation=np.array([0.01]), series=("mine",)
    ... )
    """

    frequency: FloatArray
    tan_delta: FloatArray
    standard_deviation: FloatArray
    series: tuple[str, ...]


def load_measured_attenuation(path: str | Path) -> MeasuredAttenuation:
    r"""Read points of attenuation to draw over a predicted spectrum.

    Parameters
    ----------
    path : path
        Comma-separated file with a header; lines that start with # are skipped. Columns are
        frequency_Hz and tan_delta, and if they are known tan_delta_sd and series.

    Returns
    -------
    MeasuredAttenuation
        The points.

    Raises
    ------
    InputError
        If the file cannot be read or has no points, or if a column is missing or unknown. If a
        number is not finite or not positive (a standard deviation: negative).

    Examples
    --------
    >>> lines = "frequency_Hz,tan_delta\n0.01,0.12\n0.1,0.05\n"
    >>> _ = Path("measured.csv").write_text(lines)
    >>> pyburgers.load_measured_attenuation(Path("measured.csv")).tan_delta
    array([0.12, 0.05])
    """
    path = given_path(path)
    text = io.StringIO(read_text(path))
    try:
        table = pd.read_csv(text, comment="#", skipinitialspace=True, dtype=str)
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise InputError(
            f"{path}: cannot be read as comma-separated columns ({reason})."
        ) from error
    table.columns = table.columns.str.strip()
    expected = f"expected {', '.join(NEEDED)} and at most {', '.join(OPTIONAL)}"
    for name in NEEDED:
        if name not in table:
            raise InputError(f"{path}: column {name!r} is missing, {expected}.")
    for name in table.columns:
        if name not in NEEDED + OPTIONAL:
            raise InputError(f"{path}: found column {name!r}, {expected}.")
    if table.empty:
        raise InputError(f"{path}: found no points, expected at least one row of numbers.")
    frequency, tan_delta = (_numbers(path, table[name], above_zero=True) for name in NEEDED)
    deviation = np.zeros(len(table))
    if "tan_delta_sd" in table:
        deviation = _numbers(path, table["tan_delta_sd"].fillna("0"), above_zero=False)
    series = table["series"].fillna(UNNAMED) if "series" in table else [UNNAMED] * len(table)
    return MeasuredAttenuation(frequency, tan_delta, deviation, tuple(map(str, series)))


def _numbers(path: Path, column: "pd.Series[str]", *, above_zero: bool) -> FloatArray:
    """Return a column as numbers, each of which has to be in range."""
    numbers = pd.to_numeric(column, errors="coerce").to_numpy(dtype=np.float64)
    fine = np.isfinite(numbers) & ((numbers > 0) if above_zero else (numbers >= 0))
    if not fine.all():
        row = int(np.flatnonzero(~fine)[0])
        kind = "a positive number" if above_zero else "zero or a positive number"
        raise InputError(
            f"{path}: column {column.name!r}, point {row + 1}: found {column.iloc[row]!r}, "
            f"expected {kind}."
        )
    return numbers
