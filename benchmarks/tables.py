"""Folders of the benchmarks, and tables in Markdown."""

import math
from pathlib import Path

import pandas as pd

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results"
ICE = ROOT / "data" / "ice"


def markdown(table: pd.DataFrame) -> str:
    """Table of Markdown, numbers in three digits, what is missing left blank."""
    rows = [table.columns.tolist(), ["---"] * table.shape[1]]
    rows += [[_cell(value) for value in row] for row in table.itertuples(index=False)]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def _cell(value: float | str) -> str:
    if isinstance(value, str):
        return value
    if math.isnan(value):
        return ""
    return f"{value:.0f}" if value >= 1000 else f"{value:.4g}" if value > 1 else f"{value:.3g}"
