"""Tables in files are read once by what asks for them several times."""

from pathlib import Path

import pytest

from pyburgers.cli.main import main
from pyburgers.common import tables_in_files
from pyburgers.common.tables_in_files import read_once, table_in
from pyburgers.common.text_tables import TextTable, look_at

TEXT = "time,strain\n1,0.1\n2,0.2\n3,0.4\n"


@pytest.fixture
def looks(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the files that were looked at."""
    seen: list[str] = []

    def look(path: Path, separator: str | None = None, **keys: object) -> TextTable:
        seen.append(path.name)
        return look_at(path, separator, **keys)  # type: ignore[arg-type]

    monkeypatch.setattr(tables_in_files, "look_at", look)
    return seen


def test_a_file_is_read_once_in_a_block(tmp_path: Path, looks: list[str]) -> None:
    file, other = tmp_path / "a.csv", tmp_path / "b.csv"
    file.write_text(TEXT)
    other.write_text(TEXT)
    with read_once():
        first = table_in(file)
        with read_once():
            assert table_in(file, ",", header=True) is first
        assert table_in(file) is first
        assert table_in(file, ";").separator == ";"
        assert table_in(file, header=False).names is None
        assert table_in(file, missing=["2"]) is not first
        assert table_in(other).path == other
    assert looks == ["a.csv"] * 4 + ["b.csv"]
    file.write_text(TEXT.replace("0.4", "0.5"))
    assert table_in(file).numbers("strain") == [0.1, 0.2, 0.5]


def test_few_rows_are_kept(
    tmp_path: Path, looks: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tables_in_files, "MAX_KEPT_ROWS", 7)
    files = [tmp_path / f"{name}.csv" for name in "abc"]
    for file in files:
        file.write_text(TEXT)
    with read_once():
        for file in (*files, *files[1:], files[0]):
            table_in(file)
    assert looks == ["a.csv", "b.csv", "c.csv", "a.csv"]


def test_check_file_reads_a_file_once(
    tmp_path: Path, looks: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.csv").write_text("strain,stress_MPa\n" + "".join(f"0.0{k},{k}\n" for k in range(1, 9)))
    text = """
        id = "a"
        material = "ice"
        protocol = "constant_rate"
        temperature_K = 263
        initial_grain_size_m = 5e-4
        segments = [{ start_strain = 0, strain_rate_per_s = 1e-4 }]
        provenance = { kind = "synthetic", source = "made up" }
        [data]
        file = "a.csv"
        header = true
        strain_column = "strain"
        strain_unit = "fraction"
        stress_column = "stress_MPa"
        stress_unit = "MPa"
    """
    for name in ("a.toml", "b.toml"):
        Path(name).write_text(text)
    assert main(["check-file", "a.toml", "b.toml"]) == 0
    assert looks == ["a.csv"]
