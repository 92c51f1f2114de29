"""`pyburgers new`: a file that can be read, whose guesses are right and told."""

import math
import shutil
from pathlib import Path

import numpy as np
import pytest
from refusals import CommandLine
from small_inputs import DATA

from pyburgers.cli.main import main
from pyburgers.common.text_tables import look_at
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.experiment import CONDITION_KEYS, Experiment, of_kind
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.guessed_columns import guess_columns
from pyburgers.kinds.kind import load_experiment

KNOWN = ("--material", "ice", "--temperature-K", "263", "--grain-size-m", "1e-3")
RATE = ("--strain-rate-per-s", "1e-5")


def made(path: Path, *options: str) -> Experiment:
    """File for a text file, read as a fit reads it."""
    assert main(["new", str(path), *KNOWN, *options]) == 0
    return load_experiment(path.with_suffix(".toml"))


def test_a_number_of_the_sample_is_no_amplitude(tmp_path: Path) -> None:
    path = tmp_path / "curve.csv"
    path.write_text("sample,strain,stress\n4506,0.001,2\n4506,0.02,3\n", encoding="utf-8")
    assert guess_columns(look_at(path)).keys() == {"strain", "stress"}
    path.write_text("ampl (MPa),stress_amplitude_MPa\n1,2\n3,4\n", encoding="utf-8")
    assert guess_columns(look_at(path)).keys() == {"amplitude"}


def proposed(path: Path) -> str:
    """Text of a file with the keys that it proposes in comments, but for free text."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return "\n".join(line.removeprefix("# ") for line in lines if "..." not in line)


@pytest.mark.parametrize(
    ("text", "strain"),
    [
        ("strain (%),stress (MPa)\n0.1,2\n21,3\n", 0.2),
        ("strain,stress (MPa)\n0.001,2\n0.21,3\n", 0.2),
        ("time_s,stress (MPa)\n100,2\n21000,3\n", 0.2),
    ],
)
def test_a_proposed_microstructure_is_at_a_strain_of_the_test(
    text: str, strain: float, tmp_path: Path
) -> None:
    path = tmp_path / "curve.csv"
    path.write_text(text, encoding="utf-8")
    made(path, *RATE)
    file = path.with_suffix(".toml")
    file.write_text(proposed(file), encoding="utf-8")
    test = of_kind(load_experiment(file), ConstantRateExperiment)
    assert [one.strain for one in test.microstructure] == [strain]


def test_an_oscillation_in_one_table(tmp_path: Path) -> None:
    rows = "".join(
        f"{10 * k},{1e-4 * math.sin(k / 6) + 1e-6 * k},{20 * math.sin(k / 6 + 0.3)}\n"
        for k in range(200)
    )
    path = tmp_path / "oscillation.csv"
    path.write_text(f"time_s,strain,stress_MPa\n{rows}", encoding="utf-8")
    test = made(path, "--strain-uncertainty", "1e-6", "--stress-uncertainty", "0.5")
    assert isinstance(test, OscillationExperiment)
    assert test.prepared.period == pytest.approx(2 * math.pi * 60, rel=0.01)
    np.testing.assert_allclose(test.record.stress_uncertainty, 0.5e6)


def test_a_table_of_attenuation(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    shutil.copy(DATA / "ice" / "attenuation_twin.csv", path)
    test = made(path, "--deformation", "axial")
    written = path.with_suffix(".toml").read_text(encoding="utf-8")
    assert not any(key in written for keys in CONDITION_KEYS.values() for key in keys)
    twin = load_experiment(DATA / "ice" / "attenuation_twin.toml")
    assert isinstance(test, AttenuationExperiment)
    assert isinstance(twin, AttenuationExperiment)
    np.testing.assert_allclose(test.readings.tan_delta, twin.readings.tan_delta)
    np.testing.assert_allclose(test.readings.modulus, twin.readings.modulus)
    np.testing.assert_allclose(test.conditions.period, twin.conditions.period)
    np.testing.assert_allclose(test.conditions.median_stress, twin.conditions.median_stress)


def test_what_looks_like_a_quantity_and_is_another_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "curve.csv"
    path.write_text(
        "confining_pressure_MPa,strain_rate,radial strain,strain,stress_MPa\n"
        "50,1e-5,0.1,0.001,2\n50,1e-5,0.2,0.02,3\n",
        encoding="utf-8",
    )
    columns = guess_columns(look_at(path))
    assert {name: one.column for name, one in columns.items()} == {
        "strain": "strain",
        "stress": "stress_MPa",
    }
    path.write_text("period_s,loss modulus (GPa),strain_amplitude,1/Q\n1,2,1e-5,0.1\n", "utf-8")
    columns = guess_columns(look_at(path))
    assert {name: one.column for name, one in columns.items()} == {
        "loss_modulus": "loss modulus (GPa)",
        "attenuation": "1/Q",
        "period": "period_s",
    }


@pytest.mark.parametrize("name", ["Q^-1", "Q-1", "Q⁻¹", "Q^{-1}", "1/Q", "log10(Q^-1)"])
def test_attenuation_has_many_names(name: str, tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text(f"period_s,{name}\n1,0.1\n10,0.2\n", encoding="utf-8")
    assert guess_columns(look_at(path))["attenuation"].column == name


@pytest.mark.parametrize(
    ("numbers", "form", "said", "code"),
    [
        ("-1.5 -0.5", "log10_tan_delta", " as logarithms to base 10 (by its numbers; check it)", 0),
        ("-0.0003 0.02", "tan_delta", "", 2),
    ],
)
def test_attenuation_without_a_form_is_a_logarithm_if_all_of_it_is_negative(
    numbers: str, form: str, said: str, code: int, tmp_path: Path, cli: CommandLine
) -> None:
    path = tmp_path / "table.csv"
    first, last = numbers.split()
    path.write_text(f"period_s,Q^-1\n1,{first}\n10,{last}\n", encoding="utf-8")
    assert f"guessed: attenuation: column 'Q^-1'{said}\n" in cli(
        "new", path, *KNOWN, "--deformation", "axial", code=code
    )
    assert f'attenuation_form = "{form}"' in path.with_suffix(".toml").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "name", ["Bulk modulus (GPa)", "Unrelaxed modulus (GPa)", "Peak-to-peak stress (MPa)"]
)
def test_what_resembles_a_reading_of_attenuation_is_left_out(
    name: str, tmp_path: Path, cli: CommandLine
) -> None:
    path = tmp_path / "table.csv"
    path.write_text(f"Period (s),1/Q,{name}\n1,0.1,50\n10,0.2,50\n", encoding="utf-8")
    out = cli("new", path, *KNOWN, "--deformation", "axial")
    assert f"left out: column {name!r}, because its name " in out
    assert "relaxation" not in out


@pytest.mark.parametrize("name", ["Mean stress (MPa)", "Mittelspannung [MPa]"])
def test_a_mean_stress_is_the_median_of_cycles_and_no_stress_of_a_curve(
    name: str, tmp_path: Path
) -> None:
    path = tmp_path / "table.csv"
    path.write_text(f"Period (s),1/Q,{name},Amplitude (MPa)\n1,0.1,5,2\n10,0.2,5,2\n", "utf-8")
    test = made(path, "--deformation", "axial")
    assert isinstance(test, AttenuationExperiment)
    np.testing.assert_allclose(test.conditions.median_stress, 5e6)
    path.write_text(f"Strain (%),{name}\n1,5\n2,6\n", encoding="utf-8")
    assert "stress" not in guess_columns(look_at(path))
