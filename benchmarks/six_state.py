"""The paper's six-state form on the same data: a bounded run, extrapolated.

As printed, the posterior cannot be sampled in reasonable time: with CmdStan's defaults the
warm-up alone does not end in hours. The baseline is therefore given more than a user would have:
it starts at a posterior draw, with the dense metric of the posterior, both taken from the
product's finished fit, and adapts its step size only. What its warm-up costs is taken from the
first iterations of chains with CmdStan's defaults, started at posterior draws too.
"""

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
from gradients import ms_per_gradient
from measures import read_chain
from processes import MIB, run_together

from pyburgers import Fit, OscillationExperiment, PriorSet, SamplingError, load_program
from pyburgers.common.array_types import FloatArray
from pyburgers.common.atomic_files import write_json
from pyburgers.common.messages import messages_to
from pyburgers.kinds.stan_data import PlainCoordinates
from pyburgers.model.parameters import PARAMETERS

WARMUP = 8
"""Iterations of step-size adaptation."""

N_CHAINS, TIMED = 2, 200
"""Chains, and gradients whose time is taken."""

WARMUP_SECONDS = 60.0
"""Time that the chains with CmdStan's defaults get."""

USUAL_LENGTH = 1000
"""Warm-up iterations, and draws, of the run that the extrapolation stands for."""


def run_baseline(fit: Fit, folder: Path, *, limit_seconds: float, seed: int) -> dict[str, float]:
    """Run two chains of the six-state program side by side for a bounded time.

    Return columns of the table of `sampling.py`. They are those of cost alone where no chain made
    two draws in time, and none where the solver cannot even start at a posterior draw.
    """
    folder.mkdir(parents=True)
    source, names = _paper_form(fit)
    with messages_to(sys.stdout):
        program = load_program(source)
    executable = str(program.executable)
    draws = fit.posterior["posterior"].to_dataset()
    values = {name: draws[name].to_numpy() for name in names}
    transform = _stan_transform(fit.priors, names)
    unconstrained = _unconstrained(transform, values)
    metric = folder / "metric.json"
    write_json(metric, {"inv_metric": np.cov(unconstrained.T).tolist()})
    data = fit.directory.stan_data_file
    starts = [
        {name: float(value[chain, -1]) for name, value in values.items()}
        for chain in range(N_CHAINS)
    ]
    commands, defaults = [], []
    for chain, position in enumerate(starts, start=1):
        start = folder / f"start_{chain}.json"
        write_json(start, position)
        given = ("data", f"file={data}", f"init={start}", "random", f"seed={seed}")
        tail = (*given, "output", "refresh=1")
        commands.append(
            [
                *(executable, "sample", f"num_warmup={WARMUP}", "num_samples=1000000"),
                *("adapt", "delta=0.8", "algorithm=hmc", "engine=nuts", "max_depth=10"),
                *("metric=dense_e", f"metric_file={metric}", "stepsize=0.002", f"id={chain}"),
                *(*tail, f"file={folder}/chain_{chain}.csv", "sig_figs=12"),
            ]
        )
        defaults.append(
            [
                *(executable, "sample", "num_warmup=1000", "save_warmup=1", f"id={chain}"),
                *(*tail, f"file={folder}/warmup_{chain}.csv"),
            ]
        )
    cost = run_together(commands, limit_seconds=limit_seconds)
    chains = [read_chain(folder / f"chain_{c}.csv").draws for c in range(1, N_CHAINS + 1)]
    n_draws = sum(map(len, chains))
    try:
        by_clock, _ = ms_per_gradient(program, data, starts[:1], TIMED)
    except SamplingError:
        return {}
    row = {
        "ms_per_gradient": by_clock,
        "draws": 0,
        "divergences": 0,
        "wall_s": cost.wall_seconds,
        "peak_MiB": cost.peak_bytes / MIB,
    }
    if n_draws < N_CHAINS * 2:
        return row
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
    seconds = leapfrogs * by_clock / 1e3
    of_warmup = N_CHAINS * WARMUP_SECONDS / max(iterations, 1)
    return {
        **row,
        "draws": n_draws,
        "divergences": int(sum(chain["divergent__"].sum() for chain in chains)),
        "leapfrogs_per_draw": leapfrogs,
        "ess_bulk_per_s": float(per_draw.min()) / seconds,
        "ess_bulk_per_s_with_warmup": float(per_draw.min()) / (seconds + of_warmup),
        "s_per_draw": seconds,
        "s_per_warmup_iteration": of_warmup,
        "ess_bulk_per_s_median": float(np.median(per_draw)) / seconds,
    }


def effective_draws(chains: list[FloatArray], spread: FloatArray) -> FloatArray:
    """Effective draws per draw of each parameter, from how far it moves in one draw.

    With s the posterior standard deviation, known from a converged fit, the lag-one
    autocorrelation is r = 1 - mean squared jump/(2 s^2). For a first-order autoregressive chain
    the effective sample size is (1 - r)/(1 + r) per draw; slower modes would make it less.

    `chains` have the shape (n_draws, n_parameters), s is `spread`, shape (n_parameters,).
    """
    squared_jumps = np.concatenate([np.diff(chain, axis=0) ** 2 for chain in chains])
    correlation = np.clip(1 - squared_jumps.mean(axis=0) / (2 * spread**2), 0.0, 1.0)
    per_draw: FloatArray = (1 - correlation) / (1 + correlation)
    return per_draw


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
