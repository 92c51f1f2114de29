"""Files that commands write: none of them is one that the command reads."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from pyburgers.cli.hints import text_files
from pyburgers.common.columns import TextFilesTable
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import read_tables
from pyburgers.sampling.run_directory import WRITTEN, RunDirectory


def check_output(out: Path, *inputs: Path | None, beside: Sequence[str] = ()) -> None:
    """Refuse a folder as `out`, or files that would be written but are read."""
    files = [out, *(out.with_name(f"{out.stem}{ending}") for ending in beside if out.name)]
    for file in files:
        if file.exists() and not file.is_file():
            kind = "a folder" if file.is_dir() else "no ordinary file"
            raise InputError(f"--out {out}: {_told(file, out)} is {kind}, expected a file name.")
    read = {name.resolve() for one in inputs if one is not None for name in _files_of(one)}
    for file in files:
        place = file.resolve()
        if not read.isdisjoint((place, *place.parents)):
            raise InputError(
                f"--out {out}: {_told(file, out)} would be written over, which the command reads; "
                "expected another name."
            )


def _told(file: Path, out: Path) -> str:
    return "it" if file == out else str(file)


def _files_of(one: Path) -> Iterator[Path]:
    """Return the files, and folders of files, that an input consists of."""
    if one.is_dir():
        run = RunDirectory(one)
        yield run.manifest_file
        yield from (run.path / name for name in WRITTEN)
        return
    yield one
    if one.suffix == ".toml":
        content = read_tables(one)
        data = content.get("data")
        root = data.get("data_root") if isinstance(data, dict) else None
        folder = TextFilesTable.model_validate({"data_root": root}).folder(one)
        yield from (folder / table[key] for table, key in text_files(content))
