"""Composite flow laws as records: mechanisms with their priors, from TOML files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pydantic import Field

from pyburgers.common.errors import InputError, nearest
from pyburgers.common.paths import given_path
from pyburgers.common.toml_files import NAME, Material, Table, read_toml, without_none, write_toml
from pyburgers.model.display import shown_quantity
from pyburgers.model.flow_law_prior import Conditions
from pyburgers.model.parameters import ENVIRONMENT, ENVIRONMENT_NUMBERS, Parameter
from pyburgers.model.prior_families import (
    Prior,
    PriorTable,
    check_beta,
    fixed_prior,
    is_fixed_at,
    load_prior,
)
from pyburgers.model.priors import FLOW_LAW, PriorSet, prior_table, shipped_prior_files
from pyburgers.posterior.labelled_draws import own_name

MECHANISM_PARAMETERS = (
    "mechanism_rate",
    "stress_exponent",
    "grain_size_exponent",
    "activation_enthalpy",
    "premelting_enthalpy",
    *ENVIRONMENT_NUMBERS,
)
"""Parameters of a mechanism, in the order of `stan/physics/composite_law.stan`."""

SCATTER = "rate_scatter"
SOURCE_SPREADS = ("source_rate_spread", "source_temperature_spread", "source_scatter_spread")
ENHANCEMENTS = tuple(own_name("tertiary_enhancement", where) for where in ("axial", "shear"))
TABLE_PARAMETERS = (SCATTER, *SOURCE_SPREADS, *ENHANCEMENTS)
"""Parameters that follow those of the mechanisms in `stan/rates.stan`."""


@dataclass(frozen=True)
class Mechanism:
    """A power law in a composite law.

    `process`: number from 1; mechanisms of one process are in series.
    `premelting_temperature`: K, above which the activation enthalpy is another one; 0: nowhere.
    `has_beta`: whether beta = ln(A)/Q, as in the law of a curve, takes the place of the rate.
    `environment`: which of `ENVIRONMENT_NUMBERS` it has.
    """

    name: str
    process: int
    premelting_temperature: float = 0.0
    has_beta: bool = False
    environment: tuple[str, ...] = ()

    @property
    def parameters(self) -> tuple[str, ...]:
        """Its parameters in the order of `stan/rates.stan`."""
        first, *others = MECHANISM_PARAMETERS
        return ("beta" if self.has_beta else first, *others)

    @property
    def stated_parameters(self) -> tuple[str, ...]:
        """Those that a file states: without premelting there is one enthalpy."""
        idle = {*ENVIRONMENT_NUMBERS} - {*self.environment}
        if not self.premelting_temperature:
            idle.add("premelting_enthalpy")
        return tuple(name for name in self.parameters if name not in idle)


@dataclass(frozen=True, eq=False)
class RateLaw:
    """A composite flow law of one material.

    Attributes
    ----------
    name : str
        Name of its file.
    reference : Conditions
        Conditions (SI) at which the rates of the mechanisms are given.
    mechanisms : tuple of Mechanism
        Mechanisms that add up, or act in series.
    priors : PriorSet
        Priors by ``PARAMETER[MECHANISM]``, and of scatter, sources and enhancement; SI.

    Examples
    --------
    >>> law = pyburgers.rate_law("ice_power_law")
    >>> [mechanism.name for mechanism in law.mechanisms]
    ['creep']
    """

    name: str
    reference: Conditions
    mechanisms: tuple[Mechanism, ...]
    priors: PriorSet

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters in the order of `stan/rates.stan`, under the names of their priors."""
        of_mechanisms = (
            own_name(name, mechanism.name)
            for mechanism in self.mechanisms
            for name in mechanism.parameters
        )
        return tuple(shown_quantity(name) for name in (*of_mechanisms, *TABLE_PARAMETERS))

    @property
    def is_power_law(self) -> bool:
        """Whether it has one mechanism, the same at all temperatures and in any environment."""
        one = self.mechanisms[0]
        changes = bool(one.premelting_temperature or one.environment)
        return len(self.mechanisms) == 1 and not changes

    @property
    def power_law(self) -> Mechanism:
        """The only mechanism; raise InputError if it is not a power law everywhere."""
        if not self.is_power_law:
            raise InputError(
                f"{self.priors.title!r} is no power law, expected one mechanism without a "
                "premelting temperature, activation volume, water exponent and melt factor."
            )
        return self.mechanisms[0]

    @property
    def fixed_flow_law(self) -> tuple[str, ...]:
        """Parameters of a power law that are fixed, of which there is no joint density."""
        one = self.power_law
        names = (own_name(name, one.name) for name in one.stated_parameters)
        return tuple(name for name in names if self.priors[name].is_fixed)

    @property
    def enhancements(self) -> tuple[str, ...]:
        """Parameters by which steady rates exceed the least ones, which are those of the law."""
        return tuple(name for name in ENHANCEMENTS if not is_fixed_at(self.priors[name], 1.0))

    def at(self, **values: float) -> "RateLaw":
        """Return the law with parameters fixed at values (SI), all others at their priors' centres.

        Names are those of the priors, such as ``stress_exponent[creep]``.

        Examples
        --------
        >>> exact = law.at(rate_scatter=0.1)
        """
        fixed = {
            p.name: fixed_prior(
                replace(p, name=p.name.split("[")[0]),
                values.get(p.name, self.priors[p.name].location),
                "given",
            )
            for p in self.parameters
        }
        unknown = [name for name in values if name not in fixed]
        if unknown:
            raise InputError(f"unknown parameter {unknown[0]!r}, {nearest(unknown[0], fixed)}")
        return replace(self, priors=replace(self.priors, priors=MappingProxyType(fixed)))

    @property
    def needs(self) -> tuple[str, ...]:
        """Columns of a table that a rate depends on, of those that may be unknown."""
        return tuple(
            column
            for column, number in zip(
                ("grain_size", *ENVIRONMENT),
                ("grain_size_exponent", *ENVIRONMENT_NUMBERS),
                strict=True,
            )
            if any(
                not is_fixed_at(self.priors[own_name(number, one.name)], 0.0)
                for one in self.mechanisms
            )
        )


def has_environment(law: RateLaw) -> bool:
    """Whether a rate depends on pressure, water fugacity or melt fraction."""
    return bool({*law.needs} & {*ENVIRONMENT})


def without_idle(law: RateLaw, *, sources: bool, steady: Sequence[int]) -> RateLaw:
    """Return a law with what no row can tell fixed: sources, enhancements by place."""
    priors = dict(law.priors.priors)
    for name in () if sources else SOURCE_SPREADS:
        priors[name] = fixed_prior(shown_quantity(name), 0.0, "one source")
    for place, name in enumerate(ENHANCEMENTS, start=1):
        if place not in steady:
            priors[name] = fixed_prior(
                shown_quantity("tertiary_enhancement"), 1.0, "no steady rate"
            )
    return replace(law, priors=replace(law.priors, priors=MappingProxyType(priors)))


def with_curve_flow_law(law: RateLaw, curve: PriorSet) -> RateLaw:
    """Take the priors of n, p, Q_M and beta of a power law from those of a curve.

    If the fitted flow law replaces these priors of the curve, their information is kept. It then
    agrees with the softening, which is simulated with them.

    Parameters
    ----------
    law : RateLaw
        A law of one mechanism.
    curve : PriorSet
        For a curve of the same material.

    Raises
    ------
    InputError
        If the law is no power law.

    Examples
    --------
    >>> changed = pyburgers.with_curve_flow_law(law, pyburgers.priors("ice"))
    """
    one = law.power_law
    own = {own_name(name, one.name) for name in one.stated_parameters}
    others = {name: prior for name, prior in law.priors.priors.items() if name not in own}
    taken = {own_name(name, one.name): curve[name] for name in FLOW_LAW}
    priors = replace(
        law.priors,
        priors=MappingProxyType({**taken, **others}),
        title=f"{law.priors.title}; flow law from {curve.title}",
    )
    return replace(law, mechanisms=(replace(one, has_beta=True),), priors=priors)


class _ReferenceTable(Table):
    temperature_K: float = Field(gt=0, description="in kelvin")  # noqa: N815 - a unit
    stress_MPa: float = Field(gt=0, description="differential stress in MPa")  # noqa: N815 - a unit
    grain_size_mm: float = Field(gt=0, description="mean grain size in mm")


class _MechanismTable(Table):
    name: str = Field(pattern=NAME, description="the mechanism's name")
    in_series_with: str | None = Field(
        None, description="an earlier mechanism of the same process; default a process of its own"
    )
    premelting_temperature_K: float | None = Field(  # noqa: N815 - a unit
        None, gt=0, description="the temperature above which the activation enthalpy is another one"
    )
    parameters: dict[str, PriorTable] = Field(
        description="priors of mechanism_rate (or beta), stress_exponent, grain_size_exponent, "
        "activation_enthalpy and, with a premelting temperature, premelting_enthalpy; as wanted "
        "activation_volume, water_exponent and melt_factor"
    )


class _LawFile(Table):
    material: Material
    title: str = Field(min_length=1, description="a title for tables and figures")
    notes: str | None = Field(None, description="remarks for the reader")
    reference: _ReferenceTable = Field(description="conditions of the rates of the mechanisms")
    mechanisms: list[_MechanismTable] = Field(min_length=1, description="the parts of the law")
    parameters: dict[str, PriorTable] = Field(
        description="priors of rate_scatter, source_rate_spread, source_temperature_spread, "
        "source_scatter_spread and tertiary_enhancement"
    )


def rate_law(name: str) -> RateLaw:
    """Return a law that comes with the package.

    Parameters
    ----------
    name : str
        Such as ``"ice_power_law"`` or ``"ice_composite"``.

    Raises
    ------
    InputError
        If there is none; the message names those that there are.

    Examples
    --------
    >>> law = pyburgers.rate_law("ice_composite")
    """
    files = shipped_prior_files("rates")
    if name not in files:
        raise InputError(
            f"unknown law {name!r}, expected one of {', '.join(files)}, or a file of your own."
        )
    return load_rate_law(files[name])


def load_rate_law(path: str | Path) -> RateLaw:
    """Read and check a composite flow law.

    Parameters
    ----------
    path : str or Path
        TOML with ``[reference]``, ``[[mechanisms]]`` and ``[parameters]``, whose keys
        `docs/rates.md` lists.

    Raises
    ------
    InputError
        If a key, a unit or a number is not what it has to be.

    Examples
    --------
    >>> file = data / "priors" / "rates" / "ice_power_law.toml"
    >>> law = pyburgers.load_rate_law(file)
    """
    path = given_path(path)
    file = read_toml(path, _LawFile)
    mechanisms: dict[str, Mechanism] = {}
    priors: dict[str, Prior] = {}
    for table in file.mechanisms:
        where = f"{path}: mechanism {table.name!r}"
        if table.name in mechanisms:
            raise InputError(f"{where}: found twice, expected each name once.")
        if table.in_series_with not in (None, *mechanisms):
            raise InputError(
                f"{where}: key 'in_series_with': found {table.in_series_with!r}, expected a "
                "mechanism above it."
            )
        partner = mechanisms.get(table.in_series_with or "")
        process = partner.process if partner else 1 + len({m.process for m in mechanisms.values()})
        above = table.premelting_temperature_K or 0.0
        if 0 < above <= file.reference.temperature_K:
            raise InputError(
                f"{where}: key 'premelting_temperature_K': found {above:g}, expected more than the "
                f"reference temperature of {file.reference.temperature_K:g} K."
            )
        one = Mechanism(
            table.name,
            process,
            above,
            has_beta="beta" in table.parameters,
            environment=tuple(name for name in ENVIRONMENT_NUMBERS if name in table.parameters),
        )
        found = _priors(path, where, one.stated_parameters, table.parameters)
        if not above:
            found["premelting_enthalpy"] = fixed_prior(
                shown_quantity("premelting_enthalpy"), 0.0, "no premelting"
            )
        for name in {*ENVIRONMENT_NUMBERS} - {*one.environment}:
            found[name] = fixed_prior(shown_quantity(name), 0.0, "no effect")
        if one.has_beta and one.environment:
            raise InputError(
                f"{where}: found beta and {one.environment[0]}, expected mechanism_rate in the "
                "place of beta."
            )
        if one.has_beta:
            check_beta(f"{where}: beta", found["beta"], file.material)
        else:
            _check_rate(where, found["mechanism_rate"])
        priors |= {own_name(name, table.name): found[name] for name in one.parameters}
        mechanisms[table.name] = one
    shared = _priors(
        path, str(path), (SCATTER, *SOURCE_SPREADS, "tertiary_enhancement"), file.parameters
    )
    enhancement = shared.pop("tertiary_enhancement")
    at = file.reference
    return RateLaw(
        path.stem,
        Conditions(at.temperature_K, at.stress_MPa * 1e6, at.grain_size_mm * 1e-3),
        tuple(mechanisms.values()),
        PriorSet(
            material=file.material,
            title=file.title,
            priors=MappingProxyType(
                {**priors, **shared, **dict.fromkeys(ENHANCEMENTS, enhancement)}
            ),
            name=path.stem,
            notes=file.notes,
        ),
    )


def save_rate_law(law: RateLaw, path: Path) -> None:
    """Write a file that `load_rate_law` reads back to an equal law."""
    priors = law.priors
    mechanisms: list[dict[str, Any]] = []
    first_of: dict[int, str] = {}
    for one in law.mechanisms:
        mechanisms.append(
            {
                "name": one.name,
                "in_series_with": first_of.get(one.process),
                "premelting_temperature_K": one.premelting_temperature or None,
                "parameters": {
                    name: prior_table(shown_quantity(name), priors[own_name(name, one.name)])
                    for name in one.stated_parameters
                },
            }
        )
        first_of.setdefault(one.process, one.name)
    shared = {name: shown_quantity(name) for name in (SCATTER, *SOURCE_SPREADS)}
    write_toml(
        path,
        {
            "material": priors.material,
            "title": priors.title,
            "notes": priors.notes,
            "reference": {
                "temperature_K": law.reference.temperature,
                "stress_MPa": law.reference.stress * 1e-6,
                "grain_size_mm": law.reference.grain_size * 1e3,
            },
            "mechanisms": [without_none(one) for one in mechanisms],
            "parameters": {
                **{name: prior_table(p, priors[name]) for name, p in shared.items()},
                "tertiary_enhancement": prior_table(
                    shown_quantity("tertiary_enhancement"), priors[ENHANCEMENTS[0]]
                ),
            },
        },
    )


def _priors(
    path: Path, where: str, wanted: Sequence[str], tables: Mapping[str, PriorTable]
) -> dict[str, Prior]:
    """Return the priors that a table [parameters] has to hold, and refuse any other."""
    for name in tables:
        if name not in wanted:
            raise InputError(f"{where}: unknown parameter {name!r}, {nearest(name, wanted)}")
    for name in wanted:
        if name not in tables:
            raise InputError(f"{where}: the prior of {name} is missing, expected one.")
    return {name: load_prior(path, shown_quantity(name), tables[name]) for name in wanted}


def _check_rate(where: str, prior: Prior) -> None:
    """Refuse a prior of a rate that does not count in its logarithm."""
    if prior.family not in ("lognormal", "fixed"):
        raise InputError(
            f"{where}: mechanism_rate: found the family {prior.family!r}, expected lognormal or "
            "fixed."
        )
