"""`pyburgers check-file`: all that is wrong with a file at once, and what may be behind it."""

from collections.abc import Callable
from pathlib import Path

import pytest
from small_inputs import CURVE, DATA, EXPERIMENT, PRIORS

from pyburgers.cli.main import main
from pyburgers.kinds.kind import load_experiment

Checked = Callable[..., tuple[int, list[str]]]


@pytest.fixture
def checked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Checked:
    """Check the file of an experiment, parts of it replaced; return exit code and lines."""

    def checked(*replaced: tuple[str, str], curve: str = CURVE) -> tuple[int, list[str]]:
        text = EXPERIMENT
        for old, new in replaced:
            assert old in text
            text = text.replace(old, new, 1)
        (tmp_path / "test.toml").write_text(text, encoding="utf-8")
        (tmp_path / "curve.csv").write_text(curve, encoding="utf-8")
        before = sorted(tmp_path.rglob("*"))
        code = main(["check-file", str(tmp_path / "test.toml")])
        assert sorted(tmp_path.rglob("*")) == before
        out, error = capsys.readouterr()
        assert error == ""
        return code, out.splitlines()

    return checked


def of_kind(kind: str, lines: list[str]) -> list[str]:
    return [line for line in lines if line.startswith(f"{kind}: ")]


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


def test_all_errors_of_keys_and_of_columns_are_told_at_once(checked: Checked) -> None:
    code, lines = checked(
        ("temperature_K = 263.0", "temperture_K = -10.0"),
        ('id = "sample-1"', 'id = "sample 1"'),
        ("= 1e-4", "= -1e-4"),
        ("230e-6", "230.0"),
        ('"fraction"', '"percents"'),
        ('stress_column = "stress"', 'stress_column = "sigma"'),
        ('kind = "measured"', 'kind = "guessed"'),
        curve="strain,stress\n0.01,2\nabc,3\n,4\n",
    )
    assert code == 2
    errors = of_kind("error", lines)
    for word in (
        "unknown key 'temperture_K'",
        "key 'temperature_K' is missing",
        "found -10",
        "'sample 1'",
        "strain_rate_per_s",
        "found 230",
        "'percents'",
        "'sigma'",
        "'guessed'",
        "line 3, column 'strain': found 'abc'",
        "line 4, column 'strain': found an empty cell",
    ):
        assert sum(word in error for error in errors) == 1, word
    assert len(errors) == 11
    assert lines[-1].endswith("11 errors; it cannot be used yet")


def test_of_many_bad_cells_some_are_named_and_the_others_counted(checked: Checked) -> None:
    rows = "\n".join(f"0.{k},x" for k in range(1, 9))
    code, lines = checked(curve=f"strain,stress\n{rows}\n")
    assert code == 2
    assert len(of_kind("error", lines)) == 4
    assert "5 more cells" in of_kind("error", lines)[-1]


HINTS = {
    "commented header": ((), "# strain,stress\n0.01,2\n0.02,3\n", "remove that '#'"),
    "no header": ((), "0.01,2\n0.02,3\n", "numbers of the columns from 1"),
    "header said to be none": (
        (("[data]\n", "[data]\nheader = false\n"),),
        CURVE,
        "remove header = false",
    ),
    "another separator": (
        (("[data]\n", '[data]\nseparator = ","\n'),),
        "strain;stress\n0.01;2\n0.02;3\n",
        "as if semicolons stood between them: remove the key separator",
    ),
    "empty cells between tabs": (
        (("[data]\n", '[data]\nseparator = "whitespace"\n'),),
        "strain\tnote\tstress\n0.01\t\t2\n0.02\t\t3\n",
        "as if tabs stood between them",
    ),
    "decimal commas": ((), "strain\tstress\n0,01\t2.5\n0,02\t3.1\n", "'0,01' (and 1 more)"),
    "minus signs": ((), "strain,stress\n0.01,\u22122\n0.02,3\n", "no minus sign"),
    "negative strain": ((), "strain,stress\n-0.01,2\n-0.02,3\n", 'write compression = "negative"'),
    "percent as fraction": ((), "strain,stress\n1,2\n20,3\n", "percent rather than a fraction"),
    "fraction as percent": (
        (('"fraction"', '"percent"'),),
        "strain,stress\n0.01,2\n0.2,3\n",
        "a fraction rather than percent",
    ),
}


@pytest.mark.parametrize(("replaced", "curve", "word"), HINTS.values(), ids=HINTS)
def test_hints_say_what_may_be_behind(
    replaced: tuple[tuple[str, str], ...], curve: str, word: str, checked: Checked
) -> None:
    _, lines = checked(*replaced, curve=curve)
    assert any(word in line for line in of_kind("hint", lines)), lines


@pytest.mark.parametrize("separator", ["tab", "whitespace"])
def test_tabs_are_white_space_too(separator: str, checked: Checked) -> None:
    code, lines = checked(
        ("[data]\n", f'[data]\nseparator = "{separator}"\n'),
        curve="strain\tstress\n0.001\t2\n0.02\t3\n",
    )
    assert code == 0
    assert not of_kind("hint", lines)


def test_commas_in_quoted_names_separate_nothing(checked: Checked) -> None:
    _, lines = checked(curve='"strain, true","stress, mean"\n0.001,2\n0.02,3\n')
    assert not any("separator" in line for line in of_kind("hint", lines))


CREEP = """\
id = "creep"
material = "ice"
protocol = "loading_history"
temperature_K = 263.0
initial_grain_size_m = 1e-3
stage_stress_unit = "MPa"

[[stages]]
control = "stress"
start_time = 0
end_time = 20
stress = 1.0

[data]
file = "creep.csv"
time_column = "time"
time_unit = "s"
strain_column = "strain"
strain_unit = "percent"

[provenance]
kind = "measured"
source = "somebody"
"""


def checked_creep(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    strain: tuple[float, ...],
    stress: float = 1.0,
    *replaced: tuple[str, str],
) -> str:
    """What is said of creep whose strains are read every second."""
    rows = "".join(f"{k},{one}\n" for k, one in enumerate(strain))
    (folder / "creep.csv").write_text(f"time,strain\n{rows}", encoding="utf-8")
    path = folder / "creep.toml"
    text = CREEP.replace("stress = 1.0", f"stress = {stress}")
    for old, new in replaced:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    assert main(["check-file", str(path)]) == 0
    out, error = capsys.readouterr()
    assert error == ""
    return out


def test_small_strains_of_creep_are_no_fractions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hint = "a fraction rather than percent"
    assert hint not in checked_creep(tmp_path, capsys, (0.02, 0.03, 0.0394747))
    assert hint in checked_creep(tmp_path, capsys, (0.0002, 0.0003, 0.0004))


@pytest.mark.parametrize("stress", [-1.0, 1.0])
@pytest.mark.parametrize("sign", [-1, 1])
def test_strains_against_the_imposed_stress_are_warned_about(
    stress: float, sign: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = checked_creep(tmp_path, capsys, (0.2 * sign, 0.3 * sign, 0.4 * sign), stress)
    there, here = (("compression" if one > 0 else "extension") for one in (stress, sign))
    warning = f"imposed stresses are {there} while strains are {here}"
    assert (warning in said) == (stress != sign)


def test_a_zero_of_strain_in_a_wrong_unit_is_warned_about(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    zero = ("[data]", '[strain_offset]\nvalue = 0.1\nunit = "fraction"\n\n[data]')
    said = checked_creep(tmp_path, capsys, (0.2, 0.3, 0.4), 1.0, zero)
    assert "strains are extension" in said
    assert "the zero of the strain" in said


def test_negative_strains_need_no_hint_where_compression_is_negative(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    strain = (-0.2, -0.3, -0.4)
    assert "write compression" in checked_creep(tmp_path, capsys, strain, -1.0)
    negative = ("stage_stress_unit", 'compression = "negative"\nstage_stress_unit')
    said = checked_creep(tmp_path, capsys, strain, -1.0, negative)
    assert "signs were turned" in said
    assert "write compression" not in said
    assert "extension" not in said


@pytest.mark.parametrize(
    ("replaced", "words"),
    [
        (("start_time = 0", "start_time = -30"), "stage 1 lasts 50 s, of which 30 s are before"),
        (("end_time = 20", "end_time = 200"), "stage 1 lasts 200 s, of which 190 s are after"),
        (("end_time = 20", "end_time = 16"), None),
    ],
)
def test_readings_that_leave_most_of_a_stage_out_are_warned_about(
    replaced: tuple[str, str],
    words: str | None,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    strain = tuple(0.1 + 0.01 * k for k in range(11))
    said = checked_creep(tmp_path, capsys, strain, 1.0, replaced)
    assert ("check units and start of the times" in said) == (words is not None)
    assert (words or "") in said


@pytest.mark.parametrize(("compliance", "warned"), [("1e-11", False), ("1e-5", True)])
def test_an_apparatus_that_gives_way_more_than_was_read_is_warned_about(
    compliance: str, warned: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stated = ("[data]", f"[apparatus]\ncompliance_per_Pa = {compliance}\n\n[data]")
    said = checked_creep(tmp_path, capsys, (0.2, 0.3, 0.4), 1.0, stated)
    assert ("makes a strain of 10 of a stress of 1 MPa" in said) == warned


def test_a_notice_is_told_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert checked_creep(tmp_path, capsys, (0, 0.3, 0.4)).count("was dropped") == 1


@pytest.mark.parametrize(
    ("replaced", "curve", "word"),
    [
        ((), "strain,stress\n0.015,2\n0.02,3\n", "1.5 %"),
        ((("MPa", "GPa"),), "strain,stress\n0.001,2\n0.02,5000\n", "5000 GPa"),
        ((("MPa", "Pa"),), CURVE, "5 Pa"),
        ((("230e-6", "0.23"),), CURVE, "0.23 m"),
        ((('"ice"', '"quartz"'),), CURVE, "--priors"),
        ((("263.0", "300.0"),), CURVE, "molten"),
        ((("1e-4", "16900.0"),), CURVE, "16900 1/s"),
        ((('"constant_rate"', '"constant_rate"\nfinal_strain = 2.0'),), CURVE, "small part"),
    ],
)
def test_unlikely_numbers_are_warned_about(
    replaced: tuple[tuple[str, str], ...], curve: str, word: str, checked: Checked
) -> None:
    code, lines = checked(*replaced, curve=curve)
    assert code == 0
    assert any(word in line for line in of_kind("warning", lines)), lines


def test_files_that_cannot_be_read_keep_none_after_them_from_being_checked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    late, broken, missing = (tmp_path / f"{name}.toml" for name in ("late", "broken", "missing"))
    (tmp_path / "curve.csv").write_text(CURVE, encoding="utf-8")
    late.write_text(EXPERIMENT, encoding="utf-8")
    broken.write_text("id = \n", encoding="utf-8")
    assert main(["check-file", str(missing), str(broken), str(late)]) == 2
    out, error = capsys.readouterr()
    assert error == ""
    of_missing, n_missing, of_broken, n_broken, *of_late = out.splitlines()
    assert of_missing == f"error: file {missing} does not exist."
    assert of_broken.startswith(f"error: {broken}: not a valid TOML file")
    assert [n_missing, n_broken] == [
        f"{file}: 1 error; it cannot be used yet" for file in (missing, broken)
    ]
    assert of_late[-1].startswith(f"{late}: no errors")


def test_a_prior_file_is_checked_as_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "priors.toml"
    path.write_text(PRIORS.replace("scale = 1e-6", "scale = -1e-6"), encoding="utf-8")
    assert main(["check-file", str(path)]) == 2
    assert "scale" in capsys.readouterr().out


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


def test_other_commands_tell_the_first_error_and_how_many_there_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "test.toml"
    path.write_text(EXPERIMENT.replace("temperature_K", "temperture_K"), encoding="utf-8")
    assert main(["fit", str(path)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert error.endswith("`pyburgers check-file` tells 1 more.\n")


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


def test_what_was_done_to_read_a_table_is_noted(checked: Checked) -> None:
    text = "a line\nstrain;stress\n%;MPa\n0,01;2\n0,02;3\n"
    code, lines = checked(curve=text)
    assert code == 0
    notes = of_kind("note", lines)
    assert len(notes) == 3
    assert "note: curve.csv: line 1 ahead of the table was passed over." in notes
    code, lines = checked(curve=text + "0,03;x\n")
    assert code == 2
    assert of_kind("note", lines) == sorted(notes)


def test_what_stands_in_for_missing_keys_gives_no_errors_of_its_own(checked: Checked) -> None:
    code, lines = checked(("temperature_K = 263.0\n", ""), ('strain_unit = "fraction"\n', ""))
    assert code == 2
    assert len(of_kind("error", lines)) == 2


def test_a_good_file_is_read_as_a_fit_reads_it(checked: Checked, tmp_path: Path) -> None:
    code, lines = checked()
    assert code == 0
    points = load_experiment(tmp_path / "test.toml").n_points
    assert lines[-1] == (
        f"{tmp_path / 'test.toml'}: no errors, sample-1: constant_rate of ice, {points} points"
    )


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
