"""`pyburgers predict attenuation`: files that it promises, exit codes, one sentence each."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from refusals import CommandLine

from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import ORIGINS
from pyburgers.predictions.attenuation import predict_attenuation
from pyburgers.predictions.stress_cycles import PAPER_REGIMES, Regime


def predict(cli: CommandLine, fit: Fit, out: Path, *options: object) -> str:
    return cli("predict", "attenuation", fit.directory.path, "--out", out, *options)


def test_a_prediction_is_a_table_all_draws_and_a_figure(
    small_fit: Fit, tmp_path: Path, cli: CommandLine
) -> None:
    out = tmp_path / "new" / "folder" / "tan_delta.csv"
    printed = predict(cli, small_fit, out)
    for suffix in (".csv", ".nc", ".png", ".svg"):
        assert str(out.with_suffix(suffix)) in printed
    assert "PIL40 (ice, fitted to synthetic data): 260 K, initial microstructure" in printed
    assert re.search(
        r"^ *4 ± 1\.5 MPa +fails in the hold .* \S+ \[\S+, \S+\].* % of draws$",
        printed,
        re.MULTILINE,
    )
    assert "The closed form takes the microstructure as frozen." in printed
    assert "The elastic modulus is E_M of the fit." in printed

    table = pd.read_csv(out)
    assert len(table) == 4 * 60
    assert sorted(set(table["median_stress_MPa"])) == [1.0, 1.5, 2.0, 4.0]
    assert table["frequency_Hz"].min() == pytest.approx(1e-4)
    assert table["frequency_Hz"].max() == pytest.approx(1.0)
    with xr.open_dataset(out.with_suffix(".nc"), engine="h5netcdf") as draws:
        assert draws.attrs["which_draws"] == small_fit.which_draws
        sizes = {"chain": 2, "draw": 100, "regime": 4, "frequency": 60}
        assert draws["tan_delta"].sizes == sizes
        median = draws["tan_delta"].median(("chain", "draw")).to_numpy().ravel()
    np.testing.assert_allclose(table["q50"], median, rtol=1e-6)
    assert out.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in out.with_suffix(".svg").read_text(encoding="utf-8")
    assert len(list(out.parent.iterdir())) == 4


@pytest.mark.parametrize(("temperature", "beyond"), [(260.0, False), (271.0, True)])
@pytest.mark.usefixtures("sketched")
def test_what_speaks_against_a_prediction_is_said_before_it(
    small_fit: Fit, tmp_path: Path, cli: CommandLine, temperature: float, beyond: bool
) -> None:
    out = tmp_path / "tan_delta.csv"
    options = ("--temperature-K", temperature, "--frequencies-Hz", "1e-3")
    printed = predict(cli, small_fit, out, *options)
    with xr.open_dataset(out.with_suffix(".nc"), engine="h5netcdf") as draws:
        cautions = draws.attrs["cautions"].splitlines()
    assert small_fit.sampled_well is Outcome.NO  # 200 draws
    assert cautions[0] == ORIGINS["synthetic"]
    assert cautions[1] == small_fit.verdicts()[CheckKind.SAMPLING].sentence
    told = "Beyond what was fitted: temperature 271 K (fitted: 260);"
    assert any(one.startswith(told) for one in cautions) is beyond
    table = printed.index("4 ± 1.5 MPa")
    assert all(0 <= printed.index(one) < table for one in cautions)


def test_measured_points_are_drawn_over_the_prediction(
    small_fit: Fit, tmp_path: Path, cli: CommandLine
) -> None:
    out, points = tmp_path / "tan_delta.csv", tmp_path / "points.csv"
    points.write_text("frequency_Hz,tan_delta,series\n0.01,0.3,ours\n", encoding="utf-8")
    predict(cli, small_fit, out, "--frequencies-Hz", "1e-3", "0.1", "--measured", points)
    assert ">ours<" in out.with_suffix(".svg").read_text(encoding="utf-8")


OPTIONS: dict[str, tuple[tuple[Regime, ...], dict[str, Any]]] = {
    "--median-stress-MPa 0.5 3 --amplitude-MPa 0.1 0.2 --temperature-K 250 --grain-size-um 500 "
    "--fabric-factor 0.6": (
        (Regime(0.5e6, 0.1e6), Regime(3e6, 0.2e6)),
        {"temperature": 250.0, "grain_size": 500e-6, "fabric_factor": 0.6},
    ),
    "--microstructure steady-state": (PAPER_REGIMES, {"microstructure": "steady_state"}),
    "--hold-time-h 2 --critical-share 0.2": (
        PAPER_REGIMES,
        {"hold_time": 7200.0, "critical_share": 0.2},
    ),
    "--elastic-modulus-Pa 9.3e9 1e8 --seed 4": (
        PAPER_REGIMES,
        {"elastic_modulus": 9.3e9, "elastic_modulus_sd": 1e8, "seed": 4},
    ),
}
"""Options in the units of their names, and what is given to `predict_attenuation` by them."""


@pytest.mark.usefixtures("sketched")
@pytest.mark.parametrize("options", OPTIONS)
def test_options_are_in_table_and_draws(
    options: str, small_fit: Fit, tmp_path: Path, cli: CommandLine
) -> None:
    out, (regimes, given) = tmp_path / "tan_delta.csv", OPTIONS[options]
    printed = predict(cli, small_fit, out, *options.split(), "--frequencies-Hz", "1e-4", "1e-2")
    told = "The elastic modulus is given: 9.3 ± 0.1 GPa."
    assert (told in printed) == ("elastic_modulus" in given)
    expected = predict_attenuation(small_fit, [1e-4, 1e-2], regimes, **given)
    mean = expected.mean(("chain", "draw"))
    table = pd.read_csv(out)
    np.testing.assert_allclose(table["amplitude_MPa"], np.repeat(mean["amplitude"], 2) / 1e6)
    np.testing.assert_allclose(table["mean"], mean["tan_delta"].to_numpy().ravel())
    fails = expected["frozen_fails"].mean(("chain", "draw")).to_numpy()
    np.testing.assert_allclose(table["p_frozen_fails"], fails.ravel())
    with xr.open_dataset(out.with_suffix(".nc"), engine="h5netcdf") as draws:
        np.testing.assert_array_equal(draws["frozen_fails"], expected["frozen_fails"])
        np.testing.assert_allclose(draws["cycle_strain"], expected["cycle_strain"], rtol=1e-6)
        assert float(draws["hold_time"]) == float(expected["hold_time"])


@pytest.mark.usefixtures("sketched")
def test_an_evolving_microstructure_is_solved_at_chosen_points(
    small_fit: Fit, tmp_path: Path, cli: CommandLine
) -> None:
    out = tmp_path / "tan_delta.csv"
    options = ("--regimes", "1", "4", "--hold-time-h", "1", "--evolving", "1e-3", "0.1")
    printed = predict(cli, small_fit, out, *options)
    assert "Evolving: the hold of 1 h and 3 cycles after it are solved in time" in printed
    table = pd.read_csv(tmp_path / "tan_delta_evolving.csv")
    assert table["frequency_Hz"].tolist() == [1e-3, 0.1, 1e-3, 0.1]
    assert table["median_stress_MPa"].tolist() == [1.0, 1.0, 4.0, 4.0]
    assert (table["evolving_q50"] > table["frozen_q50"]).all()
    with xr.open_dataset(tmp_path / "tan_delta_evolving.nc", engine="h5netcdf") as draws:
        assert draws["tan_delta_evolving"].sizes == {"draw": 100, "regime": 2, "frequency": 2}
        assert draws.attrs["which_draws"] == small_fit.which_draws
    for suffix in (".csv", ".nc"):
        assert str(tmp_path / f"tan_delta_evolving{suffix}") in printed
    assert len(list(tmp_path.iterdir())) == 6


@pytest.mark.usefixtures("sketched")
def test_a_joint_fit_predicts_for_each_of_its_tests(
    joint: Fit, tmp_path: Path, cli: CommandLine
) -> None:
    options = ("--frequencies-Hz", "1e-3", "1e-2")
    predict(cli, joint, tmp_path / "all.csv", *options)
    names = [*joint.tests()]
    assert len(names) == 2
    expected = {f"all_{name}.{kind}" for name in names for kind in ("csv", "nc", "png", "svg")}
    assert {path.name for path in tmp_path.iterdir()} == expected
    for name in names:
        table = pd.read_csv(tmp_path / f"all_{name}.csv")
        tan_delta = predict_attenuation(joint[name], [1e-3, 1e-2])["tan_delta"]
        np.testing.assert_allclose(
            table["mean"], tan_delta.mean(("chain", "draw")).to_numpy().ravel()
        )
        one = tmp_path / "one.csv"
        predict(cli, joint, one, "--test", name, *options)
        pd.testing.assert_frame_equal(pd.read_csv(one), table)


@pytest.mark.usefixtures("sketched")
def test_temperatures_of_all_tests_of_a_joint_fit_were_fitted(
    joint: Fit, tmp_path: Path, cli: CommandLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = joint.problem.experiments
    warmer = replace(second, temperature=second.temperature + 5.0)
    problem = replace(joint.problem, experiments=(first, warmer))
    monkeypatch.setattr(Fit, "load", lambda _: replace(joint, problem=problem))
    options = ("--test", first.id, "--frequencies-Hz", "1e-3", "--temperature-K")
    inside, outside = (
        predict(cli, joint, tmp_path / "a.csv", *options, temperature) for temperature in (263, 266)
    )
    assert "Beyond what was fitted: temperature" not in inside
    assert "temperature 266 K (fitted: 260 to 265)" in outside


@pytest.mark.usefixtures("sketched")
def test_a_pressure_is_said_to_be_beyond_what_was_fitted(
    small_fit: Fit, tmp_path: Path, cli: CommandLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    posterior = small_fit.posterior.copy()
    volume = xr.full_like(posterior["posterior"].to_dataset()["maxwell_modulus"], 1e-5)
    posterior["posterior"] = posterior["posterior"].assign(activation_volume=volume)
    monkeypatch.setattr(Fit, "load", lambda _: replace(small_fit, posterior=posterior))
    options = ("--frequencies-Hz", "1e-3", "--pressure-MPa", "300")
    told = r"^Beyond what was fitted: .*; pressure 300 MPa \(fitted: not stated\)\.$"
    printed = predict(cli, small_fit, tmp_path / "deep.csv", *options)
    assert re.search(told, printed, re.MULTILINE)


def test_the_pressure_of_a_fitted_test_is_that_of_its_prediction(small_fit: Fit) -> None:
    (own,) = small_fit.problem.experiments
    deep = replace(small_fit.problem, experiments=(replace(own, environment={"pressure": 3e8}),))
    cautions = predict_attenuation(replace(small_fit, problem=deep), [0.1]).attrs["cautions"]
    assert "pressure" not in cautions
