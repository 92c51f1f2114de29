"""Forward solutions at given parameters, through the Stan program."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import read_json
from pyburgers.model.parameters import (
    GIVEN_TOGETHER,
    PARAMETER_BY_NAME,
    PARAMETERS,
    STANDARD_VALUES,
)
from pyburgers.model.prior_families import MAY_BE_ZERO
from pyburgers.model.variants import check_piezometer
from pyburgers.protocols.experiment import Experiment, Provenance
from pyburgers.protocols.microstructure import with_drawn_microstructure
from pyburgers.protocols.program_data import given_parameters, solve
from pyburgers.protocols.protocol import protocol_of
from pyburgers.protocols.stan_data import REFERENCE_SOLVER, SolverOptions

FloatArray = npt.NDArray[np.float64]

E = TypeVar("E", bound=Experiment)

LARGEST = float(np.finfo(np.float64).max)
"""Largest finite number."""


def load_parameters(path: str | Path) -> dict[str, float]:
    """Read a JSON object of parameter values in SI units, checked by `check_parameters`.

    Raises
    ------
    InputError
        If the file is missing, is no JSON object, or has wrong names or values.
    """
    return check_parameters(read_json(Path(path)), where=str(path))


def check_parameters(values: Mapping[str, object], where: str = "parameters") -> dict[str, float]:
    """Return the values of a forward solution as floats.

    ``stress_noise`` may be left out: a solution has none. So may those of
    `pyburgers.model.parameters.VARIANT_PARAMETERS`.

    Parameters
    ----------
    values : mapping
        Names of `pyburgers.model.parameters.PROGRAM_PARAMETERS` to SI values.
    where : str
        File or argument, for messages.

    Raises
    ------
    InputError
        If a name is unknown or missing or a value is not a finite number in the model's domain.
    """
    unknown = [name for name in values if name not in PARAMETER_BY_NAME]
    if unknown:
        expected = ", ".join(PARAMETER_BY_NAME)
        raise InputError(f"{where}: unknown parameter {unknown[0]!r}; expected {expected}.")
    required = [p.name for p in PARAMETERS if p.name != "stress_noise"]
    missing = [name for name in required if name not in values]
    if missing:
        raise InputError(f"{where}: parameter {missing[0]!r} is missing.")
    checked = {}
    for name, value in values.items():
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not -LARGEST <= value <= LARGEST  # whole numbers have no largest one
        ):
            raise InputError(f"{where}: {name} is {value!r}, expected a finite number.")
        checked[name] = float(value)
        unit = PARAMETER_BY_NAME[name].si_unit
        if name not in {"beta", "stress_noise", *MAY_BE_ZERO} and value <= 0:
            raise InputError(f"{where}: {name} is {value!r} {unit}, expected a positive number.")
    check_given_together(checked, where)
    return checked


def check_given_together(values: Mapping[str, float], where: str) -> None:
    """Check what is given of a Kelvin element that is not linear, and of a piezometer.

    Parameters
    ----------
    values : mapping
        SI values by name; `pyburgers.model.parameters.VARIANT_PARAMETERS` may be left out.
    where : str
        File or argument, for messages.

    Raises
    ------
    InputError
        If the stress exponent of the Kelvin element is below 1, its activation enthalpy negative,
        or something is missing that either, or the grain size of a piezometer, has no meaning
        without.
    """
    for name, others in GIVEN_TOGETHER.items():
        standard = STANDARD_VALUES[name]
        value = values.get(name, standard)
        if value < standard:
            raise InputError(f"{where}: {name} is {value!r}, expected at least {standard:g}.")
        for other in others:
            if value > standard and other not in values:
                raise InputError(
                    f"{where}: parameter {other!r} is missing, expected it because {name} is "
                    f"{value:g}."
                )


def simulate(
    experiment: Experiment,
    parameters: Mapping[str, float],
    *,
    at: FloatArray | None = None,
    solver: SolverOptions = REFERENCE_SOLVER,
) -> pd.DataFrame:
    """Solve the model for the experiment's protocol at given parameters.

    Parameters
    ----------
    experiment : Experiment
        What is driven, temperature and initial grain size; points are not needed.
    parameters : mapping
        SI values by name (see `check_parameters`).
    at : array, shape (n,), optional
        Positions on the clock of the protocol: strains (fraction, positive; those of rate steps are
        added), or times (s, increasing, not before the start of the record) of an oscillating test.
        Default `pyburgers.protocols.protocol.Protocol.output_grid`.
    solver : SolverOptions
        Tolerance and step limit.

    Returns
    -------
    DataFrame
        Columns time_s, strain, stress_Pa, kelvin_strain, grain_size_m, fabric_factor. Strain is
        what drives an oscillating test: without its trend where the background is removed. The
        reference stress (Pa), or flow rate (1/s), is in ``.attrs`` under its name.

    Raises
    ------
    InputError
        If a parameter is wrong, or a piezometer is missing that the grain size follows.
    SamplingError
        If the solver finds no solution.
    """
    values, protocol = check_parameters(parameters), protocol_of(experiment)
    check_piezometer(given_parameters(experiment.material, values), experiment)
    grid = protocol.output_grid(experiment) if at is None else np.asarray(at, dtype=np.float64)
    draw = solve(experiment, values, grid, solver=solver)
    solution = pd.DataFrame(protocol.solution(experiment, draw))
    solution.attrs[protocol.reference.name] = float(np.exp(draw["log_reference"][0]))
    return solution


def simulate_data(
    experiment: E, values: Mapping[str, float], rng: np.random.Generator, *, source: str
) -> E:
    """Put the solution at given parameters, with noise, in the place of what was observed.

    Parameters
    ----------
    experiment : Experiment
        What is driven, and positions and relative uncertainties of the points.
    values : mapping
        SI values by name.
    rng : Generator
        Gives the noise.
    source : str
        Where the parameters come from, for the provenance.

    Returns
    -------
    Experiment
        Synthetic, of the same protocol; its true parameters are `values`. A record is prepared as a
        measured one is.

    Raises
    ------
    SamplingError
        If the solver finds no solution.
    """
    protocol = protocol_of(experiment)
    solution = simulate(experiment, values, at=protocol.simulated_positions(experiment))
    response = protocol.response_in(experiment, solution)
    simulated: E = replace(
        protocol.with_noise(experiment, response, values, rng),
        microstructure=with_drawn_microstructure(experiment.microstructure, solution, rng),
        provenance=Provenance("synthetic", f"pyburgers, {source}"),
        true_parameters=values,
    )
    return simulated
