"""Labelled draws: their weights, errors of what drives tests, and their file."""

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import stanio
import xarray as xr
from scipy import stats
from synthetic_fit import make_fit

from pyburgers.cmdstan.draw_files import Draws
from pyburgers.cmdstan.program import Program, Unsolved
from pyburgers.posterior.build import driving_errors, reference_solution
from pyburgers.posterior.groups import keep_posterior, load_posterior
from pyburgers.posterior.labelled_draws import (
    pareto_k,
    relative_efficiency,
    smooth_weights,
)

FloatArray = npt.NDArray[np.float64]


def test_weights_add_up_and_rise_with_the_ratios() -> None:
    ratios = np.random.default_rng(1).normal(size=500)
    log_weights, _ = smooth_weights(ratios)
    assert np.exp(log_weights).sum() == pytest.approx(1.0)
    assert np.all(np.diff(log_weights[np.argsort(ratios)]) >= 0)


def test_weights_turn_draws_of_one_normal_into_another() -> None:
    draws = np.random.default_rng(3).normal(size=8000)
    target = stats.norm(0.5, 0.8)
    log_weights, shape = smooth_weights(target.logpdf(draws) - stats.norm.logpdf(draws))
    assert shape < 0.7
    assert np.exp(log_weights) @ draws == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("n", [4, 24, 100])
def test_equal_ratios_have_equal_weights_and_no_tail(n: int) -> None:
    log_weights, shape = smooth_weights(np.full(n, -800.0))
    np.testing.assert_allclose(np.exp(log_weights), 1 / n)
    assert shape == -np.inf
    # A handful of draws has no tail to smooth.
    ratios = np.array([0.0, 1.0, 2.0])
    log_weights, shape = smooth_weights(ratios)
    np.testing.assert_allclose(np.exp(log_weights), np.exp(ratios) / np.exp(ratios).sum())
    assert shape == np.inf
    # The tail of the ratios counts, not that of their inverse: not even a mean.
    ratios = np.random.default_rng(2).normal(size=4000) ** 2
    assert pareto_k(ratios) > 1
    assert pareto_k(-ratios) < 0


def test_efficiency_is_one_for_independent_draws_and_less_for_a_slow_chain() -> None:
    rng = np.random.default_rng(4)
    independent = rng.normal(size=(4, 1000))
    slow = np.repeat(rng.normal(size=(4, 100)), 10, axis=1)
    values = xr.DataArray(
        np.stack([independent, slow, np.ones((4, 1000))], axis=-1), dims=("chain", "draw", "point")
    )
    found = relative_efficiency(values)
    assert found[0] == pytest.approx(1.0, abs=0.2)
    assert found[1] == pytest.approx(0.1, rel=0.4)
    assert found[2] == 1.0


@dataclass(frozen=True)
class Driven:
    id: str
    n_driving_errors: int


def test_the_last_coordinates_are_errors_of_the_tests_in_turn() -> None:
    header = ",".join(f"coordinate.{k}" for k in range(1, 6))
    values = np.arange(2 * 3 * 5.0).reshape(2, 3, 5)
    fit = Draws(stanio.parse_header(header), values)
    both = driving_errors(fit, [Driven("a", 2), Driven("b", 1)])  # type: ignore[list-item]
    assert list(both) == ["driving_error[a, 1]", "driving_error[a, 2]", "driving_error[b, 1]"]
    np.testing.assert_array_equal(
        both["driving_error[b, 1]"].transpose("chain", "draw"), values[:, :, 4]
    )
    single = driving_errors(fit, [Driven("a", 2)])  # type: ignore[list-item]
    assert list(single) == ["driving_error[1]", "driving_error[2]"]
    np.testing.assert_array_equal(
        single["driving_error[1]"].transpose("chain", "draw"), values[:, :, 3]
    )


class Halting(Program):
    """A program that has no solution below 0, and the coordinate itself as its variables."""

    def generate(self, *_: Any, **__: Any) -> Draws:
        raise Unsolved("The program has no solution at some of the draws.")

    def generate_at(
        self, data: Any, name: str, points: FloatArray, *_: Any, **__: Any
    ) -> tuple[npt.NDArray[np.bool_], Draws]:
        solved = points[:, 0] > 0
        variables = stanio.parse_header("log_lik.1,grid_strain.1")
        return solved, Draws(variables, np.repeat(points[np.newaxis, solved], 2, axis=2))


def test_draws_without_a_solution_are_nan_and_the_others_stay(tmp_path: Path) -> None:
    file = tmp_path / "draws.csv"
    file.write_text("coordinate.1\n3.0\n-1.0\n2.0\n", encoding="utf-8")
    found = reference_solution(
        Halting(tmp_path), {"point_end": [0, 1]}, [file, file], {"grid_strain": 1}, seed=1
    )
    for name in ("log_lik", "grid_strain"):
        values = found[name].transpose("chain", "draw", f"{name}_dim_0").to_numpy()
        np.testing.assert_array_equal(values[..., 0], [[3.0, np.nan, 2.0]] * 2)


KEEPING = """
import resource, sys
from pathlib import Path
from synthetic_fit import make_fit
from pyburgers.posterior.groups import keep_posterior

fit = make_fit(Path(sys.argv[1]), draws=50)
groups = {name: group.to_dataset() for name, group in fit.posterior.children.items()}
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
try:
    keep_posterior(fit.directory, groups, experiment="a", data_kind="synthetic")
except OSError as error:
    print(error.strerror, Path(error.filename).name)
"""


def test_a_disk_that_fills_up_leaves_no_draws_and_no_crash(tmp_path: Path) -> None:
    """HDF5 brings a process down that cannot write to its file."""
    done = subprocess.run(
        [sys.executable, "-c", KEEPING, str(tmp_path / "run")],
        env={"PYTHONPATH": ":".join(sys.path), "PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, "File too large posterior.nc\n"), done.stderr
    assert [file.name for file in (tmp_path / "run").iterdir()] == ["manifest.json"]


def test_draws_are_read_back_when_they_are_noted(tmp_path: Path) -> None:
    fit = make_fit(tmp_path / "run", draws=20)
    run = fit.directory
    groups = {name: group.to_dataset() for name, group in fit.posterior.children.items()}
    kept = keep_posterior(run, groups, experiment="a", data_kind="synthetic")
    assert run.read_manifest()["posterior_sha256"]
    assert kept.attrs["chains"] == "[]"
    loaded = load_posterior(run, run.read_manifest())
    assert loaded is not None
    assert loaded["posterior"].to_dataset().equals(kept["posterior"].to_dataset())
    run.update_manifest({"posterior_sha256": None})
    assert load_posterior(run, run.read_manifest()) is None


@pytest.mark.parametrize(("option", "refused"), [("-O", False), ("-OO", True)])
def test_python_without_docstrings_is_refused(option: str, refused: bool) -> None:
    done = subprocess.run(
        [sys.executable, option, "-B", "-c", "import pyburgers.posterior"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode != 0) == ("unset PYTHONOPTIMIZE" in done.stderr) == refused
