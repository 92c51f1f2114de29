"""Files of loading histories: what is read and turned, what is refused, what is written."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from refusals import refusal, written
from same_contents import assert_equal

from pyburgers.common.errors import InputError
from pyburgers.kinds.kind import save_experiment
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.files import load_loading_history
from pyburgers.kinds.loading_history.stages import Stage
from pyburgers.kinds.read_test import Stated

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
        assert test.notices == ("The reading at the start was dropped: the model starts at rest.",)

    def test_legs_follow_the_stages(self, write: Write) -> None:
        legs = load_loading_history(write(MIXED, ROWS)).legs
        assert [(leg.driven, leg.start_value, leg.rate, leg.temperature) for leg in legs] == [
            ("strain", 0.0, 1e-5, 263.0),
            ("strain", 0.0, 0.0, 263.0),
            ("stress", 2e6, 0.0, 265.0),
            ("stress", 2e6, -1e5 / 60, 263.0),
        ]
        assert [leg.stage for leg in legs] == [0, 1, 2, 3]
        assert legs[-1].end_value == pytest.approx(1e6)

    def test_time_counts_from_the_first_stage(self, write: Write) -> None:
        rows = table(("time", np.array([110.0, 120.0])), ("strain", np.array([0.1, 0.2])))
        text = one_stage('control = "stress"\nstress = 1e6', 120.0)
        path = write(
            text,
            rows,
            ("start_time = 0", "start_time = 100"),
            ('stress_column = "stress"\nstress_unit = "MPa"\n', ""),
        )
        test = load_loading_history(path)
        assert (test.stages[0].start_time, test.end_time) == (0, 20)
        np.testing.assert_array_equal(test.time, [10, 20])

    def test_a_stage_column_says_on_which_side_of_a_jump_a_reading_is(self, write: Write) -> None:
        column = ['time_unit = "min"\nstress_column', 'time_unit = "min"\nstage_column = "stage"']
        rows = "stage,time,stress,strain\n1,5,1.5,\n1,10,2.0,\n2,20,1.2,\n3,45,,0.7\n4,70,,0.7\n"
        path = write(MIXED, rows, (column[0], column[1] + "\nstress_column"))
        test = load_loading_history(path)
        np.testing.assert_array_equal(test.reading_stage, [0, 0, 1, 2, 3])
        wrong = rows.replace("2,20", "1,20")
        text = refusal(write(MIXED, wrong, (column[0], column[1] + "\nstress_column")), load)
        assert "stage column 'stage', data row 3: found 1 at 20 min, expected times from 0" in text

    def test_times_of_changes_are_equal_in_any_unit(self, write: Write) -> None:
        # 2.2 h are more than 132 min, and 4.1 h less than 246 min, by the rounding of a product.
        assert 2.2 * 3600 > 132 * 60
        assert 4.1 * 3600 < 246 * 60
        stages = "".join(
            '[[stages]]\ncontrol = "stress"\n'
            f"start_time = {start}\nend_time = {end}\nstress = {load}\n"
            for start, end, load in ((0.0, 2.2, 2e6), (2.2, 4.1, 1e6))
        )
        rows = "time,stress,strain\n60,,0.1\n132,,0.2\n246,,0.3\n"
        test = load_loading_history(write(f'{HEAD}stage_time_unit = "h"\n{stages}{TAIL}', rows))
        np.testing.assert_array_equal(test.reading_stage, [0, 1, 1])
        np.testing.assert_array_equal(test.time[1:], [stage.end_time for stage in test.stages])

    def test_compliance_and_zero_of_strain(self, write: Write) -> None:
        keys = """
[apparatus]
compliance_per_Pa = 1e-11
compliance_sd_per_Pa = 2e-12

[strain_offset]
value = 0.01
sd = 0.002
unit = "percent"
"""
        test = load_loading_history(write(MIXED, ROWS, ("\n[data]", keys + "\n[data]")))
        assert test.apparatus_compliance == Stated(1e-11, 2e-12)
        assert test.strain_offset == Stated(1e-4, 2e-5)

    def test_stated_errors_are_in_si(self, write: Write) -> None:
        stated = (
            'strain_unit = "percent"',
            'strain_unit = "percent"\nstrain_uncertainty = 0.01\nstress_uncertainty = 0.02',
        )
        test = load_loading_history(write(MIXED, ROWS, stated))
        assert test.strain_uncertainty == pytest.approx(1e-4)
        assert test.stress_uncertainty == pytest.approx(2e4)

    def test_a_test_without_data(self, write: Write) -> None:
        text = MIXED.replace(TAIL, "\n[provenance]\nkind = 'measured'\nsource = 'nobody'\n")
        test = load_loading_history(write(text, ROWS))
        assert test.n_points == 0
        assert test.largest_stress == 2e6

    def test_a_test_without_data_in_which_nothing_is_imposed(self, write: Write) -> None:
        held = '[[stages]]\ncontrol = "hold_strain"\nstart_time = 0\nend_time = 10\n'
        source = "\n[provenance]\nkind = 'measured'\nsource = 'nobody'\n"
        assert "a model at rest tells nothing" in refusal(write(HEAD + held + source, ROWS), load)


class TestTurning:
    def test_compression_negative(self, write: Write) -> None:
        negative = ROWS.replace(",1", ",-1").replace(",2", ",-2").replace(",0.", ",-0.")
        path = write(
            MIXED,
            negative,
            ("stage_time_unit", 'compression = "negative"\nstage_time_unit'),
            ("= 1e-5", "= -1e-5"),
            ("stress = 2.0", "stress = -2.0"),
            ("stress_rate = -0.1", "stress_rate = 0.1"),
        )
        turned, plain = load_loading_history(path), load_loading_history(write(MIXED, ROWS))
        assert "Compression is negative in the file: the signs were turned." in turned.notices
        assert_equal(replace(turned, notices=()), replace(plain, notices=()))

    def test_engineering_readings(self, write: Write) -> None:
        time, strain = np.array([10.0, 20.0]), np.array([10.0, 20.0])
        rows = table(("time", time), ("stress", np.array([1.0, 2.0])), ("strain", strain))
        text = one_stage(
            'control = "strain_rate"\nstrain_rate_per_s = 1e-2',
            20.0,
            'stress_measure = "engineering"',
            'strain_measure = "engineering"',
        )
        test = load_loading_history(write(text, rows))
        np.testing.assert_allclose(test.response, [0.9e6, 1.6e6], rtol=1e-14)

    def test_engineering_strain(self, write: Write) -> None:
        rows = table(("time", np.array([10.0, 20.0])), ("strain", np.array([10.0, -20.0])))
        text = one_stage(
            'control = "stress"\nstress = 1e6', 20.0, 'strain_measure = "engineering"'
        ).replace('stress_column = "stress"\nstress_unit = "MPa"\n', "")
        test = load_loading_history(write(text, rows))
        np.testing.assert_allclose(test.response, [-np.log(0.9), -np.log(1.2)], rtol=1e-14)

    def test_the_zero_of_an_engineering_strain_is_no_shortening(self, write: Write) -> None:
        """Readings are what the model has beside them: true strain and the offset."""
        time, shortening = np.array([10.0, 20.0]), np.array([0.1, 0.2])
        rows = table(
            ("time", time), ("stress", np.array([1.0, 2.0])), ("strain", 100 * (shortening + 0.02))
        )
        measures = ('stress_measure = "engineering"', 'strain_measure = "engineering"')
        zero = '[strain_offset]\nvalue = 2.0\nsd = 0.01\nunit = "percent"\n\n[data]'
        rate = 'control = "strain_rate"\nstrain_rate_per_s = 1e-2'
        pressed = one_stage(rate, 20.0, *measures).replace("[data]", zero)
        loaded = load_loading_history(write(pressed, rows))
        np.testing.assert_allclose(loaded.response, [0.9e6, 1.6e6], rtol=1e-14)
        rows = table(("time", time), ("strain", 100 * (shortening + 0.02)))
        crept = (
            one_stage('control = "stress"\nstress = 1e6', 20.0, measures[1])
            .replace('stress_column = "stress"\nstress_unit = "MPa"\n', "")
            .replace("[data]", zero)
        )
        test = load_loading_history(write(crept, rows))
        np.testing.assert_allclose(test.response, 0.02 - np.log1p(-shortening), rtol=1e-14)

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

    def test_a_displacement_rate_after_a_load_goes_on_from_the_length(self, write: Write) -> None:
        """The strain that is read of a sample at rest is no part of its shortening."""
        rows = table(
            ("time", np.array([50.0, 100.0, 200.0])),
            ("stress", np.array([1.0, 1.0, 2.0])),
            ("strain", np.array([7.0, 12.0, 22.0])),
        )
        after = '[[stages]]\ncontrol = "strain_rate"\nstrain_rate_per_s = 1e-3\n'
        text = one_stage(
            'control = "stress"\nstress = 1e6', 100.0, 'strain_measure = "engineering"'
        ).replace(
            "[data]",
            f"{after}start_time = 100.0\nend_time = 200.0\n\n"
            '[strain_offset]\nvalue = 2.0\nsd = 0.01\nunit = "percent"\n\n[data]',
        )
        legs = load_loading_history(write(text, rows)).stages[1].knots
        (_, first), (_, last) = legs[0], legs[-1]
        assert last - first == pytest.approx(np.log(0.9 / 0.8), rel=1e-12)

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

    def test_a_jump_of_the_stress_stays(self, write: Write) -> None:
        time = np.linspace(0.0, 100.0, 101)
        rows = table(
            ("time", time), ("stress", np.where(time < 50, 2.0, 5.0)), ("strain", 0.01 * time)
        )
        test = load_loading_history(write(one_stage('control = "stress_series"', 100.0), rows))
        stress = np.interp(time, *np.transpose(test.stages[0].knots)) / 1e6
        np.testing.assert_allclose(stress, np.where(time < 50, 2.0, 5.0), rtol=1e-6)
        assert len(test.legs) == 3

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


def load(path: Path) -> HistoryExperiment:
    return load_loading_history(path)


class TestRefusals:
    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ("end_time = 30\n", "end_time = 29\n", "number 3: found 30, a gap, expected 29"),
            ("end_time = 30\n", "end_time = 31\n", "number 3: found 30, an overlap, expected 31"),
            ("end_time = 10\n", "end_time = 0\n", "number 1: found 0, expected more than 0"),
            ('"hold_strain"', '"relax"', "key 'control' in [[stages]] number 2: found 'relax'"),
            ("stress = 2.0", "strain_rate_per_s = 2.0", "expected 'stress'"),
            ("stress = 2.0\n", "", "key 'stress' in [[stages]] number 3 is missing"),
            ('stage_time_unit = "min"', 'stage_time_unit = "days"', "unit 'days'"),
            ('stage_stress_unit = "MPa"', 'stage_stress_unit = "bar"', "unit 'bar'"),
            ('strain_unit = "percent"', 'strain_unit = "MPa"', "unit 'MPa'"),
            ('strain_unit = "percent"\n', "", "both or neither"),
            ("temperature_K = 265.0", "temperature_K = -8.0", "found -8.0"),
            (
                "end_time = 70",
                "end_time = 65",
                "1 point outside every stage, the first at 70 min (data row 8), "
                "expected times between 0 and 65 min",
            ),
            ('"hold_strain"', '"stress_rate"\nstress_rate = 1.0', "key 'start_stress' is missing"),
            (
                'strain_column = "strain"\nstrain_unit = "percent"\n',
                "",
                "stage 3 imposes a stress but",
            ),
        ],
    )
    def test_wrong_files(self, write: Write, old: str, new: str, words: str) -> None:
        assert words in refusal(write(MIXED, ROWS, (old, new)), load)

    def test_a_response_that_is_missing_in_a_stage(self, write: Write) -> None:
        text = refusal(
            write(MIXED, ROWS.replace("1.2,0", ",0").replace("2.0,0.6\n", ",0.6\n")), load
        )
        assert "stage 2 imposes a strain but" in text

    def test_moments_with_several_readings_that_drive_a_stage_are_named(self, write: Write) -> None:
        rows = "time,stress,strain\n0,1,0\n1,1,0.1\n1,2,0.1\n1,1,0\n2,1,0.2\n2,3,0.2\n3,1,0.3\n"
        text = refusal(write(one_stage('control = "stress_series"', 3.0), rows), load)
        assert "1 s (3 readings), 2 s (2 readings); expected one reading of a moment" in text
        assert 'control = "stress"' in text

    def test_times_that_go_back(self, write: Write) -> None:
        text = refusal(write(MIXED, ROWS.replace("5,1.5", "25,1.5")), load)
        assert "data row 3: the time 10 min comes after 25 min, expected times that" in text

    @pytest.mark.parametrize(
        ("last", "expected"), [(1, "expected 1, the only stage"), (2, "a whole number from 1 to 2")]
    )
    def test_a_stage_that_is_not_there(self, write: Write, last: int, expected: str) -> None:
        key = ("stress_column", 'stage_column = "part"\nstress_column')
        text = stages(*['control = "stress"\nstress = 1.0'] * last)
        path = write(text, f"part,time,stress,strain\n1,1,,0.1\n{last + 1},5,,0.2\n", key)
        found = refusal(path, load)
        assert f"stage column 'part', data row 2: found {last + 1}, expected" in found
        assert expected in found

    def test_a_jump_of_the_strain(self, write: Write) -> None:
        rows = table(
            ("time", np.arange(5.0)),
            ("stress", np.arange(5.0)),
            ("strain", np.array([0.5, 0.51, 0.52, 0.53, 0.54])),
        )
        text = refusal(write(one_stage('control = "strain_series"', 4.0), rows), load)
        assert "found a jump of the strain, from 0 to 0.005" in text

    def test_a_series_without_readings(self, write: Write) -> None:
        rows = "time,stress,strain\n0,,0\n1,,0.1\n2,1,0.2\n"
        text = refusal(write(one_stage('control = "stress_series"', 2.0), rows), load)
        assert "found fewer than two readings of the stress" in text

    def test_an_engineering_stress_without_a_strain(self, write: Write) -> None:
        keys = ("stage_time_unit", 'stress_measure = "engineering"\nstage_time_unit')
        rows = ROWS.replace("1.2,0.6", "1.2,")
        assert "expected the strain of every reading" in refusal(write(MIXED, rows, keys), load)

    def test_knots_of_times_that_repeat(self, write: Write) -> None:
        text = one_stage(
            'control = "stress_series"\nknots = [[0, 1e6], [1, 1e6], [1, 2e6], [2, 2e6]]', 2.0
        )
        path = write(text, "time,stress,strain\n1,1,0.1\n2,1,0.2\n")
        assert "found the time 1 after a time that is not earlier" in refusal(path, load)


STRAIN_COLUMN = 'strain_column = "strain"\nstrain_unit = "percent"\n'
STRESS_COLUMN = 'stress_column = "stress"\nstress_unit = "MPa"\n'


def stages(*lines: str, keys: str = "", after: str = "") -> str:
    """A test of stages that end 10 s after one another, without a stress column in `after`."""
    text = "".join(
        f"[[stages]]\nstart_time = {10 * k}\nend_time = {10 * (k + 1)}\n{line}\n\n"
        for k, line in enumerate(lines)
    )
    text = f'{HEAD}stage_stress_unit = "MPa"\n{keys}\n{text}{after}{TAIL}'
    return text.replace('time_unit = "min"', 'time_unit = "s"')


def ends_of_stages(test: HistoryExperiment) -> list[tuple[float, float]]:
    """Stress (MPa) at the start and the end of each stage."""
    own = [[leg for leg in test.legs if leg.stage == number] for number in range(len(test.stages))]
    return [(legs[0].start_value / 1e6, legs[-1].end_value / 1e6) for legs in own]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("", "", None),
        ("= 1e-5", "= 1e-6", "Stage 1: the strain that was read lies up to 0.00378"),
        ('control = "hold_strain"', 'control = "strain_rate"\nstrain_rate_per_s = 1e-5', "Stage 2"),
        (
            "stress = 2.0",
            "stress = 0.2",
            "Stage 3: the stress that was read lies up to 1.8 MPa from",
        ),
        ("stress_rate = -0.1", "stress_rate = -0.1\nstart_stress = 20", "Stage 4: the stress"),
    ],
)
def test_readings_unlike_what_is_imposed_are_told(
    old: str, new: str, words: str | None, write: Write
) -> None:
    rows = """\
time,stress,strain
2,0.5,0.12
4,1.3,0.24
5,1.5,0.3
9,2.0,0.54
12,1.5,0.6
20,1.2,0.6
26,1.1,0.6
40,2.0,0.65
45,2.0,0.7
55,2.0,0.71
60,2.0,0.75
62,1.8,0.75
66,1.4,0.75
70,1.0,0.74
"""
    notices = load_loading_history(write(MIXED, rows, (old, new))).notices
    told = [notice for notice in notices if "check units, signs" in notice]
    assert bool(told) == (words is not None)
    assert (words or "") in "".join(told)


SERIES = 'control = "stress_series"'


class TestSeries:
    @pytest.mark.parametrize(
        "readings",
        [
            [(0, 5), (10, 5), (20, 5), (21, 2), (30, 2), (40, 5), (50, 5)],
            [(0, 0), (1, 5), (10, 5), (100, 0), (1000, 0)],
        ],
    )
    def test_a_line_goes_through_few_readings(
        self, write: Write, readings: list[tuple[float, float]]
    ) -> None:
        time, stress = np.transpose(readings).astype(float)
        rows = table(("time", time), ("stress", stress), ("strain", 0.01 * (time + 1)))
        test = load_loading_history(write(one_stage(SERIES, float(time[-1])), rows))
        line = np.interp(time, *np.transpose(test.stages[0].knots)) / 1e6
        np.testing.assert_allclose(line, stress, atol=1e-9)

    @pytest.mark.parametrize("staged", [True, False], ids=["stage column", "no stage column"])
    def test_a_stress_that_jumps_between_stages(self, write: Write, staged: bool) -> None:
        time = np.array([0.0, 5, 9, 10, 10, 15, 20] if staged else [0.0, 5, 9, 10, 15, 20])
        stage = np.array([1.0, 1, 1, 1, 2, 2, 2] if staged else [1.0, 1, 1, 2, 2, 2])
        stress = np.where(stage == 1, 10.0, 5.0)
        column = [("stage", stage.astype(int))] if staged else []
        rows = table(("time", time), *column, ("stress", stress), ("strain", 0.1 + 0.01 * time))
        key = ("stress_column", 'stage_column = "stage"\nstress_column')
        path = write(stages(SERIES, SERIES), rows, *([key] if staged else []))
        np.testing.assert_allclose(ends_of_stages(load_loading_history(path)), [(10, 10), (5, 5)])

    def test_a_ramp_goes_on_into_the_next_stage(self, write: Write) -> None:
        time = np.arange(0.0, 21.0)
        rows = table(("time", time), ("stress", 1 + time), ("strain", 0.1 + 0.01 * time))
        test = load_loading_history(write(stages(SERIES, SERIES), rows))
        np.testing.assert_allclose(ends_of_stages(test), [(1, 11), (11, 21)])
        assert "Nothing was read in its last 10 %" in test.notices[0]

    def test_an_unloading_at_the_last_reading_goes_on_no_further(self, write: Write) -> None:
        time = np.arange(0.0, 21.0)
        stress = np.where(time < 9, 10.0, 4.0)
        rows = table(("time", time), ("stress", stress), ("strain", 0.1 + 0.01 * time))
        test = load_loading_history(write(stages(SERIES, SERIES), rows))
        np.testing.assert_allclose(ends_of_stages(test), [(10, 4), (4, 4)])

    def test_a_reading_where_nothing_jumps_counts_for_both_stages(self, write: Write) -> None:
        rows = "time,stress,strain\n0,1,0.1\n10,3,0.2\n15,2.5,0.2\n20,2,0.2\n"
        test = load_loading_history(write(stages(SERIES, 'control = "hold_strain"'), rows))
        assert ends_of_stages(test)[0] == pytest.approx((1, 3))

    def test_a_force_goes_on_from_where_keys_say_that_it_ends(self, write: Write) -> None:
        rate = 'control = "stress_rate"\nstress_rate = '
        text = stages(
            f"{rate}0.2", f"{rate}-0.1", f"{rate}-0.1", keys='stress_measure = "engineering"\n'
        ).replace('stress_column = "stress"\nstress_unit = "MPa"\n', "")
        rows = table(("time", np.linspace(0.0, 30.0, 31)), ("strain", np.zeros(31)))
        ends = ends_of_stages(load_loading_history(write(text, rows)))
        np.testing.assert_allclose(ends, [(0, 2), (2, 1), (1, 0)], atol=1e-9)

    def test_the_area_under_a_force_is_that_of_its_own_stage(self, write: Write) -> None:
        """The strain that comes back when the force goes is no strain of the stage before."""
        time = np.arange(0.0, 21.0)
        strain = np.where(time < 10, 10.0, 5.0)
        rows = table(("time", time), ("strain", strain))
        force = 'control = "stress"\nstress = '
        text = stages(f"{force}1.0", f"{force}0.5", keys='stress_measure = "engineering"\n')
        test = load_loading_history(write(text, rows, (STRESS_COLUMN, "")))
        area = np.exp(-0.1), np.exp(-0.05)
        expected = [(area[0], area[0]), (0.5 * area[1], 0.5 * area[1])]
        np.testing.assert_allclose(ends_of_stages(test), expected)

    def test_a_series_that_holds_a_part_of_its_stage_is_refused(self, write: Write) -> None:
        rows = "time,stress,strain\n4,1,0.1\n4.5,1,0.2\n5,1,0.3\n"
        text = refusal(write(stages(SERIES), rows), load)
        assert "found readings of the stress from 4 s to 5 s only, expected" in text
        assert "from 0 s to 10 s" in text

    def test_ends_without_a_reading_are_told_and_readings_counted(self, write: Write) -> None:
        rows = "time,stress,strain\n0.4,1,0.1\n4.5,1,0.2\n9.7,1,0.3\n"
        notice = load_loading_history(write(stages(SERIES), rows)).notices[0]
        assert "3 readings of the stress became 1 leg, which passes" in notice
        assert "Nothing was read in its first 4 % and its last 3 %." in notice


class TestStrainGoesOn:
    KNOTS = 'control = "strain_series"\nknots = [[{}, {}], [{}, {}]]'
    RATE = 'control = "strain_rate"\nstrain_rate_per_s = 1e-5'
    LOAD = 'control = "stress"\nstress = 1.0'
    CREPT = "time,stress,strain\n5,1,0.1\n9.9,1,0.2\n"

    def test_knots_of_the_first_stage_start_at_zero(self, write: Write) -> None:
        rows = "time,stress,strain\n5,1,\n"
        path = write(stages(self.KNOTS.format(0, 0.5, 10, 0.6)), rows)
        assert "found a jump of the strain, from 0 to 0.5" in refusal(path, load)
        test = load_loading_history(write(stages(self.KNOTS.format(0, 0.0, 10, 0.1)), rows))
        assert test.legs[0].end_value == pytest.approx(0.1)

    @pytest.mark.parametrize("first", [0.0, 0.02], ids="from {}".format)
    def test_knots_may_hold_the_zero_of_the_readings(self, write: Write, first: float) -> None:
        zero = '[strain_offset]\nvalue = 2.0\nunit = "percent"\n'
        text = stages(self.KNOTS.format(0, first, 10, 0.1 + first), after=zero)
        test = load_loading_history(write(text, "time,stress,strain\n5,1,\n"))
        assert test.legs[0].end_value == pytest.approx(0.1)

    def test_knots_go_on_from_an_imposed_strain(self, write: Write) -> None:
        rows = "time,stress,strain\n5,1,\n15,1,\n"
        path = write(stages(self.RATE, self.KNOTS.format(10, 0.5, 20, 0.6)), rows)
        assert "found a jump of the strain, from 0.0001 to 0.5" in refusal(path, load)
        going_on = stages(self.RATE, self.KNOTS.format(10, 1e-4, 20, 0.1))
        assert len(load_loading_history(write(going_on, rows)).legs) == 2

    @pytest.mark.parametrize(
        ("rows", "jump"),
        [("10,1,5\n15,2,5.1\n20,2,5.2\n", 0.05), ("10,1,0.21\n15,2,0.3\n20,2,0.4\n", None)],
    )
    def test_readings_go_on_from_a_strain_that_was_read(
        self, write: Write, rows: str, jump: float | None
    ) -> None:
        path = write(stages(self.LOAD, 'control = "strain_series"'), self.CREPT + rows)
        if jump is None:
            assert len(load_loading_history(path).legs) == 3
        else:
            assert f"found a jump of the strain, from 0.002 to {jump}" in refusal(path, load)

    def test_knots_go_on_from_a_strain_that_was_read_and_a_hold(self, write: Write) -> None:
        rows = f"{self.CREPT}15,0.9,\n25,1,\n"
        hold = 'control = "hold_strain"'
        jumping = stages(self.LOAD, hold, self.KNOTS.format(20, 0.05, 30, 0.1))
        assert "from 0.002 to 0.05" in refusal(write(jumping, rows), load)
        going_on = stages(self.LOAD, hold, self.KNOTS.format(20, 0.0021, 30, 0.1))
        assert len(load_loading_history(write(going_on, rows)).legs) == 3

    def test_a_copy_of_a_smoothed_series_is_read(self, write: Write, tmp_path: Path) -> None:
        time = np.linspace(0.0, 10.0, 101)
        noise = 0.02 * np.random.default_rng(5).standard_normal(time.size)
        rows = table(("time", time), ("stress", 1 + time), ("strain", 1 + 0.05 * time + noise))
        zero = '[strain_offset]\nvalue = 1.0\nunit = "percent"\n'
        test = load_loading_history(write(stages('control = "strain_series"', after=zero), rows))
        assert test.stages[0].knots[0][1] != 0.01
        folder = tmp_path / "copy"
        folder.mkdir()
        assert_equal(load_loading_history(save_experiment(test, folder)), test)


class TestReadingsAtJumps:
    LOAD = 'control = "stress"\nstress = {}'
    ZERO = '[strain_offset]\nvalue = 2.0\nsd = {}\nunit = "percent"\n'

    @pytest.mark.parametrize(
        ("first", "after", "stated", "dropped"),
        [
            ("0", "", None, True),
            ("0.02", "", None, False),
            ("0.02", "", 0.01, True),
            ("0.09", "", 0.04, False),
            ("2", ZERO.format(0.0), None, True),
            ("2.02", ZERO.format(0.0), None, False),
            ("2.02", ZERO.format(0.01), None, True),
        ],
    )
    def test_a_table_may_begin_before_the_load(
        self, write: Write, first: str, after: str, stated: float | None, dropped: bool
    ) -> None:
        """Equal to the state at rest by its error, and nearer to it than to the next reading."""
        zero = 2.0 if after else 0.0
        rows = f"time,stress,strain\n0,,{first}\n1,,{zero + 0.1}\n5,,{zero + 0.2}\n"
        error = [] if stated is None else [("[data]", f"[data]\nstrain_uncertainty = {stated}")]
        test = load_loading_history(write(stages(self.LOAD.format(1.0), after=after), rows, *error))
        assert test.n_points == (2 if dropped else 3)
        assert any("of the state before the load" in text for text in test.notices) == dropped

    def test_a_reading_before_a_later_change_of_the_load(self, write: Write) -> None:
        text = stages(self.LOAD.format(1.0), self.LOAD.format(3.0))
        rows = "time,stress,strain\n1,,0.1\n5,,0.2\n10,,{}\n12,,0.9\n20,,1\n"
        before = load_loading_history(write(text, rows.format(0.28)))
        np.testing.assert_array_equal(before.time, [1, 5, 12, 20])
        assert "The reading at the start of stage 2, a strain of 0.0028, was" in before.notices[0]
        behind = load_loading_history(write(text, rows.format(0.6)))
        np.testing.assert_array_equal(behind.time, [1, 5, 10, 12, 20])

    def test_a_stage_column_is_believed(self, write: Write) -> None:
        rows = "stage,time,stress,strain\n1,1,,0.1\n1,5,,0.2\n2,10,,0.28\n2,12,,0.9\n"
        key = ("stress_column", 'stage_column = "stage"\nstress_column')
        test = load_loading_history(
            write(stages(self.LOAD.format(1.0), self.LOAD.format(3.0)), rows, key)
        )
        assert test.n_points == 4

    def test_readings_where_the_load_goes_on_stay(self, write: Write) -> None:
        rows = "time,stress,strain\n1,,0.1\n5,,0.2\n10,,0.28\n12,,0.9\n20,,1\n"
        test = load_loading_history(
            write(stages(self.LOAD.format(1.0), self.LOAD.format(1.0)), rows)
        )
        assert test.n_points == 5

    def test_a_copy_keeps_its_readings(self, write: Write, tmp_path: Path) -> None:
        """Simulated ones too, whose noise may take them to the state before."""
        rows = "time,stress,strain\n0,,0.05\n1,,0.1\n5,,0.2\n"
        test = load_loading_history(write(stages(self.LOAD.format(1.0)), rows))
        simulated = replace(test, reading=np.array([0.0, 0.001, 0.002]))
        folder = tmp_path / "copy"
        folder.mkdir()
        assert_equal(load_loading_history(save_experiment(simulated, folder)), simulated)

    def test_how_large_a_dropped_reading_was(self, write: Write) -> None:
        notices = load_loading_history(write(MIXED, ROWS.replace("0,0,0", "0,0.4,0"))).notices
        assert (
            "The reading at the start, 0.4 MPa, was dropped: the model starts at rest." in notices
        )


class TestLoadingAhead:
    HOLD = 'control = "hold_strain"'
    RELAXING = "time,stress\n0,10\n1,9\n5,8\n10,7\n"

    @pytest.mark.parametrize("control", [HOLD, 'control = "strain_rate"\nstrain_rate_per_s = 0.0'])
    def test_a_relaxation_without_its_loading(self, write: Write, control: str) -> None:
        path = write(stages(control), self.RELAXING, (STRAIN_COLUMN, ""))
        text = refusal(path, load)
        assert "[[stages]] number 1: found a stress of 10 MPa although nothing was imposed" in text
        assert "expected the loading as a stage ahead of it" in text

    def test_a_load_that_stood_before_the_first_stage(self, write: Write) -> None:
        rate = 'control = "strain_rate"\nstrain_rate_per_s = 1e-5'
        rows = "time,stress\n1,9\n5,8\n15,9\n20,10\n"
        path = write(stages(self.HOLD, rate), rows, (STRAIN_COLUMN, ""))
        assert "found a stress of 9 MPa although" in refusal(path, load)

    def test_noise_before_the_loading_is_read(self, write: Write) -> None:
        rate = 'control = "strain_rate"\nstrain_rate_per_s = 1e-5'
        rows = "time,stress\n1,0.1\n5,-0.1\n15,9\n20,10\n"
        path = write(stages(self.HOLD, rate), rows, (STRAIN_COLUMN, ""))
        assert load_loading_history(path).n_points == 4

    def test_only_a_reading_at_the_start(self, write: Write) -> None:
        rate = 'control = "strain_rate"\nstrain_rate_per_s = 1e-5'
        for stage in (rate, TestReadingsAtJumps.LOAD.format(1.0)):
            text = refusal(write(stages(stage), "time,stress,strain\n0,0,0\n"), load)
            assert "table.csv: found no reading but that at the start" in text


class TestKnots:
    @pytest.mark.parametrize(
        ("knots", "words"),
        [
            ("[[0, 1.0]]", "found 1 of them, expected at least two"),
            ("[[0, 1.0, 2], [10, 1]]", "found [0.0, 1.0, 2.0], expected pairs"),
            ("[[0, 1.0], [10, nan]]", "key 'knots' in [[stages]] number 1, entry 2, entry 2"),
            ("[[0, 1.0], [10, 2.0]]\ntolerance = 0.3", "key 'tolerance': found it beside 'knots'"),
        ],
    )
    def test_wrong_knots(self, write: Write, knots: str, words: str) -> None:
        path = write(stages(f"{SERIES}\nknots = {knots}"), "time,stress,strain\n5,,0.1\n")
        assert words in refusal(path, load)


class TestRoundTrip:
    def test_a_copy_reads_the_same(self, write: Write, tmp_path: Path) -> None:
        keys = "\n[apparatus]\ncompliance_per_Pa = 1e-11\n\n[strain_offset]\nvalue = 0.01\n"
        stated = 'unit = "percent"\n\n[data]\nstrain_uncertainty = 0.01'
        test = load_loading_history(write(MIXED, ROWS, ("\n[data]", f"{keys}{stated}")))
        folder = tmp_path / "copy"
        folder.mkdir()
        assert_equal(load_loading_history(save_experiment(test, folder)), test)

    def test_readings_on_both_sides_of_a_jump(self, write: Write, tmp_path: Path) -> None:
        test = load_loading_history(write(MIXED, ROWS))
        moved = replace(
            test, reading_stage=np.array([0, 0, 1, 1, 2, 3, 3]), reading=test.reading * 1e3
        )
        folder = tmp_path / "copy"
        folder.mkdir()
        assert_equal(load_loading_history(save_experiment(moved, folder)), moved)

    def test_a_series_that_was_smoothed_and_thinned(self, write: Write, tmp_path: Path) -> None:
        time = np.linspace(0.0, 1000.0, 501)
        noise = 0.02 * np.random.default_rng(1).standard_normal(time.size)
        stress = np.interp(time, [0, 100, 600, 700, 1000], [0, 10, 10, 3, 3]) + noise
        rows = table(("time", time), ("stress", stress), ("strain", 0.001 * time))
        limit = ('strain_unit = "percent"', 'strain_unit = "percent"\nmax_readings = 60')
        text = one_stage('control = "stress_series"', 1000.0)
        test = load_loading_history(write(text, rows, limit))
        assert test.n_points <= 60
        folder = tmp_path / "copy"
        folder.mkdir()
        assert_equal(load_loading_history(save_experiment(test, folder)), test)

    def test_a_test_without_readings(self, write: Write, tmp_path: Path) -> None:
        empty = np.empty(0)
        test = replace(
            load_loading_history(write(MIXED, ROWS)),
            time=empty,
            reading=empty,
            reading_stage=np.empty(0, dtype=np.int64),
            n_readings_in_file=0,
        )
        folder = tmp_path / "copy"
        folder.mkdir()
        assert_equal(load_loading_history(save_experiment(test, folder)), test)


def test_an_error_is_an_input_error(write: Write) -> None:
    with pytest.raises(InputError):
        load_loading_history(write(MIXED, ROWS, ("1e-3", "-1e-3")))
