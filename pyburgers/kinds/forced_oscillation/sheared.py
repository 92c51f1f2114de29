"""Set-up of the sheared coordinates (`stan/charts/sheared.stan`).

Everything comes from the posterior mode and the curvature there; only the speed of a run depends
on it, not its result.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt
from scipy.interpolate import make_interp_spline

from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.forced_oscillation.harmonics import fundamentals
from pyburgers.kinds.likelihood import AtMode, Chart, ChartUnsuited, likelihood_of
from pyburgers.kinds.stan_data import Layout, Mode, PlainCoordinates, StanData
from pyburgers.model.prior_families import Prior

FloatArray = npt.NDArray[np.float64]

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
    `first_log_rate`: ln(flow rate s) of the first solution, those of the others follow in
        `LOG_RATE_STEP`.
    `log_dashpot_compliance` (N_SOLUTIONS,): ln of the dashpot's loss compliance (1/Pa) in the
        solutions.
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
        """Set the shifts so that the flow rate is as independent of n, p and epsilon_c1 as can be.

        Return slopes of the flow rate, zero shift at the mode and the dashpot's compliance at other
        rates; and the sheared coordinates of the mode, (n_coordinates,).
        """
        priors, coordinates = test.priors, test.coordinates
        replaced = coordinates.replaced_parameter
        if replaced is None:
            raise ChartUnsuited("neither Q_M nor beta leaves its place to the flow rate")
        beta = priors["beta"]
        if replaced == "activation_enthalpy" and not beta.is_fixed:
            for prior in (beta, priors[replaced]):
                if not _is_unbounded_normal(prior):
                    raise ChartUnsuited(
                        f"the prior of {prior.parameter} is not an unbounded normal"
                    )
        if test.data["storage_compliance"][0] <= 0 or test.data["loss_compliance"][0] <= 0:
            raise ChartUnsuited("the observed stress is not ahead of the strain by 0 to 90 degrees")
        flow = coordinates.parameters.index(replaced)
        wanted = STRETCHED_FROM * test.data["loss_compliance"][0]
        log_rates, log_compliance = _dashpot_at_other_rates(test, flow, wanted)
        seen_from = float(
            np.interp(np.log(wanted), np.maximum.accumulate(log_compliance), log_rates)
        )
        curvature = test.curvature()
        reference = ShearedReference(
            _flow_slope(test, flow, curvature - test.curvature(use_likelihood=0)),
            np.array([test.mode.values[name] for name in SHIFTED_BY]),
            max(seen_from, _log_width(test, flow, curvature)),
            float(log_rates[0]),
            log_compliance,
        )
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
    """Ln of the width (1/s) that the posterior leaves to the flow rate; `flow` is its place.

    That of the Laplace approximation, given the parameters that shift the flow rate; -inf where the
    curvature is none of a mode.
    """
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
    """Slopes of `ShearedReference` at the mode, from the flow rate's place.

    `likelihood` is what the likelihood adds to the curvature of minus the log density.
    """
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
    by_growth = (
        by_parameter.get("critical_strain_grain_size", 0.0) / of_growth if of_growth != 0 else 0.0
    )
    by_exponent = by_parameter.get("grain_size_exponent", 0.0)
    return np.array(
        [
            by_parameter.get("stress_exponent", 0.0),
            by_exponent - by_growth * float(growth["typical_growth"][0]),
            by_growth,
        ]
    )


def _is_unbounded_normal(prior: Prior) -> bool:
    return prior.family == "normal" and bool(np.isinf([prior.lower, prior.upper]).all())


def _derivative(coordinates: PlainCoordinates, name: str, mode: Mode) -> float:
    """Return the derivative of a parameter by its plain coordinate at the mode."""
    k = coordinates.parameters.index(name)
    value, lower, upper = mode.values[name], coordinates.lower[k], coordinates.upper[k]
    if np.isinf(lower):
        return float(coordinates.scale[k])
    if np.isinf(upper):
        return float(value - lower)
    return float((value - lower) * (upper - value) / (upper - lower))
