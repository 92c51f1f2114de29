"""Modes of a posterior beside the highest one, among the ends of climbs."""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from typing import Any

import numpy as np

from pyburgers.cmdstan.program import Program
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import SamplingError
from pyburgers.kinds.stan_data import OtherMode, StanData
from pyburgers.sampling.laplace import laplace_metric

MAX_DEPTH = 12.0
"""Of the log density below the highest mode: from further below, no volume makes up for it."""

MIN_MODE_DISTANCE = 3.0
"""Distance of two ends, in standard deviations at the one, from which on they are two modes."""


def modes_beside_the_highest(
    model: Program, data: StanData, ends: Sequence[tuple[float, dict[str, FloatArray]]]
) -> list[tuple[float, dict[str, FloatArray]]]:
    """Return the modes among ends of climbs other than the first, which is the highest.

    The ends have log density and variables, the best first (`Program.ends`). Each mode is returned
    with ln of its weight over that of the highest, and the variables there.
    """
    (highest, at_highest), *others = ends
    candidates = [end for end in others if end[0] > highest - MAX_DEPTH]
    if not candidates:
        return []
    try:
        covariance = laplace_metric(model, data, _place(at_highest))
    except SamplingError:
        return []  # at the edge of where the solver has solutions nothing can be weighed against it
    known = [(_place(at_highest), covariance)]
    log_weight = highest + _log_volume(covariance)
    found: list[tuple[float, dict[str, FloatArray]]] = []
    for density, variables in candidates:
        place = _place(variables)
        if any(_distance(place, *mode) < MIN_MODE_DISTANCE for mode in known):
            continue
        # An end beside which the solver has no solution is no mode.
        with suppress(SamplingError):
            covariance = laplace_metric(model, data, place)
            known.append((place, covariance))
            found.append((density + _log_volume(covariance) - log_weight, variables))
    return found


def _place(variables: Mapping[str, FloatArray]) -> FloatArray:
    """Return the coordinates of an end."""
    return np.atleast_1d(variables["coordinate"])


def _log_volume(covariance: FloatArray) -> float:
    """Return ln of the volume around a mode, but for a constant."""
    return float(np.linalg.slogdet(covariance)[1]) / 2


def _distance(coordinate: FloatArray, mode: FloatArray, covariance: FloatArray) -> float:
    """Distance of an end from a mode in standard deviations there."""
    apart = coordinate - mode
    return float(np.sqrt(apart @ np.linalg.solve(covariance, apart)))


def modes_record(found: Iterable[OtherMode]) -> list[dict[str, Any]]:
    """Return other modes as the manifest of a run has them."""
    return [asdict(one) for one in found]


def recorded_modes(manifest: dict[str, Any], part: str | None) -> tuple[OtherMode, ...]:
    """Return the other modes that the manifest of a run notes, of one of its tests or all."""
    return tuple(
        OtherMode(
            one["log_weight"],
            one["values"] if part is None else {part: one["values"][part]},
        )
        for one in manifest.get("other_modes", [])
    )
