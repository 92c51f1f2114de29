"""The paper's six-state form on the same data: a bounded run, extrapolated.

As printed, the posterior cannot be sampled in reasonable time: with CmdStan's defaults the
warm-up alone does not end in hours. The baseline is therefore given more than a user would have:
it starts at a posterior draw, with the dense metric of the posterior, both taken from the
product's finished fit, and adapts its step size only. What its warm-up costs is taken from the
first iterations of chains with CmdStan's defaults, started at posterior draws too.
"""

import json
import math
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from chain_files import read_chain
from processes import Cost, run_together

from pyburgers.cmdstan.compilation import compile_program
from pyburgers.common.messages import messages_to
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.stan_data import PlainCoordinates
from pyburgers.model.parameters import PARAMETERS
from pyburgers.model.priors import PriorSet

FloatArray = npt.NDArray[np.float64]

WARMUP = 8
"""Iterations of step-size adaptation."""

N_CHAINS = 2
WARMUP_SECONDS = 60.0
"""Time that the chains with CmdStan's defaults get."""

USUAL_LENGTH = 1000
"""Warm-up iterations, and draws, of the run that the extrapolation stands for."""


@dataclass(frozen=True)
class Baseline:
    """What the bounded run says.

    Attributes
    ----------
    ms_per_gradient : float
        At a posterior draw.
    cost : Cost
        Of the bounded run.
    draws : int
        Draws after the step-size adaptation, all chains together.
    seconds_per_draw, leapfrogs_per_draw : float
        Means over them; these and the following are unknown where there are none.
    seconds_per_warmup_iteration : float
        Of chains with CmdStan's defaults.
    divergences : int
        Among the draws.
    ess_per_draw_least, ess_per_draw_median : float
        Over the parameters; see `effective_draws()`.
    """

    ms_per_gradient: float
    cost: Cost
    draws: int = 0
    seconds_per_draw: float = math.nan
    leapfrogs_per_draw: float = math.nan
    seconds_per_warmup_iteration: float = math.nan
    divergences: int = 0
    ess_per_draw_least: float = math.nan
    ess_per_draw_median: float = math.nan


def run_baseline(fit: Fit, folder: Path, *, limit_seconds: float, seed: int) -> Baseline | None:
    """Run two chains of the six-state program side by side for a bounded time.

    Returns
    -------
    Baseline or None
        Without draws where no chain made two of them in time; None where the solver cannot even
        start at a posterior draw.
    """
    folder.mkdir(parents=True)
    source, names = _paper_form(fit)
    with messages_to(sys.stdout):
        program = compile_program(source)
    draws = fit.posterior["posterior"].to_dataset()
    values = {name: draws[name].to_numpy() for name in names}
    transform = _stan_transform(fit.priors, names)
    unconstrained = _unconstrained(transform, values)
    metric = folder / "metric.json"
    metric.write_text(json.dumps({"inv_metric": np.cov(unconstrained.T).tolist()}))
    data = ("data", f"file={fit.directory.stan_data_file}")
    commands, defaults = [], []
    for chain in range(1, N_CHAINS + 1):
        start = folder / f"start_{chain}.json"
        start.write_text(
            json.dumps({name: float(value[chain - 1, -1]) for name, value in values.items()})
        )
        tail = (*data, f"init={start}", "random", f"seed={seed}", "output", "refresh=1")
        commands.append(
            [
                *(str(program), "sample", f"num_warmup={WARMUP}", "num_samples=1000000"),
                *("adapt", "delta=0.8", "algorithm=hmc", "engine=nuts", "max_depth=10"),
                *("metric=dense_e", f"metric_file={metric}", "stepsize=0.002", f"id={chain}"),
                *(*tail, f"file={folder}/chain_{chain}.csv", "sig_figs=12"),
            ]
        )
        defaults.append(
            [
                *(str(program), "sample", "num_warmup=1000", "save_warmup=1", f"id={chain}"),
                *(*tail, f"file={folder}/warmup_{chain}.csv"),
            ]
        )
    cost = run_together(commands, limit_seconds=limit_seconds)
    chains = [read_chain(folder / f"chain_{c}.csv").draws for c in range(1, N_CHAINS + 1)]
    n_draws = sum(map(len, chains))
    try:
        ms_per_gradient = 1e3 * _seconds_per_gradient(commands[0], folder)
    except subprocess.CalledProcessError:
        return None
    if n_draws < N_CHAINS * 2:
        return Baseline(ms_per_gradient=ms_per_gradient, cost=cost)
    positions = [
        _unconstrained(transform, {name: chain[name].to_numpy() for name in names})
        for chain in chains
    ]
    leapfrogs = float(np.concatenate([chain["n_leapfrog__"] for chain in chains]).mean())
    run_together(defaults, limit_seconds=WARMUP_SECONDS)
    iterations = sum(
        len(read_chain(folder / f"warmup_{c}.csv").draws) for c in range(1, N_CHAINS + 1)
    )
    per_draw = effective_draws(positions, unconstrained.std(axis=0, ddof=1))
    return Baseline(
        draws=n_draws,
        seconds_per_draw=leapfrogs * ms_per_gradient / 1e3,
        leapfrogs_per_draw=leapfrogs,
        ms_per_gradient=ms_per_gradient,
        seconds_per_warmup_iteration=N_CHAINS * WARMUP_SECONDS / max(iterations, 1),
        divergences=int(sum(chain["divergent__"].sum() for chain in chains)),
        ess_per_draw_least=float(per_draw.min()),
        ess_per_draw_median=float(np.median(per_draw)),
        cost=cost,
    )


def effective_draws(chains: list[FloatArray], spread: FloatArray) -> FloatArray:
    """Effective draws per draw of each parameter, from how far it moves in one draw.

    With s the posterior standard deviation, known from a converged fit, the lag-one
    autocorrelation is r = 1 - mean squared jump/(2 s^2). For a first-order autoregressive chain
    the effective sample size is (1 - r)/(1 + r) per draw; slower modes would make it less.

    Parameters
    ----------
    chains : list of array, shape (n_draws, n_parameters)
        Positions.
    spread : array, shape (n_parameters,)
        s.
    """
    squared_jumps = np.concatenate([np.diff(chain, axis=0) ** 2 for chain in chains])
    correlation = np.clip(1 - squared_jumps.mean(axis=0) / (2 * spread**2), 0.0, 1.0)
    per_draw: FloatArray = (1 - correlation) / (1 + correlation)
    return per_draw


def _seconds_per_gradient(command: list[str], folder: Path) -> float:
    """Time of short static trajectories with few and many steps; their difference is gradients."""

    def seconds(steps: int) -> float:
        start, output = next(a for a in command if "init=" in a), folder / "timing.csv"
        data = next(a for a in command if a.startswith("file=") and a.endswith(".json"))
        started = time.monotonic()
        subprocess.run(
            [
                *(command[0], "sample", "num_warmup=0", "num_samples=1", "adapt", "engaged=0"),
                *("algorithm=hmc", "engine=static", f"int_time={steps * 1e-12:g}"),
                *("metric=dense_e", f"metric_file={folder}/metric.json", "stepsize=1e-12"),
                *("id=1", "data", data, start, "random", "seed=1", "output", f"file={output}"),
            ],
            check=True,
            capture_output=True,
        )
        return time.monotonic() - started

    return (seconds(220) - seconds(20)) / 200


def _paper_form(fit: Fit) -> tuple[Path, tuple[str, ...]]:
    """Program in the paper's form, and the parameters that it declares."""
    folder = Path(__file__).parent
    if isinstance(fit.experiment, OscillationExperiment):
        return folder / "six_state_oscillation.stan", fit.priors.free
    return folder / "six_state.stan", tuple(p.name for p in PARAMETERS)


def _stan_transform(priors: PriorSet, names: tuple[str, ...]) -> PlainCoordinates:
    """Stan's own transforms of the parameters, declared in SI with their priors' bounds."""
    lower, upper = (
        np.array([getattr(priors[name], end) for name in names]) for end in ("lower", "upper")
    )
    return PlainCoordinates(names, names, np.zeros(len(names)), np.ones(len(names)), lower, upper)


def _unconstrained(transform: PlainCoordinates, values: Mapping[str, npt.ArrayLike]) -> FloatArray:
    """Positions, shape (n_draws, n_parameters)."""
    return np.column_stack(
        [
            transform.of_quantity(k, values[name]).ravel()
            for k, name in enumerate(transform.quantities)
        ]
    )
