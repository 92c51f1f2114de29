"""`pyburgers new` of files as others write them: which column is what, which kind of test it is."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from refusals import CommandLine
from terminal import answer_with

from pyburgers.cli.main import main
from pyburgers.common.text_tables import look_at
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.experiment import of_kind
from pyburgers.kinds.guessed_columns import guess_columns
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.loading_history.experiment import HistoryExperiment

KNOWN = ("--material", "ice", "--grain-size-m", "1e-3", "--temperature-K", "263")
AXIAL = ("--deformation", "axial")
RATE = ("--strain-rate-per-s", "1e-5")

TIME = 100.0 * np.arange(1, 31)
CURVE = 100 * (1 - np.exp(-TIME / 500))
PERCENT = 1e-3 * TIME
FREQUENCY = np.logspace(1, -2, 6)

Column = Sequence[float] | np.ndarray | float
Table = Callable[..., Path]


def assert_refused(cli: CommandLine, path: Path, *options: str, told: str) -> None:
    """Run `new`, which has to say in one line why it writes nothing."""
    cli("new", path, *KNOWN, *options, code=2)
    assert told in cli.error
    assert cli.error.count("\n") == 1
    assert not path.with_suffix(".toml").exists()


@pytest.fixture
def table(tmp_path: Path) -> Table:
    """Write a text file of columns; one number stands in every row."""

    def write(**columns: Column) -> Path:
        n_rows = max(np.size(values) for values in columns.values())
        rows = zip(*(np.broadcast_to(values, n_rows) for values in columns.values()), strict=True)
        lines = [",".join(columns), *(",".join(f"{cell:.9g}" for cell in row) for row in rows)]
        path = tmp_path / "table.csv"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path

    return write


STRESSES = {
    "differential before pressure": ("Differential stress (MPa)", ("Pressure (MPa)",)),
    "differential before axial": ("Axial diff. stress (MPa)", ("Axial stress (MPa)",)),
    "stress before load": ("Stress (MPa)", ("Load (MPa)",)),
    "stress before a force": ("Stress (MPa)", ("Axial load (kN)", "Pounds (lbs)")),
    "a known unit": ("Stress (MPa)", ("Stress (psi)", "Stress")),
    "q": ("q (MPa)", ("sigma1 (MPa)", "sigma3 (MPa)", "p (MPa)")),
    "eff": ("sDiff-eff [MPa]", ("s1-eff [MPa]", "s3 [MPa]")),
    "cell": ("Deviator stress (MPa)", ("Cell pressure (MPa)", "Oil pressure (MPa)")),
    "actual": ("Actual stress (MPa)", ("Stress set point (MPa)", "Target stress (MPa)")),
    "true": ("True stress (MPa)", ("Engineering stress (MPa)",)),
    "German": ("Druckspannung [N/mm²]", ("Manteldruck [MPa]", "Kraft [kN]")),
    "French": ("Contrainte (MPa)", ("Pression de confinement (MPa)", "Force (kN)")),
}


@pytest.mark.parametrize(("wanted", "others"), STRESSES.values(), ids=STRESSES)
@pytest.mark.parametrize("others_first", [True, False])
def test_the_stress_is_decided_by_name_and_unit(
    wanted: str, others: Sequence[str], others_first: bool, table: Table, cli: CommandLine
) -> None:
    rivals: dict[str, Column] = {name: 300.0 + k for k, name in enumerate(others)}
    own: dict[str, Column] = {"Strain (%)": PERCENT, wanted: CURVE}
    path = table(**{**rivals, **own} if others_first else {**own, **rivals})
    cli("new", path, *KNOWN, *RATE)
    test = of_kind(load_experiment(path.with_suffix(".toml")), ConstantRateExperiment)
    np.testing.assert_allclose(test.stress, 1e6 * CURVE, rtol=1e-8)
    out = cli.out
    assert all(f"left out: column {name!r}, because " in out for name in others)


@pytest.mark.parametrize(
    ("quantity", "wanted", "others"),
    [
        ("temperature", "Sample temperature (C)", ("Room temperature (C)", "Furnace temp (C)")),
        ("temperature", "Probentemperatur [°C]", ("Ofentemperatur [°C]",)),
        ("strain", "True strain (%)", ("Engineering strain (%)", "Radial strain (%)")),
        ("strain", "Stauchung [%]", ("Querdehnung radial [%]", "strain rate (1/s)")),
        ("strain", "eps_ax", ("steps", "eps_vol")),
        ("time", "Elapsed time (s)", ("Step time (s)", "Cycle time (s)")),
        ("time", "Temps (s)", ("Température (°C)",)),
        ("time", "t/s", ("T/K", "T / °C", "date of the test")),
        ("temperature", "T/K", ("t/s", "sigma/MPa")),
        ("stress", "Δσ (MPa)", ("σ1 (MPa)", "σ3 (MPa)", "Pression (MPa)")),
        ("strain", "Strain_corr (%)", ("Strain_raw (%)", "Strain set (%)")),
        ("modulus", "|E*| (MPa)", ("E (MPa)", "Modulus (MPa)")),
        ("storage_modulus", "G' (MPa)", ("G'' (MPa)", "|G*| (MPa)")),
        ("storage_modulus", "Speichermodul E′ [MPa]", ("Verlustmodul E″ [MPa]",)),
        ("attenuation", "tan δ", ("Raw phase (°)", "1/Q", "Loss angle (deg)")),
        ("frequency", "Freq (Hz)", ("Angular frequency (rad/s)",)),
    ],
)
def test_the_column_of_a_quantity_is_decided_by_its_name(
    quantity: str, wanted: str, others: Sequence[str], table: Table
) -> None:
    for names in ((*others, wanted), (wanted, *others)):
        guessed = guess_columns(look_at(table(**{name: 0.1 * TIME + len(name) for name in names})))
        assert (guessed[quantity].column, guessed[quantity].is_decided) == (wanted, True)


def test_rivals_that_nothing_decides_are_asked_about(
    table: Table, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = table(**{"Strain A (%)": PERCENT, "Strain B (%)": 2 * PERCENT, "Stress (MPa)": CURVE})
    command = ["new", str(path), *KNOWN, *RATE]
    assert main([*command, "--strain-column", "Strain B (%)", "--out", str(path) + "2.toml"]) == 0
    by_option = load_experiment(Path(f"{path}2.toml"))
    answers = iter(["Strain C", "Strain B (%)", "", "", ""])
    answer_with(monkeypatch, lambda question: next(answers))
    assert main(command) == 0
    asked = load_experiment(path.with_suffix(".toml"))
    np.testing.assert_allclose(asked.position, by_option.position)
    np.testing.assert_allclose(asked.position, 2 * PERCENT / 100)


def test_the_same_numbers_in_two_units_are_no_rivals(table: Table) -> None:
    columns = guess_columns(
        look_at(table(time_s=TIME, time_h=TIME / 3600, strain=PERCENT / 100, stress_MPa=CURVE))
    )
    assert columns["time"].is_decided
    assert columns["time"].unit == "s"


@pytest.mark.parametrize(
    ("stress", "beside"),
    [
        ("sigma1 (MPa)", "sigma3 (MPa)"),
        ("Stress (MPa)", "Sigma 3 (MPa)"),
        *(
            ("Axial stress (MPa)", name)
            for name in (
                *("Confining pressure", "Pc", "P conf", "Pconf", "Cell pressure", "sigma3"),
                *("Radial stress", "Conf. pressure (MPa)", "Conf P (MPa)", "Conf. press.", "Gas P"),
                *("Pressure (MPa)", "sigma3 (MPa)"),
            )
        ),
    ],
)
def test_the_total_stress_along_the_axis_is_no_differential_stress(
    stress: str, beside: str, table: Table, cli: CommandLine
) -> None:
    path = table(**{"strain (%)": PERCENT, stress: CURVE + 300, beside: 300.0})
    assert_refused(cli, path, *RATE, told=f"never below column {beside!r}")
    cli("new", path, *KNOWN, *RATE, "--stress-column", stress)


@pytest.mark.parametrize(
    ("stress", "strain", "remedy"),
    [
        ("tau (MPa)", "gamma", "shear: write sqrt(3) tau as the stress, gamma/sqrt(3) as"),
        ("Shear stress (MPa)", "strain", "shear: write sqrt(3) tau as the stress"),
        ("Torque (N m)", "Twist (rad)", "torsion: a torque M gives tau = (3 + 1/n) M/(2 pi R^3)"),
    ],
)
def test_shear_and_torsion_are_refused_with_the_axial_equivalents(
    stress: str, strain: str, remedy: str, table: Table, cli: CommandLine
) -> None:
    path = table(**{"time (s)": TIME, strain: PERCENT / 100, stress: CURVE})
    assert_refused(cli, path, *RATE, told=remedy)


def test_a_sine_of_the_loss_angle_is_refused_with_its_tangent(
    table: Table, cli: CommandLine
) -> None:
    path = table(**{"f (Hz)": FREQUENCY, "sin_delta": 0.1})
    assert_refused(cli, path, *AXIAL, told="write tan(arcsin(...)) of it")


@pytest.mark.parametrize(
    "beside",
    [
        *("Radial strain", "Compressive strain rate", "Load (MPa)"),
        *("P-wave velocity", "P_load", "P (kN)", "Pore pressure", "Oil pressure"),
    ],
)
def test_other_columns_beside_a_stress_are_no_pressure(beside: str, table: Table) -> None:
    path = table(**{"strain (%)": PERCENT, "True stress (MPa)": 0.01 * CURVE + 1, beside: 1.0})
    assert main(["new", str(path), *KNOWN, *RATE]) == 0


def test_a_temperature_that_leaves_the_stated_one_is_told(table: Table, cli: CommandLine) -> None:
    heated = np.linspace(-40, -3, TIME.size)
    path = table(**{"strain (%)": PERCENT, "stress (MPa)": CURVE, "T (C)": heated})
    out = cli("new", path, *KNOWN, *RATE)
    assert "--temperature-K 263 takes its place; it holds 233.15 to 270.15 K" in out
    assert "column 'T (C)' holds mostly 235 to 268.3 K, but the test is at 263 K; check both" in out


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("Stress std (MPa)", "stress_uncertainty"),
        ("Stress std.dev. (MPa)", "stress_uncertainty"),
        ("stress_std", "stress_uncertainty"),
        ("std of the stress", "stress_uncertainty"),
        ("Strain stdev (%)", "strain_uncertainty"),
        ("Zeit (Std)", "time"),
        ("Test deviator stress (MPa)", "stress"),
    ],
)
def test_std_is_an_error_unless_it_is_hours(name: str, quantity: str, table: Table) -> None:
    assert [*guess_columns(look_at(table(**{name: PERCENT, "Count": CURVE})))] == [quantity]


LONG = np.array([0, 30, 60, 120, 240, 480, 900, 1800, 2700, 3600, 5400, 7200, 10800.0])
TRANSIENT = 0.01 + 0.02 * (1 - np.exp(-LONG / 600)) + 2e-6 * LONG
LATE = np.logspace(-2, 4, 24)
RAMP = np.concatenate([np.arange(1.0, 10), 10 + LATE[LATE > 1]])
HELD = np.concatenate([np.arange(0.0, 101, 2), np.arange(150.0, 3951, 50)])
LOADS = np.repeat([2.0, 4.0, 1.0], 10)
RAMPED = np.concatenate([np.linspace(0, 3, 20), 3 + 0.01 * np.sin(np.arange(140))])
KINDS = {
    "creep read at growing intervals": (LONG, TRANSIENT, 1.0, "stays the same while strain grows"),
    "few readings, the first before the load": (
        LONG[:8],
        TRANSIENT[:8],
        np.array([0.0, *[1.0] * 7]),
        "stays the same while strain grows",
    ),
    "noisy creep": (LONG, TRANSIENT, 1 + 1e-3 * np.sin(LONG), "stays the same while strain grows"),
    "several loads": (TIME, np.cumsum(LOADS**3) / 1e3, LOADS, "goes in steps and stays the same"),
    "held, at levels by chance": (
        LATE[:9],
        0.1,
        np.array([37.3, 37.3, 37.2, 29.4, 29.3, 29.2, 15, 14.9, 14.8]),
        "falls while the strain is held",
    ),
    "several loads with ramps between": (
        np.arange(1.0, 321),
        np.cumsum(np.concatenate([RAMPED, RAMPED + 3]) ** 3) / 1e5,
        np.concatenate([RAMPED, RAMPED + 3]),
        "goes in steps and stays the same",
    ),
    "one rate, read densely": (
        np.arange(1.0, 1001),
        np.arange(1.0, 1001) / 100,
        50 * (1 - np.exp(-np.arange(1000) / 100)) - np.arange(1000) / 100,
        "there are strain and stress",
    ),
    "strain held": (LATE, 0.1, 0.4 * LATE**-0.05, "falls while the strain is held"),
    "strain held, not read": (LATE, None, 0.4 * LATE**-0.05, "falls while the strain is held"),
    "held in tension": (LATE, -0.1, -0.4 * LATE**-0.05, "falls while the strain is held"),
    "ramp and hold": (
        RAMP,
        np.minimum(RAMP, 10) / 100,
        np.where(RAMP > 10, 10 * np.maximum(RAMP - 9, 1) ** -0.1, RAMP),
        "falls while the strain is held",
    ),
    "ramp and hold, read until the strain is held": (
        HELD,
        np.minimum(HELD, 100) / 100 + 1e-4 * np.sin(9 * HELD),
        np.where(HELD > 100, 5 * np.exp((100 - HELD) / 2000), HELD / 20),
        "falls while the strain is held",
    ),
    "unloading": (TIME, 2 - np.abs(PERCENT - 2), 5 - np.abs(CURVE - 50) / 9, "strain turns back"),
    "cycles": (TIME, np.sin(TIME / 130), np.sin(TIME / 130 + 0.3), "goes back and forth"),
    "one rate": (TIME, PERCENT, CURVE, "there are strain and stress"),
    "one rate, its rise read a few times": (
        np.arange(41.0),
        0.5 * np.arange(41),
        8 * (1 - np.exp(-np.arange(41.0))),
        "there are strain and stress",
    ),
    "creep, its rise read a few times": (
        np.arange(41.0),
        0.5 * np.arange(41) ** 0.8,
        8 * (1 - np.exp(-np.arange(41.0))),
        "stays the same while strain grows",
    ),
    "strain and stress in turn": (
        TIME,
        np.where(np.arange(30) % 2, PERCENT, np.nan),
        np.where(np.arange(30) % 2, np.nan, 5.0),
        "stays the same while strain grows",
    ),
    "one rate, softening": (TIME, PERCENT, CURVE - TIME / 100, "there are strain and stress"),
    "one rate, with noise": (
        TIME,
        PERCENT + 3e-3 * np.sin(7 * TIME),
        CURVE + np.cos(5 * TIME),
        "there are strain and stress",
    ),
    "times and stresses": (TIME, None, CURVE, "there are time and stress"),
}


@pytest.mark.parametrize(("time", "strain", "stress", "because"), KINDS.values(), ids=KINDS)
def test_kinds_of_tests_are_told_by_what_readings_do(
    time: np.ndarray,
    strain: Column | None,
    stress: Column,
    because: str,
    table: Table,
    cli: CommandLine,
) -> None:
    columns = {"time (s)": time, "strain (%)": strain, "stress (MPa)": stress}
    path = table(**{name: values for name, values in columns.items() if values is not None})
    assert because in cli("new", path, *KNOWN, code=None)


def test_the_slope_of_the_strain_is_the_rate_that_is_proposed(
    table: Table, cli: CommandLine
) -> None:
    path = table(**{"time (h)": TIME / 3600, "strain (%)": PERCENT, "stress (MPa)": CURVE})
    assert "taken: --strain-rate-per-s 1e-05\n" in cli("new", path, *KNOWN)
    file = path.with_suffix(".toml")
    assert "stated rates" not in cli("check-file", file)
    file.write_text(file.read_text("utf-8").replace("per_s = 1e-05", "per_s = 1e-06"), "utf-8")
    assert "(its slope is 1e-05 1/s) lies up to 0.0261" in cli("check-file", file)


def test_times_that_go_back_are_told_and_suggest_no_rate(table: Table, cli: CommandLine) -> None:
    time = np.where(TIME > 2000, TIME - 1500, TIME)
    path = table(**{"time (s)": time, "strain (%)": PERCENT, "stress (MPa)": CURVE})
    assert_refused(cli, path, told="Missing: --strain-rate-per-s")
    assert "data row 21: the time 600 s comes after 2000 s" in cli("new", path, *KNOWN, *RATE)


def test_creep_whose_rows_are_in_no_order_is_no_oscillation(table: Table, cli: CommandLine) -> None:
    rows = np.random.default_rng(1).permutation(TIME.size)
    path = table(**{"time (s)": TIME[rows], "strain (%)": CURVE[rows], "stress (MPa)": 0.8})
    first, *others = cli("new", path, *KNOWN, code=None).splitlines()
    assert first.startswith("check: the time goes back in ")
    assert "sort the rows" in first
    assert any("because the stress stays the same while strain grows" in one for one in others)


def test_one_of_several_tests_is_read_by_what_tells_them_apart(
    table: Table, cli: CommandLine
) -> None:
    path = table(
        specimen=np.repeat([1, 2], TIME.size),
        time_s=np.tile(TIME, 2),
        strain_percent=np.concatenate([PERCENT, 3 * PERCENT]),
        stress_MPa=np.concatenate([CURVE, CURVE + 10]),
    )
    cli("new", path, *KNOWN, code=2)
    selection = 'rows = { "specimen" = "1" }'
    assert f"tells tests apart, read the first with {selection} in [data]" in cli.out
    file = path.with_suffix(".toml")
    text = file.read_text("utf-8").replace("[data]\n", f"[data]\n{selection}\n")
    file.write_text(text, encoding="utf-8")
    test = of_kind(load_experiment(file), ConstantRateExperiment)
    np.testing.assert_allclose(test.stress, 1e6 * CURVE)
    assert [one.strain_rate for one in test.segments] == [1e-5]


@pytest.mark.parametrize(
    ("columns", "is_told"),
    [
        ({"strain_percent": np.tile([20.0, 3.0, 9.0], 10)}, True),
        ({}, True),
        ({"strain_percent": PERCENT}, False),
        ({"time_s": TIME, "strain_percent": PERCENT}, False),
    ],
)
def test_a_table_of_rates_is_no_curve(
    columns: dict[str, Column], is_told: bool, table: Table, cli: CommandLine
) -> None:
    path = table(**{**columns, "T_C": -10.0, "stress_MPa": CURVE, "edot_per_s": 1e-6})
    cli("new", path, *KNOWN, *RATE, code=None)
    told = "check: column 'edot_per_s' holds strain rates, and no time is read. If each row is a"
    assert (told in cli.out) == is_told


@pytest.mark.parametrize(
    ("name", "pascal"), [("stress (kPa)", 1e3), ("Stress [bar]", 1e5), ("stress / kbar", 1e8)]
)
@pytest.mark.parametrize(
    ("time", "strain"), [("time (days)", "strain (µε)"), ("Days", "microstrain")]
)
def test_units_of_instruments_are_read(
    name: str, pascal: float, time: str, strain: str, table: Table, cli: CommandLine
) -> None:
    path = table(**{time: TIME / 86400, strain: 1e4 * PERCENT, name: 1e6 * CURVE / pascal})
    assert f"guessed: time: column '{time}' in d (by its name)" in cli("new", path, *KNOWN, *RATE)
    test = of_kind(load_experiment(path.with_suffix(".toml")), ConstantRateExperiment)
    np.testing.assert_allclose(test.stress, 1e6 * CURVE, rtol=1e-8)
    np.testing.assert_allclose(test.strain, 1e-2 * PERCENT, rtol=1e-8)


def test_a_clock_that_started_long_before_starts_the_test(table: Table, cli: CommandLine) -> None:
    path = table(**{"time (s)": 1.7e9 + TIME, "strain (%)": PERCENT, "stress (MPa)": 2.0})
    assert "decided: the test starts with its first reading, at 1700000100 s of its clock" in cli(
        "new", path, *KNOWN
    )
    test = of_kind(load_experiment(path.with_suffix(".toml")), HistoryExperiment)
    assert [(stage.start_time, stage.end_time) for stage in test.stages] == [(0, 2900)]
    np.testing.assert_allclose(test.time, TIME - 100)
    # The end of a long test is no such clock.
    path = table(**{"time (s)": 5e4 + TIME, "strain (%)": PERCENT, "stress (MPa)": 2.0})
    assert "of its clock" not in cli("new", path, *KNOWN, "--out", f"{path}2.toml", code=None)


def test_a_date_beside_its_time_of_day_is_read(tmp_path: Path, cli: CommandLine) -> None:
    rows = [f"2024-03-05,09:{k:02}:00,{0.1 * k:.3g},{CURVE[k]:.6g}" for k in range(1, 30)]
    rows[4] = rows[4].rpartition(",")[0] + ",#DIV/0!"
    path = tmp_path / "dated.csv"
    path.write_text("Date,Time,strain (%),stress (MPa)\n" + "\n".join(rows) + "\n", "utf-8")
    out = cli("new", path, *KNOWN, *RATE)
    assert "column 'Time' with 'Date' holds time stamps" in out
    assert "#DIV/0! (in 1 of 29 rows) stands for no reading" in out
    assert "left out: column 'Date'" not in out
    assert "not read" not in cli("check-file", path.with_suffix(".toml"))


@pytest.mark.parametrize(
    ("comments", "told"),
    [
        (
            "# time: h\n# stress: kPa\n# strain: percent\n",
            ["line 1 ('time: h')", "('stress: kPa')"],
        ),
        ("# Time in hours; stress (MPa)\n", ["line 1 ('Time in hours')"]),
        ("# creep of ice for 3 h under a load\n# time: s, strain rate: 1/h\n", []),
        (
            "Time unit: h\nStress unit,kPa\nTest time,3 h\nStart of test (min),5\nTime (min),9\n",
            ["line 1 ('Time unit: h')", "line 2 ('Stress unit kPa')"],
        ),
    ],
)
def test_units_ahead_of_the_names_are_told(
    comments: str, told: Sequence[str], table: Table, cli: CommandLine
) -> None:
    path = table(time=TIME, stress=CURVE, strain=PERCENT)
    path.write_text(comments + path.read_text("utf-8"), encoding="utf-8")
    lines = [line for line in cli("new", path, *KNOWN).splitlines() if "may state another" in line]
    assert len(lines) == len(told)
    assert all(any(words in line for line in lines) for words in told)


def test_stages_end_where_the_strain_turns(table: Table, cli: CommandLine) -> None:
    strain = 2 - np.abs(PERCENT - 2)
    path = table(**{"time (s)": TIME, "strain (%)": strain, "stress (MPa)": 0.5 * strain**0.5})
    out = cli("new", path, *KNOWN, *RATE, "--protocol", "loading_history")
    assert "decided: the strain turns back at 2000 s: stages end there" in out
    assert "that was read lies" not in out
    test = of_kind(load_experiment(path.with_suffix(".toml")), HistoryExperiment)
    assert [(stage.end_time, stage.value) for stage in test.stages] == [(2000, 1e-5), (3000, -1e-5)]
    cli("new", path, *KNOWN, "--out", f"{path}2.toml")
    series = of_kind(load_experiment(Path(f"{path}2.toml")), HistoryExperiment)
    assert [stage.control for stage in series.stages] == ["strain_rate", "strain_series"]
    assert series.stages[0].value == pytest.approx(1e-5)


def test_a_hold_and_its_loading_are_found_where_they_were_read(table: Table) -> None:
    _, strain, stress, _ = KINDS["ramp and hold"]
    path = table(**{"time (s)": RAMP, "strain (%)": strain, "stress (MPa)": stress})
    assert main(["new", str(path), *KNOWN]) == 0
    test = of_kind(load_experiment(path.with_suffix(".toml")), HistoryExperiment)
    assert [stage.control for stage in test.stages] == ["strain_rate", "hold_strain"]
    assert test.stages[0].end_time == pytest.approx(9)
    assert test.stages[0].value == pytest.approx(1e-4)


@pytest.mark.parametrize("lasted", ["0", "0.5"])
def test_a_modulus_of_relaxation_is_a_stress_at_a_strain_that_is_held(
    lasted: str, table: Table, cli: CommandLine
) -> None:
    path = table(**{"time (s)": LATE, "Relaxation modulus E(t) (GPa)": 9 * LATE**-0.1})
    loading = ("--held-strain", "2e-4", "--loading-time", lasted)
    assert (
        "loading in no time is written as a stage of" in cli("new", path, *KNOWN, *loading)
    ) == (lasted == "0")
    test = of_kind(load_experiment(path.with_suffix(".toml")), HistoryExperiment)
    np.testing.assert_allclose(test.reading, 9e9 * LATE**-0.1 * 2e-4, rtol=1e-8)
    first = test.stages[0]
    assert first.value * first.end_time == pytest.approx(2e-4)
    assert first.end_time == pytest.approx(1e-5 if lasted == "0" else 0.5)
    assert test.time[0] - first.end_time == pytest.approx(LATE[0])


SPECTRA = {
    "angular frequency": ({"Angular Frequency": 2 * math.pi * FREQUENCY, "tan delta": 0.1}, None),
    "short": ({"ang. frequency (1/s)": 2 * math.pi * FREQUENCY, "tan delta": 0.1}, None),
    "omega": ({"omega [rad/s]": 2 * math.pi * FREQUENCY, "tan delta": 0.1}, None),
    "degrees": ({"f (Hz)": FREQUENCY, "Loss angle (deg)": math.degrees(math.atan(0.1))}, None),
    "phase": ({"f (Hz)": FREQUENCY, "Raw phase (°)": math.degrees(math.atan(0.1))}, None),
    "To": ({"To (s)": 1 / FREQUENCY, "log10 Q-1": -1.0, "T(C)": 900.0}, None),
    "mrad": ({"f (Hz)": FREQUENCY, "delta (mrad)": 1e3 * math.atan(0.1)}, None),
    "two moduli": ({"f (Hz)": FREQUENCY, "G' (MPa)": 500.0, "G'' (MPa)": 50.0}, 5e8 * 1.01**0.5),
    "storage modulus": ({"f (Hz)": FREQUENCY, "E' (MPa)": 500.0, "tan d": 0.1}, 5e8 * 1.01**0.5),
    "the absolute one": (
        {"f (Hz)": FREQUENCY, "E' (MPa)": 500.0, "|E*| (MPa)": 510.0, "tan d": 0.1},
        5.1e8,
    ),
    "by name a logarithm": ({"f (Hz)": FREQUENCY, "log10(1/Q)": -1.0}, None),
    "German": (
        {"Frequenz [Hz]": FREQUENCY, "Speichermodul [MPa]": 500.0, "Verlustfaktor": 0.1},
        5e8 * 1.01**0.5,
    ),
}


@pytest.mark.parametrize(("columns", "modulus"), SPECTRA.values(), ids=SPECTRA)
def test_spectra_are_turned_into_tan_delta_and_the_absolute_modulus(
    columns: dict[str, Column], modulus: float | None, table: Table
) -> None:
    path = table(**columns)
    assert main(["new", str(path), *KNOWN, *AXIAL]) == 0
    test = of_kind(load_experiment(path.with_suffix(".toml")), AttenuationExperiment)
    np.testing.assert_allclose(test.conditions.period, 1 / FREQUENCY, rtol=1e-7)
    np.testing.assert_allclose(test.readings.tan_delta, 0.1, rtol=1e-7)
    np.testing.assert_allclose(test.readings.modulus, [] if modulus is None else modulus)


@pytest.mark.parametrize(("name", "error"), [("phase sd (deg)", 0.01), ("phase sd (rad)", 0.0)])
def test_the_error_of_an_angle_is_read_in_the_unit_of_the_angle(
    table: Table, name: str, error: float
) -> None:
    angle = math.degrees(math.atan(0.1))
    sd = math.degrees(0.01 / 1.01)
    path = table(**{"f (Hz)": FREQUENCY, "Phase (deg)": angle, name: sd})
    assert main(["new", str(path), *KNOWN, *AXIAL]) == 0
    test = of_kind(load_experiment(path.with_suffix(".toml")), AttenuationExperiment)
    np.testing.assert_allclose(test.readings.tan_delta_error, error, rtol=1e-6)


@pytest.mark.parametrize(
    ("given", "name"),
    [
        ("axial", "Shear modulus (GPa)"),
        ("shear", "Young modulus (GPa)"),
        ("axial", "G (GPa)"),
        ("shear", "|E*| (GPa)"),
    ],
)
def test_a_modulus_of_another_deformation_is_told(
    table: Table, cli: CommandLine, given: str, name: str
) -> None:
    columns = {"Frequency (Hz)": FREQUENCY, "tan delta": 0.05, name: 60.0}
    cli("new", table(**columns), *KNOWN, "--deformation", given)
    other = {"axial": "shear", "shear": "axial"}[given]
    assert f"the name of column {name!r} states {other}: check it" in cli.out


@pytest.mark.parametrize(
    ("columns", "quantity"),
    [
        ({"T": 1100.0, "period": 1 / FREQUENCY, "1/Q": 0.02}, "temperature"),
        ({"T": TIME, "strain": PERCENT, "stress": CURVE}, "time"),
        ({"T": FREQUENCY, "period": 1 / FREQUENCY, "temp": 1100.0, "1/Q": 0.02}, "time"),
    ],
)
def test_a_t_beside_periods_is_a_temperature(
    columns: dict[str, Column], quantity: str, table: Table
) -> None:
    assert guess_columns(look_at(table(**columns)))[quantity].column == "T"


def test_the_unit_of_a_modulus_is_not_guessed_from_its_size(table: Table, cli: CommandLine) -> None:
    path = table(**{"period (s)": 1 / FREQUENCY, "1/Q": 0.02, "G": 60e3})
    out = cli("new", path, *KNOWN)
    assert "guessed: modulus: column 'G' in GPa (by nothing; check it)" in out
    assert "Pa is far from the" in out
    assert 'deformation = "shear"' in path.with_suffix(".toml").read_text(encoding="utf-8")


def test_the_periods_of_a_spectrum_may_have_any_name(table: Table) -> None:
    path = table(**{"X (s)": FREQUENCY, "1/Q": 0.02})
    assert main(["new", str(path), *KNOWN, *AXIAL, "--period-column", "X (s)"]) == 0


def test_an_answer_that_the_file_cannot_hold_is_asked_for_again_with_the_reason(
    table: Table, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    path = table(strain=PERCENT / 100, stress=CURVE)
    replies = {
        "name of the test": ["a b", ""],
        "material": ["ice"],
        "temperature": ["-10", "nan", "cold", "263"],
        "mean grain size": ["", "7", "230e-6"],
        "imposed strain rate": ["-1e-5", "0", "1e-5"],
        "kind of data": ["guess", "measured"],
        "source": ["me\x7f", "me"],
    }
    asked: list[str] = []

    def answer(prompt: str) -> str:
        name = next(name for name in replies if prompt.startswith(name))
        asked.append(name)
        return replies[name].pop(0)

    answer_with(monkeypatch, answer)
    out = cli("new", path)
    for words in (
        "key 'id': found 'a b'",
        "key 'temperature_K': found -10",
        "key 'initial_grain_size_m': found 7",
        "found 'cold', expected a number",
    ):
        assert words in out
    assert out.count("key 'strain_rate_per_s'") == 2
    assert not any(replies.values())
    test = load_experiment(path.with_suffix(".toml"))
    assert (test.id, test.material, test.temperature) == (path.stem, "ice", 263.0)
    assert test.provenance.source == "me"
