"""Every key of the files that the package reads, told from the models that check them."""

import re
import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import annotated_types
from pydantic.fields import FieldInfo

from pyburgers.common.columns import Column, DataFile
from pyburgers.common.toml_files import Table
from pyburgers.flow_law_tables import laws, table_files
from pyburgers.kinds.attenuation.files import AttenuationFile
from pyburgers.kinds.experiment import CONDITION_KEYS
from pyburgers.kinds.experiment_file import ExperimentFile
from pyburgers.kinds.kind import kinds
from pyburgers.model import priors

UNIT_OF_ENDING = {
    "_per_Pa": "1/Pa",
    "_per_s": "1/s",
    "_Pa": "Pa",
    "_K": "K",
    "_sd_m": "m",
    "_size_m": "m",
    "_s": "s",
}
"""What the ending of a key says about the unit of its number, the longest first."""

UNIT_OF_WORDS = {
    "(fraction) or stress": "fraction, or `stage_stress_unit`",
    "(fraction)": "fraction",
    "a fraction": "fraction",
    "in kelvin": "K",
    "in Pa": "Pa",
    "in 1/s": "1/s",
    "in m": "m",
}
"""What the meaning of a key says about it."""

COLUMN_MEANING = "the column that holds the {}: its name, or its number from 1 without header"

REFUSED: Mapping[type[Table], frozenset[str]] = {
    AttenuationFile: frozenset(key for keys in CONDITION_KEYS.values() for key in keys)
}
"""Keys that files of all experiments share, but that this kind of test refuses."""

_WORDS: dict[Any, str] = {
    float: "number",
    int: "whole number",
    str: "text",
    bool: "true or false",
    Any: "text, number, true or false",
    get_args(get_args(DataFile)[0])[1]: "table of columns",
}


@dataclass(frozen=True)
class Key:
    """One key of a table.

    Attributes
    ----------
    name : str
        As it stands in the file.
    holds : str
        Kind of its value and what limits it.
    unit : str
        Unit of its number, or the key that gives it; empty without one.
    default : str
        What holds where it is left out; ``needed`` where it must not be.
    meaning : str
        What it is.
    """

    name: str
    holds: str
    unit: str
    default: str
    meaning: str


@dataclass(frozen=True)
class KeyTable:
    """A table of a file.

    Attributes
    ----------
    heading : str
        As it stands in the file, such as ``[data]`` or ``[[stages]]``; empty for the top.
    needed : bool
        Whether a file must have it.
    meaning : str
        What it is.
    keys : tuple of Key
        In the order of the model that checks it.
    """

    heading: str
    needed: bool
    meaning: str
    keys: tuple[Key, ...]


def structures() -> dict[str, type[Table]]:
    """Return the model of every file that users write, by the name of its section here.

    Those of experiments are found by the protocol that they are for, so that none is left out.
    """
    kinds()  # imports the modules of all kinds of test
    by_protocol = {
        get_args(structure.model_fields["protocol"].annotation)[0]: structure
        for structure in ExperimentFile.__subclasses__()
    }
    return {
        **{name: by_protocol[name] for name in kinds()},
        "rates": table_files._RateFile,
        "rate_law": laws._LawFile,
        "priors": priors._PriorFile,
    }


def key_tables(structure: type[Table]) -> tuple[KeyTable, ...]:
    """Return the tables of a file in the order in which they are checked."""
    return tuple(_tables(structure, (), repeated=False, needed=True, meaning=""))


def _tables(
    structure: type[Table], place: tuple[str, ...], *, repeated: bool, needed: bool, meaning: str
) -> Iterator[KeyTable]:
    """Tell a table, then those inside it."""
    inside = {name: _table_in(field.annotation) for name, field in structure.model_fields.items()}
    keys = tuple(
        _key(name, field, structure)
        for name, field in structure.model_fields.items()
        if inside[name] is None and name not in REFUSED.get(structure, ())
    )
    path = ".".join(place)
    heading = f"[[{path}]]" if repeated else f"[{path}]" if path else ""
    if keys:
        yield KeyTable(heading, needed, meaning, keys)
    for name, found in inside.items():
        if found is None:
            continue
        model, container = found
        field = structure.model_fields[name]
        yield from _tables(
            model,
            (*place, name, "NAME") if container is dict else (*place, name),
            repeated=container is list,
            needed=needed and field.is_required(),
            meaning=_description(field) or _first_line(model),
        )


def _table_in(annotation: Any) -> tuple[type[Table], type | None] | None:
    """Return the table that a key holds, and whether in a list or under names of its own."""
    for part in _alternatives(annotation):
        if isinstance(part, type) and issubclass(part, Table):
            return part, None
        container, arguments = get_origin(part), get_args(part)
        if container in (list, dict):
            held = _table_in(arguments[-1])
            if held is not None:
                return held[0], container
    return None


def _alternatives(annotation: Any) -> tuple[Any, ...]:
    """Return what a value may be, without None and without remarks."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return _alternatives(get_args(annotation)[0])
    if origin in (Union, types.UnionType):
        parts = (part for part in get_args(annotation) if part is not type(None))
        return tuple(found for part in parts for found in _alternatives(part))
    return (annotation,)


def _key(name: str, field: FieldInfo, structure: type[Table]) -> Key:
    holds = "column" if _is_column(field) else _kind(field.annotation)
    limits = ", ".join(_limits(field))
    key = Key(
        name=name,
        holds=f"{holds}, {limits}" if limits else holds,
        unit="",
        default=_default(field),
        meaning=_meaning(name, field),
    )
    return replace(key, unit=_unit(key, structure))


def _is_column(field: FieldInfo) -> bool:
    """Whether a key names a column; those that always do have lost the remark that says so."""
    column = get_args(Column)[0]
    return set(_alternatives(field.annotation)) == set(_alternatives(column))


def _meaning(name: str, field: FieldInfo) -> str:
    own = _description(field)
    if _is_column(field) and own in ("", _column_description()):
        return COLUMN_MEANING.format(name.removesuffix("_column").replace("_", " "))
    return own


def _column_description() -> str:
    (remark,) = (part for part in get_args(Column) if isinstance(part, FieldInfo))
    return remark.description or ""


def _description(field: FieldInfo) -> str:
    return field.description or ""


def _first_line(model: type[Table]) -> str:
    return (model.__doc__ or "").splitlines()[0].rstrip(".") if model.__doc__ else ""


def _kind(annotation: Any) -> str:
    words = []
    for part in _alternatives(annotation):
        container, arguments = get_origin(part), get_args(part)
        if container is Literal:
            words.append(" or ".join(f"`{_toml(choice)}`" for choice in arguments))
        elif container is list:
            words.append(f"list of {_plural(_kind(arguments[0]))}")
        elif container is dict:
            words.append(f"table: {_kind(arguments[1])} by name")
        else:
            words.append(_WORDS[part])
    return " or ".join(words)


def _plural(kind: str) -> str:
    first, of, others = kind.partition(" of ")
    return f"{first}s{of}{others}"


def _limits(field: FieldInfo) -> Iterator[str]:
    for limit in field.metadata:
        match limit:
            case annotated_types.Gt(gt=value):
                yield f"above {value:g}"
            case annotated_types.Ge(ge=value):
                yield f"at least {value:g}"
            case annotated_types.Lt(lt=value):
                yield f"below {value:g}"
            case annotated_types.Le(le=value):
                yield f"at most {value:g}"
            case annotated_types.MinLen(min_length=value) if value > 1:
                yield f"{value} or more"
            case annotated_types.MaxLen(max_length=value):
                yield f"at most {value}"


def _unit(key: Key, structure: type[Table]) -> str:
    """Return the unit that a key's name or meaning says, or the key beside it that does."""
    number = key.holds.startswith("number")
    if not number and key.holds != "column" and "lists of numbers" not in key.holds:
        return ""
    named = re.search(r"\b\w+_unit\b", key.meaning)
    if named:
        return f"`{named[0]}`"
    for ending, unit in UNIT_OF_ENDING.items():
        if number and key.name.endswith(ending):
            return unit
    for words, unit in UNIT_OF_WORDS.items():
        if words in key.meaning:
            return unit
    stem = key.name
    while stem:
        if f"{stem}_unit" in structure.model_fields:
            return f"`{stem}_unit`"
        stem = stem.rpartition("_")[0]
    return "`unit`" if number and "unit" in structure.model_fields else ""


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "needed"
    value = field.get_default(call_default_factory=True, validated_data={})
    return "none" if value is None or value in ([], {}) else f"`{_toml(value)}`"


def _toml(value: object) -> str:
    """Return a value as TOML has it."""
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else f"{value:g}"
