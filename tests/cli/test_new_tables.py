"""`pyburgers new` of tables whose numbers, and what they do, are easily taken for others."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from refusals import CommandLine

from pyburgers.common.text_tables import look_at
from pyburgers.kinds.guessed_columns import guess_columns

KNOWN = ("--material", "ice", "--grain-size-m", "1e-3")
AT_263 = (*KNOWN, "--temperature-K", "263")
RATE = ("--strain-rate-per-s", "1e-5")


def written(folder: Path, head: str, rows: Sequence[str] | np.ndarray, sign: str = ",") -> Path:
    """Write a table; rows are texts or numbers."""
    lines = [one if isinstance(one, str) else sign.join(f"{x:.8g}" for x in one) for one in rows]
    path = folder / "table.csv"
    path.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
    return path


def test_points_that_separate_thousands_beside_decimal_commas_are_named(
    tmp_path: Path, cli: CommandLine
) -> None:
    rows = ["10;0,1;936", "20;0,2;991", "30;0,3;1.039", "1.040;0,4;1.103.000"]
    path = written(tmp_path, "Zeit [s];Dehnung [%];Spannung [MPa]", rows)
    errors = [
        one
        for one in cli("new", path, *AT_263, *RATE, code=2).splitlines()
        if one.startswith("error: ")
    ]
    assert len(errors) == 1
    assert "line 4: found '1.039' (and in 1 more lines) beside decimal commas" in errors[0]
    path.write_text(path.read_text("utf-8").replace(".", ""), encoding="utf-8")
    cli("check-file", path.with_suffix(".toml"))


def test_commas_between_thousands_are_to_be_removed(tmp_path: Path, cli: CommandLine) -> None:
    path = written(tmp_path, "Strain (%);Stress (MPa)", ["0.1;991", "0.2;1,039", "0.3;1,103"])
    assert "remove a comma between thousands" in cli("new", path, *AT_263, *RATE, code=2)


STRAIN = np.linspace(0, 0.08, 161)
CURVE = 300 * (1 - np.exp(-np.maximum(STRAIN - 0.02, 0) / 0.003))


@pytest.mark.parametrize(
    "stress", [20 + CURVE, CURVE * np.minimum(STRAIN / 0.03, 1) ** 2], ids=["friction", "slack"]
)
def test_slack_and_friction_at_one_rate_are_no_steps_of_a_load(
    stress: np.ndarray, tmp_path: Path, cli: CommandLine
) -> None:
    rows = np.column_stack([STRAIN / 1e-5, 100 * STRAIN, stress])
    path = written(tmp_path, "Time (s),Strain (%),Stress (MPa)", rows)
    assert "protocol constant_rate" in cli("new", path, *AT_263)


FALLING = np.geomspace(3e-6, 1e-6, 40)
GROWING = np.linspace(0.1, 5, 40)
RISING = 5 * (1 - np.exp(-GROWING))


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("Strain rate (1/s)", np.repeat([1e-5, 3e-5, 1e-5], [20, 10, 10])),
        ("Strain rate (1/s)", np.repeat([1e-6, 1e-5], [10, 30])),
        ("log10 strain rate", np.log10(FALLING)),
    ],
)
def test_a_column_of_rates_that_leave_the_stated_one_is_told(
    name: str, column: np.ndarray, tmp_path: Path, cli: CommandLine
) -> None:
    path = written(tmp_path, f"Strain (%),Stress (MPa),{name}", np.c_[GROWING, RISING, column])
    out = cli("new", path, *AT_263, *RATE)
    assert f"column {name!r} holds mostly" in out
    assert "check: " not in out


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("Strain rate (1/s)", 1e-5 * np.exp(0.5 * np.sin(np.arange(400) ** 2))),
        ("log strain rate (1/s)", np.full(400, 1e-5)),
        ("log10 strain rate (1/s)", np.full(400, -5.0)),
    ],
)
def test_rates_that_scatter_about_the_stated_one_are_no_matter(
    name: str, column: np.ndarray, tmp_path: Path, cli: CommandLine
) -> None:
    strain = np.linspace(0.1, 5, 400)
    rows = np.c_[strain, 5 * (1 - np.exp(-strain)), column]
    path = written(tmp_path, f"Strain (%),Stress (MPa),{name}", rows)
    assert "check both" not in cli("new", path, *AT_263, *RATE)


@pytest.mark.parametrize(("stress", "is_told"), [(np.full(40, 0.8), True), (RISING, False)])
def test_a_steady_stress_without_times_may_be_creep(
    stress: np.ndarray, is_told: bool, tmp_path: Path, cli: CommandLine
) -> None:
    path = written(tmp_path, "Strain (%),Stress (MPa)", np.c_[GROWING, stress])
    assert ("If the stress was imposed" in cli("new", path, *AT_263, *RATE)) == is_told


@pytest.mark.parametrize(
    ("celsius", "is_wide"),
    [
        (np.where(np.arange(40) == 7, -1.0, -10.0), False),
        (np.linspace(-13, -7, 40), True),
        (np.linspace(-11, -9, 40), False),
    ],
)
def test_the_temperature_of_a_test_is_the_median_of_its_column(
    celsius: np.ndarray, is_wide: bool, tmp_path: Path, cli: CommandLine
) -> None:
    path = written(tmp_path, "Strain (%),Stress (MPa),T (C)", np.c_[GROWING, RISING, celsius])
    out = cli("new", path, *KNOWN, *RATE)
    assert "taken: --temperature-K 263.15\n" in out
    assert ("as temperature_sd_K" in out) == (np.ptp(celsius) > 2.1)
    assert ("but the test is at 263.15 K; check both" in out) == is_wide
    toml = path.with_suffix(".toml")
    stated = toml.read_text("utf-8").replace("# temperature_sd_K = 2.0", "temperature_sd_K = 2.0")
    toml.write_text(stated, encoding="utf-8")
    assert "check both" not in cli("check-file", toml)


def test_a_test_that_starts_where_the_strain_goes_on_is_told(
    tmp_path: Path, cli: CommandLine
) -> None:
    first = np.c_[np.ones(40), GROWING - 0.1, RISING - RISING[0]]
    second = first + np.array([1, 5, 0])
    path = written(tmp_path, "Test,Strain (%),Stress (MPa)", np.r_[first, second])
    assert 'read the first with rows = { "Test" = "1" } in [data]' in cli(
        "new", path, *AT_263, *RATE
    )


@pytest.mark.parametrize(("share", "is_told"), [(0.01, False), (0.1, True)])
def test_a_loss_modulus_that_contradicts_the_attenuation_is_told(
    share: float, is_told: bool, tmp_path: Path, cli: CommandLine
) -> None:
    storage = np.array([8500.0, 8700.0, 8900.0])
    rows = np.c_[[0.1, 1.0, 10.0], storage, share * storage, np.full(3, 0.01)]
    path = written(tmp_path, "Frequency (Hz),E' (MPa),E'' (MPa),tan delta", rows)
    cli("new", path, *AT_263, "--deformation", "axial")
    said = "is 10 times the tan(delta) of 'tan delta' in the median"
    assert (said in cli.out) == is_told
    assert (said in cli("check-file", path.with_suffix(".toml"), code=None)) == is_told


@pytest.mark.parametrize(
    ("head", "row", "words"),
    [
        ("Strain (%),Stress (MPa)", "0.1,0.78 ± 0.05", "; write the error in a column of its own"),
        ("Strain (%),Stress (MPa)", "0.1,0.78(5)", "; write the error in a column of its own"),
        ("Strain (%),Stress (MPa)", "0.1,high", "line 2, column 'Stress (MPa)': found 'high'"),
        ("log10 t (s),stress (MPa)", "-1,11", "column 'log10 t (s)' is a logarithm by its name"),
        ("log10 To (s),log10 Q^-1", "0.4,-1.8", "column 'log10 To (s)' is a logarithm by its name"),
    ],
)
def test_what_keeps_a_column_of_the_right_name_from_being_read_is_named(
    head: str, row: str, words: str, tmp_path: Path, cli: CommandLine
) -> None:
    path = written(tmp_path, head, [row] * 3)
    cli("new", path, *AT_263, code=2)
    error = cli.error
    assert words in error
    if "line 2" in error:
        cli("new", path, *AT_263, "--stress-column", "Stress (MPa)", code=2)
        assert cli.error == error


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("err G (GPa)", "modulus"),
        ("sd G (GPa)", "modulus"),
        ("uncertainty of G (GPa)", "modulus"),
        ("Std. dev. G (GPa)", "modulus"),
        ("dG (GPa)", "modulus"),
        ("σ_G (GPa)", "modulus"),
        ("G err (GPa)", "modulus"),
        ("σ(Q-1)", "attenuation"),
        ("err 1/Q", "attenuation"),
    ],
)
def test_words_and_signs_of_an_error_may_stand_ahead(
    name: str, quantity: str, tmp_path: Path
) -> None:
    rows = np.c_[[1.0, 10.0], [0.02, 0.03], [60.0, 58.0], [0.001, 0.001]]
    columns = guess_columns(look_at(written(tmp_path, f"Period (s),1/Q,G (GPa),{name}", rows)))
    assert columns[f"{quantity}_uncertainty"].column == name
    assert not columns[quantity].rivals


def test_a_difference_of_stresses_is_no_error(tmp_path: Path) -> None:
    rows = np.c_[GROWING, RISING, 2 * RISING]
    columns = guess_columns(look_at(written(tmp_path, "Strain (%),dσ (MPa),σ (MPa)", rows)))
    assert columns["stress"].column == "dσ (MPa)"
