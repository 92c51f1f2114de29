"""Draws without likelihood beside their priors."""

import json
from contextlib import closing
from pathlib import Path

import arviz as az
import numpy as np
from scipy import stats

from pyburgers.cmdstan.draw_files import Draws, read_draws
from pyburgers.cmdstan.program import Program
from pyburgers.common.processes import side_by_side
from pyburgers.kinds.stan_data import StanData
from pyburgers.model.parameters import PLACE
from pyburgers.model.priors import PriorSet

FAMILY_WISE_LEVEL = 1e-3
SAMPLER = ("num_warmup=500", "algorithm=hmc", "metric=dense_e", "adapt", "delta=0.9")
"""CmdStan's defaults else: no metric, start or coordinates of ours."""


def sampled(program: Program, data: StanData, folder: Path, *, draws: int, thin: int) -> Draws:
    """Sample four chains from the origin, two side by side."""
    data_file = folder / "data.json"
    data_file.write_text(json.dumps(data), encoding="utf-8")
    outputs = [folder / f"draws_{chain}.csv" for chain in range(1, 5)]
    starting = (
        program.start(
            ["method=sample", f"num_samples={draws}", f"thin={thin}", *SAMPLER],
            data=data_file,
            init=0,
            output=output,
            seed=20,
            chain=chain,
            digits=12,
        )
        for chain, output in enumerate(outputs, start=1)
    )
    with closing(side_by_side(starting, at_once=2)) as looks:
        for _, ended in looks:
            for one in ended:
                assert not one.failed, one.console_tail()
    return read_draws(outputs)


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
    sample = sampled(program, data, folder, draws=draws, thin=thin)
    parameters = sample.dataset(["parameter"])["parameter"].isel(parameter_dim_0=0)
    for name in priors.free:
        values = parameters.isel(parameter_dim_1=PLACE[name] - 1).to_dataset(name=name)
        size = az.ess(values)[name].item()
        assert size > least_size, name
        step = int(np.ceil(values[name].size / size))
        independent = values[name].to_numpy().ravel()[::step]
        p_value = stats.kstest(independent, priors[name].distribution().cdf).pvalue
        assert p_value > FAMILY_WISE_LEVEL / len(priors.free), name
