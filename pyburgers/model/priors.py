"""Sets of priors: of all parameters for one material, and their TOML files."""

import importlib.resources
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from pydantic import Field

from pyburgers.common.atomic_files import write_text
from pyburgers.common.errors import InputError, nearest, require_type
from pyburgers.common.paths import given_path, shipped_folder
from pyburgers.common.toml_files import Material, Table, all_of, read_toml, toml_text
from pyburgers.model.flow_law_prior import FlowLawPrior, FlowLawTable
from pyburgers.model.parameters import (
    CONDITIONS,
    ENVIRONMENT,
    GIVEN_TOGETHER,
    MATERIAL_PARAMETERS,
    PARAMETER_BY_NAME,
    PARAMETERS,
    PROGRAM_PARAMETERS,
    STANDARD_VALUES,
    Parameter,
)
from pyburgers.model.plausible import PlausibleRanges
from pyburgers.model.prior_families import (
    MAX_STRESS,
    Prior,
    PriorTable,
    check_beta,
    check_prior,
    fixed_prior,
    is_fixed_at,
    load_prior,
    normal_prior,
)

FLOW_LAW = ("stress_exponent", "grain_size_exponent", "activation_enthalpy", "beta")
"""Parameters that a joint prior of the flow law is about."""

NEARLY = 0.15
"""Standard deviations by which a stated prior may differ from a marginal of the flow law and stay:
a saved one is rounded, and a file may say more of its source."""

JOINT_PRIOR = "flow_law"
"""Stands for the joint prior of the flow law among the priors of single parameters."""


TAKEN_OUT: Mapping[tuple[str, str], tuple[str, ...]] = {
    ("grain_size", "constant"): ("steady_state_grain_size", "critical_strain_grain_size"),
    ("grain_size", "piezometric"): ("steady_state_grain_size",),
    ("fabric", "constant"): ("steady_state_fabric_factor", "critical_strain_fabric"),
}
"""Parameters that the law of a part takes out of the model at constant rate, by part and law."""


SOME_PRIORS = "a set of priors, as of pyburgers.priors('ice')"


@dataclass(frozen=True, repr=False)
class PriorSet:
    """Priors of all parameters for one material.

    Attributes
    ----------
    material, title : str
        Material and title, as in the file.
    priors : mapping of str to Prior
        Every one of `pyburgers.model.parameters.PARAMETERS`, in their order, then those of variants
        and of conditions that are given; the others have their standard values.
    name : str
        Name of the file without its ending.
    notes : str or None
        Remarks for the reader.
    flow_law : FlowLawPrior or None
        Joint prior of `FLOW_LAW` in place of their own, which are then its marginals.

    Examples
    --------
    >>> pyburgers.priors("ice")["stress_exponent"].family
    'uniform'
    """

    material: str
    title: str
    priors: Mapping[str, Prior]
    name: str = field(compare=False)
    notes: str | None = None
    flow_law: FlowLawPrior | None = None

    def __getitem__(self, parameter: str) -> Prior:
        """Return the prior of a parameter; one of a variant may be left to its standard value."""
        found = self.priors.get(parameter)
        return _standard(parameter) if found is None else found

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that are inferred."""
        return tuple(name for name, prior in self.priors.items() if not prior.is_fixed)

    def read_off(self, data: Sequence[str]) -> frozenset[str]:
        """Return the priors, or `JOINT_PRIOR`, that were read off data.

        Parameters
        ----------
        data : sequence of str
            Id, source and DOI of each test or table, in one text.
        """
        words = {name: self.priors[name].read_off for name in self.free}
        if self.flow_law is not None:
            words[JOINT_PRIOR] = self.flow_law.read_off
        return frozenset(
            name for name, own in words.items() if any(one in text for one in own for text in data)
        )

    def sample(self, rng: np.random.Generator) -> dict[str, float]:
        """Draw every parameter (SI); fixed ones have their value.

        Examples
        --------
        >>> ice = pyburgers.priors("ice").resolved(2e6)
        >>> values = ice.sample(np.random.default_rng(1))
        """
        values = {name: prior.sample(rng) for name, prior in self.priors.items()}
        return values if self.flow_law is None else {**values, **self.flow_law.sample(rng)}

    def exchanging(self, *changed: Prior) -> "PriorSet":
        """Return the set with priors exchanged or added, in the order of the programs.

        Raises
        ------
        InputError
            If there is no such parameter, or a prior is none that a file could hold.

        Examples
        --------
        >>> ice = pyburgers.priors("ice").exchanging(priors["beta"])
        """
        where, new = f"priors of {self.material}", {prior.parameter: prior for prior in changed}
        for name, prior in new.items():
            if name not in PARAMETER_BY_NAME:
                known = nearest(name, PARAMETER_BY_NAME)
                raise InputError(f"{where}: unknown parameter {name!r}, {known}")
            check_prior(f"{where}: [parameters.{name}]", prior)
        merged = {**self.priors, **new}
        ordered = {p.name: merged[p.name] for p in PROGRAM_PARAMETERS if p.name in merged}
        _check_together(where, self.material, ordered, new)
        return replace(self, priors=MappingProxyType(ordered))

    def with_(self, **changed: PriorTable) -> "PriorSet":
        """Return the set with other priors of some parameters.

        Parameters
        ----------
        **changed
            Parameters and their priors, such as
            ``activation_enthalpy=pyburgers.normal(60, 5, "kJ/mol")``.

        Raises
        ------
        InputError
            If there is no such parameter, or a prior is none that its file could hold.

        Examples
        --------
        >>> law = pyburgers.normal(4, 0.5, "1", lower=1)
        >>> pyburgers.priors("ice").with_(stress_exponent=law)["stress_exponent"].location
        4.0
        """
        for name in changed:
            if name not in {p.name for p in MATERIAL_PARAMETERS}:
                known = nearest(name, [p.name for p in MATERIAL_PARAMETERS])
                raise InputError(f"with_: unknown parameter {name!r}, {known}")
            require_type(name, changed[name], PriorTable, "a prior, as of pyburgers.normal")
        where = Path("with_")
        found = self.exchanging(
            *(load_prior(where, PARAMETER_BY_NAME[name], table) for name, table in changed.items())
        )
        return replace(found, title=f"{self.title}; changed: {', '.join(changed)}")

    def plot(self) -> Any:
        """Draw the density of every prior that is not fixed (`pyburgers.plot_priors`).

        Examples
        --------
        >>> figure = pyburgers.priors("ice").resolved(2e6).plot()
        """
        return import_module("pyburgers").plot_priors(self)

    def __repr__(self) -> str:
        """Return a line: title, and how many parameters are free."""
        free = f"{len(self.free)} of {len(self.priors)} parameters free"
        return f"<priors of {self.material}: {self.title}, {free}>"

    def resolved(self, max_stress: float) -> "PriorSet":
        """Return the set with shares of the largest stress turned into Pa.

        Parameters
        ----------
        max_stress : float
            Largest measured absolute stress (Pa).

        Examples
        --------
        >>> ice = pyburgers.priors("ice").resolved(max_stress=2e6)
        """
        resolved = {name: prior.resolved(max_stress) for name, prior in self.priors.items()}
        return replace(self, priors=MappingProxyType(resolved))


def with_flow_law(priors: PriorSet, flow_law: FlowLawPrior, where: str) -> PriorSet:
    """Replace the priors of n, p, Q_M and beta by a flow law.

    Parameters
    ----------
    priors : PriorSet
        Priors of every parameter.
    flow_law : FlowLawPrior
        Joint prior of the four.
    where : str
        Its origin, for messages.

    Raises
    ------
    InputError
        If it is of another material, or one of the four parameters is fixed.

    Examples
    --------
    >>> law = pyburgers.flow_law_prior(peaks)
    >>> ice = pyburgers.with_flow_law(pyburgers.priors("ice"), law, where="my table")
    """
    if flow_law.material != priors.material:
        raise InputError(
            f"{where}: is a flow law of {flow_law.material}, expected one of {priors.material}."
        )
    fixed = [name for name in FLOW_LAW if priors[name].is_fixed]
    if fixed:
        raise InputError(
            f"{where}: {fixed[0]} is fixed by the priors {priors.title!r}, expected the whole flow "
            "law free where a joint prior takes its place."
        )
    source = f"Marginal of the joint prior of the flow law, {flow_law.source}"
    marginals = [
        normal_prior(PARAMETER_BY_NAME[name], *moments, source)
        for name, moments in flow_law.marginals().items()
    ]
    check_beta(f"{where}: the mean of beta", marginals[-1], flow_law.material)
    for k, one in enumerate(marginals):
        stated, width = priors[one.parameter], NEARLY * one.scale
        means, spreads = abs(stated.location - one.location), abs(stated.scale - one.scale)
        if stated.family == "normal" and max(means, spreads) < width:
            marginals[k] = stated
    return replace(
        priors.exchanging(*marginals),
        title=f"{priors.title}; flow law from {flow_law.source}",
        flow_law=flow_law,
    )


class _PriorFile(Table):
    material: Material
    title: str = Field(min_length=1, description="a title for tables and figures")
    notes: str | None = Field(None, description="remarks for the reader")
    plausible: PlausibleRanges = Field(
        default_factory=lambda: PlausibleRanges.model_validate({}),
        description="numbers that tests of the material are likely to have; read in shipped files",
    )
    parameters: dict[str, PriorTable] = Field(description="one table for each parameter")
    flow_law: FlowLawTable | None = Field(
        None, description="a joint prior in the place of those of n, p, Q_M and beta"
    )


def load_priors(path: str | Path, choices: Mapping[str, str] | None = None) -> PriorSet:
    """Read and check a prior file.

    Parameters
    ----------
    path : str or Path
        TOML with material, title and one table ``[parameters.NAME]`` for every parameter.
        Parameters of variants (`pyburgers.model.parameters.VARIANT_PARAMETERS`) may be left out.
    choices : mapping of str to str, optional
        Law by part, as for `pyburgers.with_variant`. Tables of parameters that these laws take out
        may be left out.

    Raises
    ------
    InputError
        If the file, a key, a unit or a number is wrong, or a prior gives mass to values that the
        model excludes.

    Examples
    --------
    >>> ice = pyburgers.load_priors(data / "priors" / "ice.toml")
    """
    path = given_path(path)
    file = read_toml(path, _PriorFile)
    for name in file.parameters:
        if name in CONDITIONS or name in ENVIRONMENT:
            raise InputError(
                f"{path}: found {name!r} in [parameters], expected it in the file of a test "
                "(temperature_sd_K, stress_calibration_sd, pressure_Pa, water_fugacity_Pa or "
                "melt_fraction): it belongs to no material."
            )
        if name not in PARAMETER_BY_NAME:
            raise InputError(
                f"{path}: unknown parameter {name!r} in [parameters], "
                f"{nearest(name, [p.name for p in MATERIAL_PARAMETERS])}"
            )
    needless = {
        name for part, law in (choices or {}).items() for name in TAKEN_OUT.get((part, law), ())
    }
    all_of(*(partial(_require_table, path, p, file, needless) for p in PARAMETERS))
    priors = {
        p.name: load_prior(path, p, file.parameters[p.name])
        if p.name in file.parameters
        else fixed_prior(p, 1.0, "taken out by the variant")
        for p in MATERIAL_PARAMETERS
        if p.name in file.parameters or p.name in needless
    }
    _check_together(str(path), file.material, priors, priors)
    found = PriorSet(
        material=file.material,
        title=file.title,
        priors=MappingProxyType(priors),
        name=path.stem,
        notes=file.notes,
    )
    if file.flow_law is None:
        return found
    where = f"{path}: [flow_law]"
    law = file.flow_law.flow_law_prior(file.material, where)
    return replace(with_flow_law(found, law, where), title=file.title)


def save_priors(priors: PriorSet, path: Path) -> None:
    """Write a file of `priors_text` into a folder that exists."""
    write_text(path, priors_text(priors))


def prior_table(parameter: Parameter, prior: Prior) -> dict[str, Any]:
    """Return the table of a prior in a file, in SI."""
    return {
        "family": prior.family,
        **prior.numbers(),
        "unit": MAX_STRESS if prior.relative_to_max_stress else parameter.si_unit,
        "source": prior.source,
        "read_off": list(prior.read_off) or None,
    }


def priors_text(priors: PriorSet) -> str:
    """Return the text of a prior file in SI units; `load_priors` reads back an equal set.

    Parameters that the set does not give are left out, and the others keep their order. Conditions
    are in the files of the tests.
    """
    tables = {}
    for parameter in MATERIAL_PARAMETERS:
        prior = priors.priors.get(parameter.name)
        if prior is not None:
            tables[parameter.name] = prior_table(parameter, prior)
    table = {
        "material": priors.material,
        "title": priors.title,
        "notes": priors.notes,
        "parameters": tables,
        "flow_law": priors.flow_law and priors.flow_law.table(),
    }
    return toml_text(table)


def priors(material: str, protocol: str | None = None) -> PriorSet:
    """Return the priors that come with the package for a material.

    Parameters
    ----------
    material : str
        For example ``"ice"``.
    protocol : str, optional
        Kind of test. Some kinds have priors of their own, such as of the material's elastic modulus
        without an apparatus.

    Raises
    ------
    InputError
        If there are none, or no such kind of test. The message names the known ones.

    Examples
    --------
    >>> pyburgers.priors("ice").material
    'ice'
    """
    return load_priors(shipped_file(material, protocol))


default_priors = priors
"""Its name where `priors` are a set of them."""


def _kinds_of_test() -> list[str]:
    """Names of the kinds of test, by their folders: the room that knows them is above this one."""
    folder = Path(str(importlib.resources.files("pyburgers"))) / "kinds"
    return sorted(file.parent.name for file in folder.glob("*/files.py"))


def shipped_file(material: str, protocol: str | None) -> Path:
    """Return the file of the priors of a material, and of a kind of test if it has its own."""
    own = {} if protocol is None else shipped_prior_files(protocol)
    if protocol is not None and not own and protocol not in (kinds := _kinds_of_test()):
        raise InputError(f"protocol {protocol!r} does not exist, {nearest(protocol, kinds)}")
    return own.get(material) or shipped_prior_file(material)


def shipped_prior_file(material: str, folder: str = ".") -> Path:
    """Return the prior file that comes with the package for a material, such as ``"ice"``.

    `folder` is inside that of the priors. Raise InputError if there is none; the message names the
    materials that have one.
    """
    files = shipped_prior_files(folder)
    if material not in files:
        raise InputError(
            f"material {material!r} has no default priors, expected one of "
            f"{', '.join(files)}, or a prior file of your own."
        )
    return files[material]


def shipped_prior_files(folder: str = ".") -> dict[str, Path]:
    """Return the prior files that come with the package, in a folder of theirs, by material."""
    files = (shipped_folder("data") / "priors" / folder).glob("*.toml")
    return {path.stem: path for path in sorted(files)}


def _standard(name: str) -> Prior:
    """Prior of a parameter of a variant of which nothing is said."""
    value = STANDARD_VALUES[name]
    return fixed_prior(PARAMETER_BY_NAME[name], value, "standard value, without effect")


def _require_table(
    path: Path, parameter: Parameter, file: _PriorFile, needless: Container[str]
) -> None:
    """Ask for the table of a parameter, unless a variant takes it out."""
    name = parameter.name
    if name in file.parameters or name in needless:
        return
    variants = [f"{part}={law}" for (part, law), names in TAKEN_OUT.items() if name in names]
    without = f", or the variant {' or '.join(variants)}, which takes it out" if variants else ""
    raise InputError(
        f"{path}: table [parameters.{name}] is missing, expected a prior or a fixed value of the "
        f"{parameter.label}{without}."
    )


def _check_together(
    where: str, material: str, priors: Mapping[str, Prior], new: Container[str]
) -> None:
    """Check the sign of a new beta, and ask for what a parameter of a variant needs beside it."""
    is_new = "beta" in new or "stress_exponent" in new
    if is_new and not is_fixed_at(priors["stress_exponent"], 1.0):
        check_beta(f"{where}: [parameters.beta]", priors["beta"], material)
    for name, others in GIVEN_TOGETHER.items():
        standard = STANDARD_VALUES[name]
        in_use = name in priors and not is_fixed_at(priors[name], standard)
        for other in others:
            if in_use and other not in priors:
                raise InputError(
                    f"{where}: table [parameters.{other}] is missing, expected a prior or a fixed "
                    f"value because {name} is not fixed at {standard:g}."
                )
