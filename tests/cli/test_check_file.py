"""`pyburgers check-file` of shipped files, and of tables; tests/messages has what it says."""

from pathlib import Path

import pytest
from small_inputs import CURVE, DATA

from pyburgers.cli.main import main


@pytest.mark.parametrize(
    "path",
    [path for path in sorted(DATA.rglob("*.toml")) if path.parent.name != "variants"],
    ids=lambda path: path.stem,
)
def test_shipped_files_have_no_errors(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check-file", str(path)]) == 0
    out = capsys.readouterr().out
    assert "no errors" in out
    assert "error: " not in out


@pytest.mark.parametrize("content", [CURVE.encode(), CURVE.encode("utf-16"), b"PK\x03\x04\xff"])
def test_a_table_in_the_place_of_an_experiment_file(
    content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "my curve.csv"
    path.write_bytes(content)
    assert main(["fit", str(path)]) == 2
    error = capsys.readouterr().err
    assert f"write an experiment file for them: pyburgers new '{path}'." in error
