"""What describes the package elsewhere says what pyproject.toml says."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CONDA_NAMES = {"matplotlib": "matplotlib-base", "netCDF4": "netcdf4"}


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def test_the_conda_recipe_needs_what_the_package_needs() -> None:
    recipe = text_of("packaging/conda/recipe.yaml")
    run = recipe.split("  run:\n")[1].split("\n\n")[0]
    needed = {line.strip().removeprefix("- ") for line in run.splitlines()}
    wanted = {f"python {PROJECT['requires-python']}"}
    for dependency in PROJECT["dependencies"]:
        found = re.fullmatch(r"([\w-]+)(>=[\d.]+)", dependency)
        assert found is not None, dependency
        wanted.add(f"{CONDA_NAMES.get(found[1], found[1])} {found[2]}")
    assert {one for one in needed if not one.startswith("cmdstan ")} == wanted
    assert f'version: "{PROJECT["version"]}"' in recipe
    assert f"pyburgers = {PROJECT['scripts']['pyburgers']}" in recipe


def test_the_citation_is_of_this_version() -> None:
    citation = text_of("CITATION.cff")
    assert f"\nversion: {PROJECT['version']}\n" in citation
    assert f'abstract: "{PROJECT["description"]}."' in citation
    assert all(f"\n  - {word}\n" in citation for word in PROJECT["keywords"])
