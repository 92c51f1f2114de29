"""Options of `pyburgers new`: held by the file or refused, never dropped; relaxations."""

import json
import math
import shlex
import tomllib
from collections.abc import Iterator, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from history_twins import TRUTH
from refusals import CommandLine
from terminal import answer_with

from pyburgers.cli.main import main
from pyburgers.kinds.experiment import of_kind
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.likelihood import NAMES
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.new_file import new_files

KNOWN = ("--material", "ice", "--temperature-K", "263", "--grain-size-m", "1e-3")
LOADING = ("--protocol", "loading_history", "--strain-rate-per-s", "1e-5")
VALUES = {
    "strain_rate_per_s": "1.37e-05",
    "stress_uncertainty": "0.0723",
    "strain_uncertainty": "0.00234",
    "stress_MPa": "4.321",
    "hold_start_time": "111.5",
    "held_strain": "0.00217",
    "loading_time": "113.25",
    "deformation": "shear",
    "poisson_ratio": "0.3125",
}
"""An answer to each question that some kinds of test have, found in no other line of a file."""
RELAXATION = {"strain_rate_per_s", "hold_start_time", "loading_time"}

CYCLES = [(10.0 * k, 1e-4 * math.sin(k / 6), 20 * math.sin(k / 6 + 0.3)) for k in range(60)]
TABLES: dict[str, tuple[str, Sequence[tuple[float, ...]]]] = {
    "all": ("time_s,strain,stress_MPa", CYCLES),
    "no strain": ("time_s,stress_MPa", [(10.0 * k, 9.0 - 0.1 * k) for k in range(40)]),
    "rising stress": ("time_s,stress_MPa", [(10.0 * k, 1.0 + 0.1 * k) for k in range(40)]),
    "no stress": ("time_s,strain", [(10.0 * k, 1e-3 * k) for k in range(40)]),
    "attenuation": ("period_s,temperature_K,tan_delta", [(10.0 * k, 260.0, 0.1) for k in (1, 2)]),
}


def written(path: Path, table: str) -> Path:
    """Write one of the tables."""
    names, rows = TABLES[table]
    text = "".join(",".join(f"{value:.6g}" for value in row) + "\n" for row in rows)
    path.write_text(f"{names}\n{text}", encoding="utf-8")
    return path


@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("protocol", NAMES)
def test_every_option_is_in_the_file_or_refused(
    protocol: str, table: str, tmp_path: Path, cli: CommandLine
) -> None:
    questions = {q.name: q for new_file in new_files().values() for q in new_file.questions}
    assert questions.keys() == VALUES.keys()
    path = written(tmp_path / "test.csv", table)
    file = path.with_suffix(".toml")
    own = {q.name for q in new_files()[protocol].questions}
    sets: list[set[str]] = [{name} for name in VALUES]
    # What a kind has no question of is refused by itself.
    sets += [{*pair} for pair in combinations(VALUES, 2) if own & {*pair}]
    if own >= RELAXATION:
        sets += [RELAXATION, *(RELAXATION | {name} for name in VALUES)]
    for names in sets:
        options = [text for name in names for text in (questions[name].option, VALUES[name])]
        cli("new", path, *KNOWN, "--protocol", protocol, *options, code=None)
        assert cli.code == 0 or cli.error or file.exists()
        assert own & names or not file.exists()
        if file.exists():
            text = file.read_text(encoding="utf-8")
            assert text.startswith("# This draft cannot be used yet") == (cli.code != 0)
            for name in names:
                value = VALUES[name]
                if name == "loading_time":  # the time at which it began is written
                    start = VALUES["hold_start_time"] if "hold_start_time" in names else 0.0
                    value = str(float(start) - float(value))
                if name == "held_strain":
                    stage = tomllib.loads(text)["stages"][0]
                    lasted = stage["end_time"] - stage["start_time"]
                    assert stage["strain_rate_per_s"] * lasted == pytest.approx(float(value))
                    continue
                assert value in text, f"{name} of {names}"
            file.unlink()


ANSWERS = " ".join((*KNOWN, "--strain-rate-per-s", "1e-5"))
COLUMNS = "time_s,strain,stress_MPa,x,time (weeks)\n1,0.001,2,0,1\n2,0.02,3,0,2\n"


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        (COLUMNS, "--stress-uncertainty-column x", "that column; give --stress-uncertainty"),
        (COLUMNS, "--amplitude-column x", "protocol constant_rate does not read that column"),
        (COLUMNS, "--period-column time_s", "protocol constant_rate does not read that column"),
        (COLUMNS, "--time-column 'time (weeks)'", "found the unit 'weeks'"),
        (COLUMNS, "--strain-column 6", "expected a column of"),
        (COLUMNS, "--out nowhere/test.toml", "the folder nowhere does not exist"),
        (
            "strain,strain,stress (MPa)\n0.1,0.1,2\n0.2,0.2,3\n",
            ANSWERS,
            "rename all of them but one",
        ),
        ("time,strain\nh,furlong\n1,2\n2,3\n", "", "looks like stress among h, furlong, "),
    ],
)
def test_what_cannot_be_written_is_refused_before_anything_is_asked(
    text: str, options: str, words: str, tmp_path: Path, cli: CommandLine
) -> None:
    path = tmp_path / "test.csv"
    path.write_text(text, encoding="utf-8")
    command = ["new", str(path), "--protocol", "constant_rate", *shlex.split(options)]
    cli(*command, code=2)
    assert words in cli.error


def test_a_column_is_named_by_its_number(tmp_path: Path) -> None:
    path = tmp_path / "test.csv"
    path.write_text("x,y,1\n0.001,2,0.1\n0.02,3,0.2\n", encoding="utf-8")
    columns = ("--strain-column", "1", "--stress-column", "2", "--strain-rate-per-s", "1e-5")
    assert main(["new", str(path), *KNOWN, *columns]) == 0
    named = tomllib.loads(path.with_suffix(".toml").read_text("utf-8"))["data"]
    assert (named["strain_column"], named["stress_column"]) == ("1", "y")


@pytest.mark.parametrize(
    ("text", "hold", "loading"),
    [
        ("time (min),stress (MPa)\n0,10\n1,9\n5,8\n20,7\n", 0.0, 30.0),
        ("time_s,stress (MPa)\n0,0\n10,2\n30,10\n31,9\n35,8\n50,7\n", 30.0, 30.0),
    ],
    ids=["loading not read", "loading read"],
)
def test_a_relaxation_is_written_with_its_loading(
    text: str, hold: float, loading: float, programs: None, tmp_path: Path
) -> None:
    path, file = tmp_path / "relaxation.csv", tmp_path / "relaxation.toml"
    path.write_text(text, encoding="utf-8")
    held = ("--hold-start-time", str(hold), "--loading-time", str(loading))
    assert main(["new", str(path), *KNOWN, *LOADING, *held]) == 0
    test = of_kind(load_experiment(file), HistoryExperiment)
    first, second = test.stages
    unit = 60.0 if "min" in text else 1.0
    assert (first.control, first.value, second.control) == ("strain_rate", 1e-5, "hold_strain")
    assert first.end_time - first.start_time == pytest.approx(unit * loading)
    assert test.time[-1] == pytest.approx(test.end_time)
    assert (test.reading_stage[-3:] == 1).all()
    written_text = file.read_text(encoding="utf-8")
    assert "# stress_uncertainty = 0.05" in written_text
    file.write_text(written_text.replace("# stress_unc", "stress_unc"), encoding="utf-8")
    assert main(["check-file", str(file)]) == 0
    parameters, out = tmp_path / "parameters.json", tmp_path / "solution.csv"
    parameters.write_text(json.dumps(dict(TRUTH)), encoding="utf-8")
    assert main(["simulate", str(file), "--parameters", str(parameters), "--out", str(out)]) == 0
    stress = np.genfromtxt(out, delimiter=",", names=True)["stress_Pa"]
    assert 0 < stress[-1] < stress.max()


ASKED = {
    "axial": ("attenuation", "attenuation", {"deformation": "axial"}, "Poisson"),
    "shear": ("attenuation", "attenuation", {"deformation": "shear", "Poisson": "0.3"}, None),
    "never held": (
        "loading_history",
        "rising stress",
        {"strain rate": "1e-5", "is held": ""},
        "until then",
    ),
    "held": (
        "loading_history",
        "no strain",
        {
            "from which the strain is held": "0",
            "strain that is held, a": "1e-3",
            "until then": "100",
        },
        "strain rate",
    ),
}
"""Kind, table, answers by words of their questions, and words of what is not asked."""


@pytest.mark.parametrize(("protocol", "table", "answers", "needless"), ASKED.values(), ids=ASKED)
def test_what_is_asked_next_depends_on_the_answers(
    protocol: str,
    table: str,
    answers: dict[str, str],
    needless: str | None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    path, asked = written(tmp_path / "test.csv", table), list[str]()

    def answer(question: str) -> str:
        asked.append(question)
        assert len(asked) < 50, question
        return next((text for words, text in answers.items() if words in question), "")

    answer_with(monkeypatch, answer)
    assert main(["new", str(path), *KNOWN, "--protocol", protocol]) == 0
    assert all(sum(words in question for question in asked) == 1 for words in answers)
    assert needless is None or not any(needless in question for question in asked)


def test_what_is_typed_has_to_be_text(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    path = tmp_path / "test.csv"
    path.write_text("strain,stress\n0.001,2\n0.02,3\n", encoding="utf-8")
    typed: Iterator[str | bytes] = iter([b"a\xff", "a\udcff", "mine"])

    def answer(question: str) -> str:
        given = next(typed) if "name of the test" in question else ""
        return given if isinstance(given, str) else given.decode("utf-8")

    answer_with(monkeypatch, answer)
    assert (
        cli("new", path, *KNOWN, "--strain-rate-per-s", "1e-5").count(
            "found bytes that are no text, expected text"
        )
        == 2
    )
    assert load_experiment(path.with_suffix(".toml")).id == "mine"
