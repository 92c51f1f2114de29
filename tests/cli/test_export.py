"""`pyburgers export` and `simulate --from`: what a fit gives to other codes."""

import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import ICE
from refusals import CommandLine
from synthetic_olivine_fit import redrawn

import pyburgers
from pyburgers.cli.main import main
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import ORIGINS
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.problem import problem_of
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.model.pooling import DEFAULT_KINDS
from pyburgers.model.variants import with_variant
from pyburgers.predictions.exported import LEFT_OUT, LOG_FACTOR, as_latex, exported, wide_notes
from pyburgers.predictions.exports import export
from pyburgers.predictions.stated_laws import POWER_LAW


def printed(fit: Fit, kind: str, cli: CommandLine) -> str:
    return cli("export", fit.directory.path, "--format", kind)


def test_json_holds_mean_and_covariance_of_the_draws(small_fit: Fit, cli: CommandLine) -> None:
    content = json.loads(printed(small_fit, "json", cli))
    names = content["names"]
    draws = small_fit.posterior["posterior"].to_dataset()
    assert "stress_noise" not in names
    for name in ("maxwell_modulus", "stress_exponent", "beta"):
        values = draws[name].to_numpy().ravel()
        assert content["mean"][names.index(name)] == pytest.approx(values.mean())
    pair = [names.index(name) for name in ("maxwell_modulus", "kelvin_viscosity")]
    expected = np.cov(*(draws[names[k]].to_numpy().ravel() for k in pair))
    np.testing.assert_allclose(np.array(content["covariance"])[np.ix_(pair, pair)], expected)
    assert content["units"][names.index("maxwell_modulus")] == "Pa"
    # The text names the law, and what it holds for; its values: predictions/test_stated_laws.py.
    assert content["flow_law"] == POWER_LAW
    assert content["microstructure"]["undeformed"] == {
        "grain_size": f"{small_fit.experiment.initial_grain_size:g}",
        "fabric_factor": "1",
    }
    # ln A is that of the flow law written with A.
    product = (draws["beta"] * draws["activation_enthalpy"]).to_numpy()
    assert content["mean"][names.index(LOG_FACTOR)] == pytest.approx(product.mean())


def test_what_is_left_out_is_of_a_test_or_its_readings() -> None:
    assert set(PARAMETER_BY_NAME) >= LEFT_OUT
    # What tests share by default belongs to the material, but for scatter, which one kind has.
    shared = {name for name, kind in DEFAULT_KINDS.items() if kind == "shared"}
    assert shared & LEFT_OUT == {"attenuation_scatter", "modulus_scatter"}


def test_what_is_fixed_has_its_value_and_no_spread(small_fit: Fit) -> None:
    """Of numbers such as 0.55 the mean of equal draws is another, and their variance is not 0."""
    fixed = {"grain_size_exponent": 0.55, "beta": -7.29e-4}
    draws = {name: np.full((2, 100), value) for name, value in fixed.items()}
    one = exported(redrawn(small_fit, **draws))
    for name, value in fixed.items():
        place = one.names.index(name)
        assert one.mean[place] == value
        assert not one.covariance[place].any()
        assert not one.covariance[:, place].any()
    assert (one.sd > 0).any()


def test_csv_holds_the_same(small_fit: Fit, cli: CommandLine) -> None:
    table = pd.read_csv(io.StringIO(printed(small_fit, "csv", cli)))
    one = exported(small_fit)
    assert tuple(table["name"]) == one.names
    np.testing.assert_allclose(table["mean"], one.mean, rtol=1e-15)
    np.testing.assert_allclose(
        table[[f"cov_{name}" for name in one.names]], one.covariance, rtol=1e-15
    )


def test_latex_is_a_table_with_a_row_for_each(
    small_fit: Fit, tmp_path: Path, cli: CommandLine
) -> None:
    text = printed(small_fit, "latex", cli)
    one = exported(small_fit)
    body = text.split(r"\midrule")[1].split(r"\bottomrule")[0].strip().splitlines()
    assert len(body) == len(one.names)
    columns = 4 + int(np.count_nonzero(one.sd))
    assert all(row.endswith(r" \\") and row.count("&") == columns - 1 for row in body)
    out = tmp_path / "table.tex"
    cli("export", small_fit.directory.path, "--format", "latex", "--out", out)
    assert out.read_text(encoding="utf-8") == text


@pytest.mark.parametrize(
    ("name", "mean", "sd", "cells"),
    [
        ("second_rate", 1.234e-6, 2.1e-8, r"$r_2$ & 1/s & $(1.234 \pm 0.021) \times 10^{-6}$"),
        ("recovery_rate", 2e-7, 0.0, r"$r$ & 1/s & $2 \times 10^{-7}$ (fixed)"),
        (
            "modulus_temperature_coefficient",
            -3e-4,
            0.0,
            r"$a_E$ & 1/K & $-0.0003$ (fixed)",
        ),
        ("kelvin_viscosity", 2.5e16, 1e15, r"$(2.50 \pm 0.10) \times 10^{7}$"),
        ("kelvin_modulus", 1e9, 2e7, r"$E_K$ & GPa & $1.000 \pm 0.020$"),
        ("ln_mechanism_rate[basal_slip]", -18.75, 0.51, r"[\mathrm{basal\_slip}]$ & ln of SI &"),
    ],
)
def test_latex_has_rates_in_si_and_powers_of_ten(
    name: str, mean: float, sd: float, cells: str, small_fit: Fit
) -> None:
    one = replace(
        exported(small_fit),
        names=(name,),
        mean=np.array([mean]),
        covariance=np.array([[sd**2]]),
        decided_by=("data",),
        by_prior_of=("",),
    )
    assert cells in as_latex(one)


def test_exports_say_which_quantities_mean_and_covariance_do_not_describe(small_fit: Fit) -> None:
    viscosity = small_fit.posterior["posterior"]["kelvin_viscosity"].to_numpy()
    spread = np.exp(np.random.default_rng(1).normal(size=viscosity.shape))
    wide = redrawn(small_fit, kelvin_viscosity=viscosity * spread)
    (told,) = [note for note in exported(wide).notes if "use draws" in note]
    assert told == (
        "Mean and covariance are not enough for a positive quantity with a standard deviation "
        "above half of its mean (kelvin_viscosity): use draws (sample)."
    )
    assert told not in exported(small_fit).notes
    for name, mean in (("kelvin_modulus", 4.0), ("beta", -2.0), ("ln_flow_law_factor", -2.0)):
        assert wide_notes([name], np.array([mean]), np.array([[3.9]])) == ()


def test_every_format_says_who_decides_a_number(small_fit: Fit, cli: CommandLine) -> None:
    decided = small_fit.summary("SI")[["decided_by", "by_prior_of"]]
    content = json.loads(printed(small_fit, "json", cli))
    table = pd.read_csv(io.StringIO(printed(small_fit, "csv", cli)), index_col=0)
    text = printed(small_fit, "latex", cli)
    one = exported(small_fit)
    for k, name in enumerate(content["names"]):
        word, priors = content["decided_by"][k], content["by_prior_of"][k]
        if name in decided.index:
            assert [word, priors] == decided.loc[name].tolist()
        assert word == ("fixed" if one.sd[k] == 0 else word) != ""
        assert table["decided_by"][name] == word
    told = [*small_fit.prior_conflicts(), *small_fit.prior_decisions()]
    assert content["notes"] == [small_fit.which_draws, ORIGINS["synthetic"], *told]
    assert content["draws_of"] == "synthetic"
    assert set(table["draws_of"]) == {"synthetic"}
    assert ORIGINS["synthetic"] in text
    by_enthalpy = replace(
        one,
        decided_by=("prior",) * len(one.names),
        by_prior_of=("activation_enthalpy",) * len(one.names),
        notes=("n is decided by a prior.",),
    )
    assert "& prior (of $Q_M$) &" in as_latex(by_enthalpy)
    assert "\n% n is decided by a prior.\n" in as_latex(by_enthalpy)
    assert "decided by" in text


def test_every_format_says_which_draws_it_is_of(
    small_fit: Fit, joint: Fit, cli: CommandLine
) -> None:
    first = small_fit.manifest["chains"]["1"]["sha256"][:12]
    told = f"Draws of the fit: 200; SHA-256 of its first chain: {first}."
    for kind in ("json", "latex"):
        assert told in printed(small_fit, kind, cli)
    (row, *_) = pd.read_csv(io.StringIO(printed(small_fit, "csv", cli))).to_dict("records")
    assert (row["draws"], row["first_chain_sha256"]) == (200, first)
    part, other = joint["other"].which_draws, joint.which_draws
    assert part == other != small_fit.which_draws
    (text,) = export(small_fit, "pism", microstructure="initial")
    assert f"# {told}\n" in text


def test_what_does_not_correlate_has_no_sign(small_fit: Fit) -> None:
    one = exported(small_fit)
    weak = np.outer(one.sd, one.sd) * np.where(np.eye(one.sd.size), 1.0, -1e-3)
    text = as_latex(replace(one, covariance=weak))
    assert "$0.00$" in text
    assert "-0.00" not in text


def test_the_solution_of_a_draw_and_of_the_mean(
    small_fit: Fit, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    solved = small_fit.posterior["model_response"].to_dataset().stack(sample=("chain", "draw"))
    (response,) = solved.data_vars.values()
    away = (response - response.median("sample")) / response.std("sample")
    central = int((away**2).sum("point").to_numpy().argmin())
    out, run = tmp_path / "curve.csv", str(small_fit.directory.path)
    arguments = ["simulate", str(ICE / "PIL40.toml"), "--from", run, "--out", str(out)]
    draws = small_fit.posterior["posterior"].to_dataset()[list(small_fit.priors.priors)]
    for options, values in (
        ((), draws.stack(sample=("chain", "draw")).isel(sample=central)),
        (("--draw", "mean"), draws.mean()),
        (("--draw", "102"), draws.isel(chain=1, draw=1)),
    ):
        assert main([*arguments, *options]) == 0
        assert (f"note: draw {central + 1} is solved" in caplog.text) == (not options)
        assert ("no draw of the fit" in caplog.text) == ("mean" in options)
        caplog.clear()
        known = {str(name): float(one) for name, one in values.data_vars.items()}
        expected = simulate(load_experiment(ICE / "PIL40.toml"), known)
        np.testing.assert_allclose(pd.read_csv(out)["stress_Pa"], expected["stress_Pa"], rtol=1e-9)


def write_creep(path: Path, *, hours: float = 10.0, **keys: Any) -> None:
    """Write the file of an imagined test."""
    load = {"control": "stress", "start_time": 0.0, "end_time": hours, "stress": 1.0}
    keys |= {"stage_time_unit": "h", "stage_stress_unit": "MPa", "kind": "synthetic"}
    keys |= {"material": "ice", "temperature_K": 260.0, "grain_size_um": 1e3}
    pyburgers.LoadingHistory(stages=[load], **keys).to_toml(path)


def test_a_solution_from_a_run_has_what_the_file_states_as_a_prediction_has(
    small_fit: Fit, tmp_path: Path
) -> None:
    offset = {"value": 1.0, "unit": "percent"}
    cases: dict[str, dict[str, Any]] = {
        "plain": {},
        "stated": {"apparatus": {"compliance_per_Pa": 1e-9}, "strain_offset": offset},
        "force": {"stress_measure": "engineering"},
    }
    run = str(small_fit.directory.path)
    ends = {}
    for name, keys in cases.items():
        path, out = (tmp_path / f"{name}{suffix}" for suffix in (".toml", ".csv"))
        write_creep(path, **keys)
        assert main(["simulate", str(path), "--from", run, "--draw", "1", "--out", str(out)]) == 0
        solved = pd.read_csv(out)["strain"]
        # One draw alone is the first.
        assert main(["predict", run, str(path), "--draws", "1", "--out", str(out)]) == 0
        predicted = pd.read_csv(out)["strain_q50"]
        assert solved.iloc[-1] == pytest.approx(predicted.iloc[-1], rel=1e-5)
        ends[name] = solved.iloc[-1]
    assert ends["stated"] - ends["plain"] == pytest.approx(1e-2 + 1e-9 * 1e6, rel=1e-6)
    # Under a constant force the area grows.
    assert 0 < ends["force"] < 0.998 * ends["plain"]


def test_a_solution_from_a_run_keeps_grains_that_the_fit_kept(
    small_fit: Fit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    test = small_fit.experiment
    priors = with_variant(small_fit.priors, test, {"grain_size": "constant"})
    frozen = replace(small_fit, problem=problem_of([test], priors))
    path, out = tmp_path / "creep.toml", tmp_path / "creep.csv"
    write_creep(path, hours=1e3)
    sizes = []
    for fit in (small_fit, frozen):
        monkeypatch.setattr(Fit, "load", lambda _, fit=fit: fit)
        assert main(["simulate", str(path), "--from", "run", "--draw", "1", "--out", str(out)]) == 0
        sizes.append(pd.read_csv(out)["grain_size_m"].to_numpy())
    assert sizes[0][-1] < 0.9e-3
    np.testing.assert_allclose(sizes[1], 1e-3, rtol=1e-9)
