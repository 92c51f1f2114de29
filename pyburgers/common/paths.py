"""Paths as users give them, as messages show them, and of the files that come with the package."""

import importlib.resources
import os
import re
from pathlib import Path

from pyburgers.common.errors import InputError, require_type


def given_path(path: str | Path) -> Path:
    """Return the absolute path that a user means; ``~`` at its start is a known user's home."""
    require_type("path", path, (str, os.PathLike), "the path of a file or folder")
    return Path(os.path.expanduser(path)).absolute()  # noqa: PTH111 - pathlib's refuses unknown users


def shown(text: object) -> str:
    """Return a path, or a message, in which paths below the working folder are relative to it."""
    try:
        here = re.escape(str(Path.cwd()))
    except FileNotFoundError:  # it was removed: nothing lies below it
        return str(text)
    begins, ends = r"(?<![^\s'\"`(=:,])", r"(?![^\s'\"`):;,])"
    # "-x" alone would be an option.
    dashed = re.sub(rf"{begins}{here}{os.sep}(?=-)", f".{os.sep}", str(text))
    below = re.sub(rf"{begins}{here}{os.sep}(?!~)(?=\S)", "", dashed)
    return re.sub(rf"{begins}{here}{ends}", ".", below)


def shipped_folder(name: str) -> Path:
    """Return a folder that comes with the package: ``data`` or ``stan``.

    Parameters
    ----------
    name : {"data", "stan"}
        Shipped tests and priors, or the Stan programs and their functions.

    Returns
    -------
    Path
        The folder inside an installed package, else that of the checkout.

    Raises
    ------
    InputError
        If `name` is another one.

    Examples
    --------
    >>> (pyburgers.shipped_folder("data") / "ice" / "PIL40.toml").is_file()
    True
    """
    if name not in ("data", "stan"):
        raise InputError(f"name: found {name!r}, expected 'data' or 'stan'.")
    package = Path(str(importlib.resources.files("pyburgers")))
    inside = package / name
    return inside if inside.is_dir() else package.parent / name
