"""Forward solutions at given parameters, through the Stan program."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path
from pyburgers.common.toml_files import read_json
from pyburgers.kinds.experiment import E, Experiment, MeasuredMicrostructure, Provenance
from pyburgers.kinds.kind import solution_columns
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.program_data import given_parameters, solve
from pyburgers.kinds.stan_data import REFERENCE_SOLVER, SolverOptions
from pyburgers.model.parameters import (
    BELOW_ONE,
    GIVEN_TOGETHER,
    MAY_BE_ZERO,
    PARAMETER_BY_NAME,
    PARAMETERS,
    STANDARD_VALUES,
    UNSIGNED,
)
from pyburgers.model.variants import check_laws, with_variant

LARGEST = float(np.finfo(np.float64).max)
"""Largest finite number."""

OF_EITHER_SIGN = UNSIGNED - {"activation_enthalpy"} | {"peak_time_decades"}
"""Parameters that a solution takes below zero too: the second of two elements may be the slower."""

NOT_NEGATIVE = (MAY_BE_ZERO | {"stress_noise"}) - OF_EITHER_SIGN
"""Parameters that may be zero, but not less."""

ROUNDING = 1e-9
"""Share of the range of a clock by which a position may lie outside it: units were converted."""


def load_parameters(path: str | Path) -> dict[str, float]:
    """Read a JSON object of parameter values in SI units, checked by `check_parameters`.

    Raises
    ------
    InputError
        If the file is missing, is no JSON object, or has wrong names or values.

    Examples
    --------
    >>> _ = Path("values.json").write_text(json.dumps(dict(values)))
    >>> pyburgers.load_parameters("values.json") == values
    True
    """
    return check_parameters(read_json(given_path(path)), where=str(path))


def check_parameters(values: Mapping[str, object], where: str = "parameters") -> dict[str, float]:
    """Return the values (SI) of a forward solution as floats; noise and variants may be missing."""
    unknown = [name for name in values if name not in PARAMETER_BY_NAME]
    if unknown:
        expected = ", ".join(PARAMETER_BY_NAME)
        raise InputError(f"{where}: unknown parameter {unknown[0]!r}; expected {expected}.")
    required = [p.name for p in PARAMETERS if p.name != "stress_noise"]
    missing = [name for name in required if name not in values]
    if missing:
        raise InputError(f"{where}: parameter {missing[0]!r} is missing.")
    checked = {}
    for name, given in values.items():
        value = given.item() if isinstance(given, np.generic) else given
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not -LARGEST <= value <= LARGEST  # whole numbers have no largest one
        ):
            raise InputError(f"{where}: {name} is {value!r}, expected a finite number.")
        checked[name] = float(value)
        wanted = _wanted_instead(name, checked[name])
        if wanted is not None:
            unit = PARAMETER_BY_NAME[name].si_unit
            raise InputError(f"{where}: {name} is {value!r} {unit}, expected {wanted}.")
    check_given_together(checked, where)
    return checked


def _wanted_instead(name: str, value: float) -> str | None:
    """Return what a value (SI) has to be where it is not what the parameter can be."""
    if name not in OF_EITHER_SIGN | NOT_NEGATIVE and value <= 0:
        return "a positive number"
    if name in NOT_NEGATIVE and value < 0:
        return "zero or a positive number"
    if name in BELOW_ONE and value >= 1:
        return "less than 1"
    if name == "residual_correlated_share" and value > 1:
        return "a share of at most 1"
    if name == "stress_calibration_error" and abs(value) >= 1:
        return "a relative error between -1 and 1"
    return None


def check_given_together(values: Mapping[str, float], where: str) -> None:
    """Refuse a nonlinear Kelvin element or a piezometer without what gives it a meaning."""
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


def with_stated(experiment: Experiment, values: Mapping[str, float]) -> dict[str, float]:
    """Return parameters (SI) with what a test's file states of it where they do not say that."""
    stated = {name: one.value for name, one in experiment.stated.items()}
    missing = {k: v for k, v in {**stated, **experiment.environment}.items() if k not in values}
    return {**values, **missing}


def with_laws(
    experiment: Experiment, values: Mapping[str, float], choices: Mapping[str, str]
) -> dict[str, float]:
    """Return parameters (SI) of the model with the chosen laws, those without effect changed."""
    priors = with_variant(given_parameters(experiment.material, values), experiment, choices)
    for name in priors.free:
        chosen = ", ".join(f"{part}={law}" for part, law in choices.items())
        raise InputError(
            f"{experiment.id}: {chosen}: the parameters have no {name} for this law, expected a "
            f"value of {name} among the parameters."
        )
    return {name: prior.location for name, prior in priors.priors.items()}


def checked_positions(experiment: Experiment, at: npt.ArrayLike) -> FloatArray:
    """Return positions on the clock of a test (SI) as an array, which do not decrease."""
    clock = likelihood_of(experiment).clock
    low, high = experiment.span
    unit = "" if clock.si_unit == "1" else f" {clock.si_unit}"
    expected = (
        f"expected a list of positions along its {clock.name} that do not decrease, from "
        f"{low:.6g} to {high:.6g}{unit}"
    )
    try:
        positions = np.asarray(at, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{experiment.id}: at: found {at!r}, {expected}.") from error
    if positions.ndim != 1 or positions.size == 0:
        raise InputError(
            f"{experiment.id}: at: found an array of shape {positions.shape}, {expected}."
        )
    margin = ROUNDING * (high - low)
    outside = positions[~((positions >= low - margin) & (positions <= high + margin))]
    if outside.size > 0:
        raise InputError(f"{experiment.id}: at: found {outside[0]:.6g}{unit}, {expected}.")
    falling = np.flatnonzero(np.diff(positions) < 0)
    if falling.size > 0:
        first, second = positions[falling[0] : falling[0] + 2]
        raise InputError(
            f"{experiment.id}: at: found {second:.6g} behind {first:.6g}{unit}, {expected}."
        )
    return np.clip(positions, low, high)


def simulate(
    experiment: Experiment,
    parameters: Mapping[str, float],
    *,
    at: npt.ArrayLike | None = None,
    solver: SolverOptions = REFERENCE_SOLVER,
) -> pd.DataFrame:
    """Solve the model for the experiment's protocol at given parameters.

    Parameters
    ----------
    experiment : Experiment
        Imposed quantities, temperature and initial grain size; points are not needed.
    parameters : mapping
        SI values by name (see `check_parameters`). If compliance of the apparatus or zero of the
        strain is missing, the value is that of the test, else none.
    at : array, shape (n,), optional
        Positions on the clock of the protocol, within the test, not decreasing. At constant rate
        they are strains (positive fractions). In oscillations and loading histories they are times
        (s) from the start; the second of two at a jump is behind it. In a table of attenuation they
        are places. Default
        `pyburgers.kinds.likelihood.Likelihood.output_grid`.
    solver : SolverOptions
        Tolerance and step limit.

    Returns
    -------
    DataFrame
        Columns time_s, strain, stress_Pa, kelvin_strain, grain_size_m, fabric_factor. Strain of an
        oscillating test is the driving strain, without the trend of a removed background. The
        reference stress (Pa), or flow rate (1/s), is in ``.attrs`` under its name. So is the
        ``log_likelihood`` of the readings, if the program of the test holds them (forced
        oscillations, loading histories) and the parameters have their noise.

    Raises
    ------
    InputError
        If a parameter or a position is wrong, the kind of test does not take a law, or the grain
        size lacks its piezometer.
    SamplingError
        If the solver finds no solution.

    Examples
    --------
    >>> solution = pyburgers.simulate(test, values, at=[0.001, 0.01])
    >>> list(solution["strain"])
    [0.001, 0.01]
    """
    return _solved(experiment, parameters, at, solver)[0]


def _solved(
    experiment: Experiment,
    parameters: Mapping[str, float],
    at: npt.ArrayLike | None,
    solver: SolverOptions,
    sections: Sequence[MeasuredMicrostructure] = (),
) -> tuple[pd.DataFrame, FloatArray]:
    """Return what `simulate` does, and grain sizes (m) and fabric factors, (n_sections, 2)."""
    values = with_stated(experiment, check_parameters(parameters))
    likelihood = likelihood_of(experiment)
    error, coldest = values.get("temperature_error", 0.0), float(experiment.temperatures.min())
    if abs(error) >= coldest:
        raise InputError(
            f"{experiment.id}: temperature_error is {error:g} K, expected less than the "
            f"temperature of the test, {coldest:g} K."
        )
    check_laws(given_parameters(experiment.material, values), experiment)
    grid = likelihood.output_grid(experiment) if at is None else checked_positions(experiment, at)
    draw = solve(experiment, values, grid, solver=solver, sections=sections)
    solution = pd.DataFrame(solution_columns(experiment, draw))
    with np.errstate(over="ignore"):  # of a dashpot that never flows
        solution.attrs[likelihood.reference.name] = float(np.exp(draw["log_reference"][0]))
    # Programs have no such variables where nothing was measured.
    noises = {likelihood.read[k].noise for k in experiment.quantity}
    if noises and noises <= values.keys() and "log_lik" in draw:
        solution.attrs["log_likelihood"] = float(draw["log_lik"].sum())
    return solution, draw.get("microstructure_model", np.empty((0, 2)))


def simulate_data(
    experiment: E, values: Mapping[str, float], rng: np.random.Generator, *, source: str
) -> E:
    """Return a synthetic test: the solution at parameters (SI), with noise, as its readings."""
    values, (positions, places) = with_stated(experiment, values), experiment.reading_places()
    solution, model = _solved(
        experiment, values, positions, REFERENCE_SOLVER, experiment.microstructure
    )
    columns = [quantity.column for quantity in likelihood_of(experiment).read]
    response = solution[columns].to_numpy()[places, experiment.quantity]
    return replace(
        experiment.with_noise(response, values, rng),
        microstructure=tuple(
            one.drawn(size, factor, rng)
            for one, (size, factor) in zip(experiment.microstructure, model, strict=True)
        ),
        provenance=Provenance("synthetic", f"pyburgers, {source}"),
        true_parameters=values,
    )
