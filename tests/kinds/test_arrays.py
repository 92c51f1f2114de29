"""Tests from arrays in memory are those that files hold, and are refused in the same words."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import ICE
from kind_examples import EXAMPLES
from matplotlib import pyplot as plt
from same_contents import assert_equal

import pyburgers
from pyburgers.common.errors import InputError
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.kind import load_experiment

COMMON: dict[str, Any] = {
    "temperature_K": 263.0,
    "grain_size_um": 230,
    "material": "ice",
    "name": "one",
    "kind": "measured",
}
STRAINS = [0.1, 0.2, 0.5, 1.0]
CURVE: dict[str, Any] = {
    "strain": STRAINS,
    "strain_unit": "percent",
    "stress": [1.0, 2.0, 3.0, 3.5],
    "stress_unit": "MPa",
    "strain_rate": 1e-6,
}
CREEP: dict[str, Any] = {
    "time": [1, 2, 3, 4],
    "time_unit": "h",
    "strain": [0.1, 0.15, 0.18, 0.2],
    "strain_unit": "percent",
    "stress": 1.0,
    "stress_unit": "MPa",
}
RELAXATION: dict[str, Any] = {
    "time": [1, 2, 3, 4],
    "time_unit": "h",
    "stress": [2.0, 1.5, 1.4, 1.3],
    "stress_unit": "MPa",
    "strain": 0.1,
    "strain_unit": "percent",
    "loading_time": 0.5,
}
TABLE: dict[str, Any] = {
    "period": [1.0, 10.0, 100.0],
    "period_unit": "s",
    "attenuation": [0.01, 0.02, 0.05],
    "attenuation_form": "tan_delta",
    "attenuation_uncertainty": 0.002,
    "modulus": [9.0, 8.9, 8.5],
    "modulus_unit": "GPa",
    "modulus_uncertainty": 0.1,
    "deformation": "axial",
    "amplitude_Pa": 1e5,
}

CASES = [(kind, name) for kind in EXAMPLES for name in EXAMPLES[kind].twins]


@pytest.mark.parametrize(("kind", "name"), CASES)
def test_readings_are_drawn_and_shown_in_a_line(kind: str, name: str) -> None:
    test = EXAMPLES[kind].load(name)
    _, axes = plt.subplots()
    assert test.plot(axes) is axes
    assert axes.get_xlabel()
    assert axes.get_ylabel()
    drawn = np.size(axes.lines[0].get_xdata())
    # Of two quantities that were read, one.
    assert test.n_points / 2 <= drawn <= test.n_points
    plt.close("all")
    first, *notes = repr(test).splitlines()
    assert first.startswith(f"<test {test.id} ({kind}): {test.material}, ")
    assert notes == [f"note: {one}" for one in (*test.notices, *test.doubts)]


HEAD = """
id = "one"
material = "ice"
temperature_K = 263.0
initial_grain_size_m = 230e-6
provenance = { kind = "measured", source = "a test" }
"""

ROWS: dict[Callable[..., Experiment], tuple[dict[str, Any], str]] = {
    pyburgers.ConstantRateTest: (
        CURVE,
        """
protocol = "constant_rate"
segments = [{ start_strain = 0.0, strain_rate_per_s = 1e-6 }]
[data]
strain_column = "strain"
strain_unit = "percent"
stress_column = "stress"
stress_unit = "MPa"
""",
    ),
    pyburgers.CreepTest: (
        CREEP,
        """
protocol = "loading_history"
stage_time_unit = "h"
stage_stress_unit = "MPa"
stages = [{ control = "stress", start_time = 0, end_time = 4, stress = 1.0 }]
[data]
time_column = "time"
time_unit = "h"
strain_column = "strain"
strain_unit = "percent"
""",
    ),
    pyburgers.RelaxationTest: (
        RELAXATION,
        """
protocol = "loading_history"
stage_time_unit = "h"
[[stages]]
control = "strain_rate"
start_time = 0
end_time = 0.5
strain_rate_per_s = 5.555555555555555e-07
[[stages]]
control = "hold_strain"
start_time = 0.5
end_time = 4
[data]
time_column = "time"
time_unit = "h"
stress_column = "stress"
stress_unit = "MPa"
""",
    ),
    pyburgers.AttenuationTable: (
        TABLE,
        """
protocol = "attenuation"
[attenuation]
deformation = "axial"
amplitude_Pa = 1e5
[data]
period_column = "period"
period_unit = "s"
attenuation_column = "attenuation"
attenuation_form = "tan_delta"
attenuation_uncertainty = 0.002
modulus_column = "modulus"
modulus_unit = "GPa"
modulus_uncertainty = 0.1
""",
    ),
}


@pytest.mark.parametrize("make", ROWS, ids=lambda make: make.__name__)
@pytest.mark.parametrize("kept_as", [list, np.array, pd.Series], ids=lambda kind: kind.__name__)
def test_arrays_make_the_test_that_a_file_of_them_holds(
    make: Callable[..., Experiment], kept_as: Callable[[Any], Any], tmp_path: Path
) -> None:
    arguments, text = ROWS[make]
    columns = {name: values for name, values in arguments.items() if isinstance(values, list)}
    pd.DataFrame(columns).to_csv(tmp_path / "rows.csv", index=False)
    path = tmp_path / "one.toml"
    path.write_text(f'{HEAD}{text}file = "rows.csv"\n', encoding="utf-8")
    arrays = {name: kept_as(values) for name, values in columns.items()}
    assert_equal(make(**{**COMMON, **arguments, **arrays}, source="a test"), load_experiment(path))


def test_an_oscillation_is_the_one_of_its_file() -> None:
    known = EXAMPLES["forced_oscillation"].load(EXAMPLES["forced_oscillation"].twins[0])
    assert isinstance(known, pyburgers.OscillationExperiment)
    record = known.record
    test = pyburgers.ForcedOscillation(
        strain=record.strain,
        strain_unit="fraction",
        strain_uncertainty=record.strain_uncertainty,
        time=record.strain_time,
        time_unit="s",
        stress=record.stress / 1e6,
        stress_unit="MPa",
        stress_uncertainty=record.stress_uncertainty / 1e6,
        stress_time=record.stress_time,
        temperature_K=known.temperature,
        grain_size_um=known.initial_grain_size * 1e6,
        material=known.material,
        period_s=known.settings.period,
        background=known.settings.background,
        strain_trend_degree=known.settings.strain_trend_degree,
        stress_trend_degree=known.settings.stress_trend_degree,
    )
    np.testing.assert_allclose(test.stress, known.stress, rtol=1e-9)
    assert test.prepared.period == known.prepared.period


def test_a_history_may_have_any_stages_and_no_readings() -> None:
    stages: list[dict[str, Any]] = [
        {"control": "stress", "start_time": 0, "end_time": 2, "stress": 1.0},
        {"control": "stress", "start_time": 2, "end_time": 4, "stress": 2.0},
    ]
    units: dict[str, Any] = {"time_unit": "h", "stress_unit": "MPa", "strain_unit": "percent"}
    readings: dict[str, Any] = {"time": CREEP["time"], "strain": CREEP["strain"]}
    test = pyburgers.LoadingHistory(stages=stages, **readings, **units, **COMMON)
    assert [stage.value for stage in test.stages] == [1e6, 2e6]
    assert test.reading_stage.tolist() == [0, 1, 1, 1]
    imagined = pyburgers.LoadingHistory(
        stages=stages, stage_time_unit="h", stage_stress_unit="MPa", **COMMON
    )
    assert imagined.n_points == 0
    assert_equal(imagined.stages, test.stages)


def test_times_of_pandas_count_from_the_first() -> None:
    clock = pd.date_range("2024-03-01 09:00", periods=4, freq="30min").to_series()
    test = pyburgers.ConstantRateTest(**{**COMMON, **CURVE, "time": clock, "time_unit": "s"})
    assert any("read as seconds since the first row" in notice for notice in test.notices)


SECONDS = np.array([100, 200, 400, 800], "timedelta64[s]")


@pytest.mark.parametrize(
    "time", [SECONDS, SECONDS.astype("timedelta64[ns]"), pd.Series(SECONDS), SECONDS.tolist()]
)
def test_elapsed_times_are_seconds_from_their_own_zero(time: Any) -> None:
    clock = {"time": time, "time_unit": "s"}
    test = pyburgers.CreepTest(**{**COMMON, **CREEP, **clock})
    assert test.position.tolist() == [100, 200, 400, 800]
    assert test.stages[-1].end_time == 800
    assert test.notices == ()
    rate = pyburgers.ConstantRateTest(
        **{**COMMON, **CURVE, **clock, "strain": None, "strain_unit": None}
    )
    np.testing.assert_allclose(rate.position, [1e-4, 2e-4, 4e-4, 8e-4])


def test_a_test_that_has_time_stamps_ends_with_the_last() -> None:
    clock = pd.date_range("2024-03-01 09:00", periods=4, freq="30min")
    test = pyburgers.CreepTest(**{**COMMON, **CREEP, "time": clock, "time_unit": "s"})
    assert test.stages[-1].end_time == 5400


def test_a_reading_that_is_not_there_is_left_out_and_said() -> None:
    for nothing in (np.nan, None, pd.NA):
        stress = [1.0, nothing, 3.0, 3.5]
        test = pyburgers.ConstantRateTest(**{**COMMON, **CURVE, "stress": stress})
        assert test.n_points == 3
        assert "1 row left out" in test.notices[0]
        assert "(row 2)" in test.notices[0]


def test_a_reading_that_a_mask_hides_is_left_out() -> None:
    hidden = np.ma.masked_array([1.0, 99.0, 3.0, 3.5], mask=[False, True, False, False])
    test = pyburgers.ConstantRateTest(**{**COMMON, **CURVE, "stress": hidden})
    np.testing.assert_allclose(test.stress, [1e6, 3e6, 3.5e6])


def test_a_grain_size_may_be_an_array_of_one_number() -> None:
    test = pyburgers.ConstantRateTest(**{**COMMON, **CURVE, "grain_size_um": np.array(230.0)})
    assert test.initial_grain_size == pytest.approx(230e-6)


REFUSED: list[tuple[Callable[..., Experiment], dict[str, Any], dict[str, Any], str]] = [
    (pyburgers.ConstantRateTest, CURVE, change, words)
    for change, words in (
        ({"temperature_K": -10}, "argument 'temperature_K': found -10, expected kelvin"),
        ({"id": "other"}, "argument 'id': expected 'name' in its place"),
        ({"initial_grain_size_m": 1e-3}, "expected 'grain_size_um' in its place"),
        ({"grain_size_um": -5}, "argument 'grain_size_um': found -5, expected micrometres"),
        ({"grain_size_um": None}, "argument 'grain_size_um' is missing, expected the mean"),
        ({"strain": [10.0, 20.0, 30.0, 2500.0], "strain_unit": "fraction"}, "check its unit"),
        ({"strain": [0.1, 0.2]}, "found columns of different lengths, 2 in 'strain'"),
        ({"strain": [0.1, 1.0, 0.5, 1.2]}, "data row 3: found strain 0.005, which runs backwards"),
        ({"strain_unit": "percnt"}, "argument 'strain_unit': unit 'percnt' is not a unit"),
        ({"strain_unit": None}, "needs both or neither of the arguments 'strain'"),
        ({"strain_rate": -1e-6}, "argument 'strain_rate', entry 1: found -1e-06"),
        ({"strain_rate": [1e-6, 1e-5]}, "found 2 values of 'strain_rate' and 1 of 'start_strain'"),
        ({"temprature": 3}, "unknown argument 'temprature', did you mean 'temperature_K'?"),
        ({"stress": [1, 2, "high", 4]}, "row 3, column 'stress': found 'high', expected a number"),
        ({"stress": [1, 2, np.inf, 4]}, "row 3, column 'stress': found 'inf', expected a finite"),
        ({"strain": 0.01}, "argument 'strain': found 0.01, expected a list of readings"),
        ({"stress": "a.csv"}, "argument 'stress': found 'a.csv', expected a list of readings"),
        ({"stress": [[1, 2]]}, "column 'stress': found 2 dimensions"),
        ({"name": "a b"}, "argument 'name': found 'a b'"),
        ({"strain": None, "strain_unit": None}, "needs the argument 'strain' or 'time'"),
    )
]
STAGE = {"start_time": 0, "end_time": 4}
HISTORY: dict[str, Any] = {
    **{key: CREEP[key] for key in ("time", "time_unit", "strain", "strain_unit", "stress_unit")},
    "stages": [{**STAGE, "control": "stress", "stress": 1.0}],
}
REFUSED += [
    (made, arguments, {key: value}, f"argument {key!r}: expected {instead} in its place")
    for made, arguments in ((pyburgers.CreepTest, CREEP), (pyburgers.RelaxationTest, RELAXATION))
    for key, value, instead in (
        ("stages", HISTORY["stages"], "pyburgers.LoadingHistory"),
        ("stage_time_unit", "h", "'time_unit'"),
        ("stage_stress_unit", "Pa", "'stress_unit'"),
    )
]
REFUSED += [
    (pyburgers.LoadingHistory, HISTORY, change, words)
    for change, words in (
        ({"stress_unit": None}, "argument 'stress_unit' is missing, expected it because a stage"),
        ({"time_unit": None}, "argument 'time_unit' is missing, expected it because a stage"),
        ({"strain": 0.01}, "argument 'strain': found 0.01, expected a list of readings"),
        ({"stages": 3}, "argument 'stages': found 3, expected a list of tables"),
        ({"stages": [3]}, "argument 'stages': found 3, expected a list of tables"),
        ({"stages": [{**STAGE, "control": "strain_rate"}]}, "argument 'strain_rate_per_s' in [["),
    )
]
REFUSED += [
    (pyburgers.CreepTest, CREEP, {"time": [1, 3, 2, 4]}, "data row 3: the time 2 h comes after"),
    (pyburgers.CreepTest, CREEP, {"time_unit": "days"}, "argument 'time_unit': unit 'days'"),
    (pyburgers.CreepTest, CREEP, {"time": SECONDS}, "found 'h' for column 'time', which holds el"),
    (pyburgers.CreepTest, CREEP, {"time": ["a"]}, "argument 'time': expected a list of numbers"),
    (pyburgers.RelaxationTest, RELAXATION, {"loading_time": 9.0}, "argument 'loading_time'"),
    (
        pyburgers.RelaxationTest,
        RELAXATION,
        {"loading_time": None},
        "'loading_time': found NoneType",
    ),
    (pyburgers.RelaxationTest, RELAXATION, {"strain": ".06"}, "argument 'strain': found '.06'"),
    (pyburgers.RelaxationTest, RELAXATION, {"strain_unit": "mm"}, "argument 'strain_unit'"),
    (pyburgers.AttenuationTable, TABLE, {"deformation": "shear"}, "argument 'deformation'"),
    (pyburgers.AttenuationTable, TABLE, {"attenuation": 0.02}, "found 0.02, expected a list of"),
    (pyburgers.AttenuationTable, TABLE, {"temperature": 1300}, "found 1300, expected a list of"),
    (pyburgers.AttenuationTable, TABLE, {"period": [1.0, 1.0, 2.0]}, "found the period 1 twice"),
]


@pytest.mark.parametrize(("make", "arguments", "change", "words"), REFUSED)
def test_arguments_are_refused_by_name(
    make: Callable[..., Experiment], arguments: dict[str, Any], change: dict[str, Any], words: str
) -> None:
    assert make(**{**COMMON, **arguments}).n_points
    with pytest.raises(InputError) as refused:
        make(**{**COMMON, **arguments, **change})
    assert words in " ".join(refused.value.sentences)
    assert "key" not in str(refused.value)


def test_readings_of_unstated_origin_count_as_measured_and_the_test_says_so() -> None:
    arguments = {**COMMON, **CURVE}
    del arguments["kind"]
    assert "count as measured" in repr(pyburgers.ConstantRateTest(**arguments))
    synthetic = pyburgers.ConstantRateTest(**arguments, kind="synthetic", source="made up")
    assert synthetic.provenance.kind == "synthetic"
    assert "count as" not in repr(synthetic)


def test_percent_as_a_fraction_is_doubted_as_in_files() -> None:
    test = pyburgers.ConstantRateTest(
        **{**COMMON, **CURVE, "strain": [0.1, 1, 5, 9], "strain_unit": "fraction"}
    )
    assert "check that it is not in percent" in repr(test)


def test_columns_may_stand_in_a_toml_file(tmp_path: Path) -> None:
    text = (ICE / "PIL40.toml").read_text(encoding="utf-8")
    known = pd.read_csv(ICE / "PIL40.csv")
    lists = "".join(f"{name!r} = {known[name].tolist()}\n" for name in known)
    path = tmp_path / "one.toml"
    lines = [line for line in text.splitlines() if not line.startswith("file =")]
    (data,) = (k for k, line in enumerate(lines) if line == "[data]")
    rest = next(k for k in range(data + 1, len(lines)) if lines[k].startswith("["))
    inside = [*lines[:rest], "[data.file]", lists, *lines[rest:]]
    path.write_text("\n".join(inside), encoding="utf-8")
    test, file = load_experiment(path), load_experiment(ICE / "PIL40.toml")
    assert_equal(test.response, file.response)
    path.write_text("\n".join(inside).replace("[data.file]", "[data.files]"), encoding="utf-8")
    with pytest.raises(InputError, match="unknown key 'files'"):
        load_experiment(path)


@pytest.mark.parametrize(
    ("make", "arguments", "column", "name", "is_told"),
    [
        (pyburgers.ConstantRateTest, CURVE, "stress", "Stress (ksi)", True),
        (pyburgers.ConstantRateTest, CURVE, "stress", "Stress (MPa)", False),
        (pyburgers.ConstantRateTest, CURVE, "strain", "Strain", False),
        (pyburgers.CreepTest, CREEP, "time", "t (min)", True),
        (pyburgers.AttenuationTable, TABLE, "modulus", "G (MPa)", True),
        (pyburgers.AttenuationTable, TABLE, "modulus", 3, False),
    ],
)
def test_a_column_of_pandas_whose_name_says_another_unit_is_told(
    make: Callable[..., Experiment],
    arguments: dict[str, Any],
    column: str,
    name: object,
    is_told: bool,
) -> None:
    series = pd.Series(arguments[column], name=name)
    test = make(**{**COMMON, **arguments, column: series})
    said = [one for one in test.notices if f"for column {name!r}, whose name says" in one]
    assert len(said) == is_told


@pytest.mark.parametrize(
    ("make", "arguments", "column", "name", "said"),
    [
        (pyburgers.ConstantRateTest, CURVE, "stress", "tau (MPa)", "of shear: write sqrt(3) tau"),
        (pyburgers.ConstantRateTest, CURVE, "strain", "shear strain", "gamma/sqrt(3)"),
        (
            pyburgers.ConstantRateTest,
            CURVE,
            "strain",
            "engineering strain",
            "or let a loading",
        ),
        (pyburgers.CreepTest, CREEP, "strain", "engineering strain", 'strain_measure = "eng'),
        (pyburgers.CreepTest, CREEP, "strain", "elongation", 'compression = "negative"'),
        (pyburgers.AttenuationTable, TABLE, "attenuation", "sin(delta)", "tan(arcsin(...))"),
    ],
)
def test_a_column_of_pandas_whose_name_says_another_form_is_told(
    make: Callable[..., Experiment], arguments: dict[str, Any], column: str, name: str, said: str
) -> None:
    test = make(**{**COMMON, **arguments, column: pd.Series(arguments[column], name=name)})
    (notice,) = (one for one in test.notices if repr(name) in one)
    assert said in notice


def test_elapsed_times_of_pandas_have_no_unit_in_their_name() -> None:
    times = pd.Series(pd.to_timedelta(CREEP["time"], unit="h"), name="Time (h)")
    test = pyburgers.CreepTest(**{**COMMON, **CREEP, "time": times, "time_unit": "s"})
    assert "whose name says" not in repr(test)
