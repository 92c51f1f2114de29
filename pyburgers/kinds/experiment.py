"""Deformation experiments: what every test has, and what its file says about it.

An experiment is a TOML file beside one or several text files of columns; the keys and what they
hold are the fields of the tables below and of the module of its protocol (`constant_rate`,
`forced_oscillation`). Everything is converted to SI on reading.
"""

import re
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import date, datetime, time
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Self, TypeVar

import numpy as np
import numpy.typing as npt
from pydantic import Field

from pyburgers.common.errors import InputError, all_of, nearest
from pyburgers.common.toml_files import NAME, Table, write_toml
from pyburgers.common.units import span_text
from pyburgers.kinds.limits import impossible_conditions, refuse_impossible
from pyburgers.kinds.microstructure import MeasuredMicrostructure
from pyburgers.kinds.read_test import ReadTest
from pyburgers.model.laws import KELVIN_LAWS
from pyburgers.model.parameters import CONDITIONS, PARAMETER_BY_NAME

FloatArray = npt.NDArray[np.float64]
MetadataValue = str | float | int | bool


MAX_TEMPERATURE_SD_SHARE = 0.1
"""Largest standard deviation of a temperature over it: a wider error would reach zero kelvin."""


@dataclass(frozen=True)
class Provenance:
    """Where data come from.

    `kind`: measured numbers, numbers read off a figure, or the output of a model.
    `source`: citation or origin.
    `doi`, `licence`, `notes`: as far as known.
    """

    kind: Literal["measured", "digitised", "synthetic"]
    source: str
    doi: str | None = None
    licence: str | None = None
    notes: str | None = None


@dataclass(frozen=True)
class UncertainCondition:
    """A condition of a test that is known up to an error, normal about 0.

    `parameter`: the error: one of `pyburgers.model.parameters.CONDITIONS`.
    `sd`: its standard deviation (K; 1 of the load cell).
    `apparatus`: furnace or load cell that gives it, with one error in all tests that name it.
    """

    parameter: str
    sd: float
    apparatus: str | None


CONDITION_KEYS: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "temperature_error": ("temperature_sd_K", "furnace"),
        "stress_calibration_error": ("stress_calibration_sd", "load_cell"),
    }
)
"""Keys of files that state the standard deviation of an error, and the apparatus."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Experiment(ReadTest):
    """A deformation test of any protocol, in SI units.

    Attributes
    ----------
    protocol : str
        Name of the kind of test, as in files; a constant of each derived class.
    laws : mapping of str to sequence of str
        Laws that such tests can be fitted with, by part of the model
        (`pyburgers.model.variants.CHOICES`): any of a part that is not named. A constant as well.
    parts_name : str
        Name of the parts of a test, in the plural. A constant as well.
    residual_correlation : str
        Parameter along which residuals may correlate: over strain or over time. A constant as well.
    may_be_uncertain : frozenset of str
        Errors of conditions (`pyburgers.model.parameters.CONDITIONS`) that the program of such
        tests knows. A constant as well.
    without_effect : frozenset of str
        Parameters that such tests do not inform. A constant as well.
    small_strain : float
        Largest strain (fraction) of a table below which its unit is doubted. A constant as well.
    id, material : str
        Sample and material; the material names the default priors.
    temperature : float
        Kelvin, as stated.
    initial_grain_size : float
        Metres, where the data start.
    uncertain : tuple of UncertainCondition
        Conditions that are not taken as known.
    microstructure : tuple of MeasuredMicrostructure
        Measured grain sizes and fabric factors, by increasing strain or time.
    provenance : Provenance
        Origin of the data.
    metadata : mapping
        Free remarks that no computation uses.
    notices : tuple of str
        Sentences about numbers that were changed or doubted during reading.
    true_parameters : mapping of str to float, or None
        Parameters (SI) behind synthetic data.
    """

    protocol: ClassVar[str]
    laws: ClassVar[Mapping[str, Sequence[str]]] = MappingProxyType(
        {"kelvin": tuple(law.name for law in KELVIN_LAWS.values() if law.one_time)}
    )
    parts_name: ClassVar[str] = "parts"
    residual_correlation: ClassVar[str] = "residual_correlation_strain"
    may_be_uncertain: ClassVar[frozenset[str]] = CONDITIONS
    without_effect: ClassVar[frozenset[str]] = frozenset()
    small_strain: ClassVar[float] = 5e-3
    material: str
    temperature: float
    initial_grain_size: float
    provenance: Provenance
    metadata: Mapping[str, MetadataValue]
    notices: tuple[str, ...]
    true_parameters: Mapping[str, float] | None
    uncertain: tuple[UncertainCondition, ...] = ()
    microstructure: tuple[MeasuredMicrostructure, ...] = ()

    def __post_init__(self) -> None:
        """Refuse numbers that no test has, wherever they come from."""
        refuse_impossible(
            self.id,
            np.array([self.temperature, *self.temperatures]),
            np.array([self.initial_grain_size, *(m.grain_size for m in self.microstructure)]),
            self.response,
            None if self.provenance.kind == "synthetic" else self.largest_strain,
        )

    @property
    @abstractmethod
    def span(self) -> tuple[float, float]:
        """First and last position on the clock (SI) at which the test has a solution."""

    @property
    @abstractmethod
    def largest_stress(self) -> float:
        """Largest |σ| (Pa) in the test; only of an experiment with data."""

    @property
    def doubts(self) -> tuple[str, ...]:
        """Sentences about numbers that are unlikely in a test of its kind."""
        return ()

    @property
    def largest_strain_read(self) -> float | None:
        """Largest |ε| that was read as response, None where the response is no strain."""
        return None

    @property
    def largest_strain(self) -> float | None:
        """Largest |ε| that was imposed or read, as far as it is known."""
        return self.largest_strain_read

    @property
    @abstractmethod
    def title(self) -> str:
        """Sample, material, conditions and kind of data for figures, as matplotlib text."""

    @property
    def temperatures(self) -> FloatArray:
        """All temperatures (K) of the test, in any order."""
        return np.array([self.temperature])

    @property
    def temperature_text(self) -> str:
        """The temperature, or the lowest and the highest of the test, in K."""
        temperatures = self.temperatures
        return f"{span_text((temperatures.min(), temperatures.max()), digits=6)} K"

    @property
    def parts(self) -> Mapping[str, int]:
        """Readings in each part that can be predicted from the others, by name; none in most."""
        return MappingProxyType({})

    def without_part(self, name: str) -> Self:
        """Return the test without one of its `parts`.

        Raises
        ------
        InputError
            If it has no such part.
        """
        raise InputError(f"{self.id}: has no part {name!r}, {nearest(name, self.parts)}")


E = TypeVar("E", bound=Experiment)


def of_kind(experiment: Experiment, kind: type[E]) -> E:
    """Return a test that has to be of a kind (`InputError` if it is of another)."""
    if not isinstance(experiment, kind):
        raise InputError(
            f"{experiment.id}: found a test of protocol {experiment.protocol!r}, expected one of "
            f"protocol {kind.protocol!r}."
        )
    return experiment


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


def write_experiment(experiment: Experiment, directory: Path, own: Mapping[str, Any]) -> Path:
    """Write ``experiment.toml``.

    `own`: keys and tables of the experiment's protocol.
    """
    table = {
        "id": experiment.id,
        "material": experiment.material,
        "protocol": experiment.protocol,
        "temperature_K": experiment.temperature,
        "initial_grain_size_m": experiment.initial_grain_size,
        **{
            key: value
            for condition in experiment.uncertain
            for key, value in zip(
                CONDITION_KEYS[condition.parameter],
                (condition.sd, condition.apparatus),
                strict=True,
            )
        },
        **own,
        "notices": list(experiment.notices),
        "provenance": asdict(experiment.provenance),
        "metadata": experiment.metadata,
        "true_parameters": experiment.true_parameters,
    }
    target = directory / "experiment.toml"
    write_toml(target, table)
    return target


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
