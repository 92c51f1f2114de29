"""What a page tells of the runs behind it, and the manifest of a report."""

import importlib.metadata
import platform
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

import pandas as pd

from pyburgers.common.atomic_files import sha256_of_file
from pyburgers.common.units import duration_text
from pyburgers.fitting.sampled_fit import SampledFit

REPORT_KIND = "pyburgers report"
"""What the manifest of a report says, so that no other manifest is overwritten."""

PACKAGES = ("pyburgers", "arviz", "jinja2", "matplotlib", "numpy", "pandas", "scipy", "xarray")

_OF_A_RUN = {"state": "status", "begun": "started", "fingerprint": "fingerprint"}


def runs_table(named: Sequence[tuple[str, SampledFit]]) -> pd.DataFrame:
    """Say of each fit what no other has: state, beginning, hash, time of all chains, as text."""
    return pd.DataFrame(
        [
            {"fit": name}
            | {title: fit.manifest[key] for title, key in _OF_A_RUN.items()}
            | {"all chains": duration_text(sum(one["wall_seconds"] for one in chains))}
            for name, fit in named
            for chains in (fit.manifest["chains"].values(),)
        ]
    )


def report_manifest(
    named: Sequence[tuple[str, SampledFit]], title: str, command: str
) -> dict[str, Any]:
    """Record what made the report and from what."""
    return {
        "kind": REPORT_KIND,
        "title": title,
        "command": command,
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {
            "python": platform.python_version(),
            **{package: importlib.metadata.version(package) for package in PACKAGES},
        },
        "runs": [
            {
                "id": key,
                "directory": fit.directory.path.name,
                "data_kind": fit.provenance.kind,
                "command": fit.manifest["command"],
                "fingerprint": fit.manifest["fingerprint"],
                "status": fit.manifest["status"],
                "manifest_sha256": sha256_of_file(fit.directory.manifest_file),
            }
            for key, fit in named
        ],
    }
