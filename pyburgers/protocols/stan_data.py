"""What the data of every Stan program have in common: priors, coordinates, options of the solver.

This module, `program_data` beside it and the `stan_data` of each protocol and of tables of peak
stresses are the only ones that know the data blocks in `stan/data/` and of the programs.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import logit

from pyburgers.common.errors import InputError
from pyburgers.model.flow_law_prior import FlowLawPrior
from pyburgers.model.parameters import (
    REFERENCE_FLOW_RATE_QUANTITY,
    REFERENCE_QUANTITIES,
    REFERENCE_STRESS_QUANTITY,
    Parameter,
)
from pyburgers.model.priors import FLOW_LAW, PriorSet

FloatArray = npt.NDArray[np.float64]
StanData = dict[str, Any]

FAMILY_CODE = {"fixed": 0, "uniform": 1, "normal": 2, "half_normal": 2, "lognormal": 3}
"""Codes of `stan/statistics/priors.stan`; a half-normal is a normal cut at zero."""

PART_OF_FLOW_LAW = 4
"""Code of a parameter whose density is in the joint prior of the flow law."""

REFERENCE_STRESS = REFERENCE_STRESS_QUANTITY.name
"""Name of the coordinate ln S_0 that replaces Q_M or beta."""

REFERENCE_FLOW_RATE = REFERENCE_FLOW_RATE_QUANTITY.name
"""Name of the coordinate ln(flow rate s) that replaces Q_M or beta in oscillating tests."""

PLAIN, CHART = 1, 2
"""Codes of the coordinate systems: each program has plain ones and the chart of its protocol."""


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
    """Real-line coordinates of the free parameters, as in `stan/charts/plain.stan`.

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

    @property
    def quantity(self) -> FloatArray:
        """Rows of shift, scale, lower and upper bound, shape (n_coordinates, 4)."""
        return np.column_stack([self.shift, self.scale, self.lower, self.upper])

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


def prior_block(priors: PriorSet, parameters: Sequence[Parameter]) -> StanData:
    """Return the priors of a program's parameters, in its order."""
    ordered = [priors[parameter.name] for parameter in parameters]
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


def solver_block(solver: SolverOptions) -> StanData:
    """Return the block `stan/data/solver.stan`."""
    return {"tolerance": solver.tolerance, "max_num_steps": solver.max_num_steps}


def ends(sizes: Iterable[int]) -> list[int]:
    """Return where the parts of a ragged array end, after a leading 0."""
    return list(accumulate(sizes, initial=0))
