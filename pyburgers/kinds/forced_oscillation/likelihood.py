"""How tests at an oscillating strain rate are sampled, and their sheared coordinates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from scipy.integrate import trapezoid
from scipy.interpolate import make_interp_spline

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.forced_oscillation.harmonics import N_HARMONICS, fundamentals, trend_projection
from pyburgers.kinds.likelihood import (
    AtMode,
    Chart,
    ChartUnsuited,
    Likelihood,
    grid_quantities,
    likelihood_of,
)
from pyburgers.kinds.stan_data import Layout, Mode, PlainCoordinates, StanData, ends
from pyburgers.model.priors import PriorSet
from pyburgers.model.read_quantities import STRESS, Quantity
from pyburgers.model.reference_quantities import REFERENCE_FLOW_RATE_QUANTITY

LOG_RATE_STEP, N_SOLUTIONS = 0.5, 25
"""Between solutions that say what the dashpot does at other flow rates, and how many there are."""


NO_COMPLIANCE = -100.0
"""ln of a compliance (1/Pa) next to which that of any element is large."""


LEAST_INFORMATION = 10.0
"""Curvature of the log likelihood along ln(flow rate s) below which its slopes say nothing."""


SHIFTED_BY = ("stress_exponent", "grain_size_exponent", "critical_strain_grain_size")
"""Parameters whose values shift the flow rate."""


STRETCHED_FROM = 0.1
"""Share of the observed loss from which on the flow rate counts by itself, not its logarithm.

Where data leave a wider range to the flow rate, it does from that width on."""


FIRST_SOLUTION = -4.0
"""ln of the first solution's flow rate over the one that would give the dashpot that share, if its
compliance were in proportion."""


LEAST_SHARE = 1e-6
"""Of that share: noise of a solution can make less of it negative."""


UNINFORMED_SLOPE = np.array([0.0, 0.0, 1.0])
"""The flow at the grain size half way through the record, whatever n."""


@dataclass(frozen=True, eq=False)
class ShearedReference:
    """What sets the sheared coordinates of a test up, as in `stan/data/sheared.stan`.

    `flow_slope` (3,): derivatives of the ln(flow rate s) that fits best by n, p and p ln(d/d_0).
    `flow_reference` (3,): n, p and epsilon_c1 where the flow rate is not shifted.
    `log_rate_scale`: ln(flow rate s) from which on the coordinate is the rate itself.
    `first_log_rate`: ln(flow rate s) of the first solution, steps of `LOG_RATE_STEP` follow.
    `log_dashpot_compliance` (N_SOLUTIONS,): ln of the dashpot's loss compliance (1/Pa) there.
    """

    flow_slope: FloatArray
    flow_reference: FloatArray
    log_rate_scale: float
    first_log_rate: float
    log_dashpot_compliance: FloatArray


UNSHIFTED = ShearedReference(
    np.zeros(3), np.array([3.0, 0.0, 1.0]), 0.0, 0.0, np.full(N_SOLUTIONS, NO_COMPLIANCE)
)
"""In place of a reference in plain coordinates, which make no use of it."""


def shifts_block(references: Sequence[ShearedReference]) -> StanData:
    """Return shifts of the block `stan/data/sheared.stan`, a reference for each test."""
    return {
        "log_rate_step": LOG_RATE_STEP,
        "n_solutions": N_SOLUTIONS,
        **{
            field.name: np.array([getattr(one, field.name) for one in references]).tolist()
            for field in fields(ShearedReference)
        },
    }


class ShearedChart(Chart[OscillationExperiment]):
    """The sheared coordinates."""

    name = "sheared"
    curvature_tolerance = 1e-7
    """At tolerances as loose as those for sampling, the error of the solver can be as large as
    differences of gradients where the dashpot carries most of the load: at 1e-4 slopes of the flow
    rate came out 50 times too large."""

    def reference(self, test: AtMode[OscillationExperiment]) -> tuple[ShearedReference, FloatArray]:
        """Make the flow rate least dependent on n, p and epsilon_c1, unshifted at the mode."""
        priors, coordinates = test.priors, test.coordinates
        replaced = coordinates.replaced_parameter
        if replaced is None:
            raise ChartUnsuited("neither Q_M nor beta leaves its place to the flow rate")
        beta = priors["beta"]
        if replaced == "activation_enthalpy" and not beta.is_fixed:
            for prior in (beta, priors[replaced]):
                is_bounded = np.isfinite([prior.lower, prior.upper]).any()
                if prior.family != "normal" or is_bounded:
                    raise ChartUnsuited(
                        f"the prior of {prior.parameter} is not an unbounded normal"
                    )
        if test.data["storage_compliance"][0] <= 0 or test.data["loss_compliance"][0] <= 0:
            raise ChartUnsuited("the observed stress is not ahead of the strain by 0 to 90 degrees")
        flow = coordinates.parameters.index(replaced)
        wanted = STRETCHED_FROM * test.data["loss_compliance"][0]
        log_rates, log_compliance = _dashpot_at_other_rates(test, flow, wanted)
        rising = np.maximum.accumulate(log_compliance)
        seen_from = float(np.interp(np.log(wanted), rising, log_rates))
        curvature = test.curvature()
        slope = _flow_slope(test, flow, curvature - test.curvature(use_likelihood=0))
        at_mode = np.array([test.mode.values[name] for name in SHIFTED_BY])
        scale = max(seen_from, _log_width(test, flow, curvature))
        first = float(log_rates[0])
        reference = ShearedReference(slope, at_mode, scale, first, log_compliance)
        shifted = test.generated(**shifts_block([reference]))
        return reference, np.atleast_1d(shifted["sheared_coordinate"])

    def block(self, references: Sequence[ShearedReference], layout: Layout) -> StanData:
        """Return shifts of the block `stan/data/sheared.stan`; no references: plain coordinates."""
        return shifts_block(references or [UNSHIFTED] * layout.n_tests)


def _dashpot_at_other_rates(
    test: AtMode[OscillationExperiment], flow: int, wanted: float
) -> tuple[FloatArray, FloatArray]:
    """ln(flow rate s) and ln(loss compliance / (1/Pa)) about a wanted one; `flow` is its place."""
    at_mode = test.coordinates.value(flow, test.mode.coordinate[flow])
    (there,) = _dashpot_compliance(test, flow, np.array([at_mode]))
    first = at_mode - np.log(abs(there) / wanted) + FIRST_SOLUTION
    log_rates = np.asarray(first + LOG_RATE_STEP * np.arange(N_SOLUTIONS), dtype=np.float64)
    compliance = _dashpot_compliance(test, flow, log_rates)
    solved = np.isfinite(compliance)
    known = np.log(np.maximum(compliance[solved], LEAST_SHARE * wanted))
    line = make_interp_spline(log_rates[solved], known, k=1)
    return log_rates, np.asarray(line(log_rates), dtype=np.float64)


def _dashpot_compliance(
    test: AtMode[OscillationExperiment], flow: int, log_rates: FloatArray
) -> FloatArray:
    """Loss compliance (1/Pa) of the dashpot at the mode with other flow rates; nan: unsolved."""
    prepared = test.experiment.prepared
    points = np.tile(np.append(test.mode.coordinate, test.mode.driving_error), (log_rates.size, 1))
    points[:, flow] = test.coordinates.of_quantity(flow, log_rates)
    grids = likelihood_of(test.experiment).grid_block([test.experiment], [prepared.time])
    solved, found = test.generated_at(points, **grids)
    if solved.sum() < min(2, log_rates.size):
        raise ChartUnsuited("there is no solution at flow rates near that of the mode")
    rate, stress = fundamentals(
        prepared.time,
        np.array([found["grid_dashpot_rate"][0], found["grid_stress"][0]]),
        period=prepared.period,
        degree=prepared.stress_fit.degree,
    )
    compliance = np.full(log_rates.size, np.nan)
    compliance[solved] = (rate / stress).real * prepared.period / (2 * np.pi)
    return compliance


def _log_width(test: AtMode[OscillationExperiment], flow: int, curvature: FloatArray) -> float:
    """Ln of the width (1/s) that the posterior leaves to the flow rate, given what shifts it."""
    coordinates = test.coordinates
    shifting = [k for k, name in enumerate(coordinates.parameters) if name in SHIFTED_BY]
    others = [k for k in range(len(curvature)) if k not in shifting]
    given_shifts = curvature[np.ix_(others, others)]
    if np.linalg.eigvalsh(given_shifts)[0] <= 0:
        return -np.inf
    variance = np.linalg.inv(given_shifts)[others.index(flow), others.index(flow)]
    log_rate = coordinates.value(flow, test.mode.coordinate[flow])
    return float(log_rate + np.log(variance) / 2 + np.log(coordinates.scale[flow]))


def _flow_slope(
    test: AtMode[OscillationExperiment], flow: int, likelihood: FloatArray
) -> FloatArray:
    """Slopes of `ShearedReference` at the mode; `likelihood` is the curvature that data add."""
    coordinates, mode = test.coordinates, test.mode
    if likelihood[flow, flow] < LEAST_INFORMATION:
        return UNINFORMED_SLOPE
    slope = -likelihood[flow] / likelihood[flow, flow] * coordinates.scale[flow]
    by_parameter = {
        name: slope[coordinates.parameters.index(name)] / _derivative(coordinates, name, mode)
        for name in SHIFTED_BY
        if name in coordinates.parameters
    }
    growth = test.generated()
    # Of p ln(d/d_0); zero where the flow law or the piezometer leaves nothing to grow.
    of_growth = mode.values["grain_size_exponent"] * float(growth["typical_growth_slope"][0])
    by_n, by_p, by_strain = (by_parameter.get(name, 0.0) for name in SHIFTED_BY)
    by_growth = by_strain / of_growth if of_growth != 0 else 0.0
    return np.array([by_n, by_p - by_growth * float(growth["typical_growth"][0]), by_growth])


def _derivative(coordinates: PlainCoordinates, name: str, mode: Mode) -> float:
    """Return the derivative of a parameter by its plain coordinate at the mode."""
    k = coordinates.parameters.index(name)
    value, lower, upper = mode.values[name], coordinates.lower[k], coordinates.upper[k]
    if np.isinf(lower):
        return float(coordinates.scale[k])
    if np.isinf(upper):
        return float(value - lower)
    return float((value - lower) * (upper - value) / (upper - lower))


TYPICAL_FLOW_RATE = 0.1
"""Origin of the sampled flow rate over the root mean square of the driving strain rate."""


START_MARGIN = 1e-3
"""Periods by which a record starts ahead of its first reading, so that the solver can start."""


PATH_TIMES = 4001
"""Times at which the strain rate is read off for the path strain of a record."""


OUTPUTS_PER_CYCLE, PREDICTIONS_PER_CYCLE = 60, 30
"""Times in a cycle of a smooth curve, and of the predictive bands."""


class OscillationLikelihood(Likelihood[OscillationExperiment]):
    """Stresses are read along time."""

    name = "forced_oscillation"
    clock = Quantity("time", "time_s", "s", "s", 1.0)
    read = (STRESS,)
    response = STRESS
    reference = REFERENCE_FLOW_RATE_QUANTITY
    grid_quantities = grid_quantities(
        "oscillating_stress", "stress_replicated", "kelvin_strain", "grain_size", "dashpot_rate"
    )
    warmup = 250
    has_fast_solver = True
    target_acceptance = 0.95
    chart = ShearedChart()

    def reference_origin(self, experiment: OscillationExperiment) -> tuple[float, float]:
        """Origin and size of ln(flow rate s)."""
        prepared = experiment.prepared
        time = prepared.time if experiment.imposed is None else _path_times(experiment)
        rate = float(np.sqrt(np.mean(prepared.strain_rate(time) ** 2)))
        return float(np.log(TYPICAL_FLOW_RATE * rate)), 1.0

    def tests_block(
        self, experiments: Sequence[OscillationExperiment], priors: Sequence[PriorSet]
    ) -> StanData:
        """Return the block `stan/data/forced_oscillation.stan`, with records of `sheared.stan`."""
        records = [_record(experiment) for experiment in experiments]
        entries = {name: [record[name] for record in records] for name in records[0]}
        return {
            "n_harmonics": N_HARMONICS,
            "n_background": max(one.shape[1] for one in entries["background"]),
            "error_end": ends(map(len, entries["strain_error"])),
            "n_trend": [one.shape[1] for one in entries["trend_shape"]],
            **{name: _of_all(values) for name, values in entries.items()},
        }

    def grid_block(
        self, experiments: Sequence[OscillationExperiment], grids: Sequence[FloatArray]
    ) -> StanData:
        """Return the times at which the solutions are reported apart from the observed ones."""
        shapes, times = [], []
        for experiment, grid in zip(experiments, grids, strict=True):
            prepared = experiment.prepared
            shape = prepared.stress_fit.trend_shape(grid)
            shapes.append(shape if prepared.background == "removed" else shape[:, :0])
            times.append(grid / prepared.period)
        return {
            "grid_end": ends(grid.size for grid in grids),
            "grid_tau": _of_all(times),
            "grid_trend_shape": _of_all(shapes),
        }

    def grid(self, experiment: OscillationExperiment, *, fine: bool = False) -> FloatArray:
        """Return evenly spaced times (s) from the start of a record, or of imposed cycles."""
        (start, end), period = experiment.span, experiment.prepared.period
        per_cycle = OUTPUTS_PER_CYCLE if fine else PREDICTIONS_PER_CYCLE
        return np.linspace(start, end, round(per_cycle * (end - start) / period) + 1)

    def along(self, experiment: OscillationExperiment) -> dict[str, tuple[FloatArray, str]]:
        """Return driving strains, times, and stated errors of the stress readings."""
        prepared = experiment.prepared
        return {
            "strain": (prepared.strain(prepared.time), "1"),
            **super().along(experiment),
            "reading_error": (prepared.uncertainty, "Pa"),
        }

    def reading_noise(
        self,
        experiment: OscillationExperiment,
        values: Mapping[str, FloatArray],
        solved: FloatArray,
    ) -> FloatArray:
        """Return the size of the noise for each reading, by its stated error."""
        noise = super().reading_noise(experiment, values, solved)
        return np.asarray(noise * experiment.prepared.relative_uncertainty)


def _of_all(values: Sequence[Any]) -> list[Any]:
    """Return an entry of all tests; arrays are joined, and their rows have zeros behind them."""
    if not isinstance(values[0], np.ndarray):
        return list(values)
    if values[0].ndim > 1:
        width = max(one.shape[1] for one in values)
        values = [np.pad(one, ((0, 0), (0, width - one.shape[1]))) for one in values]
    joined: list[Any] = np.concatenate(values).tolist()
    return joined


def _record(experiment: OscillationExperiment) -> dict[str, Any]:
    """Entries of the blocks for one test; those that differ in size between tests are arrays."""
    prepared = experiment.prepared
    strain, period = prepared.strain_fit, prepared.period
    kept = prepared.background == "kept"
    first_tau = prepared.start / period - START_MARGIN
    sine, cosine = strain.sine[0], strain.cosine[0]
    # The oscillation passes upwards through zero where tau + phase is a whole number. A zero at the
    # first reading, whatever the rounding, is the last one: spin-up cycles are counted from there.
    phase = float(np.arctan2(cosine, sine)) / (2 * np.pi)
    last_zero = float(np.floor(prepared.start / period + START_MARGIN + phase))
    trend_shape = np.empty((prepared.time.size, 0))
    trend_fit = trend_shape.T
    bias = float(prepared.stress_fit.trend(np.array([prepared.start]))[0])
    amplitude = float(prepared.stress_fit.amplitude()[0])
    lag = prepared.stress_fit.phase()[0] - strain.phase()[0]
    compliance = float(np.hypot(sine, cosine)) / amplitude
    harmonics_error, background_error = np.split(prepared.strain_error, [2 * N_HARMONICS], axis=1)
    background = prepared.background_rate * period
    background_error = background_error * period
    if not kept:
        background, background_error = background[:0], background_error[:, :0]
        degree, uncertainty = prepared.stress_fit.degree, prepared.uncertainty
        trend_shape, trend_fit = trend_projection(
            prepared.time, degree=degree, uncertainty=uncertainty
        )
    time = _path_times(experiment)
    path_strain = float(trapezoid(np.abs(prepared.strain_rate(time)), time))
    return {
        "period": period,
        "strain_sine": strain.sine.tolist(),
        "strain_cosine": strain.cosine.tolist(),
        "background": background[np.newaxis],
        "background_range": [strain.t_middle / period, strain.t_half / period],
        "strain_error": np.hstack([harmonics_error, background_error]),
        "start_tau": last_zero - phase - experiment.spin_up_cycles,
        "start_stress": prepared.start_stress,
        "first_tau": first_tau,
        "stress_scale": max(amplitude, abs(bias)) if kept else amplitude,
        "strain_scale": float(np.hypot(sine, cosine)),
        "storage_compliance": compliance * float(np.cos(lag)),
        "loss_compliance": compliance * float(np.sin(lag)),
        "typical_path_strain": 0.5 * path_strain,
        "stress_observed": experiment.stress,
        "tau": prepared.time / period,
        "relative_noise": prepared.relative_uncertainty,
        "trend_shape": trend_shape,
        "trend_fit": trend_fit.T,
    }


def _path_times(experiment: OscillationExperiment) -> FloatArray:
    return np.linspace(experiment.prepared.start, experiment.end, PATH_TIMES)


LIKELIHOOD = OscillationLikelihood()
