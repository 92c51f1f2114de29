"""Groups of a table of peak stresses: tests that share a line of the flow law."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pyburgers.common.draws import FloatArray
from pyburgers.flow_law_tables.inputs import PeakStressData

GROUP_TEMPERATURES = 2.0
"""Widest gap (K) between sorted temperatures of tests that are drawn together."""

GRID_STRESSES = 30
"""Stresses at which each group's flow law is drawn."""

GRID_MARGIN = 1.3
"""Factor by which the drawn stresses reach beyond those of a group."""


@dataclass(frozen=True, eq=False)
class Group:
    """Tests at one grain size (m) and about one temperature (harmonic mean, K) on one line.

    Points (n,) are positions in the table; the line is drawn at GRID_STRESSES stresses (Pa).
    """

    points: npt.NDArray[np.int64]
    temperature: float
    grain_size: float
    stress: FloatArray


def groups(data: PeakStressData) -> tuple[Group, ...]:
    """Split a table by grain size, and by gaps of temperature wider than `GROUP_TEMPERATURES`."""
    found = []
    for grain_size in np.unique(data.grain_size):
        alike = np.flatnonzero(data.grain_size == grain_size)
        ordered = alike[np.argsort(data.temperature[alike], kind="stable")]
        gaps = np.flatnonzero(np.diff(data.temperature[ordered]) > GROUP_TEMPERATURES) + 1
        for points in np.split(ordered, gaps):
            stress = data.stress[points]
            found.append(
                Group(
                    points=points,
                    temperature=float(1 / np.mean(1 / data.temperature[points])),
                    grain_size=float(grain_size),
                    stress=np.geomspace(
                        stress.min() / GRID_MARGIN, stress.max() * GRID_MARGIN, GRID_STRESSES
                    ),
                )
            )
    return tuple(found)
