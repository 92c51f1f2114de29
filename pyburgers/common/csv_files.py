"""Text files that hold columns of numbers, as the package writes them."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from pyburgers.common.atomic_files import write_text

FloatArray = npt.NDArray[np.float64]

WRITTEN_LAYOUT = MappingProxyType({"separator": ",", "header": True, "missing": []})
"""Keys of a table [data] that describe what `write_columns` writes."""


def write_data(directory: Path, data: Mapping[str, Any]) -> dict[str, Any]:
    """Write columns in memory as text files; return a table [data] that names the files.

    The columns of the key ``file`` go to ``experiment.csv``, of ``NAME_file`` to
    ``experiment_NAME.csv``.
    """
    named: dict[str, Any] = {**data, **WRITTEN_LAYOUT}
    for key, columns in data.items():
        if isinstance(columns, Mapping):
            named[key] = f"experiment_{key}".removesuffix("_file") + ".csv"
            write_columns(directory / named[key], columns)
    return named


def write_columns(path: Path, columns: Mapping[str, Sequence[float] | FloatArray]) -> None:
    """Write columns with a header, separated by commas, that read back to the same numbers.

    The cells of NaN are empty.
    """
    rows = zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join(map(_written, row)) for row in rows)]
    write_text(path, "\n".join(lines) + "\n")


def _written(number: float) -> str:
    return "" if math.isnan(number) else repr(number)
