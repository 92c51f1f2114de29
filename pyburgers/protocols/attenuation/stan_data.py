"""Data of `stan/attenuation.stan` about its tables."""

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pyburgers.model.priors import PriorSet
from pyburgers.protocols.attenuation.experiment import AttenuationExperiment
from pyburgers.protocols.attenuation.table import ATTENUATION, Conditions
from pyburgers.protocols.stan_data import StanData, ends

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

FLOW_RATE_ORIGIN = 1e-7
"""Origin of the sampled flow rate (1/s): in cycles of a minute to an hour it is seen from there."""

QUADRATURE_HALF_WIDTH, QUADRATURE_STEPS = 3.2, 32
"""Of the double exponential rule on each part of half a period: good to 1e-12, kink or none."""

NO_ERROR = 1e-12
"""Stated error of a solution, which may have no scatter either: a normal law needs some width."""

NO_LIMIT = -1e3
"""ln(tan delta) that no reading is below."""


def reference_origin(experiment: AttenuationExperiment) -> tuple[float, float]:
    """Origin and size of ln(flow rate s)."""
    return float(np.log(FLOW_RATE_ORIGIN)), 1.0


def stress_nodes(median_stress: float, amplitude: float) -> FloatArray:
    """Return nodes and weights of the dashpot's fluidity (`stan/physics/stress_cycles.stan`).

    Half a period, from lowest to highest stress, is split where the stress changes sign, and each
    part takes the double exponential rule (Takahasi and Mori 1974, Publ. RIMS 9, 721-741), which
    does not mind the kink of a power law there.

    Parameters
    ----------
    median_stress, amplitude : float
        In one unit.

    Returns
    -------
    array, shape (n_nodes, 2)
        sin(omega t), and weights times 2/pi.
    """
    ratio = median_stress / amplitude
    edges = [-np.pi / 2, np.pi / 2]
    if ratio < 1:
        edges.insert(1, float(-np.arcsin(ratio)))
    t = QUADRATURE_HALF_WIDTH * np.linspace(-1.0, 1.0, 2 * QUADRATURE_STEPS + 1)
    inner = 0.5 * np.pi * np.sinh(t)
    x = np.tanh(inner)
    weight = 0.5 * np.pi * np.cosh(t) / np.cosh(inner) ** 2 * (t[1] - t[0])
    parts = [
        (0.5 * (low + high) + 0.5 * (high - low) * x, 0.5 * (high - low) * weight)
        for low, high in pairwise(edges)
    ]
    return np.concatenate(
        [np.column_stack([np.sin(angle), 2 / np.pi * own]) for angle, own in parts]
    )


def tests_block(
    experiments: Sequence[AttenuationExperiment], priors: Sequence[PriorSet]
) -> StanData:
    """Return the block `stan/data/attenuation.stan`."""
    regimes = [_regimes(e.conditions) for e in experiments]
    stresses = [
        e.elasticity.stress_factor * own for e, (own, _) in zip(experiments, regimes, strict=True)
    ]
    nodes = [
        stress_nodes(median, amplitude) if amplitude > 0 else np.empty((0, 2))
        for own in stresses
        for median, amplitude in own
    ]
    points = [_points(e) for e in experiments]
    return {
        "row_end": ends(e.conditions.n_rows for e in experiments),
        "frequency": _joined(2 * np.pi / e.conditions.period for e in experiments),
        "row_temperature": _joined(e.conditions.temperature for e in experiments),
        "regime_end": ends(len(own) for own in stresses),
        "median_stress": _joined(own[:, 0] for own in stresses),
        "amplitude": _joined(own[:, 1] for own in stresses),
        "node_end": ends(len(own) for own in nodes),
        "node": np.concatenate(nodes).tolist(),
        "regime": [int(k) + 1 for _, of_rows in regimes for k in of_rows],
        "conversion": [list(e.elasticity.conversion) for e in experiments],
        "stress_scale": [e.largest_stress for e in experiments],
        **{name: [one for own in points for one in own[name]] for name in points[0]},
        "log_reading_observed": _joined(e.response for e in experiments),
    }


def grid_block(
    experiments: Sequence[AttenuationExperiment], grids: Sequence[FloatArray]
) -> StanData:
    """Return the readings that are reported apart from the observed ones."""
    found = []
    for experiment, grid in zip(experiments, grids, strict=True):
        conditions = experiment.conditions
        period, spectrum, quantity = conditions.at(grid)
        row = conditions.first_rows[spectrum]
        typical = [_typical_error(experiment, k) for k in (0, 1)]
        found.append(
            {
                "grid_frequency": 2 * np.pi / period,
                "grid_temperature": conditions.temperature[row],
                "grid_regime": _regimes(conditions)[1][row] + 1,
                "grid_quantity": quantity + 1,
                "grid_stated_error": np.array(typical)[quantity],
            }
        )
    return {
        "grid_end": ends(grid.size for grid in grids),
        **{name: [one for own in found for one in own[name].tolist()] for name in found[0]},
    }


def _joined(parts: Iterable[FloatArray]) -> list[float]:
    return [float(one) for part in parts for one in part]


def _regimes(conditions: Conditions) -> tuple[FloatArray, IntArray]:
    """Stresses that rows have in common, shape (n, 2), and which each row has, from 0."""
    both = np.column_stack([conditions.median_stress, conditions.amplitude])
    found, places = np.unique(both, axis=0, return_inverse=True)
    return found, np.asarray(places).ravel()


def _points(experiment: AttenuationExperiment) -> dict[str, list[int] | list[float]]:
    """Entries of every reading: attenuations, then moduli."""
    readings, n_rows = experiment.readings, experiment.conditions.n_rows
    attenuations, moduli = readings.tan_delta.size, readings.modulus.size
    no_limit = np.full(moduli, NO_LIMIT)
    with np.errstate(divide="ignore"):  # no limit
        log_limit = np.maximum(np.log(readings.limit), NO_LIMIT)
    return {
        "reading": [*range(1, attenuations + 1), *range(n_rows + 1, n_rows + moduli + 1)],
        "quantity_of_point": [*[1] * attenuations, *[2] * moduli],
        "stated_error": [
            *readings.tan_delta_error.tolist(),
            *(readings.modulus_error / readings.modulus).tolist(),
        ],
        "is_limit": [*readings.is_limit.astype(int).tolist(), *[0] * moduli],
        "log_limit": np.concatenate([log_limit, no_limit]).tolist(),
    }


def _typical_error(experiment: AttenuationExperiment, quantity: int) -> float:
    """Median of the stated errors of tan delta, or of ln(modulus)."""
    readings = experiment.readings
    errors = (
        readings.tan_delta_error
        if quantity == ATTENUATION
        else readings.modulus_error / readings.modulus
    )
    return max(float(np.median(errors)), NO_ERROR) if errors.size else NO_ERROR
