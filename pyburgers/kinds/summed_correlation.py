"""Grid over which programs sum how residuals correlate: the share w, and a strain or time.

Each is placed on a scale from 0 to 1 on which priors are alike, whatever their family.
`stan/statistics/summed_correlation.stan` has the sum.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.stats import norm

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.likelihood import correlated_blocks
from pyburgers.kinds.stan_data import StanData, ends
from pyburgers.model.parameters import CORRELATED_SHARE
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import PriorSet

CORRELATION = "residual_correlation"
"""Variable of the programs: strain or time and w of each test, drawn if they are summed over."""

N_SHARES, N_LENGTHS, N_CELLS = 12, 10, 24
"""Nodes of w and of the strain or time, and cells of each.

Beside the integral, the mean of ln s of 148 readings moves by at most 0.02 of its width, which is
0.99 to 1.02 times the integral's, where 30 to 99.5 % of the variance correlate."""

LARGEST_SCORE = 3.0
"""Standard normal score of a strain or time up to which its prior counts, on both sides."""

LEAST_LEFT = np.exp(-10.0)
"""Share of the prior of w above the last cells: 1 - w, if the prior is uniform up to 1."""

SHARE_POWER = 1.5
"""Power of its scale with which minus ln of the share of the prior above w grows."""


@dataclass(frozen=True, eq=False)
class _Axis:
    """One of the two on its scale: edges (n_cells + 1,), nodes (n_nodes,), and their spline.

    `spline` (n_cells, n_nodes): values at nodes to those at the middles of cells.
    """

    edge: FloatArray
    node: FloatArray
    spline: FloatArray


NO_SUM = _Axis(np.empty(0), np.empty(0), np.empty((0, 0)))
KNOWN = _Axis(np.array([0.5, 0.5]), np.array([0.5]), np.ones((1, 1)))


def blocks_block(experiments: Sequence[Experiment]) -> StanData:
    """Return the blocks of readings within which residuals correlate, by tests."""
    blocks = [correlated_blocks(experiment) for experiment in experiments]
    return {
        "block_end": ends(len(own) for own in blocks),
        "n_in_block": [size for own in blocks for size in own],
    }


def grid_block(experiment: Experiment, priors: Sequence[PriorSet], *, is_summed: bool) -> StanData:
    """Return the block `stan/data/summed_correlation.stan`, but for the blocks of readings.

    The first test says along what residuals correlate. The priors are those of each test.
    """
    shares = [own[CORRELATED_SHARE] for own in priors]
    lengths = [own[experiment.residual_correlation] for own in priors]
    share = _axis(N_SHARES, shares[0]) if is_summed else NO_SUM
    length = _axis(N_LENGTHS, lengths[0]) if is_summed else NO_SUM
    return {
        "n_shares": share.node.size,
        "n_lengths": length.node.size,
        "share_node": [_shares(prior, share.node).tolist() for prior in shares],
        "length_node": [_lengths(prior, length.node).tolist() for prior in lengths],
        "n_share_cells": len(share.spline),
        "n_length_cells": len(length.spline),
        "share_spline": share.spline.tolist(),
        "length_spline": length.spline.T.tolist(),
        "log_share_mass": _log_masses(1 - _left(share.edge)).tolist(),
        "log_length_mass": _log_masses(norm.cdf(_scores(length.edge))).tolist(),
        "share_edge": [_shares(prior, share.edge).tolist() for prior in shares],
        "log_length_edge": [np.log(_lengths(prior, length.edge)).tolist() for prior in lengths],
        "length_score": _scores(length.edge).tolist(),
    }


def _axis(n_nodes: int, prior: Prior) -> _Axis:
    """Return evenly spaced cells and nodes, or one for what is known."""
    if prior.is_fixed:
        return KNOWN
    edge = np.linspace(0.0, 1.0, N_CELLS + 1)
    middle = (edge[1:] + edge[:-1]) / 2
    node = np.linspace(middle[0], middle[-1], n_nodes)
    return _Axis(edge, node, np.asarray(CubicSpline(node, np.eye(n_nodes))(middle)))


def _left(place: FloatArray) -> FloatArray:
    """Return the share of the prior above w, 0 at the end of its scale."""
    return np.where(place < 1, LEAST_LEFT ** (place**SHARE_POWER), 0.0)


def _scores(place: FloatArray) -> FloatArray:
    """Return standard normal scores of a strain or time."""
    return LARGEST_SCORE * (2 * place - 1)


def _log_masses(below: FloatArray) -> FloatArray:
    """Return ln of the prior masses of cells, which add up to 1, from the shares below edges."""
    mass = np.diff(below) if below.size != 2 else np.ones(1)
    return np.asarray(np.log(mass / mass.sum()))


def _shares(prior: Prior, place: FloatArray) -> FloatArray:
    """Return w at places, of a prior that ends at 1."""
    if prior.is_fixed:
        return np.full(place.size, prior.location)
    law = prior.distribution()
    beyond = law.sf(1.0)
    return np.asarray(np.clip(law.isf(beyond + (1 - beyond) * _left(place)), 0.0, 1.0))


def _lengths(prior: Prior, place: FloatArray) -> FloatArray:
    """Return the correlation strain or time (SI) at places."""
    if prior.is_fixed:
        return np.full(place.size, prior.location)
    return np.asarray(prior.distribution().ppf(norm.cdf(_scores(place))))
