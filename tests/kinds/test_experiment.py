"""Experiment files: what is read, what is put right with a notice, what is refused."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from refusals import refusal, written
from same_contents import assert_equal

from pyburgers.common.errors import InputError
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, load_constant_rate
from pyburgers.kinds.doubts import doubts
from pyburgers.kinds.kind import load_experiment, save_experiment
from pyburgers.kinds.likelihood import likelihood_of

CHECKOUT = Path(__file__).parents[2]
EXPERIMENT = """\
id = "sample-1"
material = "ice"
protocol = "constant_rate"
temperature_K = 263.0
initial_grain_size_m = 230e-6

[[segments]]
start_strain = 0.0
strain_rate_per_s = 1e-4

[[segments]]
start_strain = 0.05
strain_rate_per_s = 1e-5

[data]
file = "curve.csv"
strain_column = "strain"
strain_unit = "percent"
stress_column = "stress"
stress_unit = "MPa"

[provenance]
kind = "measured"
source = "Somebody (2020)"

[metadata]
operator = "somebody"
confined = true
pressure_MPa = 300
"""
STRAINS_PERCENT = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 10.5, 11)

Write = Callable[..., Path]


def curve(strains: Sequence[float] = STRAINS_PERCENT) -> str:
    rows = [f"{strain},{1 + 0.1 * k:.1f}" for k, strain in enumerate(strains)]
    return "\n".join(["strain,stress", *rows]) + "\n"


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write an experiment with replaced text and its data files; return the TOML's path."""

    def write(*replacements: tuple[str, str], text: str = EXPERIMENT, **files: str | None) -> Path:
        return written(tmp_path / "test.toml", text, replacements, {"curve": curve(), **files})

    return write


class TestReading:
    def test_everything_is_converted_to_si(self, write: Write) -> None:
        experiment = load_constant_rate(write())
        np.testing.assert_allclose(experiment.strain, np.array(STRAINS_PERCENT) / 100, rtol=1e-15)
        np.testing.assert_allclose(experiment.stress[:2], [1.0e6, 1.1e6], rtol=1e-15)
        assert experiment.n_points == 12
        assert experiment.final_strain == pytest.approx(0.11)
        assert experiment.notices == ()
        assert experiment.metadata == {
            "operator": "somebody",
            "confined": True,
            "pressure_MPa": 300,
        }

    def test_time_follows_from_the_rates(self, write: Write) -> None:
        times = load_constant_rate(write()).time_at(np.array([0.0, 0.02, 0.05, 0.06]))
        np.testing.assert_allclose(times, [0, 200, 500, 1500], rtol=1e-12)

    def test_strain_follows_from_time_and_the_rates(self, write: Write) -> None:
        path = write(
            ('strain_column = "strain"', 'time_column = "time"'),
            ('strain_unit = "percent"', 'time_unit = "min"'),
            curve="time,stress\n5,1\n10,2\n20,3\n",
        )
        experiment = load_constant_rate(path)
        np.testing.assert_allclose(experiment.strain, [0.03, 0.051, 0.057], rtol=1e-12)
        np.testing.assert_allclose(
            experiment.time_at(experiment.strain), [300, 600, 1200], rtol=1e-12
        )

    @pytest.mark.parametrize(
        ("shift", "late", "words"),
        [
            (0, 1.0, None),
            (1e4, 1.03, None),
            (1e4, 1.5, "its slope is 1.4e-05 1/s) lies up to 0.01 from"),
            (0, 10.0, "which it leaves at data row 4; check units"),
        ],
    )
    def test_times_beside_strains_are_compared_with_the_rates(
        self, shift: float, late: float, words: str | None, write: Write
    ) -> None:
        times = [100, 300, 500, *(500 + late * own for own in (500, 1000, 2000))]
        strains = (1, 3, 5, 5.5, 6, 7)
        rows = "".join(f"{t + shift},{e},2\n" for t, e in zip(times, strains, strict=True))
        path = write(
            ('strain_unit = "percent"', 'strain_unit = "percent"\ntime_column="t"\ntime_unit="s"'),
            curve=f"t,strain,stress\n{rows}",
        )
        experiment = load_constant_rate(path)
        np.testing.assert_allclose(experiment.strain, np.array(strains) / 100)
        told = [notice for notice in experiment.notices if "the stated rates impose" in notice]
        assert bool(told) == (words is not None)
        assert (words or "") in "".join(told)

    def test_columns_by_number_between_spaces(self, write: Write) -> None:
        path = write(
            ('strain_column = "strain"', 'separator = "whitespace"\nheader = false\n'),
            ('stress_column = "stress"', "strain_column = 3\nstress_column = 1"),
            curve="# stress, load, strain\n\n 1.0\t7  1.0\n 2.0 8 6.0 \n",
        )
        experiment = load_constant_rate(path)
        np.testing.assert_allclose(experiment.strain, [0.01, 0.06])
        np.testing.assert_allclose(experiment.stress, [1e6, 2e6])

    def test_one_file_for_each_segment(self, write: Write) -> None:
        path = write(
            ("strain_rate_per_s = 1e-4", 'strain_rate_per_s = 1e-4\nfile = "curve.csv"'),
            ("strain_rate_per_s = 1e-5", 'strain_rate_per_s = 1e-5\nfile = "second.csv"'),
            ('[data]\nfile = "curve.csv"', "[data]"),
            curve=curve((1, 5.04)),
            second=curve((5, 6)),
        )
        experiment = load_constant_rate(path)
        np.testing.assert_allclose(experiment.strain, [0.01, 0.05, 0.05, 0.06])
        assert "curve.csv: 1 point moved by at most 0.0004" in experiment.notices[0]
        assert "1 point at the same strain" in experiment.notices[1]

    def test_an_experiment_without_data_can_be_simulated(self, write: Write) -> None:
        start, end = EXPERIMENT.index("[data]"), EXPERIMENT.index("[provenance]")
        text = "final_strain = 0.1\n" + EXPERIMENT[:start] + EXPERIMENT[end:]
        experiment = load_constant_rate(write(text=text))
        assert experiment.n_points == 0
        assert experiment.final_strain == 0.1

    def test_the_environment_takes_the_place_of_data_root(
        self, write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        path = write(("[data]", '[data]\ndata_root = "elsewhere"'))
        monkeypatch.delenv("PYBURGERS_DATA", raising=False)
        assert "elsewhere" in refusal(path)
        monkeypatch.setenv("PYBURGERS_DATA", str(tmp_path))
        assert load_constant_rate(path).n_points == 12

    def test_nothing_depends_on_the_current_directory(
        self, write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        path = write()
        (tmp_path / "empty").mkdir()
        monkeypatch.chdir(tmp_path / "empty")
        assert load_constant_rate(path).n_points == 12


class TestJitter:
    def test_a_hair_out_of_order_is_sorted_and_reported(self, write: Write) -> None:
        strains = (1, 2, 3, 2.95, 4, 5, 6, 7, 8, 9, 10, 11)
        experiment = load_constant_rate(write(curve=curve(strains)))
        assert np.all(np.diff(experiment.strain) >= 0)
        np.testing.assert_allclose(experiment.stress[2:4], [1.3e6, 1.2e6])
        assert experiment.notices == (
            "curve.csv: 1 point out of order by at most 0.0005 in strain sorted.",
        )

    def test_repeated_strains_keep_their_order(self, write: Write) -> None:
        strains = (1, 2, 2, 2, 4, 5, 6, 7, 8, 9, 10, 11)
        experiment = load_constant_rate(write(curve=curve(strains)))
        np.testing.assert_allclose(experiment.stress[1:4], [1.1e6, 1.2e6, 1.3e6])
        assert experiment.notices == ("2 points at the same strain as the point before.",)

    def test_points_at_and_just_before_zero_are_dropped(self, write: Write) -> None:
        experiment = load_constant_rate(write(curve=curve((-0.05, 0, *STRAINS_PERCENT))))
        assert experiment.n_points == 12
        assert experiment.strain[0] == pytest.approx(0.01)
        assert "1 point moved" in experiment.notices[0]
        assert "2 points at zero strain dropped" in experiment.notices[1]

    def test_points_just_beyond_the_end_are_moved_onto_it(self, write: Write) -> None:
        experiment = load_constant_rate(
            write(("[[segments]]", "final_strain = 0.1095\n[[segments]]"))
        )
        assert experiment.strain[-1] == experiment.final_strain == 0.1095
        assert "1 point moved by at most 0.0005" in experiment.notices[0]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (curve((-0.05, 0)), "every point is at zero strain"),
        ("strain,stress\n1,0\n2,0\n", "every stress is zero"),
    ],
)
def test_a_file_without_a_curve_is_refused(write: Write, content: str, words: str) -> None:
    with pytest.raises(InputError, match=rf"curve\.csv: {words}, expected a curve"):
        load_constant_rate(
            write(("[[segments]]", "final_strain = 0.11\n[[segments]]"), curve=content)
        )


@pytest.mark.parametrize(
    ("content", "notice"),
    [
        (curve((1, 2, 6)), "3 points for the 12 parameters"),
        ("strain,stress\n" + "\n".join(f"{k},-1" for k in range(1, 13)), "compression is positive"),
        (curve([100 * strain for strain in STRAINS_PERCENT]), "not in percent"),
    ],
)
def test_doubtful_data_are_announced(write: Write, content: str, notice: str) -> None:
    assert notice in " ".join(load_constant_rate(write(curve=content)).notices)


class TestTablesOfStrangers:
    """Layouts that need no key, and what is told of them."""

    def test_semicolons_units_and_decimal_commas(self, write: Write) -> None:
        path = write(curve="Probe 1\nstrain;stress\n%;MPa\n1,0;1,5\n6,0;2,5\n")
        experiment = load_constant_rate(path)
        np.testing.assert_allclose(experiment.stress, [1.5e6, 2.5e6])
        assert experiment.notices[:3] == (
            "curve.csv: line 1 ahead of the table was passed over.",
            "curve.csv: line 3 is a row of units (%, MPa).",
            "curve.csv: numbers have decimal commas.",
        )

    def test_a_row_whose_cell_stands_for_no_reading_is_left_out(self, write: Write) -> None:
        path = write(curve="strain,stress\n1,2\n2,-9999\n3,NaN\n6,4\n")
        experiment = load_constant_rate(path)
        np.testing.assert_allclose(experiment.strain, [0.01, 0.06])
        assert "-9999, NaN (in 2 of 4 rows) stands for no reading" in experiment.notices[0]
        assert (
            "2 rows left out, where a column that is read holds no reading (line 3, 4)"
            in experiment.notices[1]
        )

    def test_which_cells_stand_for_no_reading_may_be_said(self, write: Write) -> None:
        path = write(("[data]", "[data]\nmissing = [-7]"), curve="strain,stress\n1,2\n2,-7\n6,4\n")
        np.testing.assert_allclose(load_constant_rate(path).strain, [0.01, 0.06])
        path = write(("[data]", "[data]\nmissing = []"), curve="strain,stress\n1,2\n2,NaN\n6,4\n")
        assert "found 'NaN', expected a finite number" in refusal(path)

    def test_time_stamps_are_read_in_seconds(self, write: Write) -> None:
        by_time = (
            ('strain_column = "strain"', 'time_column = "strain"'),
            ('strain_unit = "percent"', 'time_unit = "s"'),
        )
        content = "strain,stress\n09:00:00,0\n09:05:00,2\n09:10:00,3\n10:00:00,4\n"
        experiment = load_constant_rate(write(*by_time, curve=content))
        np.testing.assert_allclose(experiment.strain, [0.03, 0.051, 0.081])
        assert "read as seconds since the first row" in experiment.notices[0]
        in_hours = (by_time[0], (by_time[1][0], 'time_unit = "h"'))
        assert "holds time stamps, expected 's'" in refusal(write(*in_hours, curve=content))

    def test_compression_may_be_negative(self, write: Write) -> None:
        content = curve([-strain for strain in STRAINS_PERCENT]).replace(",", ",-")
        content = content.replace("-stress", "stress")
        positive = load_constant_rate(write())
        path = write(curve=content)
        assert "found strains to -0.11 (fraction), which are negative" in refusal(path)
        assert 'write compression = "negative"' in refusal(path)
        path = write(("[[segments]]", 'compression = "negative"\n[[segments]]'), curve=content)
        negative = load_constant_rate(path)
        np.testing.assert_array_equal(negative.strain, positive.strain)
        np.testing.assert_array_equal(negative.stress, positive.stress)
        assert "the signs were turned" in negative.notices[0]


class TestNumbersThatNoTestHas:
    """Constructors refuse them as files do."""

    @pytest.mark.parametrize(
        ("changed", "words"),
        [
            ({"temperature": -10.0}, "temperature: found -10, expected kelvin"),
            ({"temperature": float("nan")}, "temperature: found nan"),
            ({"initial_grain_size": 230.0}, "grain size: found 230, expected metres"),
            ({"initial_grain_size": float("nan")}, "grain size: found nan"),
            ({"final_strain": 99.0}, "strain: found 99 as a fraction"),
            ({"stress": np.full(12, np.nan)}, "reading 1: found nan, expected a finite number"),
        ],
    )
    def test_they_are_refused(self, write: Write, changed: dict[str, Any], words: str) -> None:
        experiment = load_constant_rate(write())
        with pytest.raises(InputError, match=f"sample-1: {words}"):
            replace(experiment, **changed)

    def test_a_stress_that_a_material_does_not_bear_is_doubted(self, write: Write) -> None:
        experiment = load_constant_rate(write())
        assert doubts(experiment) == []
        (doubt,) = doubts(replace(experiment, stress=1e3 * experiment.stress))
        assert "GPa is unlikely in ice (up to 200 MPa is plausible)" in doubt

    def test_a_reading_that_is_far_from_all_others_is_doubted(self, write: Write) -> None:
        experiment = load_constant_rate(write())
        stress = experiment.stress.copy()
        stress[3] = -99e6
        (doubt,) = doubts(replace(experiment, stress=stress))
        assert "one stress (MPa) of -99 is more than 10 times as large as all others" in doubt


class TestBadInput:
    """One sentence that names the file and the key, column or line."""

    @pytest.mark.parametrize(
        ("old", "new", "fragments"),
        [
            ("temperature_K = 263.0\n", "", ["'temperature_K' is missing", "kelvin"]),
            ("temperature_K", "temperature_k", ["'temperature_k'", "mean 'temperature_K'"]),
            ("[data]", "[data]\nweight = 1", ["'weight' in [data]", "stress_unit"]),
            ("[data]", "[data]\nstress_uncertainty = 0", ["'stress_uncertainty' in [data]"]),
            ("start_strain = 0.05", "start = 0.05", ["'start' in [[segments]] number 2"]),
            ("temperature_K = 263.0", "temperature_K = -10.0", ["'temperature_K'", "Celsius"]),
            ("temperature_K = 263.0", "temperature_K = 26300", ["'temperature_K'", "3000"]),
            ("temperature_K = 263.0", 'temperature_K = "263"', ["'temperature_K'", "'263'"]),
            ("temperature_K = 263.0", "temperature_K = nan", ["'temperature_K'", "finite"]),
            ("[[segments]]", "final_strain = 0.04\n[[segments]]", ["'final_strain'", "0.05"]),
            ("strain_rate_per_s = 1e-5", "strain_rate_per_s = -1e-5", ["'strain_rate_per_s'", "2"]),
            ("strain_rate_per_s = 1e-4", "strain_rate_per_s = 0", ["'strain_rate_per_s'"]),
            ("size_m = 230e-6", "size_m = 230", ["'initial_grain_size_m'", "metres"]),
            ("size_m = 230e-6", "size_m = 0", ["'initial_grain_size_m'", "metres"]),
            ("start_strain = 0.0\n", "start_strain = 0.01\n", ["'start_strain'", "number 1"]),
            ("start_strain = 0.05", "start_strain = 0.0", ["'start_strain'", "number 2"]),
            ("start_strain = 0.05", "start_strain = 0.5", ["'start_strain'", "0.11"]),
            ('stress_unit = "MPa"', 'stress_unit = "psi"', ["'stress_unit'", "'psi'", "GPa"]),
            ('strain_unit = "percent"', 'strain_unit = "%"', ["'strain_unit'", "'%'"]),
            ('strain_unit = "percent"\n', "", ["'strain_unit'", "strain_column"]),
            (
                'strain_column = "strain"',
                'strain_column = "eps"',
                ["'strain_column'", "strain, st"],
            ),
            ('strain_column = "strain"', "strain_column = 1.5", ["'strain_column'", "1.5"]),
            (
                'strain_column = "strain"',
                "header = false\nstrain_column = 3",
                ["number from 1 to 2"],
            ),
            ('file = "curve.csv"', 'file = "curves.csv"', ["'file' in [data]", "does not exist"]),
            ('file = "curve.csv"\n', "", ["'file' is missing"]),
            ('kind = "measured"', 'kind = "guessed"', ["'kind' in [provenance]", "'guessed'"]),
            ('kind = "measured"\n', "", ["'kind' in [provenance] is missing"]),
            ('source = "Somebody (2020)"\n', "", ["'source' in [provenance] is missing"]),
            (
                'protocol = "constant_rate"',
                'protocol = "creep"',
                ["'protocol'", "constant_rate", "forced_oscillation"],
            ),
            ('id = "sample-1"', 'id = "../sample"', ["'id'", "letters"]),
            ("confined = true", "when = 2020-01-01", ["'when' in [metadata]", "a date"]),
            ("[metadata]", "[true_parameters]\nbeta = -1e-4\n[metadata]", ["synthetic"]),
            ("id = ", "id ", ["not a valid TOML file"]),
        ],
    )
    def test_experiment_file(self, write: Write, old: str, new: str, fragments: list[str]) -> None:
        path = write((old, new))
        text = refusal(path)
        for fragment in (str(path), *fragments):
            assert fragment in text

    @pytest.mark.parametrize(
        ("content", "fragments"),
        [
            ("", ["no data rows"]),
            ("strain,stress\n", ["no data rows"]),
            ("strain,stress\n1,2\n2,high\n", ["line 3", "'stress'", "'high'"]),
            ("strain,stress\n1,2\n2,\n", ["line 3", "'stress'", "an empty cell"]),
            ("strain,stress\n1,2\n2\n", ["line 3", "'stress'", "row ends before"]),
            ("strain,stress\n1,2\n2,inf\n", ["line 3", "'stress'", "finite"]),
            ("strain,stress\n1,2\n2,-1e306\n", ["'stress'", "too large"]),
            (curve((1, 2, 3, 2, 4, 5, 6)), ["row 4", "backwards", "0.01"]),
            (curve((-1, 2, 6)), ["row 1", "-0.01"]),
            (curve((0, 0)), ["final_strain", "0.05"]),
        ],
    )
    def test_data_file(self, write: Write, content: str, fragments: list[str]) -> None:
        path = write(curve=content)
        text = refusal(path)
        assert str(path) in text or str(path.with_name("curve.csv")) in text
        for fragment in fragments:
            assert fragment in text

    def test_missing_experiment_file(self, tmp_path: Path) -> None:
        assert str(tmp_path / "none.toml") in refusal(tmp_path / "none.toml")

    def test_a_folder_in_place_of_a_file(self, tmp_path: Path) -> None:
        assert "is a folder" in refusal(tmp_path)

    def test_binary_data_file(self, write: Write) -> None:
        path = write()
        path.with_name("curve.csv").write_bytes(b"\xff\xfe\x00strain")
        assert "not UTF-8" in refusal(path)

    def test_points_beyond_the_end(self, write: Write) -> None:
        path = write(("[[segments]]", "final_strain = 0.1\n[[segments]]"))
        assert "row 12: found strain 0.11, expected 0 to 0.1" in refusal(path)

    def test_points_outside_their_segment(self, write: Write) -> None:
        path = write(
            ("strain_rate_per_s = 1e-4", 'strain_rate_per_s = 1e-4\nfile = "curve.csv"'),
            ("strain_rate_per_s = 1e-5", 'strain_rate_per_s = 1e-5\nfile = "second.csv"'),
            ('[data]\nfile = "curve.csv"', "[data]"),
            second=curve((4, 11)),
            curve=curve((1, 2)),
        )
        text = refusal(path)
        assert "second.csv" in text
        assert "found strain 0.04" in text

    def test_no_data_and_no_end(self, write: Write) -> None:
        start, end = EXPERIMENT.index("[data]"), EXPERIMENT.index("[provenance]")
        assert "'final_strain'" in refusal(write(text=EXPERIMENT[:start] + EXPERIMENT[end:]))

    def test_unknown_true_parameter(self, write: Write) -> None:
        path = write(
            ('"measured"', '"synthetic"'),
            ("[metadata]", "[true_parameters]\nbetta = 1\n[metadata]"),
        )
        assert "'betta' in [true_parameters], did you mean 'beta'?" in refusal(path)


class TestSaving:
    def test_a_copy_reads_back_exactly_with_its_notices(self, write: Write, tmp_path: Path) -> None:
        path = write(
            (
                'source = "Somebody (2020)"',
                'source = "Müller \\"ice\\" \\\\ 2020"\nnotes = "a\\nb"',
            ),
            curve=curve((0, 1 / 3, 1, 0.99, 6, 6)),
        )
        original = load_experiment(path)
        assert len(original.notices) == 4
        assert isinstance(original, ConstantRateExperiment)
        assert original.stress_uncertainty is None
        copy = load_experiment(save_experiment(original, tmp_path))
        assert_equal(copy, original)

    def test_a_stated_reading_error_is_kept_in_pascals(self, write: Write, tmp_path: Path) -> None:
        original = load_experiment(write(("[data]", "[data]\nstress_uncertainty = 0.05")))
        assert isinstance(original, ConstantRateExperiment)
        assert original.stress_uncertainty == pytest.approx(0.05e6)
        assert_equal(load_experiment(save_experiment(original, tmp_path)), original)
        error, unit = likelihood_of(original).along(original)["reading_error"]
        assert error.tolist() == [original.stress_uncertainty] * original.n_points
        assert unit == "Pa"

    def test_a_copy_without_data(self, write: Write, tmp_path: Path) -> None:
        start, end = EXPERIMENT.index("[data]"), EXPERIMENT.index("[provenance]")
        text = "final_strain = 0.1\n" + EXPERIMENT[:start] + EXPERIMENT[end:]
        original = load_experiment(write(text=text))
        assert_equal(load_experiment(save_experiment(original, tmp_path)), original)


TABLE = """\
sample,part,strain,stress
A,1,1,1.0
B,1,1,9.0
A,1,5.04,2.0
A,2,5,3.0
A,2,8,4.0
B,2,8,8.0
"""
OF_A = ('[data]\nfile = "curve.csv"', '[data]\nfile = "curve.csv"\nrows = { sample = "A" }')
PARTS = (
    ("strain_rate_per_s = 1e-4", "strain_rate_per_s = 1e-4\nrows = { part = 1 }"),
    ("strain_rate_per_s = 1e-5", "strain_rate_per_s = 1e-5\nrows = { part = 2 }"),
)


class TestRowsOfATable:
    def test_rows_of_one_sample(self, write: Write) -> None:
        path = write(OF_A, ('"A"', '"B"'), curve=TABLE)
        experiment = load_constant_rate(path)
        np.testing.assert_allclose(experiment.strain, [0.01, 0.08], rtol=1e-12)
        np.testing.assert_allclose(experiment.stress, [9e6, 8e6], rtol=1e-12)

    def test_each_segment_has_rows_of_its_own(self, write: Write) -> None:
        experiment = load_constant_rate(write(OF_A, *PARTS, curve=TABLE))
        np.testing.assert_allclose(experiment.stress, [1e6, 2e6, 3e6, 4e6], rtol=1e-12)
        # The third reading is of the first segment and lies 4e-4 beyond its end.
        np.testing.assert_allclose(experiment.strain, [0.01, 0.05, 0.05, 0.08], rtol=1e-12)
        assert "curve.csv, sample A, part 1: 1 point moved" in experiment.notices[0]

    def test_a_copy_reads_back_without_the_table(self, write: Write, tmp_path: Path) -> None:
        original = load_experiment(write(OF_A, *PARTS, curve=TABLE))
        copy = tmp_path / "copy"
        copy.mkdir()
        assert_equal(load_experiment(save_experiment(original, copy)), original)

    def test_no_such_sample(self, write: Write) -> None:
        text = refusal(write(OF_A, ('"A"', '"C"'), curve=TABLE))
        assert "key 'rows': found 'C' for column 'sample', expected one" in text
        assert text.endswith("curve.csv holds: A, B.")

    def test_no_such_column(self, write: Write) -> None:
        text = refusal(write(OF_A, ("sample = ", "name = "), curve=TABLE))
        assert "key 'rows': column 'name' is not in" in text

    def test_no_header(self, write: Write) -> None:
        text = refusal(write(OF_A, ("[data]", "[data]\nheader = false"), curve=TABLE))
        assert "key 'rows': found column 'sample', expected none" in text

    def test_a_number_with_a_fraction_names_no_row(self, write: Write) -> None:
        text = refusal(write(OF_A, ('"A"', "1.5"), curve=TABLE))
        assert "key 'sample' in [data.rows]: found 1.5, expected text, or a whole number" in text

    def test_a_line_is_named_as_it_stands_in_the_file(self, write: Write) -> None:
        path = write(OF_A, curve=TABLE.replace("A,2,8,4.0", "A,2,8,four"))
        assert "line 6, column 'stress': found 'four'" in refusal(path)

    def test_rows_of_some_segments_only(self, write: Write) -> None:
        path = write(OF_A, PARTS[0], curve=TABLE)
        assert "key 'rows' in [[segments]]: expected it in every one" in refusal(path)

    def test_rows_of_segments_that_have_files(self, write: Write) -> None:
        parts = [(old, f'{new}\nfile = "curve.csv"') for old, new in PARTS]
        path = write(*parts, ('[data]\nfile = "curve.csv"', "[data]"), curve=TABLE)
        assert "and with it one 'file' in [data]" in refusal(path)
