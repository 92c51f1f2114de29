"""Joint problem -> data of `stan/constant_rate.stan` with further experiments."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
import numpy.typing as npt

from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment
from pyburgers.protocols.stan_data import (
    SolverOptions,
    StanData,
    ValleyReference,
    constant_rate_data,
    experiment_block,
    grid_block,
    prior_block,
    valley_block,
)
from pyburgers.sampling.problem import JointProblem

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

CENTRE, SPREAD = "centre", "spread"
"""Owners of the coordinates that belong to no test."""

PRIOR_NUMBERS = ("prior_location", "prior_scale", "prior_lower", "prior_upper")
"""Entries of the block `stan/data/priors.stan` that can differ between tests."""


@dataclass(frozen=True, eq=False)
class JointCoordinates:
    """Which coordinate of a joint fit stands for what.

    Attributes
    ----------
    names : tuple of str
        Parameters with a coordinate in every test by itself.
    position : array of int, shape (n_experiments, n_names)
        Where the coordinate of each parameter of each test stands, from 0; that of a shared
        parameter is the same in all tests.
    partial : tuple of str
        Partially pooled parameters.
    centre, spread : array of int, shape (n_partial,)
        Where their centres and spreads stand.
    """

    names: tuple[str, ...]
    position: IntArray
    partial: tuple[str, ...]
    centre: IntArray
    spread: IntArray

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return int(self.position.max(initial=-1)) + 1 + 2 * len(self.partial)


def joint_coordinates(problem: JointProblem) -> JointCoordinates:
    """Lay the coordinates out: the first test's, the other tests' own ones, centres, spreads."""
    names = problem.free
    position = np.zeros((len(problem.experiments), len(names)), dtype=np.int64)
    position[0] = np.arange(len(names))
    following = len(names)
    for e in range(1, len(problem.experiments)):
        for i, name in enumerate(names):
            position[e, i] = i if name in problem.shared else following
            following += name not in problem.shared
    n_partial = len(problem.partial)
    centre = following + np.arange(n_partial)
    return JointCoordinates(names, position, problem.partial, centre, centre + n_partial)


@dataclass(frozen=True, eq=False)
class JointValley:
    """References of the valley coordinates of a joint fit.

    Attributes
    ----------
    tests : tuple of ValleyReference
        One for each test; the coordinates of partially pooled parameters are the real numbers
        behind them.
    pooling : array, shape (2 * n_partial,)
        Centres at the reference point, then ln(spread/scale).
    """

    tests: tuple[ValleyReference, ...]
    pooling: FloatArray


def joint_data(
    problem: JointProblem,
    *,
    solver: SolverOptions,
    use_likelihood: bool = True,
    valley: JointValley | None = None,
) -> StanData:
    """Return all data of `stan/constant_rate.stan` for a joint fit, without grid.

    Parameters
    ----------
    problem : JointProblem
        Tests, priors, pooling.
    solver : SolverOptions
        Tolerance and step limit.
    use_likelihood : bool
        False gives the prior.
    valley : JointValley, optional
        Sample in valley coordinates around these references; default plain coordinates.
    """
    data = constant_rate_data(
        problem.experiments[0],
        problem.priors[0],
        solver=solver,
        use_likelihood=use_likelihood,
    )
    layout = joint_coordinates(problem)
    coordinates = problem.coordinates[1:]
    further = problem.experiments[1:]
    priors = [prior_block(priors) for priors in problem.priors[1:]]
    return {
        **data,
        "n_further": len(further),
        **_ragged([experiment_block(e, use_likelihood=use_likelihood) for e in further]),
        **{f"further_{key}": [block[key] for block in priors] for key in PRIOR_NUMBERS},
        "n_further_coordinates": layout.size - len(layout.names),
        "further_position": (layout.position[1:] + 1).tolist(),
        **{
            f"further_quantity_{key}": [getattr(own, key).tolist() for own in coordinates]
            for key in ("shift", "scale", "lower", "upper")
        },
        "n_pooled": len(layout.partial),
        "pooled_coordinate": [layout.names.index(name) + 1 for name in layout.partial],
        "spread_scale": [problem.pooling.spread_scales[name] for name in layout.partial],
        **joint_valley_block(problem, valley),
        **further_grid_block(further, [np.empty(0)] * len(further)),
    }


def _ragged(blocks: Sequence[Mapping[str, Any]]) -> StanData:
    """Return what several blocks of single tests hold, under the names of further ones."""
    return {
        **{
            f"further_{key}": [block[key] for block in blocks]
            for key in ("temperature", "initial_grain_size")
        },
        **{
            f"n_further_{key}": [block[f"n_{key}"] for block in blocks]
            for key in ("segments", "strains", "points")
        },
        **{
            f"further_{key}": _joined(blocks, key)
            for key in (
                "segment_start",
                "segment_rate",
                "strain",
                "strain_of_point",
                "stress_observed",
            )
        },
        "n_further_strains_in_segment": _joined(blocks, "n_strains_in_segment"),
    }


def _joined(blocks: Sequence[Mapping[str, Any]], key: str) -> list[Any]:
    return list(chain.from_iterable(block[key] for block in blocks))


def further_grid_block(
    experiments: Sequence[ConstantRateExperiment], grids: Sequence[FloatArray]
) -> StanData:
    """Return the strains at which the solutions of further tests are reported."""
    blocks = [grid_block(e, grid) for e, grid in zip(experiments, grids, strict=True)]
    return {
        "n_further_grid": [block["n_grid"] for block in blocks],
        "further_grid_strain": _joined(blocks, "grid_strain"),
        "n_further_grid_in_segment": _joined(blocks, "n_grid_in_segment"),
    }


def with_joint_grid(
    data: StanData, experiments: Sequence[ConstantRateExperiment], grids: Sequence[FloatArray]
) -> StanData:
    """Return the data of a joint fit with other positions of the solutions.

    Parameters
    ----------
    data : dict
        Data of the program.
    experiments : sequence of ConstantRateExperiment
        All tests.
    grids : sequence of array
        Strains of each.
    """
    return {
        **data,
        **grid_block(experiments[0], grids[0]),
        **further_grid_block(experiments[1:], grids[1:]),
    }


def joint_valley_block(problem: JointProblem, valley: JointValley | None) -> StanData:
    """Return what the valley coordinates of all tests need; None keeps the plain ones."""
    n_further = len(problem.experiments) - 1
    if valley is None:
        blocks = [valley_block(None)] * n_further
        pooling = [0.0] * (2 * len(problem.partial))
        first = valley_block(None)
    else:
        first, *blocks = [valley_block(reference) for reference in valley.tests]
        pooling = valley.pooling.tolist()
    return {
        **first,
        "n_further_knots": [block["n_knots"] for block in blocks],
        "n_further_pins": [block["n_pins"] for block in blocks],
        **{
            f"further_{key}": _joined(blocks, key)
            for key in ("knot_time_step", "knot_stress", "pin_knot", "pin")
        },
        **{
            f"further_{key}": [block[key] for block in blocks]
            for key in ("reference_coordinate", "linear_from", "noise_exponent")
        },
        "pooling_reference": pooling,
    }
