"""Sentences that commands say about inputs, and tests as read, compared with an approved file.

Each other TOML file of this folder has a command, its input files, and cases: changes of an input.
Texts approved for the cases are in `approved.toml`. `MESSAGES=write pytest tests/messages` writes
that file anew; read the difference before you commit it.
"""

import os
import re
import shlex
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from same_contents import assert_equal

from pyburgers.cli.main import main
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.kind import load_experiment, save_experiment
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.loading_history.experiment import HistoryExperiment

HERE = Path(__file__).parent
APPROVED = HERE / "approved.toml"
WRITE = os.environ.get("MESSAGES") == "write"
MAX_NUMBERS = 25


@dataclass(frozen=True)
class Case:
    """Words of a command, its input files, and how a fit of the same input is asked for."""

    group: str
    name: str
    words: tuple[str, ...]
    files: Mapping[str, str]
    run: str | None
    reader: str | None


def changed(files: Mapping[str, str], changes: Mapping[str, Any]) -> dict[str, str]:
    """Exchange a file by its name, a table by its header, or a text; `false` removes either."""
    found: dict[str, Any] = dict(files)
    for old, new in changes.items():
        if old.endswith((".csv", ".json", ".toml")):
            found[old] = new
            continue
        name = next((name for name, text in found.items() if text and old in text), None)
        assert name is not None, f"no file holds {old!r}"
        if isinstance(new, str):
            found[name] = found[name].replace(old, new, 1)
        else:
            start = found[name].index(old)
            end = found[name].find("\n[", start) + 1 or len(found[name])
            table = f"{old}\n{tomli_w.dumps(new)}\n" if new else ""
            found[name] = found[name][:start] + table + found[name][end:]
    return {name: text for name, text in found.items() if text is not False}


def cases() -> Iterator[Case]:
    for path in sorted(HERE.glob("*.toml")):
        if path == APPROVED:
            continue
        group = tomllib.loads(path.read_text(encoding="utf-8"))
        files = {
            name: (HERE.parents[1] / text[1:]).read_text("utf-8") if text[0] == "@" else text
            for name, text in group.get("files", {}).items()
        }
        for name, changes in group["cases"].items():
            command = changes.pop("command", None)
            options = changes.pop("options", "")
            words = shlex.split(f"{command or group.get('command', '')} {options}")
            reader = None if command else group.get("reader")
            inputs = changed(files, changes)
            yield Case(path.stem, name, tuple(words), inputs, group.get("run"), reader)


CASES = tuple(cases())


@pytest.fixture(scope="module")
def approved() -> Iterator[dict[str, dict[str, str]]]:
    """Texts by group and case, written after the tests where that is asked for."""
    found: dict[str, dict[str, str]] = {}
    if APPROVED.is_file():
        found = tomllib.loads(APPROVED.read_text(encoding="utf-8"))
    yield found
    if WRITE:
        kept: dict[str, dict[str, str]] = {case.group: {} for case in CASES}
        for case in CASES:
            if case.name in found.get(case.group, {}):
                kept[case.group][case.name] = found[case.group][case.name]
        APPROVED.write_text(tomli_w.dumps(kept, multiline_strings=True), encoding="utf-8")


def said(capsys: pytest.CaptureFixture[str], words: list[str]) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command."""
    capsys.readouterr()
    code = main(words)
    return (code, *capsys.readouterr())


def digits(value: float) -> str:
    """Four digits; what rounding leaves of a difference is zero."""
    return "0" if abs(value) < 1e-8 else f"{value:.4g}"


def as_read(path: Path) -> Iterator[str]:
    """Readings of a test and what is imposed on it (SI); its copy has to be the same test."""
    experiment = load_experiment(path)
    likelihood = likelihood_of(experiment)
    columns = {name: values for name, (values, _) in likelihood.along(experiment).items()}
    columns = {**columns, likelihood.response.name: experiment.response}
    for name, values in sorted(columns.items()):
        shown = " ".join(map(digits, np.asarray(values)[:MAX_NUMBERS]))
        yield f"{name}: {shown}"
    if isinstance(experiment, HistoryExperiment):
        for leg in experiment.legs[:MAX_NUMBERS]:
            stretch = f"{digits(leg.start_value)} to {digits(leg.end_value)}"
            times = f"{digits(leg.start_time)} to {digits(leg.end_time)} s"
            yield f"{leg.driven} {stretch}, {times}"
    Path("copy").mkdir()
    assert_equal(load_experiment(save_experiment(experiment, Path("copy"))), experiment)


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.group}: {case.name}")
def test_a_command_says_what_was_approved(
    case: Case,
    approved: dict[str, dict[str, str]],
    request: pytest.FixtureRequest,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A refusal is one sentence and exit code 2; `fit` refuses what `check-file` does."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYBURGERS_DATA", raising=False)
    for name, text in case.files.items():
        Path(name).write_text(text, encoding="utf-8")
    if case.run is not None:
        run: Fit = request.getfixturevalue(case.run)
        Path("run").symlink_to(run.directory.path)
    before = {path.name for path in tmp_path.iterdir()}
    code, out, error = said(capsys, [*case.words])
    if error:
        assert code == 2
        assert re.fullmatch(r"(note: [^\n]+\n)*pyburgers: [^\n]+[.?]\n", error)
    new = sorted({path.name for path in tmp_path.iterdir()} - before)
    lines = [f"exit {code}", *(f"wrote {name}" for name in new), *(out + error).splitlines()]
    assert all(Path(name).read_text("utf-8") == text for name, text in case.files.items())
    if case.reader is not None and code == 2:
        first = out.splitlines()[0].removeprefix("error: ")
        code, out, error = said(capsys, shlex.split(case.reader))
        assert (code, out) == (2, "")
        assert error.splitlines()[-1].startswith(f"pyburgers: {first.rstrip('.')}")
        assert {path.name for path in tmp_path.iterdir()} == {*before, *new}
    elif code == 0 and (new or ": no errors, " in out):
        lines += as_read(Path(new[0] if new else case.words[-1]))
    text = "\n".join(lines)
    if WRITE:
        approved.setdefault(case.group, {})[case.name] = text
    assert approved[case.group][case.name] == text


def test_every_approved_text_has_a_case(approved: dict[str, dict[str, str]]) -> None:
    named = [(case.group, case.name) for case in CASES]
    assert sorted(named) == sorted((group, name) for group in approved for name in approved[group])
