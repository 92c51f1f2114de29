"""Data of `stan/constant_rate.stan` about its tests."""

from collections.abc import Sequence
from itertools import chain

import numpy as np
import numpy.typing as npt

from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.microstructure import measured_block, strains_of
from pyburgers.kinds.stan_data import StanData, ends
from pyburgers.model.prior_families import is_fixed_at
from pyburgers.model.priors import PriorSet

FloatArray = npt.NDArray[np.float64]

REFERENCE_STRESS_SCALE = 0.1
"""Scale of ln S_0: data fix it to about 0.01, the prior to about 1."""

LABORATORY_STRESS = 1e7
"""Origin of the reference stress (Pa) where nothing was observed."""

STEP_ROUNDING = 1e-12
"""Relative distance from a rate step below which a strain counts as the step."""


def reference_origin(experiment: ConstantRateExperiment) -> tuple[float, float]:
    """Origin and size of ln S_0: the largest observed stress."""
    stress = experiment.largest_stress if experiment.n_points > 0 else LABORATORY_STRESS
    return float(np.log(stress)), REFERENCE_STRESS_SCALE


def solver_strains(
    experiment: ConstantRateExperiment, strain: FloatArray
) -> tuple[FloatArray, list[int], npt.NDArray[np.int64]]:
    """Solver outputs for the wanted strains: increasing, rate steps included.

    A rate step is an output of the segment that ends there (the solver restarts from it). A strain
    that rounding puts beside a step counts as the step: the solver cannot start into so short a
    segment. Return `outputs` (n_outputs,): strains without repetition. Return `counts`: number of
    outputs in each segment. Return `positions` (n,): place of each wanted strain among the outputs,
    from 0.
    """
    steps = np.array([segment.start_strain for segment in experiment.segments[1:]])
    snapped = strain.copy()
    for step in steps:
        snapped[np.isclose(strain, step, rtol=STEP_ROUNDING, atol=0.0)] = step
    outputs = np.unique(np.concatenate([snapped, steps]))
    counts = np.bincount(experiment.segment_of(outputs), minlength=len(experiment.segments))
    return outputs, counts.tolist(), np.searchsorted(outputs, snapped)


def tests_block(
    experiments: Sequence[ConstantRateExperiment], priors: Sequence[PriorSet]
) -> StanData:
    """Return the block `stan/data/constant_rate.stan`."""
    outputs = [
        solver_strains(e, np.append(e.strain, strains_of(e.microstructure))) for e in experiments
    ]
    at_points, at_measured = (
        [places[part] for (_, _, places), part in zip(outputs, parts, strict=True)]
        for parts in (
            [slice(e.n_points) for e in experiments],
            [slice(e.n_points, None) for e in experiments],
        )
    )
    segments = [segment for e in experiments for segment in e.segments]
    return {
        "segment_end": ends(len(e.segments) for e in experiments),
        "segment_start": [segment.start_strain for segment in segments],
        "segment_rate": [segment.strain_rate for segment in segments],
        "strain_end": ends(strain.size for strain, _, _ in outputs),
        "strain": np.concatenate([strain for strain, _, _ in outputs]).tolist(),
        "n_strains_in_segment": list(chain.from_iterable(counts for _, counts, _ in outputs)),
        "strain_of_point": np.concatenate([places + 1 for places in at_points]).tolist(),
        "point_strain": np.concatenate(
            [strain[places] for (strain, _, _), places in zip(outputs, at_points, strict=True)]
        ).tolist(),
        "measured_end": ends(len(e.microstructure) for e in experiments),
        "strain_of_measured": np.concatenate([places + 1 for places in at_measured]).tolist(),
        "measured": measured_block([e.microstructure for e in experiments]),
        "point_segment": np.concatenate([e.reading_segment for e in experiments]).tolist(),
        "stress_observed": np.concatenate([e.stress for e in experiments]).tolist(),
        "correlated_residuals": int(
            not all(is_fixed_at(own["residual_correlation_strain"], 0.0) for own in priors)
        ),
    }


def grid_block(
    experiments: Sequence[ConstantRateExperiment], grids: Sequence[FloatArray]
) -> StanData:
    """Return the strains at which the solutions are reported apart from the observed ones.

    Rate steps are added to a grid, so that what comes back may be longer; an empty one stays so.
    """
    strains, counts, rates = [], [], []
    for experiment, grid in zip(experiments, grids, strict=True):
        strain, count, _ = solver_strains(experiment, grid)
        if grid.size == 0:
            strain, count = grid, [0] * len(experiment.segments)
        rate = np.array([segment.strain_rate for segment in experiment.segments])
        strains.append(strain)
        counts.append(count)
        rates.append(rate[experiment.segment_of(strain)])
    return {
        "grid_end": ends(strain.size for strain in strains),
        "grid_strain": np.concatenate(strains).tolist(),
        "grid_rate": np.concatenate(rates).tolist(),
        "n_grid_in_segment": list(chain.from_iterable(counts)),
    }
