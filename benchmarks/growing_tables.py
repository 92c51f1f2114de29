"""Tables of many fits that grow row by row, and go on from their file."""

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pandas as pd

from pyburgers.common.tasks import Workers, run_tasks

Row = dict[str, float | str]
Key = tuple[str | int, ...]


def parser_of(doc: str | None, seeds: Sequence[int]) -> argparse.ArgumentParser:
    """Return the command line of a folder, seeds, and how many tasks are done side by side."""
    parser = argparse.ArgumentParser(description=doc)
    parser.add_argument("out", type=Path, metavar="OUT")
    parser.add_argument("--seeds", nargs="+", type=int, default=seeds)
    parser.add_argument("--jobs", type=int, help="fits side by side; default one for each core")
    return parser


def grow(
    file: Path,
    keys: Sequence[str],
    work: Callable[..., Row],
    tasks: Mapping[Key, Sequence[object]],
    jobs: int | None,
    show: Callable[[pd.DataFrame], None],
) -> None:
    """Do the tasks whose rows are missing, and show the table as it is now and after each.

    The columns `keys` of the CSV `file` are the keys of the tasks. `work` is a function of a module
    that returns the row of a task.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    table = pd.DataFrame(columns=list(keys))
    if file.is_file():
        table = pd.read_csv(file)
        show(table)
    there = set(table[list(keys)].itertuples(index=False, name=None))
    missing = {key: arguments for key, arguments in tasks.items() if key not in there}
    with run_tasks(work, missing, workers=Workers(jobs=jobs), out=file.parent) as done:
        for key, row in done:
            grown = [*table.to_dict("records"), row]
            pd.DataFrame(grown).sort_values(list(keys)).to_csv(file, index=False)
            print(f"{file}: {', '.join(map(str, key))} is there.", flush=True)
            table = pd.read_csv(file)
            show(table)
