"""What CmdStan's CSV files say of a chain, finished or not."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd


@dataclass(frozen=True, eq=False)
class ChainFile:
    """Draws and cost of one chain.

    `draws`: rows that are complete; warm-up is among them only if it was saved, and a chain stopped
        early may have none.
    `warmup_seconds`, `sampling_seconds`: CmdStan's own timing; NaN where the chain was stopped.
    """

    draws: pd.DataFrame
    warmup_seconds: float
    sampling_seconds: float


def read_chain(path: Path) -> ChainFile:
    """Read a CSV of CmdStan that may break off anywhere."""
    lines = path.read_text(encoding="utf-8").splitlines()
    table = [line.split(",") for line in lines if line and not line.startswith("#")]
    header = table[0] if table else []
    rows = [row for row in table[1:] if len(row) == len(header)]
    seconds = {"Warm-up": float("nan"), "Sampling": float("nan")}
    for line in lines:
        for phase in seconds:
            if line.startswith("#") and line.endswith(f"seconds ({phase})"):
                seconds[phase] = float(line.removesuffix(f"seconds ({phase})").split()[-1])
    draws = pd.DataFrame(rows, columns=header).astype(float)
    return ChainFile(draws, seconds["Warm-up"], seconds["Sampling"])
