"""What is known of a made-up fit before its data: draws of its priors, weighed as a test wants."""

import numpy as np
import xarray as xr
from maor.before_data import Knowledge

from pyburgers.common.array_types import FloatArray
from pyburgers.common.draws import all_draws
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.prior_draws import PriorDraws


def make_known(
    fit: Fit, *, n_draws: int = 400, weights: FloatArray | None = None, **changed: FloatArray
) -> Knowledge:
    """Return what is known of a fit, with solutions of the fit in place of those of the prior.

    Draws, shape (n_draws,), weigh the same unless `weights` are given. `changed` are draws of
    parameters, or solutions of shape (n_draws, n_grid), that are not those of the prior.
    """
    rng = np.random.default_rng(3)
    posterior, predictions = (
        fit.posterior[group].to_dataset() for group in ("posterior", "predictions")
    )
    values = {
        name: np.full(n_draws, prior.location)
        if prior.is_fixed
        else prior.distribution().rvs(size=n_draws, random_state=rng)
        for name, prior in fit.priors.priors.items()
    }
    grid = {
        name: rng.choice(all_draws(variable), n_draws) for name, variable in predictions.items()
    }
    for name, draws in changed.items():
        (grid if name in grid else values)[name] = draws
    clock = next(str(name) for name in predictions.dims if name not in ("chain", "draw"))
    labels = {"chain": [1], "draw": np.arange(n_draws)}
    groups = {
        "posterior": xr.Dataset(
            {
                name: (("chain", "draw"), draws[None])
                for name, draws in values.items()
                if name in posterior
            },
            labels,
        ),
        "predictions": xr.Dataset(
            {name: (("chain", "draw", clock), draws[None]) for name, draws in grid.items()},
            {**labels, clock: predictions[clock]},
        ),
    }
    prior = PriorDraws(fit.experiment, fit.priors, xr.DataTree.from_dict(groups), 0)
    return Knowledge(fit, prior, np.full(n_draws, 1 / n_draws) if weights is None else weights)
