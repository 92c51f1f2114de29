"""Deformation experiments: what every test has, in SI."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Literal, Self, TypeVar

import numpy as np
import pandas as pd

from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.common.csv_tables import data_files
from pyburgers.common.errors import InputError, nearest
from pyburgers.common.paths import given_path
from pyburgers.common.toml_files import toml_text, write_toml
from pyburgers.common.units import counted, span_text
from pyburgers.kinds.limits import refuse_impossible
from pyburgers.model.fitted_test import Test
from pyburgers.model.parameters import CONDITIONS
from pyburgers.model.peak_test import PeakTest

MetadataValue = str | float | int | bool

DataKind = Literal["synthetic", "digitised", "measured"]
"""Of several together the first counts."""


@dataclass(frozen=True)
class Provenance:
    """Where data come from.

    `kind`: measured numbers, numbers read off a figure, or the output of a model.
    `source`: citation or origin.
    `doi`, `licence`, `notes`: as far as known.
    """

    kind: DataKind
    source: str
    doi: str | None = None
    licence: str | None = None
    notes: str | None = None


@dataclass(frozen=True)
class Stated:
    """A number that a file states with its uncertainty, in SI.

    `value`, `sd`: mean and standard deviation; with an sd of 0 the number is known.
    """

    value: float
    sd: float


@dataclass(frozen=True)
class UncertainCondition:
    """A condition known up to an error of `sd` (K; 1 of the load cell), normal about 0.

    `parameter`: the error, one of `CONDITIONS`; `apparatus` gives it to all tests that name it.
    """

    parameter: str
    sd: float
    apparatus: str | None


CONDITION_KEYS: Mapping[str, tuple[str, str]] = {
    "temperature_error": ("temperature_sd_K", "furnace"),
    "stress_calibration_error": ("stress_calibration_sd", "load_cell"),
}
"""Keys of files that state the standard deviation of an error, and the apparatus."""


ENVIRONMENT_KEYS: Mapping[str, str] = {
    "pressure": "pressure_Pa",
    "water_fugacity": "water_fugacity_Pa",
    "melt_fraction": "melt_fraction",
}
"""Keys of files that state each of `pyburgers.model.parameters.ENVIRONMENT`."""


@dataclass(frozen=True)
class MeasuredMicrostructure:
    """Microstructure of a sample at one strain or time, as measured.

    `strain`: path strain (fraction, above 0), where that is what is known.
    `grain_size`, `grain_size_sd`: mean and standard deviation (m) of a lognormal error.
    `fabric_factor`, `fabric_factor_sd`: fabric factor (1 = isotropic) and its error, if measured.
    `time`: seconds since the start of a loading history, in the place of the strain.
    """

    strain: float | None
    grain_size: float
    grain_size_sd: float
    fabric_factor: float | None = None
    fabric_factor_sd: float | None = None
    time: float | None = None

    @property
    def numbers(self) -> list[float]:
        """Row of `stan/statistics/measured_microstructure.stan`; 0 was not measured."""
        relative_sd = self.grain_size_sd / self.grain_size
        fabric = (self.fabric_factor or 0.0, self.fabric_factor_sd or 0.0)
        return [self.grain_size, relative_sd, *fabric]

    @property
    def table(self) -> dict[str, float]:
        """Its table [[microstructure]], with the strain as a fraction and the time in s."""
        keys = {"grain_size": "grain_size_m", "grain_size_sd": "grain_size_sd_m"}
        found = {keys.get(name, name): value for name, value in asdict(self).items()}
        return {key: value for key, value in found.items() if value is not None}

    def drawn(
        self, grain_size: float, fabric_factor: float, rng: np.random.Generator
    ) -> "MeasuredMicrostructure":
        """Measure a microstructure (m; 1 = isotropic) in the place of this one, as uncertain."""
        _, log_sd, _, fabric_sd = self.numbers
        size = float(grain_size * np.exp(log_sd * rng.standard_normal()))
        drawn = replace(self, grain_size=size, grain_size_sd=log_sd * size)
        if self.fabric_factor is None:
            return drawn
        factor = float(fabric_factor + fabric_sd * rng.standard_normal())
        return replace(drawn, fabric_factor=factor)


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Experiment(Test):
    """A deformation test of any protocol, in SI units.

    Attributes
    ----------
    protocol : str
        Name of the kind of test, as in files; like all up to `id` a constant of each class.
    laws : mapping of str to sequence of str
        Laws that such tests can be fitted with, by part of the model
        (`pyburgers.model.variants.CHOICES`): any of a part that is not named.
    linear_hardening : bool
        Whether a backstress has its linear form in such tests.
    parts_name : str
        Name of the parts of a test, in the plural.
    residual_correlation : str
        Parameter along which residuals may correlate: over strain or over time.
    may_be_uncertain, without_effect : frozenset of str
        Errors of conditions (`pyburgers.model.parameters.CONDITIONS`) that the program of such
        tests knows, and parameters that they do not inform.
    small_strain : float
        Largest strain (fraction) of a table below which its unit is doubted.
    of_points : tuple of str
        Attributes with an entry for each point.
    points_together : str
        Why single points cannot be left out; empty if they can.
    id, material : str
        Sample and material; the material names the default priors.
    temperature : float
        Kelvin, as stated.
    initial_grain_size : float
        Metres, where the data start.
    uncertain : tuple of UncertainCondition
        Conditions that are not taken as known.
    environment : mapping of str to float
        Pressure and water fugacity (Pa) and melt fraction, as far as stated
        (`pyburgers.model.parameters.ENVIRONMENT`).
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

    Examples
    --------
    >>> test = pyburgers.load_experiment(data / "ice" / "PIL40.toml")
    >>> test.id, test.material, test.n_points
    ('PIL40', 'ice', 61)
    """

    parts_name: ClassVar[str] = "parts"
    may_be_uncertain: ClassVar[frozenset[str]] = CONDITIONS
    without_effect: ClassVar[frozenset[str]] = frozenset(
        {"modulus_temperature_coefficient", "attenuation_scatter", "modulus_scatter"}
    )
    small_strain: ClassVar[float] = 5e-3
    of_points: ClassVar[tuple[str, ...]] = ()
    points_together: ClassVar[str] = ""
    id: str
    material: str
    temperature: float
    initial_grain_size: float
    provenance: Provenance
    metadata: Mapping[str, MetadataValue]
    notices: tuple[str, ...]
    true_parameters: Mapping[str, float] | None
    uncertain: tuple[UncertainCondition, ...] = ()
    environment: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
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
    def response(self) -> FloatArray:
        """Readings for comparison with the model (SI unit), shape (n_points,)."""

    @property
    def response_limit(self) -> FloatArray:
        """Response at or below which a reading is an upper limit; -inf: none, (n_points,)."""
        return np.full(self.n_points, -np.inf)

    @property
    def n_points(self) -> int:
        """Number of data points; zero for an experiment that can only be simulated."""
        return len(self.response)

    def has_readings_of(self, other: "Experiment") -> bool:
        """Whether both tests have the same data, however they are prepared.

        Examples
        --------
        >>> test.has_readings_of(test)
        True
        """
        return self.n_points > 0 and np.array_equal(self.response, other.response)

    @property
    def quantity(self) -> IntArray:
        """Number, in what its kind reads, of what each reading is of, shape (n_points,)."""
        return np.zeros(self.n_points, dtype=np.int64)

    @property
    @abstractmethod
    def noises(self) -> Mapping[str, float | None]:
        """Noises (parameters) of what is read, and the sizes (SI) that the file states.

        Zero: each reading has a stated error, and there may be no noise beside it.
        """

    @property
    def stated(self) -> Mapping[str, Stated]:
        """Parameters of the test and its apparatus that its file states."""
        return {}

    @property
    def peak(self) -> PeakTest | None:
        """Its peak as tables of rates have it, if it has one."""
        return None

    @abstractmethod
    def to_be_solved(self) -> Self:
        """Return the test as one to be simulated, if its program can; what drives it is known."""

    def known_columns(self, at: FloatArray) -> Mapping[str, FloatArray]:
        """Return columns of a solution at positions (SI) that are known without solving."""
        return {}

    def conditions_at(self, at: FloatArray) -> Mapping[str, FloatArray]:
        """Return columns that say what positions (SI) mean, where the clock does not."""
        return {}

    def reading_places(self) -> tuple[FloatArray, IntArray]:
        """Return positions (SI) at which a solution holds all readings, and the place of each."""
        positions, places = np.unique(self.position, return_inverse=True)
        return positions, places

    @abstractmethod
    def with_noise(
        self, response: FloatArray, values: Mapping[str, float], rng: np.random.Generator
    ) -> Self:
        """Return the test with the model's responses (SI), (n_points,), and noise for its own."""

    def solution_table(self, solution: pd.DataFrame) -> pd.DataFrame:
        """Return the table that `pyburgers simulate` writes of a solution."""
        return solution

    @property
    def n_driving_errors(self) -> int:
        """Number of uncertain numbers in what drives the test, which are inferred with it."""
        return 0

    def driving_error(self, true: Self) -> FloatArray:
        """Return errors of what drives a simulated test, given the test that knows the truth."""
        return np.zeros(self.n_driving_errors)

    def without_point(self, point: int) -> Self:
        """Return the test without one of its points, counted from 0, unless they go together."""
        if self.points_together:
            raise InputError(
                f"{self.id}: points cannot be left out one by one, expected a comparison without "
                f"fitting again, because {self.points_together}."
            )
        left: dict[str, Any] = {n: np.delete(getattr(self, n), point) for n in self.of_points}
        return replace(self, **left)

    @property
    @abstractmethod
    def span(self) -> tuple[float, float]:
        """First and last position on the clock (SI) at which the test has a solution."""

    @property
    def doubts(self) -> tuple[str, ...]:
        """Sentences about numbers that are unlikely in a test of its kind."""
        return ()

    @property
    def poisson_ratio_in_shear(self) -> float | None:
        """Poisson's ratio of readings in shear, NaN if a bulk modulus stands for it; else None."""
        return None

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
        return {}

    def without_part(self, name: str) -> Self:
        """Return the test without one of its `parts`; raise InputError if it has no such part."""
        raise InputError(f"{self.id}: has no part {name!r}, {nearest(name, self.parts)}")

    @abstractmethod
    def own_tables(self) -> dict[str, Any]:
        """Return the keys and tables of a file that only this kind of test has, as `tables`."""

    def tables(self) -> dict[str, Any]:
        """Return the tables of an experiment file in SI, with readings as arrays by column.

        Keys that do not apply are None. A test that is read from `toml_text` of them is equal.

        Examples
        --------
        >>> test.tables()["material"]
        'ice'
        """
        conditions: dict[str, float | str | None] = {}
        for one in self.uncertain:
            sd_key, apparatus_key = CONDITION_KEYS[one.parameter]
            conditions |= {sd_key: one.sd, apparatus_key: one.apparatus}
        return {
            "id": self.id,
            "material": self.material,
            "protocol": self.protocol,
            "temperature_K": self.temperature,
            "initial_grain_size_m": self.initial_grain_size,
            **conditions,
            **{ENVIRONMENT_KEYS[name]: value for name, value in self.environment.items()},
            **self.own_tables(),
            "microstructure": [one.table for one in self.microstructure] or None,
            "notices": list(self.notices),
            "provenance": asdict(self.provenance),
            "metadata": self.metadata,
            "true_parameters": self.true_parameters,
        }

    def file_texts(self) -> dict[str, str]:
        """Return the texts of its data files and, last, of ``experiment.toml`` in SI, by name.

        `pyburgers.load_experiment` reads back exactly equal contents, notices included.
        """
        tables = self.tables()
        data, texts = data_files(tables.get("data"))
        return {**texts, "experiment.toml": toml_text({**tables, "data": data})}

    def to_toml(self, path: str | Path) -> None:
        """Write one experiment file in SI, with the readings inside it.

        Parameters
        ----------
        path : str or Path
            The file. `pyburgers.load_experiment` reads an equal test from it.

        Raises
        ------
        InputError
            If there is no folder for it.

        Examples
        --------
        >>> test.to_toml("mine.toml")
        >>> pyburgers.load_experiment("mine.toml").n_points == test.n_points
        True
        """
        write_toml(given_path(path), self.tables())

    def plot(self, ax: Any = None) -> Any:
        """Draw the readings of the test.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes to draw into; without them new ones.

        Returns
        -------
        matplotlib Axes
            As of `pyburgers.plot`.

        Examples
        --------
        >>> axes = test.plot()
        """
        return import_module("pyburgers").plot(self, ax)

    def __repr__(self) -> str:
        """Return a line about the test, and a line for each notice and doubt."""
        readings = counted(self.n_points, "reading") if self.n_points else "no readings"
        grains = f"{self.initial_grain_size * 1e6:.4g} µm"
        head = f"{self.material}, {self.temperature_text}, {grains}, {readings}"
        doubts = import_module("pyburgers.kinds.conditions").doubts(self)
        told = (*self.notices, *(one.removeprefix(f"{self.id}: ") for one in doubts))
        notes = (f"note: {sentence}" for sentence in told)
        return "\n".join([f"<test {self.id} ({self.protocol}): {head}>", *notes])


A_TEST = "a test, as of pyburgers.load_experiment or pyburgers.CreepTest"
"""Words for an argument."""

E = TypeVar("E", bound=Experiment)


def of_kind(experiment: Experiment, kind: type[E]) -> E:
    """Return a test that has to be of a kind (`InputError` if it is of another)."""
    if not isinstance(experiment, kind):
        raise InputError(
            f"{experiment.id}: found a test of protocol {experiment.protocol!r}, expected one of "
            f"protocol {kind.protocol!r}."
        )
    return experiment
