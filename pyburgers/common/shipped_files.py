"""Where the files lie that come with the package: Stan programs, priors, data."""

import importlib.resources
from pathlib import Path


def shipped_folder(name: str) -> Path:
    """Return a folder that comes with the package: inside it in a wheel, beside it in a checkout.

    Parameters
    ----------
    name : str
        ``"data"`` or ``"stan"``.

    Returns
    -------
    Path
        Where neither is there, that of a checkout.
    """
    package = Path(str(importlib.resources.files("pyburgers")))
    inside = package / name
    return inside if inside.is_dir() else package.parent / name
