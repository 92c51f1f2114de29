"""Arguments of a function as the tables of an experiment file, and messages that name arguments."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

import numpy as np

from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import nested_table
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.experiment_file import ExperimentFile

ARGUMENT_NAMES: tuple[tuple[str, str | Callable[[re.Match[str]], str]], ...] = (
    (r" in \[\[segments\]\] number (\d+)", r", entry \1"),
    (r" in \[\w+\]", ""),
    (r"\[data\] needs", "needs"),
    (r"'(\w+)_column'", r"'\1'"),
    (r"'stage_(\w+)_unit'", r"'\1_unit'"),
    (
        r"(?<='initial_grain_size_m': found )([-+.e\d]+), expected metres.*",
        lambda found: f"{1e6 * float(found[1]):g}, expected micrometres between 0 and 1e6.",
    ),
    (r"('initial_grain_size_m'.*) in metres", r"\1 in micrometres"),
    ("'initial_grain_size_m'", "'grain_size_um'"),
    ("'strain_rate_per_s'", "'strain_rate'"),
    ("'id'", "'name'"),
    (r"\ba key(?= ')", "the argument"),
    (r"\bkey(s?)(?= ')", r"argument\1"),
)
"""Patterns of keys and units in messages about files, and what stands for them about arguments."""

UNSTATED_KIND = (
    "Where the readings come from was not stated, so they count as measured: "
    'state kind="synthetic" or kind="digitised" if they are not.'
)

E = TypeVar("E", bound=Experiment)


def test_of(
    called: str,
    load: Callable[[Path, Mapping[str, Any]], E],
    structure: type[ExperimentFile],
    arguments: Mapping[str, Any],
) -> E:
    """Check arguments, under the keys of files, as the tables of a file are checked.

    `called`: the function, for messages.
    """
    (protocol,) = get_args(structure.model_fields["protocol"].annotation)
    given = {"kind": "measured", "source": f"arrays given to {called}", **arguments}
    if not {"kind", "provenance"} & arguments.keys():
        given["notices"] = [*arguments.get("notices", []), UNSTATED_KIND]
    tables = {"protocol": protocol, **_tables(structure, given)}
    try:
        return load(Path(called), tables)
    except InputError as error:
        raise InputError(*map(_of_arguments, error.sentences)) from None


def _tables(structure: type[ExperimentFile], arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return arguments as tables of a file: each in the table that has its key, arrays as columns.

    An unknown argument stays at the top, where it is refused.
    """
    nested = {
        name: table
        for name, field in structure.model_fields.items()
        if get_origin(field.annotation) is not list
        and (table := nested_table(field.annotation)) is not None
    }
    tables: dict[str, Any] = {}
    columns: dict[str, Any] = {}
    for key, value in arguments.items():
        homes = [name for name, table in nested.items() if key in table.model_fields]
        data = nested["data"].model_fields
        if value is None:
            continue
        if f"{key}_column" in data and np.ndim(value):
            columns[key] = value
            tables.setdefault("data", {})[f"{key}_column"] = key
        elif homes and key not in structure.model_fields:
            tables.setdefault(homes[0], {})[key] = _plain(value)
        else:
            tables[key] = _plain(value)
    if columns:
        tables["data"]["file"] = columns
    return tables


def _plain(value: Any) -> Any:
    """Return a number of NumPy as one of Python."""
    return value.item() if isinstance(value, np.generic) else value


def _of_arguments(sentence: str) -> str:
    """Return a message about keys of a file as one about arguments."""
    for pattern, text in ARGUMENT_NAMES:
        sentence = re.sub(pattern, text, sentence)
    return sentence
