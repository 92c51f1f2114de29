"""What files of a kind hold (`Kind`), keys that all of them share, and checks of these."""

# ruff: noqa: N815 - keys of files end in their units
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, time
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Generic, Literal, get_args, get_origin

import numpy as np
from pydantic import Field

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError, nearest, require_type
from pyburgers.common.toml_files import NAME, Material, Table, all_of, factor_to_si, nested_table
from pyburgers.kinds.experiment import (
    CONDITION_KEYS,
    ENVIRONMENT_KEYS,
    E,
    MeasuredMicrostructure,
    Provenance,
    UncertainCondition,
)
from pyburgers.kinds.limits import impossible_conditions
from pyburgers.model.parameters import PARAMETER_BY_NAME

MAX_TEMPERATURE_SD_SHARE = 0.1
"""Largest standard deviation of a temperature over it: a wider error would reach zero kelvin."""

MaxReadings = Annotated[
    int, Field(ge=10, description="to how many readings a longer record is thinned")
]
"""Readings that are used of a record, but for at least two of each stage or segment."""


class ProvenanceTable(Table):
    """The table [provenance]."""

    kind: Literal["measured", "digitised", "synthetic"] = Field(
        description="measured, digitised or synthetic"
    )
    source: str = Field(min_length=1, description="the citation or origin of the data")
    doi: str | None = Field(None, description="the DOI of the source")
    licence: str | None = Field(None, description="the licence of the data")
    notes: str | None = Field(None, description="remarks about where the data come from")


class ExperimentFile(Table):
    """Keys that experiment files of all protocols share."""

    id: str = Field(description="the sample's name")
    material: Material
    protocol: str = Field(description="the kind of test")
    temperature_K: float = Field(description="the temperature in kelvin")
    initial_grain_size_m: float = Field(description="the mean grain size at the start in metres")
    temperature_sd_K: float | None = Field(
        None, gt=0, description="the standard deviation of the temperature's error in kelvin"
    )
    furnace: str | None = Field(
        None, min_length=1, description="the furnace whose temperature is uncertain"
    )
    stress_calibration_sd: float | None = Field(
        None, gt=0, le=0.2, description="the standard deviation of the load cell's relative error"
    )
    load_cell: str | None = Field(
        None, min_length=1, description="the load cell whose calibration is uncertain"
    )
    pressure_Pa: float | None = Field(None, ge=0, description="the pressure in pascals")
    water_fugacity_Pa: float | None = Field(None, gt=0, description="the water fugacity in pascals")
    melt_fraction: float | None = Field(None, ge=0, lt=1, description="the melt fraction")
    notices: list[str] = Field(
        default_factory=list, description="remarks of an earlier reading of the same data"
    )
    provenance: ProvenanceTable = Field(description="the table that says where data come from")
    metadata: dict[str, Any] = Field(
        default_factory=dict, description="free remarks, which no computation uses"
    )
    true_parameters: dict[str, float] | None = Field(
        None, description="the parameters (SI) behind synthetic data"
    )


def shared_values(path: Path, file: ExperimentFile) -> dict[str, Any]:
    """Check the keys that all protocols share; return them as fields of `Experiment` (SI)."""
    _, uncertain, true_parameters = all_of(
        lambda: _check_conditions(path, file),
        lambda: _uncertain_conditions(path, file),
        lambda: _true_parameters(path, file),
    )
    environment = {name: getattr(file, key) for name, key in ENVIRONMENT_KEYS.items()}
    stated = {name: value for name, value in environment.items() if value is not None}
    return {
        "id": file.id,
        "material": file.material,
        "temperature": file.temperature_K,
        "initial_grain_size": file.initial_grain_size_m,
        "uncertain": uncertain,
        "environment": MappingProxyType(stated),
        "provenance": Provenance(**file.provenance.model_dump()),
        "metadata": MappingProxyType(dict(file.metadata)),
        "true_parameters": true_parameters,
    }


def _check_conditions(path: Path, file: ExperimentFile) -> None:
    """Check everything that needs no data file."""
    sentences = []
    if not re.fullmatch(NAME, file.id):
        sentences.append(
            f"{path}: key 'id': found {file.id!r}, expected at most 100 letters, digits, '.', '_' "
            "or '-', the first a letter, digit or '_', because it names files."
        )
    names = ("key 'temperature_K'", "key 'initial_grain_size_m'")
    faults = impossible_conditions(file.temperature_K, file.initial_grain_size_m, names)
    sentences += [f"{path}: {fault}" for fault in faults]
    for key, value in file.metadata.items():
        if not isinstance(value, str | bool | int | float):
            kind = "a date" if isinstance(value, date | datetime | time) else "a table or list"
            sentences.append(
                f"{path}: key {key!r} in [metadata]: found {kind}, expected a string, a number, "
                "true or false."
            )
    if sentences:
        raise InputError(*sentences)


def _uncertain_conditions(path: Path, file: ExperimentFile) -> tuple[UncertainCondition, ...]:
    """Check and return the conditions that have a standard deviation."""
    found = []
    for parameter, (sd_key, apparatus_key) in CONDITION_KEYS.items():
        sd, apparatus = getattr(file, sd_key), getattr(file, apparatus_key)
        if sd is not None:
            found.append(UncertainCondition(parameter, sd, apparatus))
        elif apparatus is not None:
            raise InputError(
                f"{path}: key {sd_key!r} is missing, expected it because {apparatus_key!r} is "
                f"{apparatus!r}."
            )
    sd = file.temperature_sd_K
    if sd is not None and sd > MAX_TEMPERATURE_SD_SHARE * file.temperature_K:
        raise InputError(
            f"{path}: key 'temperature_sd_K': found {sd:g}, expected at most "
            f"{MAX_TEMPERATURE_SD_SHARE:g} of the temperature, {file.temperature_K:g} K."
        )
    return tuple(found)


def _true_parameters(path: Path, file: ExperimentFile) -> Mapping[str, float] | None:
    """Check and return the parameters behind synthetic data."""
    if file.true_parameters is None:
        return None
    if file.provenance.kind != "synthetic":
        raise InputError(
            f"{path}: table [true_parameters] is only for data of kind 'synthetic', but key 'kind' "
            f"in [provenance] is {file.provenance.kind!r}."
        )
    for name in file.true_parameters:
        if name not in PARAMETER_BY_NAME:
            raise InputError(
                f"{path}: unknown key {name!r} in [true_parameters], "
                f"{nearest(name, PARAMETER_BY_NAME)}"
            )
    return MappingProxyType(dict(file.true_parameters))


Compression = Literal["positive", "negative"]


SIGNS_WERE_TURNED = "Compression is negative in the file: the signs were turned."


def sign_of(compression: Compression) -> int:
    """Return what turns a number of a file into one whose compression is positive: 1 or -1."""
    return 1 if compression == "positive" else -1


PATH_STRAIN_ROUNDING = 1e-9
"""Share of a path strain by which it may lie beyond the end: units were converted."""


class MeasuredTable(Table):
    """What was measured, of the tables [[microstructure]]."""

    grain_size_m: float = Field(gt=0, lt=1, description="the mean grain size in metres")
    grain_size_sd_m: float = Field(
        gt=0, description="the standard deviation of the grain size in metres"
    )
    fabric_factor: float | None = Field(None, description="the fabric factor, 1 if isotropic")
    fabric_factor_sd: float | None = Field(
        None, gt=0, description="the standard deviation of the fabric factor"
    )


class StrainTable(Table):
    """Where it was measured in a test along strain."""

    strain: float = Field(gt=0, description="the strain at which the sample was looked at")


class MicrostructureTable(MeasuredTable, StrainTable):
    """One of the tables [[microstructure]] of a test along strain."""


def measured_microstructure(
    path: Path,
    tables: Sequence[MicrostructureTable],
    strain_unit: str | None,
    final_strain: float | None,
) -> tuple[MeasuredMicrostructure, ...]:
    """Check the tables [[microstructure]] of a test along strain, in the unit of [data]."""
    factor = strain_factor(path, strain_unit)
    check_increasing(path, "strain", [table.strain for table in tables])
    for number, table in enumerate(tables, start=1):
        if final_strain is not None and table.strain * factor > final_strain:
            raise InputError(
                f"{row_text(path, number)}: key 'strain': found {table.strain:g}, expected at most "
                f"'final_strain', {final_strain:g} as a fraction."
            )
    return tuple(
        measured_row(path, number, table, strain=table.strain * factor)
        for number, table in enumerate(tables, start=1)
    )


def row_text(path: Path, number: int) -> str:
    """Return file and table, for messages."""
    return f"{path}: [[microstructure]] number {number}"


def strain_factor(path: Path, strain_unit: str | None) -> float:
    """Return the factor to a fraction, of strains in the unit of [data] if there is one."""
    return factor_to_si(strain_unit or "fraction", "strain", f"{path}: key 'strain_unit' in [data]")


def check_increasing(path: Path, key: str, values: Sequence[float | None]) -> None:
    """Refuse values of a key of the tables that do not increase, of those that have it."""
    given = [(number, one) for number, one in enumerate(values, start=1) if one is not None]
    for (_, before), (number, after) in pairwise(given):
        if after <= before:
            raise InputError(
                f"{path}: key {key!r} in [[microstructure]] number {number}: found {after:g}, "
                f"expected more than {before:g}, that of the one before."
            )


def measured_row(
    path: Path, number: int, table: MeasuredTable, strain: float | None, time: float | None = None
) -> MeasuredMicrostructure:
    """Check what was measured at a strain (fraction) or time (s)."""
    where = row_text(path, number)
    if (table.fabric_factor is None) != (table.fabric_factor_sd is None):
        raise InputError(
            f"{where} needs both or neither of the keys 'fabric_factor' and 'fabric_factor_sd'."
        )
    if table.grain_size_sd_m >= table.grain_size_m:
        raise InputError(
            f"{where}: key 'grain_size_sd_m': found {table.grain_size_sd_m:g}, expected less "
            f"than the grain size, {table.grain_size_m:g} m."
        )
    fabric = table.fabric_factor, table.fabric_factor_sd
    return MeasuredMicrostructure(strain, table.grain_size_m, table.grain_size_sd_m, *fabric, time)


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
    (
        r"^(?!.*\[\[stages\]\]).*",  # whose tables keep their keys
        lambda found: found[0].replace("'strain_rate_per_s'", "'strain_rate'"),
    ),
    ("'id'", "'name'"),
    (r"\ba key(?= ')", "the argument"),
    (r"\bkey(s?)(?= ')", r"argument\1"),
)
"""Patterns of keys and units in messages about files, and what stands for them about arguments."""


UNSTATED_KIND = (
    "Where the readings come from was not stated, so they count as measured: "
    'state kind="synthetic" or kind="digitised" if they are not.'
)


@dataclass(frozen=True)
class Kind(Generic[E]):
    """A kind of test, as in experiment files: their keys, and what reads the tables of one."""

    structure: type[ExperimentFile]
    load: Callable[[Path, Mapping[str, Any]], E]


def test_of(called: str, kind: Kind[E], arguments: Mapping[str, Any]) -> E:
    """Check arguments, under the keys of files, as tables of a file; `called` is the function."""
    (protocol,) = get_args(kind.structure.model_fields["protocol"].annotation)
    given = {"kind": "measured", "source": f"arrays given to {called}", **arguments}
    if not {"kind", "provenance"} & arguments.keys():
        given["notices"] = [*arguments.get("notices", []), UNSTATED_KIND]
    tables = {"protocol": protocol, **_tables(called, kind.structure, given)}
    try:
        return kind.load(Path(called), tables)
    except InputError as error:
        raise InputError(*map(_of_arguments, error.sentences)) from None


def _tables(
    called: str, structure: type[ExperimentFile], arguments: Mapping[str, Any]
) -> dict[str, Any]:
    """Return arguments as tables of a file, each in that which has its key, arrays as columns."""
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
        if f"{key}_column" in data and not homes and not np.ndim(value):
            require_type(f"{called}: argument {key!r}", value, list, "a list of readings")
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


MAX_DEPARTURE_SHARE = 0.05
"""Largest distance from what is imposed that is no mistake of the file, in shares of the largest
value."""


def departure(read: FloatArray, imposed: FloatArray, scale: float) -> tuple[float, int] | None:
    """Return how far readings (n,) are from what is imposed, and the first far one; else None."""
    distance = np.abs(read - imposed)
    far = np.flatnonzero(distance > MAX_DEPARTURE_SHARE * scale)
    return (float(distance.max()), int(far[0])) if far.size else None


def slope_of(time: FloatArray, values: FloatArray) -> float | None:
    """Return the slope of the line through readings, None where times go back or are all one."""
    own = time - time.mean()
    spread = float(own @ own)
    if spread == 0 or (np.diff(time) < 0).any():
        return None
    return float(own @ (values - values.mean())) / spread
