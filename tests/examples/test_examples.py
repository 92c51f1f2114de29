"""The example scripts run from any folder and give what they promise."""

import ast
import inspect
import runpy
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import oracle
import pandas as pd
import pytest
import xarray as xr
from conftest import Problem
from matplotlib import pyplot as plt

import pyburgers
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.experiment import Experiment
from pyburgers.predictions.attenuation import predict_attenuation, quantile_table
from pyburgers.predictions.stress_cycles import Regime

EXAMPLES = Path(__file__).parents[2] / "examples"

Script = Callable[..., str]


@pytest.fixture
def script(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Script:
    """Run an example in an empty folder as a user does; return what it prints."""
    monkeypatch.chdir(tmp_path)

    def run(name: str, *arguments: object) -> str:
        monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        plt.close("all")  # a script ends with its process, and its figures with it
        return capsys.readouterr().out

    return run


def test_a_curve_is_fitted(script: Script, small_problem: Problem, tmp_path: Path) -> None:
    files = (small_problem.experiment_file, "--priors", small_problem.priors_file)
    printed = script(
        "fit_your_own_curve.py", *files, "--chains", 2, "--warmup", 150, "--draws", 100
    )
    fit = Fit.load(tmp_path / "runs" / "PIL40")
    assert fit.posterior["posterior"].sizes == {"chain": 2, "draw": 100}
    row = next(line for line in printed.splitlines() if line.startswith("maxwell_modulus"))
    mean = fit.summary("SI")["mean"]["maxwell_modulus"]
    assert float(row.split()[2]) == pytest.approx(mean, rel=1e-5)
    for check in fit.checks():
        assert check.sentence in printed
    assert (fit.directory.path / "fit.png").read_bytes().startswith(b"\x89PNG")


@pytest.fixture
def no_fit(small_fit: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    """Return the same fit for any test that `fit` can be called with."""

    def found(test: Experiment, **given: object) -> Fit:
        inspect.signature(fit).bind(test, **given)
        assert (test.id, test.n_points, test.material) == ("PIL40", 61, "ice")
        return small_fit

    monkeypatch.setattr(pyburgers, "fit", found)


def test_a_table_becomes_a_page_and_draws(
    script: Script, no_fit: None, tmp_path: Path, sketched: None
) -> None:
    printed = script("table_to_page.py")
    assert "maxwell_modulus" in printed
    assert printed.splitlines()[-1] == str(tmp_path / "page.html")
    assert "PIL40" in (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "subsection" in (tmp_path / "aspect.prm").read_text(encoding="utf-8")
    with xr.open_dataset(tmp_path / "draws.nc", group="posterior") as draws:
        assert "maxwell_modulus" in draws


def test_the_landing_page_goes_from_readings_to_a_page_in_eight_lines(
    no_fit: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sketched: None
) -> None:
    landing = (EXAMPLES.parent / "docs" / "index.md").read_text(encoding="utf-8")
    code = landing.split("```python\n")[1].split("```")[0]
    assert len(code.split("\n\n", 1)[1].splitlines()) + 1 == 8  # a blank line below the import
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "index.md", "exec"), {})
    assert "PIL40" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_the_way_from_a_table_to_a_page_has_fifteen_statements() -> None:
    text = (EXAMPLES / "table_to_page.py").read_text(encoding="utf-8")
    assert len(ast.parse(text).body) <= 15


def test_attenuation_is_predicted_from_a_saved_fit(
    script: Script, small_fit: Fit, tmp_path: Path
) -> None:
    printed = script("predict_attenuation.py", small_fit.directory.path, "--median-stress-MPa", 2)
    assert "2 ± 0.2 MPa: tan(delta) at 1 mHz is" in printed
    written = pd.read_csv(tmp_path / "attenuation" / "attenuation.csv")
    spectrum = predict_attenuation(small_fit, np.geomspace(1e-4, 1.0, 80), [Regime(2e6, 0.2e6)])
    expected = quantile_table(spectrum)
    np.testing.assert_allclose(written[["0.05", "0.5", "0.95"]], expected[["q5", "q50", "q95"]])
    np.testing.assert_allclose(written["frequency"], expected["frequency_Hz"])
    picture = tmp_path / "attenuation" / "attenuation.png"
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_stan_functions_serve_another_program(
    script: Script, small_fit: Fit, tmp_path: Path
) -> None:
    arguments = ("--strain", 100, "--draws", 200, "--out", "tables/stress.csv")
    script("reuse_stan_functions/flow_stress.py", small_fit.directory.path, *arguments)
    written = pd.read_csv(tmp_path / "tables" / "stress.csv")
    # After much strain the stress is the steady one; only the enthalpy varies in this fit.
    draws = small_fit.posterior["posterior"].to_dataset()
    value = {str(name): values.to_numpy().ravel() for name, values in draws.items()}
    rate_factor = value["activation_enthalpy"] * (
        value["beta"] - 1 / (oracle.GAS_CONSTANT * small_fit.experiment.temperature)
    )
    size = value["steady_state_grain_size"] ** value["grain_size_exponent"]
    for row in written.itertuples():
        fluidity = row.strain_rate_per_s * size * np.exp(-rate_factor)
        steady = value["steady_state_fabric_factor"] * fluidity ** (1 / value["stress_exponent"])
        expected = np.quantile(steady, [0.05, 0.5, 0.95]) / 1e6
        assert (row.q5_MPa, row.q50_MPa, row.q95_MPa) == pytest.approx(expected, rel=1e-8)
