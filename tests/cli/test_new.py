"""`pyburgers new`: a file that can be read, whose guesses are right and told."""

import io
import math
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from refusals import assert_refused
from small_inputs import DATA

from pyburgers.cli.main import main
from pyburgers.common.text_tables import look_at
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.experiment import CONDITION_KEYS, Experiment
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.guessed_columns import guess_columns
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.loading_history.experiment import HistoryExperiment

KNOWN = ("--material", "ice", "--temperature-K", "263", "--grain-size-m", "1e-3")
RATE = ("--strain-rate-per-s", "1e-5")


def made(path: Path, *options: str) -> Experiment:
    """File for a text file, read as a fit reads it."""
    assert main(["new", str(path), *KNOWN, *options]) == 0
    return load_experiment(path.with_suffix(".toml"))


@pytest.mark.parametrize(
    ("text", "strain", "stress"),
    [
        ("strain,stress\n0.001,2\n0.02,3\n", [0.001, 0.02], [2e6, 3e6]),
        ("stress_GPa;strain (%)\n".replace(";", ",") + "0.2,0.1\n0.3,20\n", [0.001, 0.2], None),
        ("# eps [-]  sigma [MPa]\n0.001 2\n0.02 3\n", [0.001, 0.02], [2e6, 3e6]),
        ("0.001\t2e6\n0.02\t3e6\n", [0.001, 0.02], [2e6, 3e6]),
        ("Axial strain (%)\tnote\tStress (MPa)\n0.1\t\t2\n2\tb\t3\n", None, [2e6, 3e6]),
        ("Strain  (%)   Stress (MPa)\n0.1 2\n2 3\n", None, [2e6, 3e6]),
        ('"Strain, true (%)","Stress, mean"\n0.1,2\n2,3\n', None, [2e6, 3e6]),
        ("strain;stress\n0,001;2\n0,02;3\n", None, [2e6, 3e6]),
        ("strain,stress\n-0.001,-2\n-0.02,-3\n", None, [2e6, 3e6]),
        ("note,shortening percent,differential stress (Pa)\na,0.1,2e6\nb,2,3e6\n", None, None),
    ],
)
def test_curves_are_told_by_names_and_numbers(
    text: str, strain: list[float] | None, stress: list[float] | None, tmp_path: Path
) -> None:
    path = tmp_path / "my curve.csv"
    path.write_text(text, encoding="utf-8")
    test = made(path, *RATE)
    assert isinstance(test, ConstantRateExperiment)
    assert test.id == "my_curve"
    assert test.segments[0].strain_rate == 1e-5
    np.testing.assert_allclose(test.strain, [0.001, 0.02] if strain is None else strain)
    if stress is not None:
        np.testing.assert_allclose(test.stress, stress)


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
    test = load_experiment(file)
    assert isinstance(test, ConstantRateExperiment)
    assert [one.strain for one in test.microstructure] == [strain]


def test_creep_at_a_constant_stress(tmp_path: Path) -> None:
    path = tmp_path / "creep.csv"
    path.write_text("time_h,strain (%)\n0,0\n10,0.4\n20,0.7\n50,1.3\n", encoding="utf-8")
    test = made(path, "--stress-MPa", "0.8")
    assert isinstance(test, HistoryExperiment)
    (stage,) = test.stages
    assert (stage.control, stage.value, stage.end_time) == ("stress", 0.8e6, 50 * 3600)
    np.testing.assert_allclose(test.reading, [0.004, 0.007, 0.013])
    assert test.notices[0].endswith("was dropped: it is of the state before the load.")


def test_a_relaxation_has_to_have_its_loading(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "relaxation.csv"
    path.write_text("time_s,stress (MPa)\n0,10\n1,9\n5,8\n20,7\n", encoding="utf-8")
    command = ["new", str(path), *KNOWN, "--protocol", "loading_history"]
    assert main(command) == 2
    assert capsys.readouterr().err.startswith(
        "pyburgers: Missing: --held-strain, --loading-time. Prompts are off"
    )
    loading = ("--hold-start-time", "inf", "--strain-rate-per-s", "0")
    assert main([*command, *loading]) == 2
    assert "expected the loading as a stage ahead of it" in capsys.readouterr().err
    assert not path.with_suffix(".toml").exists()


@pytest.mark.parametrize(
    ("text", "because"),
    [
        ("time_s,stress\n1,2\n20,3\n", "because there are time and stress"),
        ("strain,stress\n0.001,2\n0.02,3\n", "because there are strain and stress"),
        ("foo,bar\n1,2\n", None),
        ("", None),
    ],
)
def test_a_reason_is_told_that_holds(
    text: str, because: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    assert main(["new", str(path), *KNOWN, *RATE]) == (2 if because is None else 0)
    out = capsys.readouterr().out
    assert ("guessed: protocol" in out) == (because is not None)
    assert because is None or because in out


def test_creep_under_a_measured_stress(tmp_path: Path) -> None:
    path = tmp_path / "creep.csv"
    rows = "".join(f"{t},{0.1 * math.log1p(t):.5f},{0.8 + 1e-4 * t}\n" for t in range(40))
    path.write_text(f"time (min),strain (%),stress (MPa)\n{rows}", encoding="utf-8")
    test = made(path)
    assert isinstance(test, HistoryExperiment)
    assert test.stages[0].control == "stress_series"


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


def test_an_oscillation_about_a_stress_that_hardly_changes_is_no_creep(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{k},{math.sin(k / 6):.4f},{100 + math.sin(k / 6):.4f}\n" for k in range(200))
    path = tmp_path / "oscillation.csv"
    path.write_text(f"time_s,strain_percent,stress_MPa\n{rows}", encoding="utf-8")
    made(path, "--strain-uncertainty", "1e-3", "--stress-uncertainty", "0.1")
    assert "protocol forced_oscillation, because the strain goes" in capsys.readouterr().out


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


def test_what_was_guessed_and_taken_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "my curve.csv"
    path.write_text("strain,stress\n0.001,2\n0.02,3\n", encoding="utf-8")
    made(path, *RATE)
    out = capsys.readouterr().out
    for line in (
        "guessed: strain: column 'strain' in fraction (by its numbers)",
        "guessed: stress: column 'stress' in MPa (by its numbers)",
        "guessed: protocol constant_rate, because there are strain and stress",
        "taken: --kind measured",
        f"next: pyburgers fit '{path.with_suffix('.toml')}'",
    ):
        assert line in out.splitlines()


def test_in_a_terminal_it_asks_again_until_it_understands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "curve.csv"
    path.write_text("strain,stress\n0.001,2\n0.02,3\n", encoding="utf-8")
    answers = iter(["", "ice", "cold", "263", "", "1e-3", "1e-5", "guess", "measured", "me, 2026"])
    terminal = io.StringIO()
    monkeypatch.setattr(terminal, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stdin", terminal)
    monkeypatch.setattr("builtins.input", lambda question: next(answers))
    assert main(["new", str(path)]) == 0
    test = load_experiment(path.with_suffix(".toml"))
    assert (test.id, test.material, test.temperature) == ("curve", "ice", 263.0)
    assert test.provenance.source == "me, 2026"
    assert "found 'cold', expected a number" in capsys.readouterr().out


CURVE = "strain,stress_MPa\n0.001,2\n0.02,3\n"
CYCLES = "time_s,strain,stress_MPa,stress_sd\n" + "".join(
    f"{k},{1e-4 * math.sin(k / 6):.7f},{math.sin(k / 6):.4f},0.1\n" for k in range(200)
)
TABLE = (DATA / "ice" / "attenuation_twin.csv").read_text(encoding="utf-8")


def test_the_error_of_a_curve_is_written_where_it_is_given(tmp_path: Path) -> None:
    path = tmp_path / "curve.csv"
    path.write_text(CURVE, encoding="utf-8")
    test = made(path, *RATE, "--stress-uncertainty", "0.07")
    assert isinstance(test, ConstantRateExperiment)
    assert test.stress_uncertainty == pytest.approx(0.07e6)


NOT_TAKEN = {
    "strain error": (CURVE, RATE, ("--strain-uncertainty", "0.01"), "constant_rate takes none"),
    "stress": (CURVE, RATE, ("--stress-MPa", "77.0"), "constant_rate takes none"),
    "Poisson": (CURVE, RATE, ("--poisson-ratio", "0.3"), "constant_rate takes none"),
    "read": (
        CYCLES,
        ("--strain-uncertainty", "1e-6"),
        ("--stress-uncertainty", "0.5"),
        "read from column 'stress_sd'",
    ),
    "axial": (TABLE, ("--deformation", "axial"), ("--poisson-ratio", "0.3"), "takes none"),
}


@pytest.mark.parametrize(("text", "options", "more", "words"), NOT_TAKEN.values(), ids=NOT_TAKEN)
def test_an_option_that_the_file_would_not_hold_is_refused(
    text: str,
    options: tuple[str, ...],
    more: tuple[str, ...],
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "curve.csv"
    path.write_text(text, encoding="utf-8")
    assert main(["new", str(path), *KNOWN, *options, *more]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"pyburgers: {' '.join(more)}: ")
    assert words in error
    assert [file.name for file in tmp_path.iterdir()] == ["curve.csv"]
    made(path, *options)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--id", "../../x"), ("key 'id': found '../../x'",)),
        (("--temperature-K", "nan"), ("key 'temperature_K'",)),
        (("--source", "me\x7f"), ("not a valid TOML file",)),
        (("--id", "a b", "--grain-size-m", "7"), ("key 'id'", "key 'initial_grain_size_m'")),
    ],
)
def test_a_file_that_could_not_be_read_is_not_written(
    options: tuple[str, ...],
    words: tuple[str, ...],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "curve.csv"
    path.write_text(CURVE, encoding="utf-8")
    assert main(["new", str(path), *KNOWN, *RATE, *options]) == 2
    out, error = capsys.readouterr()
    assert error.startswith(f"pyburgers: {path.with_suffix('.toml')}: not written")
    assert error.count("\n") == 1
    assert "unfinished" not in error
    assert all(word in error for word in words)
    assert "written" not in out
    assert [file.name for file in tmp_path.iterdir()] == ["curve.csv"]
    made(path, *RATE)


@pytest.mark.parametrize(
    ("text", "error", "hint"),
    [
        ("0.001,2\n\u22120.02,3\n", "found '\u22120.02'", "write '-'"),
        ("-0.001,2\n-0.02,3\n", "found strains to -0.02", "write compression"),
        ("0.015,1,020\n0.02,1,100\n", "line 2: found 3 cells", None),
        ("0.015,1\n0.02,1_000\n", "found '1_000'", None),
        ("0.015,1\n0.02,\u0661\n", "found '\u0661'", None),
        ('0.015,1\n0.02,"2\n', "line 3: found a quotation mark that is not closed", None),
    ],
)
def test_a_draft_is_written_of_a_table_with_bad_rows(
    text: str, error: str, hint: str | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "curve.csv"
    path.write_text(f"strain,stress\n{text}", encoding="utf-8")
    assert main(["new", str(path), *KNOWN, *RATE]) == 2
    told = capsys.readouterr().out.splitlines()
    assert any(error in line for line in told if line.startswith("error: "))
    assert hint is None or any(hint in line for line in told if line.startswith("hint: "))
    draft = path.with_suffix(".toml")
    assert draft.read_text(encoding="utf-8").startswith("# This draft cannot be used yet:\n# - ")
    path.write_text("strain,stress\n0.001,1\n0.02,2\n", encoding="utf-8")
    assert load_experiment(draft).n_points == 2


def test_what_is_wrong_with_a_table_is_told_though_no_column_is_known(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "curve.txt"
    path.write_text("Wert a b\n0.1 2\n0.2 3\n", encoding="utf-8")
    assert main(["new", str(path), *KNOWN, *RATE]) == 2
    assert "found 3 words for names (Wert a b) above 2 columns" in capsys.readouterr().out


REFUSED = {
    "no terminal": ("strain,stress\n0.001,2\n", (), ("--material", "--strain-rate-per-s")),
    "no such columns": ("force,length\n1,2\n", (*KNOWN, *RATE), ("strain or time", "protocol")),
    "no numbers": ("strain,stress\n", (*KNOWN, *RATE), ("no column",)),
}


@pytest.mark.parametrize(("text", "options", "words"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_described_is_refused(
    text: str,
    options: tuple[str, ...],
    words: tuple[str, ...],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "curve.csv"
    path.write_text(text, encoding="utf-8")
    assert main(["new", str(path), *options]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert all(word in error for word in words)
    assert not path.with_suffix(".toml").exists()


@pytest.mark.parametrize("path", [".", ".."])
def test_a_folder_is_no_table(path: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert_refused(main(["new", path, *KNOWN, *RATE]), capsys, "is a folder; expected a file")


def test_a_file_that_is_there_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "curve.csv"
    path.write_text("strain,stress\n0.001,2\n0.02,3\n", encoding="utf-8")
    path.with_suffix(".toml").write_text("mine", encoding="utf-8")
    assert_refused(main(["new", str(path), *KNOWN, *RATE]), capsys, "exists already")
    assert path.with_suffix(".toml").read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize(
    ("names", "protocol", "words"),
    [
        ("strain,stress (kPa)", "constant_rate", ("'stress (kPa)'", "Pa, MPa or GPa")),
        ("microstrain,stress", "constant_rate", ("'microstrain'", "fraction or percent")),
        ("shortening (mm),stress", "constant_rate", ("'shortening (mm)'",)),
        ("strain,load_kN", "constant_rate", ("'load_kN'",)),
        (
            "time (days),strain,stress",
            "loading_history",
            ("'time (days)'", "s, min or h; convert"),
        ),
        ("log10 time (s),strain,stress", "loading_history", ("'log10 time (s)'",)),
        ("frequency (mHz),tan_delta", "attenuation", ("'frequency (mHz)'", "Hz or rad/s")),
        ("omega (Hz),tan_delta", "attenuation", ("'omega (Hz)'",)),
        ("period_s,ln(1/Q)", "attenuation", ("'ln(1/Q)'", "log10 of them")),
        ("period_s,tan_delta,median_MPa,ampl_Pa", "attenuation", ("found Pa, expected MPa",)),
        ("period_s,tan_delta,G_GPa,G_err_MPa", "attenuation", ("found MPa, expected GPa",)),
    ],
)
def test_a_unit_that_the_file_could_not_hold_is_refused(
    names: str,
    protocol: str,
    words: tuple[str, ...],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "table.csv"
    rows = ["0.1,0.2,0.3,0.4", "0.2,0.3,0.4,0.5", "0.3,0.4,0.5,0.6"]
    n_columns = names.count(",") + 1
    table = [names, *(",".join(row.split(",")[:n_columns]) for row in rows)]
    path.write_text("\n".join(table) + "\n", encoding="utf-8")
    assert main(["new", str(path), *KNOWN, "--protocol", protocol]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"pyburgers: {path}: column ")
    assert error.count("\n") == 1
    assert all(word in error for word in words)
    assert not path.with_suffix(".toml").exists()


@pytest.mark.parametrize("name", ["strain (mm/mm)", "eps (-)", "axial strain [m/m]"])
def test_a_strain_of_lengths_is_a_fraction(name: str, tmp_path: Path) -> None:
    path = tmp_path / "curve.csv"
    path.write_text(f"{name},stress (kPa) in MPa\n0.001,2\n0.02,3\n", encoding="utf-8")
    test = made(path, *RATE)
    assert isinstance(test, ConstantRateExperiment)
    np.testing.assert_allclose(test.strain, [0.001, 0.02])


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


def test_a_column_of_errors_that_is_left_out_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "curve.csv"
    path.write_text("strain,stress_Pa,stress_sd\n0.001,2e6,5e3\n0.02,3e6,5e3\n", "utf-8")
    made(path, *RATE)
    out = capsys.readouterr().out.splitlines()
    reason = "such a file names no stress uncertainty beside the columns that are taken"
    assert f"left out: column 'stress_sd', because {reason}" in out


def test_creep_under_several_loads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "creep.csv"
    loads = [1.0] * 10 + [2.0] * 10 + [0.0] * 6
    rows = [f"{k},{0.01 * k**0.5},{load}" for k, load in enumerate(loads, start=1)]
    path.write_text("\n".join(["time_h,strain (%),stress (MPa)", *rows]) + "\n", "utf-8")
    test = made(path)
    assert isinstance(test, HistoryExperiment)
    assert test.stages[0].control == "stress_series"
    assert "because the stress goes in steps and stays" in capsys.readouterr().out


def test_a_curve_that_is_steep_at_first_is_no_creep(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "curve.csv"
    stress = [1.0, 2.0, 3.0, 4.0, 4.5] + [4.8, 4.81, 4.82] * 5
    rows = [f"{k},{1e-3 * k},{one}" for k, one in enumerate(stress, start=1)]
    path.write_text("\n".join(["time_s,strain,stress (MPa)", *rows]) + "\n", "utf-8")
    made(path, *RATE)
    assert "protocol constant_rate" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["Q^-1", "Q-1", "Q⁻¹", "Q^{-1}", "1/Q", "log10(Q^-1)"])
def test_attenuation_has_many_names(name: str, tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text(f"period_s,{name}\n1,0.1\n10,0.2\n", encoding="utf-8")
    assert guess_columns(look_at(path))["attenuation"].column == name


def test_a_test_in_which_nothing_is_imposed_is_not_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "creep.csv"
    path.write_text("time_h,strain (%)\n1,0.1\n10,0.4\n20,0.7\n", encoding="utf-8")
    assert main(["new", str(path), *KNOWN, "--stress-MPa", "0"]) == 2
    assert "found zero wherever a stress or a strain is imposed" in capsys.readouterr().err
    assert not path.with_suffix(".toml").exists()
