"""Experiment, priors and solver options -> the data dictionary of the Stan programs.

This module, `joint_stan_data` and `peak_stress_stan_data` are the only ones that know the data
blocks in `stan/data/` and of the programs.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.integrate import trapezoid
from scipy.special import logit

from pyburgers.common.errors import InputError
from pyburgers.model.flow_law_prior import FlowLawPrior
from pyburgers.model.parameters import (
    PROGRAM_PARAMETERS,
    REFERENCE_FLOW_RATE_QUANTITY,
    REFERENCE_QUANTITIES,
    REFERENCE_STRESS_QUANTITY,
    Parameter,
)
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import FLOW_LAW, PriorSet
from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.forced_oscillation.experiment import OscillationExperiment
from pyburgers.protocols.forced_oscillation.harmonics import trend_projection

FloatArray = npt.NDArray[np.float64]
StanData = dict[str, Any]

FAMILY_CODE = {"fixed": 0, "uniform": 1, "normal": 2, "half_normal": 2, "lognormal": 3}
"""Codes of `stan/functions/priors.stan`; a half-normal is a normal cut at zero."""

PART_OF_FLOW_LAW = 4
"""Code of a parameter whose density is in the joint prior of the flow law."""

REFERENCE_STRESS = REFERENCE_STRESS_QUANTITY.name
"""Name of the coordinate ln S_0 that replaces Q_M or beta."""

REFERENCE_FLOW_RATE = REFERENCE_FLOW_RATE_QUANTITY.name
"""Name of the coordinate ln(flow rate s) that replaces Q_M or beta in oscillating tests."""

PLAIN, VALLEY, SHEARED = 1, 2, 2
"""Codes of the coordinate systems: each program has plain ones and others of its own."""

REFERENCE_STRESS_SCALE = 0.1
"""Scale of ln S_0: data fix it to about 0.01, the prior to about 1."""

TYPICAL_FLOW_RATE = 0.1
"""Origin of the sampled flow rate over the root mean square of the driving strain rate."""

FORMER_FLOW_REFERENCE = [3.0, 0.0, 1.0]
"""Where the flow rate is not shifted in runs whose data do not say; plain coordinates use none."""

PINS, FORMER_PIN_COLUMNS = ("pin", "further_pin"), 5
"""Pins of the valley in the data of a program, and their columns when one weight did for all."""

START_MARGIN = 1e-3
"""Periods by which a record starts ahead of its first reading, so that the solver can start."""

PATH_TIMES = 4001
"""Times at which the strain rate is read off for the path strain of a record."""

STEP_ROUNDING = 1e-12
"""Relative distance from a rate step below which a strain counts as the step."""


@dataclass(frozen=True)
class SolverOptions:
    """Options of Stan's `ode_bdf_tol`.

    Attributes
    ----------
    tolerance : float
        Relative and absolute tolerance; the states are O(1), so one number fits both. The default
        is as loose as sampling allows: at 3e-5, a quarter cheaper, the log density of some
        oscillations varies by 0.3 between neighbouring points, at 1e-4 by 0.8, and no step is
        small enough for that; at 1e-5 it is 0.05.
    max_num_steps : int
        Steps between two output strains before the solver gives up, which rejects the draw. Low,
        so that an impossible region fails at once instead of crawling.
    """

    tolerance: float = 1e-5
    max_num_steps: int = 20_000

    def __post_init__(self) -> None:
        """Check the values.

        Raises
        ------
        InputError
            If one is out of range.
        """
        if not 1e-13 <= self.tolerance <= 1e-2:
            raise InputError(
                f"tolerance is {self.tolerance:g}, expected a number from 1e-13 to 1e-2."
            )
        if self.max_num_steps < 1:
            raise InputError(f"max_num_steps is {self.max_num_steps}, expected at least 1.")


@dataclass(frozen=True, eq=False)
class PlainCoordinates:
    """Real-line coordinates of the free parameters, as in `stan/functions/coordinates.stan`.

    Attributes
    ----------
    quantities : tuple of str
        Quantity of each coordinate: a parameter, or in place of one the reference stress or flow
        rate, as a logarithm.
    parameters : tuple of str
        Parameter that each coordinate gives a value to.
    shift, scale, lower, upper : array, shape (n_coordinates,)
        Origin, size and bounds of the quantities in SI (ln Pa for the reference stress, ln 1/s for
        the flow rate).
    """

    quantities: tuple[str, ...]
    parameters: tuple[str, ...]
    shift: FloatArray
    scale: FloatArray
    lower: FloatArray
    upper: FloatArray

    @property
    def replaced_parameter(self) -> str | None:
        """Parameter whose place the reference stress or flow rate takes, if any."""
        for quantity, parameter in zip(self.quantities, self.parameters, strict=True):
            if quantity in REFERENCE_QUANTITIES:
                return parameter
        return None

    def at(self, values: Mapping[str, float]) -> FloatArray:
        """Coordinates, shape (n_coordinates,), of SI values that include the reference one."""
        return np.array(
            [
                self.of_quantity(
                    k, np.log(values[name]) if name in REFERENCE_QUANTITIES else values[name]
                )
                for k, name in enumerate(self.quantities)
            ],
            dtype=np.float64,
        )

    def of_quantity(self, k: int, position: npt.ArrayLike) -> FloatArray:
        """Coordinate k, of any shape, where its quantity (or its logarithm) has given values."""
        position = np.asarray(position, dtype=np.float64)
        lower, upper, scale = self.lower[k], self.upper[k], self.scale[k]
        if np.isinf(lower):
            anywhere: FloatArray = (position - self.shift[k]) / scale
            return anywhere
        with np.errstate(divide="ignore"):
            if np.isinf(upper):
                above: FloatArray = np.log((position - lower) / scale)
                return above
            inside: FloatArray = logit((position - lower) / (upper - lower))
            return inside


def reference_quantity(experiment: Experiment) -> Parameter:
    """Point of the flow law whose logarithm is sampled in place of Q_M or beta."""
    if isinstance(experiment, OscillationExperiment):
        return REFERENCE_FLOW_RATE_QUANTITY
    return REFERENCE_STRESS_QUANTITY


def plain_coordinates(experiment: Experiment, priors: PriorSet) -> PlainCoordinates:
    """Choose origin and size of every free parameter and what the reference quantity replaces."""
    origin, size = _reference_origin(experiment)
    return coordinates_through(priors, reference_quantity(experiment), origin, size)


def coordinates_through(
    priors: PriorSet, reference: Parameter, origin: float, size: float
) -> PlainCoordinates:
    """Choose plain coordinates of free parameters, a point of the flow law among them.

    It replaces Q_M, or beta where Q_M cannot be replaced: a parameter with two finite bounds
    keeps its own coordinate, because its bounds would cut the replaced one obliquely.

    Parameters
    ----------
    priors : PriorSet
        Resolved priors.
    reference : Parameter
        The point: one of `pyburgers.model.parameters.REFERENCE_QUANTITIES`.
    origin, size : float
        Of its logarithm.
    """
    replaced = next(
        (
            name
            for name in ("activation_enthalpy", "beta")
            if not priors[name].is_fixed
            and not (np.isfinite(priors[name].lower) and np.isfinite(priors[name].upper))
        ),
        None,
    )
    rows = []
    for name in priors.free:
        prior = priors[name]
        if name == replaced:
            rows.append((reference.name, origin, size, -np.inf, np.inf))
        elif prior.family == "lognormal":
            # Its scale is that of the logarithm; the median sets the size.
            rows.append((name, 0.0, prior.location, prior.lower, prior.upper))
        else:
            rows.append((name, prior.location, prior.scale, prior.lower, prior.upper))
    quantities = tuple(row[0] for row in rows)
    numbers = np.array([row[1:] for row in rows], dtype=np.float64).reshape(len(rows), 4)
    return PlainCoordinates(quantities, tuple(priors.free), *numbers.T)


def _reference_origin(experiment: Experiment) -> tuple[float, float]:
    """Origin and size of the logarithm of the reference quantity."""
    if isinstance(experiment, OscillationExperiment):
        prepared = experiment.prepared
        rate = float(np.sqrt(np.mean(prepared.strain_rate(prepared.time) ** 2)))
        return float(np.log(TYPICAL_FLOW_RATE * rate)), 1.0
    # The largest observed stress, or a laboratory stress where nothing was observed.
    stress = experiment.largest_stress if experiment.n_points > 0 else 1e7
    return float(np.log(stress)), REFERENCE_STRESS_SCALE


def _outputs(
    experiment: ConstantRateExperiment, strain: FloatArray
) -> tuple[list[float], list[int], list[int]]:
    """Solver outputs for the wanted strains: increasing, rate steps included.

    A rate step is an output of the segment that ends there (the solver restarts from it). A strain
    that rounding puts beside a step counts as the step: the solver cannot start into so short a
    segment.

    Returns
    -------
    outputs : list of float
        Strains without repetition.
    counts : list of int
        Number of outputs in each segment.
    positions : list of int
        Place of each wanted strain among the outputs, from 0.
    """
    steps = np.array([segment.start_strain for segment in experiment.segments[1:]])
    snapped = strain.copy()
    for step in steps:
        snapped[np.isclose(strain, step, rtol=STEP_ROUNDING, atol=0.0)] = step
    outputs = np.unique(np.concatenate([snapped, steps]))
    segment = np.searchsorted(steps, outputs, side="left")
    counts = np.bincount(segment, minlength=len(experiment.segments))
    return outputs.tolist(), counts.tolist(), np.searchsorted(outputs, snapped).tolist()


def experiment_block(experiment: ConstantRateExperiment, *, use_likelihood: bool) -> StanData:
    """Return the block `stan/data/constant_rate_experiment.stan`."""
    strain, counts, positions = _outputs(experiment, experiment.strain)
    return {
        "temperature": experiment.temperature,
        "initial_grain_size": experiment.initial_grain_size,
        "n_segments": len(experiment.segments),
        "segment_start": [segment.start_strain for segment in experiment.segments],
        "segment_rate": [segment.strain_rate for segment in experiment.segments],
        "n_strains": len(strain),
        "strain": strain,
        "n_strains_in_segment": counts,
        "n_points": experiment.n_points,
        "strain_of_point": [position + 1 for position in positions],
        "stress_observed": experiment.stress.tolist(),
        "use_likelihood": int(use_likelihood),
    }


def prior_block(priors: PriorSet, parameters: Sequence[Parameter] = PROGRAM_PARAMETERS) -> StanData:
    """Return the block `stan/data/priors.stan` for a program's parameters, in its order."""
    ordered: Sequence[Prior] = [priors[parameter.name] for parameter in parameters]
    joint = FLOW_LAW if priors.flow_law is not None else ()
    return {
        "prior_family": [
            PART_OF_FLOW_LAW if prior.parameter in joint else FAMILY_CODE[prior.family]
            for prior in ordered
        ],
        "prior_location": [prior.location for prior in ordered],
        "prior_scale": [prior.scale for prior in ordered],
        "prior_lower": [prior.lower for prior in ordered],
        "prior_upper": [prior.upper for prior in ordered],
    }


def flow_law_block(flow_law: FlowLawPrior | None) -> StanData:
    """Return the joint prior of the flow law, the rest of the block `stan/data/priors.stan`."""
    if flow_law is None:
        return {
            "n_flow_law": 0,
            "flow_law_mean": [],
            "flow_law_factor": [],
            "flow_law_conditions": [],
        }
    at = flow_law.conditions
    return {
        "n_flow_law": flow_law.mean.size,
        "flow_law_mean": flow_law.mean.tolist(),
        "flow_law_factor": flow_law.factor.tolist(),
        "flow_law_conditions": [at.temperature, at.stress, at.grain_size],
    }


FURTHER_EXPERIMENTS = (
    "further_temperature",
    "further_initial_grain_size",
    "n_further_segments",
    "further_segment_start",
    "further_segment_rate",
    "n_further_strains",
    "further_strain",
    "n_further_strains_in_segment",
    "n_further_points",
    "further_strain_of_point",
    "further_stress_observed",
    "n_further_grid",
    "further_grid_strain",
    "n_further_grid_in_segment",
    "further_prior_location",
    "further_prior_scale",
    "further_prior_lower",
    "further_prior_upper",
    "further_position",
    "further_quantity_shift",
    "further_quantity_scale",
    "further_quantity_lower",
    "further_quantity_upper",
    "pooled_coordinate",
    "spread_scale",
    "n_further_knots",
    "further_knot_time_step",
    "further_knot_stress",
    "n_further_pins",
    "further_pin_knot",
    "further_pin",
    "further_reference_coordinate",
    "further_linear_from",
    "further_noise_exponent",
    "pooling_reference",
)
"""Arrays of the block `stan/data/further_experiments.stan`, all empty for a single fit."""


def single_block() -> StanData:
    """Return the block `stan/data/further_experiments.stan` of a fit of one experiment."""
    return {
        "n_further": 0,
        "n_further_coordinates": 0,
        "n_pooled": 0,
        **{name: [] for name in FURTHER_EXPERIMENTS},
    }


def with_later_additions(data: StanData) -> StanData:
    """Add to the data of a run what an earlier version of its program did not ask for.

    Variants of the model, a joint prior of the flow law and further experiments, each switched
    off; where the shift of the flow rate was zero; one weight of the pins for all.

    Parameters
    ----------
    data : dict
        Data of a program for curves or for oscillations, of this or an earlier version.
    """
    missing = PROGRAM_PARAMETERS[len(data["prior_family"]) :]
    added = prior_block(PriorSet("", "", {}, ""), missing)
    return {
        **single_block(),
        **flow_law_block(None),
        "flow_reference": FORMER_FLOW_REFERENCE,
        **data,
        **{name: [_with_both_weights(pin) for pin in data[name]] for name in PINS if name in data},
        **{name: [*data[name], *values] for name, values in added.items()},
    }


def _with_both_weights(pin: Sequence[float]) -> list[float]:
    return [*pin, pin[-1]] if len(pin) == FORMER_PIN_COLUMNS else [*pin]


def coordinate_block(
    coordinates: PlainCoordinates, parameters: Sequence[Parameter] = PROGRAM_PARAMETERS
) -> StanData:
    """Return the block `stan/data/coordinates.stan` for a program's parameters, in its order."""
    index = {parameter.name: k for k, parameter in enumerate(parameters, start=1)}
    replaced = coordinates.replaced_parameter
    return {
        "n_coordinates": len(coordinates.quantities),
        "parameter_of_coordinate": [index[name] for name in coordinates.parameters],
        "quantity_shift": coordinates.shift.tolist(),
        "quantity_scale": coordinates.scale.tolist(),
        "quantity_lower": coordinates.lower.tolist(),
        "quantity_upper": coordinates.upper.tolist(),
        "replaced_parameter": 0 if replaced is None else index[replaced],
    }


@dataclass(frozen=True, eq=False)
class ValleyReference:
    """Reference point and pins of the valley coordinates, as in `stan/data/valley.stan`.

    Attributes
    ----------
    coordinate : array, shape (n_coordinates,)
        Plain coordinates of the reference point, the posterior mode.
    linear_from : array, shape (n_coordinates,)
        Where a coordinate turns from logarithmic to linear, below 0 in the inverse; 0 keeps the
        plain one.
    knot_time_step, knot_stress : array, shape (n_knots,)
        The solution at the reference point: time since the knot before (s) and stress (Pa).
    pin_knot : array, shape (n_pins,)
        Knot of each pin, counted from 1.
    pin : array, shape (n_pins, 6)
        Strain, stress slope (Pa), strain rate (1/s), ln of the first rate over this rate, and
        inverse variance of ln stress for epsilon_c1 and for the rest.
    noise_exponent : array, shape (n_coordinates,)
        Power of the stress noise with which the width of each coordinate grows.
    """

    coordinate: FloatArray
    linear_from: FloatArray
    knot_time_step: FloatArray
    knot_stress: FloatArray
    pin_knot: npt.NDArray[np.int64]
    pin: FloatArray
    noise_exponent: FloatArray


def valley_block(reference: ValleyReference | None) -> StanData:
    """Return the block `stan/data/valley.stan`; None keeps the plain coordinates."""
    if reference is None:
        return {
            "coordinate_system": PLAIN,
            "n_knots": 0,
            "knot_time_step": [],
            "knot_stress": [],
            "n_pins": 0,
            "pin_knot": [],
            "pin": [],
            "reference_coordinate": [],
            "linear_from": [],
            "noise_exponent": [],
        }
    return {
        "coordinate_system": VALLEY,
        "n_knots": reference.knot_stress.size,
        "knot_time_step": reference.knot_time_step.tolist(),
        "knot_stress": reference.knot_stress.tolist(),
        "n_pins": reference.pin_knot.size,
        "pin_knot": reference.pin_knot.tolist(),
        "pin": reference.pin.tolist(),
        "reference_coordinate": reference.coordinate.tolist(),
        "linear_from": reference.linear_from.tolist(),
        "noise_exponent": reference.noise_exponent.tolist(),
    }


def solver_block(solver: SolverOptions) -> StanData:
    """Return the block `stan/data/solver.stan`."""
    return {
        "relative_tolerance": solver.tolerance,
        "absolute_tolerance": solver.tolerance,
        "max_num_steps": solver.max_num_steps,
    }


def grid_block(experiment: ConstantRateExperiment, grid_strain: FloatArray) -> StanData:
    """Return the strains at which the solution is reported apart from the observed ones.

    Rate steps are added to the grid, so that what comes back may be longer than `grid_strain`.
    """
    if grid_strain.size == 0:
        return {
            "n_grid": 0,
            "grid_strain": [],
            "n_grid_in_segment": [0] * len(experiment.segments),
        }
    strain, counts, _ = _outputs(experiment, grid_strain)
    return {"n_grid": len(strain), "grid_strain": strain, "n_grid_in_segment": counts}


def constant_rate_data(
    experiment: ConstantRateExperiment,
    priors: PriorSet,
    *,
    solver: SolverOptions,
    grid_strain: FloatArray | None = None,
    use_likelihood: bool = True,
    valley: ValleyReference | None = None,
) -> StanData:
    """Return all data of `stan/constant_rate.stan`.

    `program_data` does so for an experiment of any protocol.

    Parameters
    ----------
    experiment : ConstantRateExperiment
        The test; without points it can only be simulated.
    priors : PriorSet
        Priors in SI, resolved (`PriorSet.resolved`).
    solver : SolverOptions
        Tolerance and step limit.
    grid_strain : array, shape (n_grid,), optional
        Strains (fraction, positive) at which to report the solution.
    use_likelihood : bool
        False gives the prior.
    valley : ValleyReference, optional
        Sample in valley coordinates around this reference; default plain coordinates.
    """
    return {
        **experiment_block(experiment, use_likelihood=use_likelihood),
        **prior_block(priors),
        **flow_law_block(priors.flow_law),
        **coordinate_block(plain_coordinates(experiment, priors)),
        **valley_block(valley),
        **solver_block(solver),
        **grid_block(experiment, np.empty(0) if grid_strain is None else grid_strain),
        **single_block(),
    }


@dataclass(frozen=True, eq=False)
class ShearedReference:
    """What sets the sheared coordinates up, as in `stan/data/sheared.stan`.

    Attributes
    ----------
    flow_slope : array, shape (3,)
        Derivatives of the ln(flow rate s) that fits best by n, p and p ln(d/d_0).
    flow_reference : array, shape (3,)
        n, p and epsilon_c1 where the flow rate is not shifted.
    """

    flow_slope: FloatArray
    flow_reference: FloatArray


def sheared_block(reference: ShearedReference | None) -> StanData:
    """Return the block `stan/data/sheared.stan`; None keeps the plain coordinates."""
    if reference is None:
        return {
            "coordinate_system": PLAIN,
            "flow_slope": [0.0] * 3,
            "flow_reference": FORMER_FLOW_REFERENCE,
        }
    return {
        "coordinate_system": SHEARED,
        "flow_slope": reference.flow_slope.tolist(),
        "flow_reference": reference.flow_reference.tolist(),
    }


def oscillation_block(experiment: OscillationExperiment, *, use_likelihood: bool) -> StanData:
    """Return the block `stan/data/forced_oscillation_experiment.stan`."""
    prepared = experiment.prepared
    period = prepared.period
    kept = prepared.background == "kept"
    first_tau = prepared.start / period - START_MARGIN
    sine, cosine = prepared.strain_sine[0], prepared.strain_cosine[0]
    # The oscillation passes upwards through zero where tau + phase is a whole number.
    phase = float(np.arctan2(cosine, sine)) / (2 * np.pi)
    start_tau = float(np.floor(first_tau + phase)) - phase - experiment.spin_up_cycles
    background = prepared.background_rate * period if kept else np.empty(0)
    trend_shape, trend_fit = trend_projection(
        prepared.time,
        period=period,
        degree=prepared.stress_fit.degree,
        uncertainty=prepared.uncertainty,
    )
    n_trend = 0 if kept else trend_fit.shape[0]
    bias = float(prepared.stress_fit.trend(np.array([prepared.start]))[0])
    amplitude = prepared.stress_fit.amplitude()[0]
    lag = prepared.stress_fit.phase()[0] - prepared.strain_fit.phase()[0]
    compliance = float(np.hypot(sine, cosine)) / amplitude
    return {
        "temperature": experiment.temperature,
        "initial_grain_size": experiment.initial_grain_size,
        "period": period,
        "n_harmonics": prepared.strain_sine.size,
        "strain_sine": prepared.strain_sine.tolist(),
        "strain_cosine": prepared.strain_cosine.tolist(),
        "n_background": background.size,
        "background": background.tolist(),
        "background_middle": prepared.t_middle / period,
        "background_half": prepared.t_half / period,
        "start_tau": start_tau,
        "start_stress": bias if kept else 0.0,
        "first_tau": first_tau,
        "stress_scale": max(amplitude, abs(bias)) if kept else amplitude,
        "strain_scale": float(np.hypot(sine, cosine)),
        "stress_amplitude": amplitude,
        "storage_compliance": compliance * float(np.cos(lag)),
        "loss_compliance": compliance * float(np.sin(lag)),
        "typical_path_strain": 0.5 * _path_strain(experiment),
        "n_points": experiment.n_points,
        "tau": (prepared.time / period).tolist(),
        "stress_observed": experiment.stress.tolist(),
        "relative_noise": prepared.relative_uncertainty.tolist(),
        "n_trend": n_trend,
        "trend_shape": trend_shape[:, :n_trend].tolist(),
        "trend_fit": trend_fit[:n_trend].tolist(),
        "use_likelihood": int(use_likelihood),
    }


def _path_strain(experiment: OscillationExperiment) -> float:
    """Integral of the absolute strain rate over the record."""
    prepared = experiment.prepared
    time = np.linspace(prepared.start, prepared.time[-1], PATH_TIMES)
    return float(trapezoid(np.abs(prepared.strain_rate(time)), time))


def forced_oscillation_data(
    experiment: OscillationExperiment,
    priors: PriorSet,
    *,
    solver: SolverOptions,
    grid_time: FloatArray | None = None,
    use_likelihood: bool = True,
    sheared: ShearedReference | None = None,
) -> StanData:
    """Return all data of `stan/forced_oscillation.stan`.

    Parameters
    ----------
    experiment : OscillationExperiment
        The test.
    priors : PriorSet
        Priors in SI, resolved (`PriorSet.resolved`).
    solver : SolverOptions
        Tolerance and step limit.
    grid_time : array, shape (n_grid,), optional
        Times (s, increasing, from the start of the record on) at which to report the solution.
    use_likelihood : bool
        False gives the prior.
    sheared : ShearedReference, optional
        Sample in sheared coordinates; default plain coordinates.
    """
    return {
        **oscillation_block(experiment, use_likelihood=use_likelihood),
        **prior_block(priors),
        **flow_law_block(priors.flow_law),
        **coordinate_block(plain_coordinates(experiment, priors)),
        **sheared_block(sheared),
        **solver_block(solver),
        **time_grid_block(experiment, np.empty(0) if grid_time is None else grid_time),
    }


def time_grid_block(experiment: OscillationExperiment, grid_time: FloatArray) -> StanData:
    """Return the times at which the solution is reported apart from the observed ones."""
    prepared = experiment.prepared
    shape = prepared.stress_fit.trend_shape(grid_time)
    n_trend = shape.shape[1] if prepared.background == "removed" else 0
    return {
        "n_grid": grid_time.size,
        "grid_tau": (grid_time / prepared.period).tolist(),
        "grid_trend_shape": shape[:, :n_trend].tolist(),
    }


def program_data(
    experiment: Experiment,
    priors: PriorSet,
    *,
    solver: SolverOptions,
    grid: FloatArray | None = None,
    use_likelihood: bool = True,
) -> StanData:
    """Return all data, in plain coordinates, of the program for an experiment.

    Parameters
    ----------
    experiment, priors, solver, use_likelihood
        As for `constant_rate_data` and `forced_oscillation_data`.
    grid : array, shape (n_grid,), optional
        Strains, or times (s) of an oscillating test, at which to report the solution.
    """
    match experiment:
        case ConstantRateExperiment():
            return constant_rate_data(
                experiment,
                priors,
                solver=solver,
                grid_strain=grid,
                use_likelihood=use_likelihood,
            )
        case OscillationExperiment():
            return forced_oscillation_data(
                experiment,
                priors,
                solver=solver,
                grid_time=grid,
                use_likelihood=use_likelihood,
            )
    raise TypeError(f"no program for {type(experiment).__name__}")


def with_grid(data: StanData, experiment: Experiment, grid: FloatArray) -> StanData:
    """Return the data of a program with other positions of its solution (see `program_data`)."""
    if isinstance(experiment, OscillationExperiment):
        return {**data, **time_grid_block(experiment, grid)}
    assert isinstance(experiment, ConstantRateExperiment)  # the only other protocol
    return {**data, **grid_block(experiment, grid)}
