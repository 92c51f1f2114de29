"""The package's public names: there when they are asked for, and known to type checkers."""

import subprocess
import sys

import pytest

import pyburgers


def test_every_public_name_is_there() -> None:
    assert pyburgers.__all__ == sorted(pyburgers.__all__)
    assert set(pyburgers.__all__) <= set(dir(pyburgers))
    for name in pyburgers.__all__:
        assert getattr(pyburgers, name).__name__ == name


def test_other_names_are_refused() -> None:
    with pytest.raises(AttributeError, match=r"module 'pyburgers' has no attribute 'fits'"):
        getattr(pyburgers, "fits")  # noqa: B009 - type checkers know that there is none


def test_a_test_is_copied_wherever_it_comes_from() -> None:
    code = (
        "import copy, pickle, pyburgers as p; "
        "test = p.load_experiment(p.shipped_folder('data') / 'ice' / 'PIL40.toml'); "
        "print(copy.deepcopy(test).id, pickle.loads(pickle.dumps(p.priors('ice'))).material)"
    )
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert shown.stdout == "PIL40 ice\n"


def test_the_package_imports_nothing_by_itself() -> None:
    code = "import sys, pyburgers; print(*sys.modules)"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"numpy", "pandas", "xarray", "arviz"} & set(shown.stdout.split())
