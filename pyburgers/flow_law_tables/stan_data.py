"""A table of peak stresses and priors -> the data of `stan/peak_stress.stan`."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pyburgers.flow_law_tables.inputs import FLOW_LAW_PARAMETERS, PeakStressData
from pyburgers.model.parameters import REFERENCE_FLOW_RATE_QUANTITY
from pyburgers.model.priors import PriorSet
from pyburgers.protocols.stan_data import (
    PlainCoordinates,
    StanData,
    coordinates_through,
    prior_block,
)

FloatArray = npt.NDArray[np.float64]

GROUP_TEMPERATURES = 2.0
"""Widest gap (K) between sorted temperatures of tests that are drawn together."""

GRID_STRESSES = 30
"""Stresses at which each group's flow law is drawn."""

GRID_MARGIN = 1.3
"""Factor by which the drawn stresses reach beyond those of a group."""


@dataclass(frozen=True, eq=False)
class Group:
    """Tests at one grain size and about one temperature, which share a line of the flow law.

    Attributes
    ----------
    points : array of int, shape (n,)
        Positions in the table.
    temperature, grain_size : float
        Harmonic mean (K), and grain size (m).
    stress : array, shape (GRID_STRESSES,)
        Stresses (Pa) at which the line is drawn.
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


def peak_stress_coordinates(data: PeakStressData, priors: PriorSet) -> PlainCoordinates:
    """Choose origin and size of every free parameter and what the flow rate replaces.

    The flow rate at the mean conditions replaces Q_M, or beta, unless both are fixed or have two
    finite bounds (`pyburgers.protocols.stan_data.coordinates_through`).
    """
    origin = float(np.mean(np.log(data.strain_rate)))
    return coordinates_through(priors, REFERENCE_FLOW_RATE_QUANTITY, origin, 1.0)


def peak_stress_data(
    data: PeakStressData, priors: PriorSet, *, use_likelihood: bool = True
) -> StanData:
    """Return all data of `stan/peak_stress.stan`.

    Parameters
    ----------
    data : PeakStressData
        The table.
    priors : PriorSet
        Priors of `pyburgers.flow_law_tables.inputs.FLOW_LAW_PARAMETERS` in SI.
    use_likelihood : bool
        False gives the prior.
    """
    coordinates = peak_stress_coordinates(data, priors)
    place = {p.name: k for k, p in enumerate(FLOW_LAW_PARAMETERS, start=1)}
    mean = data.mean_conditions
    lines = groups(data)
    return {
        "n_points": data.n_points,
        "temperature": data.temperature.tolist(),
        "stress": data.stress.tolist(),
        "strain_rate": data.strain_rate.tolist(),
        "grain_size": data.grain_size.tolist(),
        "relative_stress_uncertainty": data.relative_stress_uncertainty.tolist(),
        "mean_temperature": mean.temperature,
        "mean_stress": mean.stress,
        "mean_grain_size": mean.grain_size,
        "use_likelihood": int(use_likelihood),
        **prior_block(priors, FLOW_LAW_PARAMETERS),
        "n_coordinates": len(coordinates.quantities),
        "own_parameter": [place[name] for name in coordinates.parameters],
        "quantity": coordinates.quantity.tolist(),
        "replaced_parameter": place.get(coordinates.replaced_parameter or "", 0),
        "n_grid": len(lines) * GRID_STRESSES,
        "grid_temperature": np.repeat([g.temperature for g in lines], GRID_STRESSES).tolist(),
        "grid_stress": np.concatenate([g.stress for g in lines]).tolist(),
        "grid_grain_size": np.repeat([g.grain_size for g in lines], GRID_STRESSES).tolist(),
    }
