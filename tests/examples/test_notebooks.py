"""Notebooks use public names, show what their code gives, and hold no path of a machine."""

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from sentences import fault, sentences

import pyburgers

FOLDER = Path(__file__).parents[2] / "notebooks"
PATHS = sorted(FOLDER.glob("*.ipynb"))
ABSOLUTE = re.compile(r"(?:^|(?<=[\s\"'(=:,]))(?:/\w[\w.-]*/|[A-Za-z]:\\)")
MAX_BYTES = 300_000

each_notebook = pytest.mark.parametrize("path", PATHS, ids=[path.stem for path in PATHS])


def cells(path: Path, kind: str) -> list[dict[str, Any]]:
    notebook = json.loads(path.read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    return [cell for cell in notebook["cells"] if cell["cell_type"] == kind]


def text_of(source: str | list[str]) -> str:
    return source if isinstance(source, str) else "".join(source)


def private_names(code: str) -> Iterator[str]:
    """Names of the package in some code that are none of its public names."""
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("pyburgers"):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.Import):
            yield from (name.name for name in node.names if name.name.startswith("pyburgers."))
        elif isinstance(node, ast.Attribute):
            of_package = isinstance(node.value, ast.Name) and node.value.id == "pyburgers"
            if node.attr.startswith("_") or of_package:
                yield from {node.attr} - (set(pyburgers.__all__) if of_package else set())


def output_texts(cell: dict[str, Any]) -> Iterator[str]:
    """Texts and tables that a cell has shown."""
    for output in cell["outputs"]:
        yield text_of(output.get("text", ""))
        shown = output.get("data", {})
        yield from (text_of(one) for kind, one in shown.items() if not kind.startswith("image/"))


def test_each_notebook_is_listed() -> None:
    listed = re.findall(r"\((\w+)\.ipynb\)", (FOLDER / "README.md").read_text(encoding="utf-8"))
    assert sorted(listed) == [path.stem for path in PATHS]


def test_private_names_are_found() -> None:
    code = "import pyburgers.kinds\nfrom pyburgers.fitting.fit import Fit\npyburgers.Fits\nfit._x"
    assert set(private_names(code)) == {"pyburgers.kinds", "Fit", "Fits", "_x"}
    assert not set(private_names("pyburgers.fit(test).plot.curve()"))


@each_notebook
def test_a_notebook_uses_public_names(path: Path) -> None:
    code = "\n".join(text_of(cell["source"]) for cell in cells(path, "code"))
    assert "import pyburgers" in code
    assert not set(private_names(code))


@each_notebook
def test_a_notebook_shows_one_whole_run(path: Path) -> None:
    code = cells(path, "code")
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell["outputs"]]
    assert {"error"}.isdisjoint(one["output_type"] for one in outputs)
    assert {"stderr"}.isdisjoint(one.get("name") for one in outputs)
    assert any("image/png" in one.get("data", {}) for one in outputs)
    assert path.stat().st_size < MAX_BYTES


@each_notebook
def test_a_notebook_holds_no_path_of_a_machine(path: Path) -> None:
    for cell in cells(path, "code"):
        for text in (text_of(cell["source"]), *output_texts(cell)):
            assert not ABSOLUTE.search(text)


def test_paths_of_machines_are_found() -> None:
    for path in ("/home/me/a.py", "in '/tmp/x'", r"C:\data\a.csv"):
        assert ABSOLUTE.search(path)
    for other in ("mol/J", "1/s", "data/ice", "</td></tr>", "https://doi.org/10.1186/x"):
        assert not ABSOLUTE.search(other)


@each_notebook
def test_sentences_of_a_notebook_are_short(path: Path) -> None:
    for cell in cells(path, "markdown"):
        assert not [one for _, one in sentences(text_of(cell["source"])) if fault(one)]


@pytest.mark.slow
@each_notebook
def test_a_notebook_runs(path: Path) -> None:
    """It needs the packages of the site: `make docs` installs them."""
    from notebook_runs import executed

    fresh, kept = json.loads(executed(path)), json.loads(path.read_text(encoding="utf-8"))
    for there, here in zip(fresh["cells"], kept["cells"], strict=True):
        assert there["source"] == here["source"]
        shown = [
            [(one["output_type"], sorted(one.get("data", {}))) for one in cell.get("outputs", [])]
            for cell in (there, here)
        ]
        assert shown[0] == shown[1]
