"""What the plain coordinates of a test stand for, from its priors."""

import numpy as np

from pyburgers.kinds.stan_data import PlainCoordinates
from pyburgers.model.parameters import Parameter
from pyburgers.model.priors import PriorSet


def coordinates_through(
    priors: PriorSet, reference: Parameter, origin: float, size: float
) -> PlainCoordinates:
    """Choose plain coordinates of free parameters, a point of the flow law among them.

    It replaces Q_M, or beta if two finite bounds of Q_M would cut the replaced one obliquely.
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
