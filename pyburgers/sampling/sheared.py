"""Set-up of the sheared coordinates (`stan/functions/sheared_coordinates.stan`).

Everything comes from the posterior mode and the curvature there; only the speed of a run depends
on it, not its result.
"""

import numpy as np
import numpy.typing as npt

from pyburgers.cmdstan.program import Program
from pyburgers.model.priors import Prior, PriorSet
from pyburgers.protocols.stan_data import (
    PLAIN,
    PlainCoordinates,
    ShearedReference,
    StanData,
    sheared_block,
)
from pyburgers.sampling.metric import curvature_at
from pyburgers.sampling.mode import Mode

FloatArray = npt.NDArray[np.float64]

LEAST_INFORMATION = 10.0
"""Curvature of the log likelihood along ln(flow rate s) below which its slopes say nothing."""

SHIFTED_BY = ("stress_exponent", "grain_size_exponent", "critical_strain_grain_size")
"""Parameters whose values shift the flow rate."""

UNINFORMED_SLOPE = np.array([0.0, 0.0, 1.0])
"""The flow at the grain size half way through the record, whatever n."""


class ShearedUnsuited(Exception):  # noqa: N818 - an outcome with a reason, not an error
    """The sheared coordinates do not apply; the message says why."""


def find_sheared(
    model: Program,
    data: StanData,
    priors: PriorSet,
    coordinates: PlainCoordinates,
    mode: Mode,
) -> tuple[ShearedReference, FloatArray]:
    """Set the shifts so that the flow rate is as independent of n, p and epsilon_c1 as can be.

    Parameters
    ----------
    model : Program
        The program for oscillating tests.
    data : dict
        Its data in plain coordinates.
    priors : PriorSet
        Resolved priors.
    coordinates : PlainCoordinates
        What the plain coordinates stand for.
    mode : Mode
        The posterior mode.

    Returns
    -------
    ShearedReference
        Slopes of the flow rate, zero shift at the mode.
    array, shape (n_coordinates,)
        Sheared coordinates of the mode.

    Raises
    ------
    ShearedUnsuited
        If the priors or the record do not fit the coordinates.
    """
    replaced = coordinates.replaced_parameter
    if replaced is None:
        raise ShearedUnsuited("neither Q_M nor beta leaves its place to the flow rate")
    beta = priors["beta"]
    if replaced == "activation_enthalpy" and not beta.is_fixed:
        for prior in (beta, priors[replaced]):
            if not _is_unbounded_normal(prior):
                raise ShearedUnsuited(f"the prior of {prior.parameter} is not an unbounded normal")
    if data["storage_compliance"] <= 0 or data["loss_compliance"] <= 0:
        raise ShearedUnsuited("the observed stress is not ahead of the strain by 0 to 90 degrees")
    reference = ShearedReference(
        _flow_slope(model, data, coordinates, mode, coordinates.parameters.index(replaced)),
        np.array([mode.values[name] for name in SHIFTED_BY]),
    )
    block = {**data, **sheared_block(reference), "coordinate_system": PLAIN}
    centre = model.evaluate(block, _position(mode))["sheared_coordinate"]
    return reference, np.atleast_1d(centre)


def _flow_slope(
    model: Program,
    data: StanData,
    coordinates: PlainCoordinates,
    mode: Mode,
    flow: int,
) -> FloatArray:
    """Slopes of `ShearedReference` at the mode; `flow` is the flow rate's place."""
    likelihood = curvature_at(model, data, mode.coordinate) - curvature_at(
        model, {**data, "use_likelihood": 0}, mode.coordinate
    )
    if likelihood[flow, flow] < LEAST_INFORMATION:
        return UNINFORMED_SLOPE
    slope = -likelihood[flow] / likelihood[flow, flow] * coordinates.scale[flow]
    by_parameter = {
        name: slope[coordinates.parameters.index(name)] / _derivative(coordinates, name, mode)
        for name in SHIFTED_BY
        if name in coordinates.parameters
    }
    growth = model.evaluate(data, _position(mode))
    # Of p ln(d/d_0); zero where the flow law or the piezometer leaves nothing to grow.
    of_growth = mode.values["grain_size_exponent"] * float(growth["typical_growth_slope"])
    by_growth = (
        by_parameter.get("critical_strain_grain_size", 0.0) / of_growth if of_growth != 0 else 0.0
    )
    by_exponent = by_parameter.get("grain_size_exponent", 0.0)
    return np.array(
        [
            by_parameter.get("stress_exponent", 0.0),
            by_exponent - by_growth * float(growth["typical_growth"]),
            by_growth,
        ]
    )


def _position(mode: Mode) -> dict[str, object]:
    """Parameters block at the mode, in plain coordinates."""
    return {"coordinate": mode.coordinate.tolist()}


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
