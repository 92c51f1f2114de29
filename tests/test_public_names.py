"""The package's public names: there when they are asked for, and known to type checkers."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import pyburgers


def test_every_public_name_is_there() -> None:
    assert pyburgers.__all__ == sorted(pyburgers.__all__)
    assert set(pyburgers.__all__) <= set(dir(pyburgers))
    for name in pyburgers.__all__:
        expected = "Fit" if name == "JointFit" else name  # of one to many tests
        assert getattr(pyburgers, name).__name__ == expected


def test_type_checkers_see_the_same_names() -> None:
    (file,) = [Path(folder) / "__init__.py" for folder in pyburgers.__path__]
    (block,) = [
        part for part in ast.parse(file.read_text("utf-8")).body if isinstance(part, ast.If)
    ]
    seen = {
        name.name: part.module
        for part in block.body
        if isinstance(part, ast.ImportFrom)
        for name in part.names
    }
    assert sorted(seen) == pyburgers.__all__
    for name, module in seen.items():
        assert getattr(pyburgers, name) is getattr(sys.modules[str(module)], name)


def test_other_names_are_refused() -> None:
    with pytest.raises(AttributeError, match=r"module 'pyburgers' has no attribute 'fits'"):
        pyburgers.fits  # noqa: B018


def test_the_package_imports_nothing_by_itself() -> None:
    code = "import sys, pyburgers; print(*sys.modules)"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"numpy", "pandas", "xarray", "arviz"} & set(shown.stdout.split())
