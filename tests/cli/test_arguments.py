"""Arguments that are missing, unknown, or no text: one line that says so."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from refusals import assert_refused
from small_inputs import DATA

from pyburgers.cli.main import main

NO_TEXT = "a\udcffb"
KNOWN = ("--material", "ice", "--temperature-K", "263", "--grain-size-m", "1e-3")
RATE = ("--strain-rate-per-s", "1e-5")
PIL40 = str(DATA / "ice" / "PIL40.toml")


@pytest.mark.parametrize("option", ["--id", "--source", "--material", "--kind", "--protocol"])
def test_a_new_file_takes_only_text(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "curve.csv"
    path.write_text("strain,stress\n0.001,2\n0.02,3\n", encoding="utf-8")
    code = main(["new", str(path), *KNOWN, *RATE, option, NO_TEXT])
    assert_refused(code, capsys, f"argument {option}: ", r"\udcff")
    assert [file.name for file in tmp_path.iterdir()] == ["curve.csv"]


@pytest.mark.parametrize(
    "arguments",
    [
        ("fit", PIL40, "--variant", NO_TEXT),
        ("fit", PIL40, PIL40, "--pool", NO_TEXT),
        ("predict", ".", PIL40, "--out", "x.csv", "--test", NO_TEXT),
        ("predict", "attenuation", ".", "--out", "x.csv", "--regimes", "1", NO_TEXT),
        ("simulate", PIL40, "--from", ".", "--out", "x.csv", "--draw", NO_TEXT),
    ],
)
def test_every_option_takes_only_text(
    arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert_refused(main(arguments), capsys, "bytes that are no text, expected text")


def test_a_name_of_a_file_that_is_no_text_is_refused_where_it_would_be_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = os.fsencode(tmp_path) + b"/curve\xff.csv"
    Path(os.fsdecode(path)).write_text("strain,stress\n0.001,2\n0.02,3\n", encoding="utf-8")
    out = str(tmp_path / "curve.toml")
    assert main(["new", os.fsdecode(path), *KNOWN, *RATE, "--out", out]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "found bytes that are no text in its name" in error
    options = map(os.fsencode, (*KNOWN, *RATE, "--id", "\udcff"))
    command = [os.fsencode(sys.executable), b"-m", b"pyburgers", b"new", path, *options]
    ended = subprocess.run(command, capture_output=True, check=False)
    assert (ended.returncode, ended.stderr.count(b"\n")) == (2, 1)
