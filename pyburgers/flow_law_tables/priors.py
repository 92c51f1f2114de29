"""Priors of a flow law that is fitted to a table of peak stresses, read from TOML files."""

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from pydantic import Field

from pyburgers.common.toml_files import Table, read_toml
from pyburgers.model.parameters import PARAMETER_BY_NAME, Parameter
from pyburgers.model.prior_families import PriorTable, check_beta, load_prior
from pyburgers.model.priors import PriorFile, PriorSet, save_priors, shipped_prior_file

RATE_SCATTER = Parameter(
    "rate_scatter", r"s_{\dot\epsilon}", "scatter of ln(strain rate)", "dimensionless", "1", "1"
)
"""Standard deviation of ln(strain rate) between tests, beyond what known uncertainties explain."""

FLOW_LAW_PARAMETERS: tuple[Parameter, ...] = (
    *(
        PARAMETER_BY_NAME[name]
        for name in ("stress_exponent", "grain_size_exponent", "activation_enthalpy", "beta")
    ),
    RATE_SCATTER,
)
"""Parameters of the fit, in the order of `stan/peak_stress.stan`."""


class _RateScatterTable(PriorTable):
    family: Literal["half_normal"] = Field(description="the family of the prior")


class _ParameterTables(Table):
    stress_exponent: PriorTable = Field(description="a prior or a fixed value")
    grain_size_exponent: PriorTable = Field(description="a prior or a fixed value")
    activation_enthalpy: PriorTable = Field(description="a prior or a fixed value")
    beta: PriorTable = Field(description="a prior or a fixed value")
    rate_scatter: _RateScatterTable = Field(description="a half-normal prior")


class _PeakStressPriorFile(PriorFile):
    parameters: _ParameterTables = Field(description="one table for each parameter")


def load_peak_stress_priors(path: str | Path) -> PriorSet:
    """Read and check a prior file for tables of peak stresses.

    Parameters
    ----------
    path : str or Path
        TOML as for `pyburgers.model.priors.load_priors`, with a table for each of
        `FLOW_LAW_PARAMETERS`; the scatter has a half-normal prior.

    Raises
    ------
    InputError
        If the file, a key, a unit or a number is not what it has to be.
    """
    path = Path(path)
    file = read_toml(path, _PeakStressPriorFile)
    priors = {
        p.name: load_prior(path, p, getattr(file.parameters, p.name)) for p in FLOW_LAW_PARAMETERS
    }
    check_beta(f"{path}: [parameters.beta]", priors["beta"])
    return file.prior_set(path, priors)


def save_peak_stress_priors(priors: PriorSet, path: Path) -> None:
    """Write a prior file in SI units; `load_peak_stress_priors` reads back an equal set.

    Parameters
    ----------
    priors : PriorSet
        Priors of `FLOW_LAW_PARAMETERS`.
    path : Path
        The TOML file; its folder must exist.
    """
    save_priors(priors, path, FLOW_LAW_PARAMETERS)


def default_peak_stress_priors(material: str) -> PriorSet:
    """Return the weak priors that come with the package for a material.

    Parameters
    ----------
    material : str
        For example ``"ice"``.

    Raises
    ------
    InputError
        If there are none; the message names the materials that have some.
    """
    file = shipped_prior_file(material, "peak_stress", of=" for peak stresses")
    return load_peak_stress_priors(file)


def with_enthalpy_of(priors: PriorSet, curve: PriorSet) -> PriorSet:
    """Take the priors of Q_M and beta from those of a curve.

    A table at one temperature says little about either. Where its flow law is handed on to a curve,
    in place of the curve's own priors of the flow law, they would be lost without this.

    Parameters
    ----------
    priors : PriorSet
        For a table of peak stresses.
    curve : PriorSet
        For a curve of the same material.
    """
    taken = {name: curve[name] for name in ("activation_enthalpy", "beta")}
    return replace(
        priors,
        priors=MappingProxyType({**priors.priors, **taken}),
        title=f"{priors.title}; Q_M and beta from {curve.title}",
    )
