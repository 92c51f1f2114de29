"""Keys that the files of all tests share, and what is checked of them.

An experiment is a TOML file beside one or several text files of columns, or the same tables in
memory; other keys are in the module of its kind. Everything is converted to SI on reading.
"""

import re
from collections.abc import Mapping
from datetime import date, datetime, time
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from pydantic import Field

from pyburgers.common.errors import InputError, all_of, nearest
from pyburgers.common.toml_files import NAME, Table
from pyburgers.kinds.experiment import CONDITION_KEYS, Provenance, UncertainCondition
from pyburgers.kinds.limits import impossible_conditions
from pyburgers.model.parameters import PARAMETER_BY_NAME

MAX_TEMPERATURE_SD_SHARE = 0.1
"""Largest standard deviation of a temperature over it: a wider error would reach zero kelvin."""


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
    material: str = Field(min_length=1, description="the material, such as ice")
    protocol: str = Field(description="the kind of test")
    temperature_K: float = Field(description="the temperature in kelvin")  # noqa: N815 (the key of the file, K for kelvin)
    initial_grain_size_m: float = Field(description="the mean grain size at the start in metres")
    temperature_sd_K: float | None = Field(  # noqa: N815
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
    """Check the keys that all protocols share.

    The result: fields of `Experiment` (SI), without the stress and the notices. Raise InputError if
    a value is not what it has to be.
    """
    _, uncertain, true_parameters = all_of(
        lambda: _check_conditions(path, file),
        lambda: _uncertain_conditions(path, file),
        lambda: _true_parameters(path, file),
    )
    return {
        "id": file.id,
        "material": file.material,
        "temperature": file.temperature_K,
        "initial_grain_size": file.initial_grain_size_m,
        "uncertain": uncertain,
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
