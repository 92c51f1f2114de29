"""Forward solutions at given parameters, through the Stan program."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.cmdstan.program import load_program, stan_directory
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.model.parameters import (
    KELVIN_REFERENCES,
    PARAMETER_BY_NAME,
    PARAMETERS,
    PROGRAM_PARAMETERS,
    STANDARD_VALUES,
)
from pyburgers.model.priors import MAY_BE_ZERO, PriorSet, fixed_prior
from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.forced_oscillation.experiment import OscillationExperiment
from pyburgers.protocols.stan_data import SolverOptions, program_data, reference_quantity

FloatArray = npt.NDArray[np.float64]

REFERENCE_SOLVER = SolverOptions(tolerance=1e-10, max_num_steps=1_000_000)
"""Tolerance at which a solution is taken as exact."""

FABRIC_OF_OLIVINE = 1.0
"""Oscillating tests have no fabric evolution (Eq. 5 of the paper)."""

OUTPUTS_PER_CYCLE = 60
"""Times in a cycle at which a smooth curve is drawn."""


def constant_rate_program() -> Path:
    """Path of the program for tests at imposed strain rate."""
    return stan_directory() / "constant_rate.stan"


def program_for(experiment: Experiment) -> Path:
    """Path of the program for an experiment's protocol."""
    if isinstance(experiment, OscillationExperiment):
        return stan_directory() / "forced_oscillation.stan"
    return constant_rate_program()


def load_parameters(path: str | Path) -> dict[str, float]:
    """Read a JSON object of parameter values in SI units, checked by `check_parameters`.

    Raises
    ------
    InputError
        If the file is missing, is no JSON object, or has wrong names or values.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}).") from error
    except ValueError as error:
        raise InputError(f"{path}: is not valid JSON ({error}).") from error
    if not isinstance(content, dict):
        raise InputError(
            f"{path}: found {type(content).__name__}, expected a JSON object of parameter values."
        )
    return check_parameters(content, where=str(path))


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
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise InputError(f"{where}: {name} is {value!r}, expected a finite number.")
        checked[name] = float(value)
        unit = PARAMETER_BY_NAME[name].si_unit
        if name not in {"beta", "stress_noise", *MAY_BE_ZERO} and value <= 0:
            raise InputError(f"{where}: {name} is {value!r} {unit}, expected a positive number.")
    check_kelvin_element(checked, where)
    if checked["steady_state_fabric_factor"] > 1:
        found = checked["steady_state_fabric_factor"]
        raise InputError(
            f"{where}: steady_state_fabric_factor is {found!r}, expected at most 1 (isotropic)."
        )
    return checked


def check_kelvin_element(values: Mapping[str, float], where: str) -> None:
    """Check what is given of a Kelvin element that is not linear.

    Parameters
    ----------
    values : mapping
        SI values by name; `pyburgers.model.parameters.VARIANT_PARAMETERS` may be left out.
    where : str
        File or argument, for messages.

    Raises
    ------
    InputError
        If the stress exponent is below 1, the activation enthalpy negative, or the driving stress
        or temperature that the viscosity is given for is missing.
    """
    for name, reference in KELVIN_REFERENCES.items():
        standard = STANDARD_VALUES[name]
        value = values.get(name, standard)
        if value < standard:
            raise InputError(f"{where}: {name} is {value!r}, expected at least {standard:g}.")
        if value > standard and reference not in values:
            raise InputError(
                f"{where}: parameter {reference!r} is missing, expected it because {name} is "
                f"{value:g}."
            )


def output_grid(experiment: Experiment) -> FloatArray:
    """Strains, or times (s) of an oscillating test, at which a smooth curve is drawn, shape (n,).

    They include the observed ones. Strains are dense where stress first rises.
    """
    if isinstance(experiment, OscillationExperiment):
        return np.union1d(time_grid(experiment, OUTPUTS_PER_CYCLE), experiment.prepared.time)
    assert isinstance(experiment, ConstantRateExperiment)  # the only other protocol
    shape = np.union1d(np.geomspace(1e-4, 1.0, 120), np.linspace(0.0, 1.0, 101)[1:])
    return np.union1d(strain_grid(experiment, shape), experiment.strain)


def observed_grid(experiment: Experiment) -> FloatArray:
    """Strains, or times (s) of an oscillating test, at which stress was observed, (n_points,)."""
    if isinstance(experiment, OscillationExperiment):
        return experiment.prepared.time
    assert isinstance(experiment, ConstantRateExperiment)  # the only other protocol
    return experiment.strain


def time_grid(experiment: OscillationExperiment, per_cycle: int) -> FloatArray:
    """Evenly spaced times (s) from the start of a record to its last stress reading."""
    prepared = experiment.prepared
    start, end = prepared.start, float(prepared.time[-1])
    return np.linspace(start, end, round(per_cycle * (end - start) / prepared.period) + 1)


def strain_grid(experiment: ConstantRateExperiment, shape: FloatArray) -> FloatArray:
    """Strains spread in the same way over every rate segment.

    Parameters
    ----------
    experiment : ConstantRateExperiment
        Its segments and final strain.
    shape : array, shape (n_shape,)
        Positions in a segment, increasing, more than 0 to 1.

    Returns
    -------
    array, shape (n_shape * n_segments,)
        Increasing; the strains of rate steps are among them exactly, since rounding that put
        one just behind a step would give the solver a segment too short to start in.
    """
    starts = np.array([segment.start_strain for segment in experiment.segments])
    ends = np.append(starts[1:], experiment.final_strain)
    grid = starts[:, np.newaxis] + (ends - starts)[:, np.newaxis] * shape
    grid[:, -1] = ends
    strain: FloatArray = grid.ravel()
    return strain


def given_parameters(material: str, values: Mapping[str, float]) -> PriorSet:
    """Return priors that fix every parameter.

    Parameters
    ----------
    material : str
        Of the experiment.
    values : mapping
        SI values by name; what is missing, such as the noise of a solution without any, is 1.
    """
    known = {"stress_noise": 1.0, **values}  # a solution has no noise
    return PriorSet(
        material=material,
        title="given parameters",
        priors={
            p.name: fixed_prior(p, known[p.name], "given")
            for p in PROGRAM_PARAMETERS
            if p.name in known
        },
        name="given",
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
        Protocol, temperature and initial grain size; stresses are not needed.
    parameters : mapping
        SI values by name (see `check_parameters`).
    at : array, shape (n,), optional
        Strains (fraction, positive; those of rate steps are added), or times (s, increasing, not
        before the start of the record) of an oscillating test. Default `output_grid`.
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
        If a parameter is wrong.
    SamplingError
        If the solver finds no solution.
    """
    values = check_parameters(parameters)
    grid = output_grid(experiment) if at is None else np.asarray(at, dtype=np.float64)
    draw = solve(experiment, values, grid, solver=solver)
    if isinstance(experiment, OscillationExperiment):
        time, strain = draw["grid_time"], experiment.prepared.strain(draw["grid_time"])
        fabric = np.full_like(time, FABRIC_OF_OLIVINE)
    else:
        assert isinstance(experiment, ConstantRateExperiment)  # the only other protocol
        time, strain = experiment.time_at(draw["grid_strain"]), draw["grid_strain"]
        fabric = draw["grid_fabric_factor"]
    solution = pd.DataFrame(
        {
            "time_s": time,
            "strain": strain,
            "stress_Pa": draw["grid_stress"],
            "kelvin_strain": draw["grid_kelvin_strain"],
            "grain_size_m": draw["grid_grain_size"],
            "fabric_factor": fabric,
        }
    )
    reference = reference_quantity(experiment).name
    solution.attrs[reference] = float(draw[reference])
    return solution


def solve(
    experiment: Experiment, values: Mapping[str, float], at: FloatArray, *, solver: SolverOptions
) -> dict[str, FloatArray]:
    """Solve the model once and return every generated quantity of the Stan program.

    Parameters
    ----------
    experiment, values, at, solver
        As for `simulate`; `values` are taken as they are.

    Returns
    -------
    dict
        ``grid_*`` arrays, shape (n,), as named in the Stan program, the strains or times (s)
        themselves as ``grid_strain`` or ``grid_time``, and scalars such as ``reference_stress``
        (SI).

    Raises
    ------
    SamplingError
        If the solver finds no solution.
    """
    priors = given_parameters(experiment.material, values)
    if isinstance(experiment, ConstantRateExperiment):
        experiment = replace(experiment, strain=np.empty(0), stress=np.empty(0))
    data = program_data(experiment, priors, solver=solver, grid=at)
    draw = load_program(program_for(experiment)).evaluate(data)
    if not np.isfinite(draw["grid_stress"]).all():
        raise SamplingError(
            f"{experiment.id}: the solver found no finite stress at these parameters; check their "
            "units (SI) and the sign of beta."
        )
    if isinstance(experiment, OscillationExperiment):
        return {**draw, "grid_time": np.asarray(at)}
    return {**draw, "grid_strain": np.array(data["grid_strain"])}
