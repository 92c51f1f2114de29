"""Chains that are put aside and sampled again: at a tighter tolerance, or with shorter steps."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pyburgers.cmdstan.draw_files import Adaptation, adaptation_of, read_draws
from pyburgers.common.array_types import FloatArray
from pyburgers.common.atomic_files import sha256_of_file, write_json
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import read_json_table
from pyburgers.sampling.manifest import ChainRecord
from pyburgers.sampling.run_directory import RunDirectory

TIGHTENING = 10.0
"""Factor between the tolerance of a run and of its repetition."""

LEAST_SHORTENING = 2.0
"""Factor by which steps are shortened at least."""


@dataclass(frozen=True, eq=False)
class Resumption:
    """What a chain goes on from, without a warm-up, where one was put aside for its divergences.

    `draws_file` is the CSV of the chain that was put aside last, whose last draw is the start;
    `adapted` has the shorter step, and a metric of all draws put aside with it; `number` says how
    often steps were shortened, `seconds` how long the chain has taken until then.
    """

    draws_file: Path
    adapted: Adaptation
    number: int
    seconds: float


def tighten_solver(run: RunDirectory, pareto_k: float) -> float:
    """Put a run's chains aside and have them sampled again at a tighter tolerance, the result.

    Coordinates, metric and initial values stay; `run_chains` with the same inputs then runs all
    chains. The manifest's list ``refits`` notes what was put aside and why: `pareto_k` is the
    diagnostic of the tolerance until here.
    """
    data, manifest = run.read_stan_data(), run.read_manifest()
    loose = float(data["tolerance"])
    tight = loose / TIGHTENING
    with run.claimed(manifest["fingerprint"]):
        aside = run.supersede_chains(f"tolerance_{loose:.0e}", run.finished_chains())
        refit = {"tolerance": loose, "pareto_k": pareto_k, "chains": aside}
        run.update_manifest({"refits": [*manifest["refits"], refit]})
        write_json(run.stan_data_file, {**data, "tolerance": tight})
    return tight


def shortening(divergences: int) -> float:
    """Return the factor by which steps are shortened after so many divergences.

    Their number falls with the third power of the step or faster (`docs/coordinates_trials.md`):
    about one is expected afterwards.
    """
    return max(LEAST_SHORTENING, math.cbrt(divergences))


def shorten_steps(run: RunDirectory, divergences: Mapping[int, int]) -> None:
    """Put chains aside whose trajectories diverged, and have them go on with shorter steps.

    `divergences` counts those of each chain. A chain takes its own step or that of the middle
    chain, whichever is shorter, divided by `shortening`: chains with the longest steps diverge
    most. `run_chains` with the same inputs then runs the chains, from their last draws. The
    manifest's list ``shortened`` notes what was put aside, and how many trajectories diverged.
    """
    factor = shortening(sum(divergences.values()))
    manifest = run.read_manifest()
    before = shortened(manifest)
    own = {chain: adaptation(run, chain).step_size for chain in run.finished_chains()}
    longest = float(np.median(list(own.values())))
    chains = [chain for chain in own if divergences.get(chain)]
    with run.claimed(manifest["fingerprint"]):
        done = {
            "divergences": sum(divergences.values()),
            "chains": run.supersede_chains(f"longer_steps_{len(before) + 1}", chains),
            "step_sizes": {str(one): min(own[one], longest) / factor for one in chains},
        }
        run.update_manifest({"shortened": [*before, done]})


def shortened(manifest: dict[str, Any]) -> list[dict[str, Any]]:
    """Return what the manifest of a run notes of chains that were put aside for divergences."""
    return list(manifest.get("shortened", []))


def adaptation(run: RunDirectory, chain: int) -> Adaptation:
    """Return the step size and the metric that a finished chain was sampled with."""
    resumed = resumption(run, chain)
    return adaptation_of(run.draws_file(chain)) if resumed is None else resumed.adapted


def resumption(run: RunDirectory, chain: int) -> Resumption | None:
    """Return what a chain goes on from, None where it starts with a warm-up.

    Raises `InputError` if what was put aside is gone or has changed.
    """
    aside = [one for one in shortened(run.read_manifest()) if str(chain) in one["step_sizes"]]
    if not aside:
        return None
    last = aside[-1]
    folders = {one: run.path / last["chains"] / f"chain_{one}" for one in last["step_sizes"]}
    records = {one: _record_put_aside(folder) for one, folder in folders.items()}
    return Resumption(
        folders[str(chain)] / "draws.csv",
        Adaptation(
            float(last["step_sizes"][str(chain)]),
            _metric_of([folder / "draws.csv" for folder in folders.values()]),
        ),
        len(aside),
        float(records[str(chain)].wall_seconds),
    )


def _metric_of(files: Sequence[Path]) -> FloatArray:
    """Return the covariance within chains, shape (n, n), with their metrics as n draws more.

    A chain by itself estimates it from a part of its warm-up.
    """
    metric = np.mean([adaptation_of(file).metric for file in files], axis=0)
    draws = read_draws(files)
    first = sum(name.endswith("__") for name in draws.variables)
    places = draws.values[..., first : first + len(metric)]
    covariance = np.mean([np.atleast_2d(np.cov(chain.T)) for chain in places], axis=0)
    share = len(metric) / (len(metric) + places.shape[0] * places.shape[1])
    mixed: FloatArray = share * metric + (1 - share) * covariance
    return mixed


def _record_put_aside(folder: Path) -> ChainRecord:
    """Return the record of a chain that others go on from, if its draws are those of it."""
    draws, record = folder / "draws.csv", folder / "timing.json"
    found = "is missing"
    if draws.is_file() and record.is_file():
        known = read_json_table(record, ChainRecord)
        if sha256_of_file(draws) == known.sha256:
            return known
        found = "has changed since the run"
    raise InputError(
        f"{draws}: {found}, expected the chain that another goes on from; put it back, or remove "
        "the run directory and run the command in its manifest again."
    )
