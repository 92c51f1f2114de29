"""Where the files lie that come with the package: Stan programs, priors, data."""

import importlib.resources
from pathlib import Path


def shipped_folder(name: str) -> Path:
    """Return ``data`` or ``stan`` of the package: inside it in a wheel, beside it in a checkout.

    If neither is there, return that of a checkout.
    """
    package = Path(str(importlib.resources.files("pyburgers")))
    inside = package / name
    return inside if inside.is_dir() else package.parent / name
