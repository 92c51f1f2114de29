"""Plans of tests that may be done: candidates, what they are to narrow, and limits."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from numbers import Integral
from pathlib import Path
from typing import Annotated

from pydantic import Field

from pyburgers.common.errors import InputError, require_type
from pyburgers.common.paths import given_path
from pyburgers.common.toml_files import NAME, Table, read_toml
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.kind import load_experiment
from pyburgers.model.parameters import PARAMETER_BY_NAME

UNCERTAINTIES = {"stress_uncertainty_MPa": 1e6, "strain_uncertainty": 1.0}
"""Keys of a plan that state the noise of a new reading, and their unit in SI."""

READINGS = 40
"""Readings of a quantity by default."""


class _CandidateTable(Table):
    file: str = Field(description="an experiment file; it may be without [data]")
    readings: int = Field(
        READINGS, ge=1, le=200, description="how many readings of each quantity, 1 to 200"
    )
    hours: float | None = Field(None, gt=0, description="cost of the test in hours")
    stress_uncertainty_MPa: float | None = Field(  # noqa: N815 - keys with units
        None, gt=0, description="standard deviation of a new reading of stress"
    )
    strain_uncertainty: float | None = Field(
        None, gt=0, description="standard deviation of a new reading of strain, a fraction"
    )


class _LimitTable(Table):
    stress_MPa: float | None = Field(None, gt=0, description="largest stress of the apparatus")  # noqa: N815 - keys with units
    hours: float | None = Field(None, gt=0, description="hours that there are for one test")


class _PlanFile(Table):
    about: list[str] = Field(min_length=1, description="a list of parameters to be narrowed")
    candidates: dict[Annotated[str, Field(pattern=NAME)], _CandidateTable] = Field(
        min_length=1, description="a table of tables: each candidate by its name"
    )
    limits: _LimitTable | None = Field(None, description="limits of the apparatus")


@dataclass(frozen=True, eq=False)
class Candidate:
    """A test that may be done.

    Attributes
    ----------
    experiment : Experiment
        The test; its data, if there are any, are not used.
    n_readings : int
        Number of readings of each quantity. Their places are some of those of `Fit.predict`,
        which are denser after each change of rate or load.
    hours : float, optional
        Cost of the test.

    Examples
    --------
    >>> pyburgers.Candidate(test, hours=2.0).n_readings
    40
    """

    experiment: Experiment
    n_readings: int = READINGS
    hours: float | None = None

    def __post_init__(self) -> None:
        """Check the number of readings."""
        require_type("n_readings", self.n_readings, Integral, "a whole number")
        if self.n_readings < 1:
            raise InputError(f"n_readings: found {self.n_readings}, expected at least 1.")


@dataclass(frozen=True, eq=False)
class DesignPlan:
    """Tests that may be done, and the parameters that they are to narrow.

    Attributes
    ----------
    about : tuple of str
        Parameters.
    candidates : mapping of str to Candidate
        By name.
    largest_stress : float, optional
        Of the apparatus, Pa.
    most_hours : float, optional
        For one test.

    Examples
    --------
    >>> plan = pyburgers.DesignPlan(("maxwell_modulus",), {"again": pyburgers.Candidate(test)})
    >>> plan.largest_stress is None
    True
    """

    about: tuple[str, ...]
    candidates: Mapping[str, Candidate]
    largest_stress: float | None = None
    most_hours: float | None = None


def load_design_plan(path: str | Path) -> DesignPlan:
    """Read a plan of candidate tests.

    Parameters
    ----------
    path : path
        TOML file; files of candidates are found from its folder.

    Raises
    ------
    InputError
        If the plan or the file of a candidate is wrong.

    Examples
    --------
    >>> plan = pyburgers.load_design_plan(data / "designs" / "ice.toml")
    >>> list(plan.candidates)[:2]
    ['again', 'slower']
    """
    path = given_path(path)
    file = read_toml(path, _PlanFile)
    if unknown := [name for name in file.about if name not in PARAMETER_BY_NAME]:
        raise InputError(
            f"{path}: about: found {unknown[0]!r}, expected parameters such as "
            "'stress_exponent' or 'kelvin_modulus'."
        )
    limits = file.limits
    stress = limits.stress_MPa if limits else None
    return DesignPlan(
        tuple(file.about),
        {name: _candidate(path, name, one) for name, one in file.candidates.items()},
        None if stress is None else 1e6 * stress,
        limits.hours if limits else None,
    )


def _candidate(path: Path, name: str, table: _CandidateTable) -> Candidate:
    """Load the test of a candidate, with the uncertainties that the plan states."""
    experiment = load_experiment(path.parent / table.file)
    for key, unit in UNCERTAINTIES.items():
        stated, field = getattr(table, key), key.removesuffix("_MPa")
        if stated is None:
            continue
        if not hasattr(experiment, field):
            raise InputError(
                f"{path}: candidates.{name}: found {key}, expected none: {experiment.id} "
                f"({experiment.protocol}) has no such readings."
            )
        experiment = replace(experiment, **{field: unit * stated})
    return Candidate(experiment, table.readings, table.hours)
