"""Files of loading histories: what is read and turned, what is refused, what is written."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from refusals import written

from pyburgers.kinds.loading_history.files import load_loading_history
from pyburgers.kinds.loading_history.stages import Stage

HEAD = """\
id = "sample-1"
material = "ice"
protocol = "loading_history"
temperature_K = 263.0
initial_grain_size_m = 1e-3
"""

TAIL = """
[data]
file = "table.csv"
time_column = "time"
time_unit = "min"
stress_column = "stress"
stress_unit = "MPa"
strain_column = "strain"
strain_unit = "percent"

[provenance]
kind = "measured"
source = "Somebody (2020)"
"""

MIXED = f"""\
{HEAD}
stage_time_unit = "min"
stage_stress_unit = "MPa"

[[stages]]
control = "strain_rate"
start_time = 0
end_time = 10
strain_rate_per_s = 1e-5

[[stages]]
control = "hold_strain"
start_time = 10
end_time = 30

[[stages]]
control = "stress"
start_time = 30
end_time = 60
stress = 2.0
temperature_K = 265.0

[[stages]]
control = "stress_rate"
start_time = 60
end_time = 70
stress_rate = -0.1
{TAIL}"""

ROWS = """\
time,stress,strain
0,0,0
5,1.5,0.3
10,2.0,0.6
20,1.2,0.6
30,2.0,0.62
45,2.0,0.7
60,2.0,0.75
70,,0.74
"""

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write a test with replaced text and its table; return the TOML's path."""

    def write(text: str, rows: str, *replacements: tuple[str, str]) -> Path:
        return written(tmp_path / "test.toml", text, replacements, {"table": rows})

    return write


def table(*columns: tuple[str, np.ndarray]) -> str:
    rows = zip(*(values.tolist() for _, values in columns), strict=True)
    names = ",".join(name for name, _ in columns)
    return "\n".join([names, *(",".join(map(repr, row)) for row in rows)]) + "\n"


def one_stage(stage: str, end: float, *keys: str) -> str:
    lines = ["[[stages]]", "start_time = 0", f"end_time = {end!r}", stage]
    text = "\n".join([HEAD, *keys, "", *lines, TAIL])
    return text.replace('time_unit = "min"', 'time_unit = "s"')


class TestReading:
    def test_stages_and_readings_are_in_si(self, write: Write) -> None:
        test = load_loading_history(write(MIXED, ROWS))
        assert test.stages == (
            Stage("strain_rate", 0, 600, 263.0, 1e-5),
            Stage("hold_strain", 600, 1800, 263.0),
            Stage("stress", 1800, 3600, 265.0, 2e6),
            Stage("stress_rate", 3600, 4200, 263.0, -1e5 / 60, 2e6),
        )
        np.testing.assert_array_equal(test.time, [300, 600, 1200, 1800, 2700, 3600, 4200])
        np.testing.assert_array_equal(test.reading_stage, [0, 1, 1, 2, 2, 3, 3])
        expected = [1.5e6, 2e6, 1.2e6, 0.0062, 0.007, 0.0075, 0.0074]
        np.testing.assert_allclose(test.response, expected, rtol=1e-14)
        np.testing.assert_array_equal(test.response_is_strain, [0, 0, 0, 1, 1, 1, 1])
        assert test.largest_stress == 2e6
        assert "ice, 263 to 265 K, 4 stages" in test.title
        assert test.n_readings_in_file == 8
        expansion, start = test.notices
        assert "differ by up to 2 K: thermal expansion is not in the model" in expansion
        assert start == "The reading at the start was dropped: the model starts at rest."


class TestTurning:
    @pytest.mark.parametrize("zero", [0.0, 2.0], ids="a zero of {} percent".format)
    def test_constant_force(self, write: Write, zero: float) -> None:
        time = np.linspace(0.0, 1000.0, 101)
        shortening = 0.15 * (time / 1000) ** 0.5
        rows = table(("time", time), ("strain", zero - 100 * np.log1p(-shortening)))
        offset = f'[strain_offset]\nvalue = {zero}\nsd = 0.01\nunit = "percent"\n\n[data]'
        text = (
            one_stage('control = "stress"\nstress = 1e6', 1000.0, 'stress_measure = "engineering"')
            .replace('stress_column = "stress"\nstress_unit = "MPa"\n', "")
            .replace("[data]", offset)
        )
        test = load_loading_history(write(text, rows))
        corners, stress = np.transpose(test.stages[0].knots)
        true = 1e6 * (1 - shortening)
        assert test.stages[0].control == "stress_series"
        np.testing.assert_allclose(np.interp(time, corners, stress), true, rtol=2e-3)
        assert len(test.legs) < 30

    @pytest.mark.parametrize("stated", ["", "strain_uncertainty = 0.2\n"])
    def test_noise_of_the_strain_is_no_load_under_a_constant_force(
        self, write: Write, stated: str
    ) -> None:
        time = np.linspace(0.0, 1000.0, 201)
        noise = 2e-3 * np.random.default_rng(1).standard_normal(time.size)
        rows = table(("time", time), ("strain", 100 * (1e-4 * time + noise)))
        text = one_stage(
            'control = "stress"\nstress = 1e6', 1000.0, 'stress_measure = "engineering"'
        ).replace('stress_column = "stress"\nstress_unit = "MPa"\n', stated)
        (leg,) = load_loading_history(write(text, rows)).legs
        assert leg.start_value == pytest.approx(1e6, rel=1e-3)
        assert leg.end_value == pytest.approx(1e6 * np.exp(-0.1), rel=5e-3)

    @pytest.mark.parametrize("measure", ["true", "engineering"])
    @pytest.mark.parametrize(
        "control",
        [
            '"stress"\nstress = 0.0',
            '"stress_rate"\nstart_stress = 0\nstress_rate = 0',
            '"stress_series"',
            '"stress_series"\ntolerance = 0.01',
        ],
    )
    def test_no_stress_after_a_load(self, write: Write, control: str, measure: str) -> None:
        loaded = 'control = "stress"\nstress = 1e6'
        unloaded = f"\n[[stages]]\nstart_time = 500.0\nend_time = 1000.0\ncontrol = {control}"
        time = np.linspace(0.0, 1000.0, 41)
        stress, strain = 1.0 * (time < 500), 2.0 + 1.0 * (time < 500)
        rows = table(("time", time), ("stress", stress), ("strain", strain))
        text = one_stage(loaded + unloaded, 500.0, f'stress_measure = "{measure}"')
        test = load_loading_history(write(text, rows))
        (rest,) = (leg for leg in test.legs if leg.stage == 1)
        assert (rest.start_value, rest.rate) == (0.0, 0.0)
        assert not test.doubts

    def test_constant_displacement_rate(self, write: Write) -> None:
        rows = table(("time", np.array([100.0, 200.0])), ("stress", np.array([1.0, 2.0])))
        text = one_stage(
            'control = "strain_rate"\nstrain_rate_per_s = 1e-3',
            200.0,
            'strain_measure = "engineering"',
        ).replace('strain_column = "strain"\nstrain_unit = "percent"\n', "")
        legs = load_loading_history(write(text, rows)).legs
        total = sum(leg.end_value for leg in legs)
        assert total == pytest.approx(-np.log(0.8), rel=1e-12)
        for leg in legs:
            middle = 1e-3 / (1 - 1e-3 * (leg.start_time + leg.end_time) / 2)
            assert leg.rate == pytest.approx(middle, rel=1e-4)

    def test_a_stress_series_becomes_legs(self, write: Write) -> None:
        time = np.linspace(0.0, 1000.0, 501)
        true = np.interp(time, [0, 100, 600, 700, 1000], [0, 10, 10, 3, 3])
        noisy = true + 0.02 * np.random.default_rng(1).standard_normal(time.size)
        rows = table(("time", time), ("stress", noisy), ("strain", 0.001 * time))
        test = load_loading_history(write(one_stage('control = "stress_series"', 1000.0), rows))
        corners, stress = np.transpose(test.stages[0].knots)
        assert len(test.legs) == 4
        assert np.abs(np.interp(time, corners, stress) / 1e6 - true).max() < 0.04
        assert "Stage 1: 501 readings of the stress became 4 legs" in test.notices[0]

    def test_a_tolerance_trades_legs_for_nearness(self, write: Write) -> None:
        time = np.linspace(0.0, 1000.0, 501)
        rows = table(("time", time), ("stress", np.sqrt(time)), ("strain", 0.001 * time))
        text = one_stage(
            'control = "stress_series"\ntolerance = 2.0', 1000.0, 'stage_stress_unit = "MPa"'
        )
        coarse = load_loading_history(write(text, rows))
        fine = load_loading_history(write(text.replace("2.0", "0.5"), rows))
        assert len(coarse.legs) < len(fine.legs)
        for test, tolerance in ((coarse, 2e6), (fine, 0.5e6)):
            line = np.interp(time, *np.transpose(test.stages[0].knots))
            assert np.abs(line - 1e6 * np.sqrt(time)).max() < 1.5 * tolerance
        assert "within about 2 MPa" in coarse.notices[0]

    def test_a_strain_series_becomes_legs(self, write: Write) -> None:
        time = np.linspace(0.0, 100.0, 101)
        strain = np.interp(time, [0, 30, 100], [0, 0.6, 1.3])
        rows = table(("time", time), ("stress", 1 + time), ("strain", strain))
        test = load_loading_history(write(one_stage('control = "strain_series"', 100.0), rows))
        np.testing.assert_allclose([leg.rate for leg in test.legs], [2e-4, 1e-4], rtol=1e-6)
        np.testing.assert_allclose([leg.start_value for leg in test.legs], 0)

    @pytest.mark.parametrize(
        "control", ['control = "stress"\nstress = 1.0', 'control = "stress_series"']
    )
    def test_several_readings_of_a_moment_are_kept_under_a_constant_stress(
        self, control: str, write: Write
    ) -> None:
        rows = [f"{k // 3 + 1},1,{0.1 * (k // 3 + 1) + 0.01 * (k % 3 - 1)}\n" for k in range(900)]
        path = write(one_stage(control, 300.0), "time,stress,strain\n0,1,0\n" + "".join(rows))
        test = load_loading_history(path)
        assert test.n_readings_in_file == 901
        assert 350 < test.n_points <= 402
        assert (np.diff(test.time) == 0).any()
        assert np.isfinite(test.reading).all()

    def test_long_records_are_thinned(self, write: Write) -> None:
        time = np.linspace(1.0, 10000.0, 5000)
        rows = table(("time", time), ("strain", 0.1 * time**0.3))
        text = one_stage('control = "stress"\nstress = 1e6', 10000.0)
        text = text.replace('stress_column = "stress"\nstress_unit = "MPa"\n', "")
        test = load_loading_history(write(text, rows))
        assert 300 < test.n_points <= 400
        assert test.n_readings_in_file == 5000
        assert (test.time[0], test.time[-1]) == (1.0, 10000.0)
        assert np.count_nonzero(test.time < 1000) > 0.3 * test.n_points
        assert f"{test.n_points} of 5000 readings are used" in test.notices[0]
        fewer = load_loading_history(
            write(
                text, rows, ('strain_unit = "percent"', 'strain_unit = "percent"\nmax_readings=50')
            )
        )
        assert 30 < fewer.n_points <= 50
