"""Loading histories from stages and columns in memory."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.files import load_loading_history


def history(
    stages: list[dict[str, Any]],
    columns: Mapping[str, np.ndarray],
    data: dict[str, Any],
    **head: Any,
) -> HistoryExperiment:
    """Return a test of columns by their quantities, times in s, if there are any."""
    named = {f"{quantity}_column": quantity for quantity in columns}
    table = {"file": dict(columns), "time_unit": "s", **named, **data}
    keys = {
        "id": "sample",
        "material": "ice",
        "protocol": "loading_history",
        "temperature_K": 263.0,
        "initial_grain_size_m": 1e-3,
        "stages": stages,
        **({"data": table} if columns else {}),
        "provenance": {"kind": "synthetic", "source": "this test"},
    }
    return load_loading_history(Path("sample"), {**keys, **head})


def stage(end: float, control: str, **keys: object) -> dict[str, Any]:
    """A stage from 0 s on."""
    return {"control": control, "start_time": 0.0, "end_time": end, **keys}
