"""Comparison of dataclasses that hold arrays, and of the files of folders."""

from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np


def assert_equal(one: object, other: object) -> None:
    """Compare field by field, arrays included."""
    assert type(one) is type(other)
    if isinstance(one, np.ndarray):
        np.testing.assert_array_equal(one, other)
    elif is_dataclass(one):
        for field in fields(one):
            left, right = getattr(one, field.name), getattr(other, field.name)
            assert_equal(left, right)
    else:
        assert one == other


def contents(folder: Path) -> dict[Path, bytes]:
    """Return every file of a folder and of those below it."""
    return {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
