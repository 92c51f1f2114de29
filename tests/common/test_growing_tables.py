"""Tables of benchmarks that go on from their file."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd
import pytest
from growing_tables import Key, Row, grow


def row_of(kind: str, seed: int) -> Row:
    """A row whose task fails for odd seeds, as a fit may."""
    return {"kind": kind, "seed": seed, **({"failure": "odd"} if seed % 2 else {"seconds": 1.5})}


def tables_of(file: Path, tasks: Mapping[Key, Sequence[object]]) -> list[pd.DataFrame]:
    """Do the tasks; return the tables that were shown."""
    shown: list[pd.DataFrame] = []
    grow(file, ("kind", "seed"), row_of, tasks, 1, shown.append)
    return shown


@pytest.mark.usefixtures("in_this_process")
def test_a_table_goes_on_from_its_file(tmp_path: Path) -> None:
    file = tmp_path / "rows.csv"
    tasks: dict[Key, Sequence[object]] = {("creep", seed): ("creep", seed) for seed in (2, 1, 0)}
    first = dict(list(tasks.items())[:2])
    assert [len(table) for table in tables_of(file, first)] == [1, 2]
    *_, table = tables_of(file, tasks)
    assert table["seed"].to_list() == [0, 1, 2]
    assert table["failure"].dropna().to_dict() == {1: "odd"}
    assert table["seconds"].sum() == 3.0
    (again,) = tables_of(file, tasks)
    assert again.equals(table)
