"""TOML files, and JSON ones: read, check the structure, write; every error is one sentence.

The structure of a file is a pydantic model derived from `Table`; what a key must hold is said in
its field's description, which the messages quote.
"""

import json
import re
import shlex
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args

import numpy as np
import tomli_w
from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from pyburgers.common.atomic_files import write_text
from pyburgers.common.errors import InputError, StructureError, nearest
from pyburgers.common.units import UNIT_TABLE, UNITS, Unit


def all_of(*steps: Callable[[], Any]) -> list[Any]:
    """Take independent steps; return what they return, or raise the InputErrors of all as one."""
    found, sentences = [], list[str]()
    for step in steps:
        try:
            found.append(step())
        except InputError as error:
            sentences += error.sentences
    if sentences:
        raise InputError(*dict.fromkeys(sentences))
    return found


class Table(BaseModel):
    """A TOML table whose unknown keys, wrong types and non-finite numbers are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


T = TypeVar("T")


TableT = TypeVar("TableT", bound=Table)


NAME = r"^[A-Za-z0-9_][A-Za-z0-9._-]{0,99}$"
"""What a name has to look like that becomes a part of names of files."""


LONGEST_MATERIAL = 100
"""Letters of the name of a material, which figures, tables and files of other codes quote."""


def _checked_material(found: str) -> str:
    plain = found.isprintable() and not set(found) & set("$/\\")
    if not plain or not 0 < len(found.strip()) <= len(found) <= LONGEST_MATERIAL:
        raise PydanticCustomError(
            "material", f"1 to {LONGEST_MATERIAL} printable letters without $ and slashes"
        )
    return found


Material = Annotated[
    str, AfterValidator(_checked_material), Field(description="the material, such as ice")
]


def _checked_word(found: str) -> str:
    if not any(map(str.isalpha, found)):
        raise PydanticCustomError("word", "a text with a letter")
    return found


Word = Annotated[str, AfterValidator(_checked_word)]
"""A word to be looked for, which is not in every text."""

SYSTEM_FOLDERS = ("/proc", "/sys")
"""Folders whose files are the system itself; some of them never end."""

DEEPEST = 100
"""Parts of a dotted key. Time to read one goes with the square of their number."""


UNKNOWN = "extra_forbidden"
"""Kind of error of pydantic's for a key that a table does not know."""


_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""


_DEEP_KEY = re.compile(rf"(?<![\w-])(?:{_PART}){{{DEEPEST}}}")


def is_file_of_user(path: Path) -> bool:
    """Tell whether a path is a file, and not one of the system's own."""
    of_system = any(path.resolve().is_relative_to(folder) for folder in SYSTEM_FOLDERS)
    return path.is_file() and not of_system


def read_bytes(path: Path, where: str | None = None) -> bytes:
    """Return the bytes of an input file; `where` is the file and key that name it."""
    prefix = f"{where}: " if where else ""
    try:
        if path.exists() and not (is_file_of_user(path) or path.is_dir()):
            raise InputError(f"{prefix}{path} is a device or a pipe; expected a file.")
        return path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{prefix}file {path} does not exist.") from None
    except IsADirectoryError:
        raise InputError(f"{prefix}{path} is a folder; expected a file.") from None
    except OSError as error:
        raise InputError(f"{prefix}file {path} cannot be read: {error.strerror}.") from None
    except ValueError as error:  # a name that no file can have
        raise InputError(f"{prefix}file {str(path)!r} cannot be read: {error}.") from None


def read_text(path: Path) -> str:
    """Return the text of an input file: UTF-8 with or without byte order mark."""
    try:
        return read_bytes(path).decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        raise InputError(f"file {path} is not UTF-8 text.") from None


def read_toml(
    path: Path, structure: type[TableT], tables: Mapping[str, Any] | None = None
) -> TableT:
    """Read a TOML file, or its tables in memory, into `structure` (`checked`)."""
    return checked(path, read_tables(path) if tables is None else tables, structure)


def read_tables(path: Path) -> dict[str, Any]:
    """Read a TOML file; of another one the InputError names the command that describes readings."""
    try:
        return _tables(path)
    except InputError:
        if path.is_file() and path.suffix.lower() not in ("", ".toml"):
            command = shlex.join(["pyburgers", "new", str(path)])
            raise InputError(
                f"{path}: found no TOML, expected an experiment file or the like. A table of "
                "rates needs the file that docs/rates.md shows. If it holds readings of a test, "
                f"write an experiment file for them: {command}."
            ) from None
        raise


def _tables(path: Path) -> dict[str, Any]:
    text = read_text(path)
    if _DEEP_KEY.search(text):
        raise InputError(f"{path}: a key has more than {DEEPEST} parts, expected a few.")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not a valid TOML file: {error}.") from None


def read_json(path: Path) -> dict[str, Any]:
    """Read a JSON object from a file."""
    text = read_text(path)
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is not valid JSON ({error}).") from None
    if not isinstance(content, dict):
        raise InputError(f"{path}: found {type(content).__name__}, expected a JSON object.")
    return content


def read_json_table(path: Path, structure: type[TableT]) -> TableT:
    """Read a JSON object from a file into `structure`."""
    return checked(path, read_json(path), structure)


def checked(path: Path, table: Mapping[str, Any], structure: type[TableT]) -> TableT:
    """Return contents as `structure`, or raise StructureError, unknown keys before all others."""
    try:
        return structure.model_validate(table)
    except ValidationError as error:
        errors = error.errors(include_url=False)
        unknown_first = sorted(errors, key=lambda entry: entry["type"] != UNKNOWN)
        sentences = dict.fromkeys(_sentence(entry, structure) for entry in unknown_first)
        raise StructureError(
            *(f"{path}: {text}" for text in sentences),
            faults=[(entry["loc"], entry["type"] == UNKNOWN) for entry in unknown_first],
        ) from None


def factor_to_si(unit: str, quantity: str, where: str) -> float:
    """Return the factor to SI of a unit whose zero is that of SI; see `unit_of`."""
    return _known(unit, UNITS[quantity], quantity, where)


def unit_of(unit: str, quantity: str, where: str) -> Unit:
    """Return a unit of a quantity; raise InputError, with file and key `where`, of another one."""
    return _known(unit, UNIT_TABLE[quantity], quantity, where)


def _known(unit: str, units: Mapping[str, T], quantity: str, where: str) -> T:
    if unit not in units:
        raise InputError(
            f"{where}: unit {unit!r} is not a unit of {quantity}; expected one of "
            f"{', '.join(units)}."
        )
    return units[unit]


def write_toml(path: Path, table: Mapping[str, Any]) -> None:
    """Write a file of `toml_text`; raise InputError if there is no folder for it."""
    if not path.parent.is_dir():
        raise InputError(f"{path}: found no folder {path.parent}, expected that of the file.")
    write_text(path, toml_text(table))


def toml_text(table: Mapping[str, Any]) -> str:
    """Return a table, without what is None, as text that `tomllib` reads back to equal values."""
    return tomli_w.dumps(without_none(table))


def without_none(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table without what is None, at any depth; arrays become lists."""
    return {
        key: without_none(value)
        if isinstance(value, Mapping)
        else value.tolist()
        if isinstance(value, np.ndarray)
        else value
        for key, value in table.items()
        if value is not None
    }


def _sentence(entry: ErrorDetails, structure: type[Table]) -> str:
    """Return an error in words: key, what was found, what was expected."""
    location = entry["loc"]
    parent = _model_at(structure, location[:-1])
    name = str(location[-1])
    key = f"key {_describe(location)}"
    field = parent.model_fields.get(name)
    meaning = field.description if field is not None else None
    if entry["type"] == UNKNOWN:
        return f"unknown {key}, {nearest(name, parent.model_fields)}"
    if entry["type"] == "missing":
        return f"{key} is missing, expected {meaning or 'a value'}."
    expected = entry["msg"].replace("Input should be ", "")
    if expected.startswith(("greater", "less")):
        expected = f"a number {expected}"
    if meaning is not None and entry["type"] != "column":
        expected = f"{expected} ({meaning})"
    return f"{key}: found {_shown(entry['input'])}, expected {expected}."


def _describe(location: tuple[int | str, ...]) -> str:
    """Key and the table that holds it, as they stand in the file."""
    *tables, key = location
    if isinstance(key, int):
        return f"{_describe(tuple(tables))}, entry {key + 1}"
    if not tables:
        return repr(key)
    if isinstance(tables[-1], int):
        return f"{key!r} in [[{'.'.join(map(str, tables[:-1]))}]] number {tables[-1] + 1}"
    return f"{key!r} in [{'.'.join(map(str, tables))}]"


def _shown(value: object) -> str:
    if isinstance(value, Mapping):
        return "a table"
    return "a list" if isinstance(value, list) else repr(value)


def _model_at(structure: type[Table], location: tuple[int | str, ...]) -> type[Table]:
    """Return the model of the table at `location` (indices and names of a dict are passed over)."""
    model = structure
    for part in location:
        field = model.model_fields.get(str(part))
        if field is not None:
            model = nested_table(field.annotation) or model
    return model


def nested_table(annotation: Any) -> type[Table] | None:
    """Return the table model inside an annotation such as ``list[Segment] | None``."""
    if isinstance(annotation, type) and issubclass(annotation, Table):
        return annotation
    return next((model for part in get_args(annotation) if (model := nested_table(part))), None)
