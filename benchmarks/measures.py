"""What a finished fit says of the sampler, and which arm of its valley a draw is in."""

from dataclasses import dataclass
from pathlib import Path

import arviz as az
import numpy as np
import pandas as pd
import xarray as xr

from pyburgers.fitting.fit import Fit
from pyburgers.posterior.labelled_draws import convergence_table


@dataclass(frozen=True, eq=False)
class ChainFile:
    """Draws and cost of one chain.

    `draws`: rows that are complete; warm-up is among them only if it was saved, and a chain stopped
        early may have none.
    `warmup_seconds`, `sampling_seconds`: CmdStan's own timing; NaN where the chain was stopped.
    """

    draws: pd.DataFrame
    warmup_seconds: float
    sampling_seconds: float


def read_chain(path: Path) -> ChainFile:
    """Read a CSV of CmdStan that may break off anywhere."""
    lines = path.read_text(encoding="utf-8").splitlines()
    table = [line.split(",") for line in lines if line and not line.startswith("#")]
    header = table[0] if table else []
    rows = [row for row in table[1:] if len(row) == len(header)]
    seconds = {"Warm-up": float("nan"), "Sampling": float("nan")}
    for line in lines:
        for phase in seconds:
            if line.startswith("#") and line.endswith(f"seconds ({phase})"):
                seconds[phase] = float(line.removesuffix(f"seconds ({phase})").split()[-1])
    draws = pd.DataFrame(rows, columns=header).astype(float)
    return ChainFile(draws, seconds["Warm-up"], seconds["Sampling"])


@dataclass(frozen=True)
class Measures:
    """Cost and yield of a fit; times are of CmdStan, of one core, summed over its chains.

    `draws`, `leapfrogs`, `divergences`: after the warm-up.
    `step_size_ratio`: smallest step size of a chain over the largest.
    `rhat`, `ess_bulk`, `ess_tail`: the worst over the sampled quantities.
    """

    warmup_seconds: float
    sampling_seconds: float
    draws: int
    leapfrogs: int
    divergences: int
    step_size_ratio: float
    rhat: float
    ess_bulk: float
    ess_tail: float


def core_seconds(fit: Fit) -> float:
    """Return seconds of the processes of all chains, with warm-up; each needs a core of its own."""
    return float(sum(chain["wall_seconds"] for chain in fit.manifest["chains"].values()))


def measure(fit: Fit) -> Measures:
    """Read the chains of a fit."""
    chains = [read_chain(fit.directory.draws_file(c)) for c in fit.directory.finished_chains()]
    draws = pd.concat([chain.draws for chain in chains])
    steps = [chain.draws["stepsize__"].iloc[-1] for chain in chains]
    convergence = convergence_table(fit.posterior)
    return Measures(
        warmup_seconds=sum(chain.warmup_seconds for chain in chains),
        sampling_seconds=sum(chain.sampling_seconds for chain in chains),
        draws=len(draws),
        leapfrogs=int(draws["n_leapfrog__"].sum()),
        divergences=int(draws["divergent__"].sum()),
        step_size_ratio=float(min(steps) / max(steps)),
        rhat=float(convergence["rhat"].max()),
        ess_bulk=float(convergence["ess_bulk"].min()),
        ess_tail=float(convergence["ess_tail"].min()),
    )


def grain_size_share(posterior: xr.DataTree) -> xr.DataArray:
    """Return the share of grain size in the softening beyond the stress peak, by chain and draw.

    It is ln of the strength lost to grain size between peak and end over ln of all that is
    lost, and tells the two arms of the valley in the critical strains apart
    (`docs/coordinates.md`).
    """
    predictions = posterior["predictions"].to_dataset()
    peak = predictions["stress"].argmax("strain")
    lost = {
        name: np.log(predictions[name].isel(strain=peak) / predictions[name].isel(strain=-1))
        for name in ("grain_size_softening", "fabric_softening")
    }
    share: xr.DataArray = lost["grain_size_softening"] / (
        lost["grain_size_softening"] + lost["fabric_softening"]
    )
    return share


def coordinate_ess_per_1000_gradients(fit: Fit) -> float:
    """Least bulk ESS of a fit's coordinates per 1000 gradients, those of the warm-up included."""
    chains = [read_chain(fit.directory.draws_file(c)) for c in fit.directory.finished_chains()]
    columns = [name for name in chains[0].draws if str(name).startswith("coordinate.")]
    draws = np.array([chain.draws[columns].to_numpy() for chain in chains])
    leapfrogs = sum(chain.draws["n_leapfrog__"].sum() for chain in chains)
    # CmdStan does not count the gradients of its warm-up; each costs as much time as later ones.
    with_warmup = 1 + sum(chain.warmup_seconds for chain in chains) / sum(
        chain.sampling_seconds for chain in chains
    )
    least = min(float(az.ess(draws[..., k])) for k in range(draws.shape[-1]))
    return 1e3 * least / (leapfrogs * with_warmup)
