"""Files that come with the package, in a checkout and in a wheel."""

import importlib.resources
from pathlib import Path

import pytest

from pyburgers.common.paths import shipped_folder


def test_stan_programs_and_data_are_found() -> None:
    assert (shipped_folder("stan") / "loading_history.stan").is_file()
    assert (shipped_folder("data") / "priors" / "ice.toml").is_file()


def test_a_wheel_has_them_inside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = tmp_path / "pyburgers"
    monkeypatch.setattr(importlib.resources, "files", lambda _: package)
    assert shipped_folder("data") == tmp_path / "data"
    (package / "data").mkdir(parents=True)
    assert shipped_folder("data") == package / "data"
