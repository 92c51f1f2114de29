"""`pyburgers check-file`: all that is wrong with a file at once, and what may be behind it."""

from pathlib import Path

import pytest
from small_inputs import CURVE, DATA

from pyburgers.cli.main import main


@pytest.mark.parametrize(
    "name",
    [
        "ice/PIL40",
        "olivine/olivine_twin",
        "ice/peak_stress_qi_goldsby_2021",
        "priors/ice",
        "priors/peak_stress/ice",
    ],
)
def test_shipped_files_have_no_errors(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-file", str(DATA / f"{name}.toml")]) == 0
    out = capsys.readouterr().out
    assert "no errors" in out
    assert "error: " not in out


def test_a_prior_file_of_peak_stresses_is_checked_as_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (DATA / "priors" / "peak_stress" / "ice.toml").read_text(encoding="utf-8")
    path = tmp_path / "priors.toml"
    path.write_text(text.replace("[parameters.beta]", "[parameters.betta]"), encoding="utf-8")
    assert main(["check-file", str(path)]) == 2
    out = capsys.readouterr().out
    assert "unknown key 'betta'" in out
    assert "key 'beta' in [parameters] is missing" in out


@pytest.mark.parametrize("command", ["fit", "check-file", "simulate"])
@pytest.mark.parametrize("content", [CURVE.encode(), CURVE.encode("utf-16"), b"PK\x03\x04\xff"])
def test_a_table_in_the_place_of_an_experiment_file(
    command: str, content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "my curve.csv"
    path.write_bytes(content)
    more = ("--parameters", "p.toml", "--out", "o.csv") if command == "simulate" else ()
    assert main([command, str(path), *more]) == 2
    out, error = capsys.readouterr()
    assert f"write an experiment file for them: pyburgers new '{path}'." in out + error


def test_a_plan_of_a_campaign_is_checked_as_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = tmp_path / "plan.toml"
    test = DATA / "ice" / "PIL40.toml"
    plan.write_text(f'id = "plan"\n[tests]\none = ["{test}"]\n', encoding="utf-8")
    assert main(["check-file", str(plan)]) == 0
    assert capsys.readouterr().out == f"{plan}: no errors\n"
    plan.write_text(f'id = "plan"\nvariant = 1\n[tests]\none = ["{test}", 2]\n', "utf-8")
    assert main(["campaign", str(plan)]) == 2
    assert capsys.readouterr().err.endswith("`pyburgers check-file` tells 1 more.\n")
    assert main(["check-file", str(plan)]) == 2
    out = capsys.readouterr().out
    assert "unknown key 'variant', did you mean 'variants'?" in out
    assert f"{plan}: 2 errors; it cannot be used yet" in out
