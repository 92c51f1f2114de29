"""The studies use the package as anybody does: by its public names alone."""

import ast
from pathlib import Path

import pytest

import pyburgers

REPORTS = Path(__file__).parents[2] / "reports"
FILES = sorted(REPORTS.rglob("*.py"))


def used_of_the_package(source: str) -> set[str]:
    """Names of the package that a file uses, those of modules with their dots."""
    used = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "pyburgers":
            inside = (node.module or "").removeprefix("pyburgers").lstrip(".")
            used |= {f"{inside}.{alias.name}".lstrip(".") for alias in node.names}
        elif isinstance(node, ast.Import):
            modules = {alias.name for alias in node.names}
            used |= {name for name in modules if name.startswith("pyburgers.")}
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) == "pyburgers":
            used.add(node.attr)
    return used


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(REPORTS)))
def test_a_study_imports_public_names_alone(file: Path) -> None:
    assert used_of_the_package(file.read_text(encoding="utf-8")) <= set(pyburgers.__all__)


def test_another_import_is_seen() -> None:
    for line, name in (
        ("from pyburgers.fitting.fit import Fit", "fitting.fit.Fit"),
        ("import pyburgers.fitting.fit as f", "pyburgers.fitting.fit"),
        ("pyburgers.fitting.fit", "fitting"),
    ):
        assert name in used_of_the_package(line)
        assert name not in pyburgers.__all__
