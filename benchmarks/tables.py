"""Folders of the benchmarks, and tables in Markdown."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from pyburgers.sbc.rank_uniformity import judge_ranks, rank_bands

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results"
ICE = ROOT / "data" / "ice"


def markdown(table: pd.DataFrame) -> str:
    """Table of Markdown, numbers in three digits, what is missing left blank."""
    rows = [table.columns.tolist(), ["---"] * table.shape[1]]
    rows += [[_cell(value) for value in row] for row in table.itertuples(index=False)]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def verdict_table(ranks: Mapping[str, Sequence[int]], n_draws: int) -> pd.DataFrame:
    """Judge ranks among draws of each quantity; a row for each, as text."""
    (n_ranks,) = {len(one) for one in ranks.values()}
    verdicts = judge_ranks(ranks, rank_bands(n_ranks, n_draws, len(ranks)))
    return pd.DataFrame(
        {
            "quantity": [*ranks],
            "mean rank": [f"{one.mean:.3f}" for one in verdicts.values()],
            "spread": [f"{one.spread:.3f}" for one in verdicts.values()],
            "verdict": [one.verdict for one in verdicts.values()],
            "in words": [one.sentence for one in verdicts.values()],
        }
    )


def _cell(value: float | str) -> str:
    if isinstance(value, str):
        return value
    if math.isnan(value):
        return ""
    return f"{value:.0f}" if value >= 1000 else f"{value:.4g}" if value > 1 else f"{value:.3g}"
