"""Draws without likelihood beside their priors."""

from pathlib import Path

import arviz as az
import numpy as np
from default_chains import sampled
from scipy import stats

from pyburgers.cmdstan.program import Program
from pyburgers.kinds.stan_data import StanData
from pyburgers.model.parameters import PLACE
from pyburgers.model.priors import PriorSet

FAMILY_WISE_LEVEL = 1e-3


def assert_prior_marginals(
    program: Program,
    data: StanData,
    priors: PriorSet,
    folder: Path,
    *,
    draws: int,
    least_size: int,
    thin: int = 1,
) -> None:
    """Sample and compare every marginal with its prior (Kolmogorov-Smirnov)."""
    sample = sampled(
        program,
        data,
        folder,
        chains=4,
        seed=20,
        warmup=500,
        draws=draws,
        thin=thin,
        algorithm=("metric=dense_e", "adapt", "delta=0.9"),
    )
    parameters = sample.dataset(["parameter"])["parameter"].isel(parameter_dim_0=0)
    for name in priors.free:
        values = parameters.isel(parameter_dim_1=PLACE[name] - 1).to_dataset(name=name)
        size = az.ess(values)[name].item()
        assert size > least_size, name
        step = int(np.ceil(values[name].size / size))
        independent = values[name].to_numpy().ravel()[::step]
        p_value = stats.kstest(independent, priors[name].distribution().cdf).pvalue
        assert p_value > FAMILY_WISE_LEVEL / len(priors.free), name
