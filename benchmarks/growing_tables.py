"""Tables of many fits that grow row by row, and go on from their file."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pandas as pd

from pyburgers.common.tasks import Workers, run_tasks

Row = dict[str, float | str]
Key = tuple[str | int, ...]


def grow(
    file: Path,
    keys: Sequence[str],
    work: Callable[..., Row],
    tasks: Mapping[Key, Sequence[object]],
    jobs: int | None,
    show: Callable[[pd.DataFrame], None],
) -> None:
    """Do the tasks whose rows are missing, and show the table as it is now and after each.

    Parameters
    ----------
    file
        CSV of the rows, whose columns `keys` are the keys of the tasks.
    work
        Function of a module that returns the row of a task.
    jobs
        Tasks side by side; None: one for each core.
    show
        Receives the table.
    """
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
