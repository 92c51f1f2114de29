"""Data of Stan programs about tables of attenuation."""

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.table import ATTENUATION, CycleConditions, Elasticity
from pyburgers.kinds.stan_data import StanData, ends
from pyburgers.model.priors import PriorSet

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

FLOW_RATE_ORIGIN = 1e-7
"""Origin of the sampled flow rate (1/s): in cycles of a minute to an hour it is seen from there."""

QUADRATURE_HALF_WIDTH, QUADRATURE_STEPS = 3.2, 32
"""Of the double exponential rule on each part of half a period: good to 1e-12, kink or none."""

NO_ERROR = 1e-12
"""Stated error of a solution, which may have no scatter either: a normal law needs some width."""

NO_NODES = np.empty((0, 2))

AXIAL = Elasticity("axial")
"""Of a test that is no table, where it has no effect."""

OF_READINGS = ("reading", "quantity_of_point", "stated_error", "is_limit", "log_limit")
OF_GRID = (
    "grid_frequency",
    "grid_temperature",
    "grid_regime",
    "grid_quantity",
    "grid_stated_error",
)
"""Entries of the data that have a number for every reading, and for every one on the grid."""

NO_LIMIT = -1e3
"""ln(tan delta) that no reading is below."""


def reference_origin(experiment: AttenuationExperiment) -> tuple[float, float]:
    """Origin and size of ln(flow rate s)."""
    return float(np.log(FLOW_RATE_ORIGIN)), 1.0


def stress_nodes(median_stress: float, amplitude: float) -> FloatArray:
    """Return nodes and weights of the dashpot's fluidity (`stan/physics/stress_cycles.stan`).

    Half a period, from lowest to highest stress, is split where the stress changes sign, and each
    part takes the double exponential rule (Takahasi and Mori 1974, Publ. RIMS 9, 721-741), which
    does not mind the kink of a power law there. The result (n_nodes, 2): sin(omega t), and weights
    times 2/pi.
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
    """Return the data of `stan/attenuation.stan` about its tables."""
    return {"stress_scale": [e.largest_stress for e in experiments], **tables_block(experiments)}


def tables_block(tests: Sequence[AttenuationExperiment | None]) -> StanData:
    """Return the block `stan/data/attenuation.stan` without its grid.

    `tests`: None where a test is no table.
    """
    tables = [test for test in tests if test is not None]
    regimes = [_regimes(e.conditions) for e in tables]
    stresses = [
        e.elasticity.stress_factor * own for e, (own, _) in zip(tables, regimes, strict=True)
    ]
    nodes = [
        stress_nodes(median, amplitude) if amplitude > 0 else NO_NODES
        for own in stresses
        for median, amplitude in own
    ]
    regime_counts = iter([len(own) for own in stresses])
    points = [_points(e) for e in tables]
    return {
        "row_end": ends(0 if e is None else e.conditions.n_rows for e in tests),
        "frequency": _joined(2 * np.pi / e.conditions.period for e in tables),
        "row_temperature": _joined(e.conditions.temperature for e in tables),
        "regime_end": ends(0 if e is None else next(regime_counts) for e in tests),
        "median_stress": _joined(own[:, 0] for own in stresses),
        "amplitude": _joined(own[:, 1] for own in stresses),
        "node_end": ends(len(own) for own in nodes),
        "node": np.concatenate([NO_NODES, *nodes]).tolist(),
        "regime": [int(k) + 1 for _, of_rows in regimes for k in of_rows],
        "conversion": [list((AXIAL if e is None else e.elasticity).conversion) for e in tests],
        "reading_end": ends(0 if e is None else e.n_points for e in tests),
        **{name: [one for own in points for one in own[name]] for name in OF_READINGS},
        "log_reading_observed": _joined(e.response for e in tables),
    }


def grid_block(
    experiments: Sequence[AttenuationExperiment | None], grids: Sequence[FloatArray]
) -> StanData:
    """Return the readings that are reported apart from the observed ones.

    `experiments`: None where a test is no table.
    """
    found: dict[str, list[float] | list[int]] = {name: [] for name in OF_GRID}
    sizes = []
    for experiment, grid in zip(experiments, grids, strict=True):
        sizes.append(0 if experiment is None else grid.size)
        if experiment is None:
            continue
        conditions = experiment.conditions
        period, spectrum, quantity = conditions.at(grid)
        row = conditions.first_rows[spectrum]
        typical = [_typical_error(experiment, k) for k in (0, 1)]
        own = (
            2 * np.pi / period,
            conditions.temperature[row],
            _regimes(conditions)[1][row] + 1,
            quantity + 1,
            np.array(typical)[quantity],
        )
        for name, values in zip(OF_GRID, own, strict=True):
            found[name] += values.tolist()
    return {"reading_grid_end": ends(sizes), **found}


def _joined(parts: Iterable[FloatArray]) -> list[float]:
    return [float(one) for part in parts for one in part]


def _regimes(conditions: CycleConditions) -> tuple[FloatArray, IntArray]:
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
