"""NUTS runs whatever they sample: the chains that a folder lacks, their extension, the record."""

import logging
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from importlib.metadata import version
from numbers import Integral
from pathlib import Path
from typing import Any

from pyburgers.cmdstan.program import Program
from pyburgers.cmdstan.toolchain import cmdstan_version, compiler_version, find_cmdstan
from pyburgers.common.atomic_files import sha256_of_json, write_json
from pyburgers.common.errors import (
    InputError,
    PyburgersError,
    SamplingError,
    SystemFailureError,
    ToolchainError,
    require_type,
)
from pyburgers.common.units import counted
from pyburgers.sampling.chains import Extension, run_side_by_side
from pyburgers.sampling.manifest import ChainFailure
from pyburgers.sampling.options import INDECISIVE, MOST_DRAWS, SamplerOptions
from pyburgers.sampling.run_directory import RunDirectory

logger = logging.getLogger(__name__)

PACKAGES = ("pyburgers", "cmdstanpy", "arviz", "numpy", "scipy", "pandas", "xarray")

INTERRUPTED = frozenset({"sampling", "interrupted", "sampled"})
"""Status of runs that were stopped before they were complete, for no fault of a chain."""


def decisive(content: Any) -> Any:
    """Return data without the digits in which processors differ, to tell one problem from another.

    Sums of linear algebra end in other last digits where a processor has other vector instructions,
    and a run is to go on wherever it is taken.
    """
    if isinstance(content, float):
        return f"{content + 0.0:.5e}"
    if isinstance(content, dict):
        return {name: decisive(part) for name, part in content.items()}
    if isinstance(content, (list, tuple)):
        return [decisive(part) for part in content]
    return content


def fingerprint(data: Mapping[str, Any], options: SamplerOptions, recipe: str) -> str:
    """Hash of everything that decides the draws of a chain (not how many chains there are).

    The data are in plain coordinates: others follow from them and the seed. `recipe` is the hash of
    the program, its compiler and its flags.
    """
    chosen = {k: v for k, v in asdict(options).items() if k not in INDECISIVE}
    return sha256_of_json({"data": decisive(data), "options": chosen, "program": recipe})


def complete_chains(
    model: Program,
    run: RunDirectory,
    options: SamplerOptions,
    draw_start: Callable[[int], dict[str, list[float]]],
    *,
    more_draws: int | None = None,
) -> None:
    """Run the chains that a claimed run directory lacks, and note how they ended.

    The directory has its inputs, Stan data and manifest; `draw_start` is called for the start of a
    chain, by its identifier, if the directory has none. After an earlier extension that was
    interrupted every chain is extended by `more_draws`: it goes on where it ended, with its step
    size and metric, and the draws that are there stay.
    """
    wanted = range(1, options.chains + 1)
    missing = [chain for chain in wanted if chain not in run.finished_chains()]
    if len(missing) < options.chains:
        logger.info(
            f"{options.chains - len(missing)} of {options.chains} chains are there already."
        )
    for chain in missing:
        if not run.initial_values_file(chain).is_file():
            write_json(run.initial_values_file(chain), draw_start(chain))
    failures = run_side_by_side(model, run, missing, options) if missing else ()
    not_extended: tuple[ChainFailure, ...] = ()
    asked = _asked(run, more_draws)
    for number, draws in enumerate(asked, start=1):
        finished = run.finished_chains()
        chains = [one for one in finished if not run.extended_folder(one, number).is_dir()]
        if not chains:
            continue
        logger.info(f"Extending {counted(len(chains), 'chain')} by {counted(draws, 'draw')}.")
        not_extended = run_side_by_side(model, run, chains, options, Extension(number, draws))
        if len(not_extended) == len(finished):
            # It would fail again whenever the run is continued.
            run.update_manifest({"more_draws": asked[: number - 1]})
        if not_extended:
            break
    status = "chains missing" if failures else "sampled"
    found = {
        "status": "extension failed" if not_extended else status,
        "failures": [failure.model_dump() for failure in (*failures, *not_extended)],
        "chains": run.chain_records(),
    }
    run.update_manifest(found)
    if not run.finished_chains():
        raise _error_of(failures, "No chain finished")
    if not_extended:
        raise _error_of(not_extended, f"{run.path}: not all chains could be extended")


def _error_of(failures: Sequence[ChainFailure], what: str) -> PyburgersError:
    kind = SystemFailureError if all(one.by_system for one in failures) else SamplingError
    return kind(f"{what}: {failures[0].reason}")


def draws_to_add(run: RunDirectory, more_draws: int, *, overwrite: bool) -> tuple[int | None, str]:
    """Return how many draws are to be added to a run, and its command, which makes its first draws.

    None are added if the same number was asked for before and that command was interrupted.
    """
    require_type("more_draws", more_draws, Integral, "a whole number")
    option = f"--more-draws {more_draws}"
    if not 1 <= more_draws <= MOST_DRAWS:
        raise InputError(f"{option}: expected a number from 1 to {MOST_DRAWS}.")
    if overwrite:
        raise InputError(
            f"{option}: found it beside --overwrite, expected one of them: draws are added to a "
            "run that stays."
        )
    known = run.read_manifest() if run.manifest_file.is_file() else {}
    if "command" not in known:
        raise InputError(
            f"{option}: found no run in {run.path}, expected one to add draws to; run the same "
            "command without it first."
        )
    asked, command = known.get("more_draws", []), str(known["command"])
    if known.get("status") in INTERRUPTED and asked[-1:] == [more_draws]:
        logger.info(
            f"Adding {counted(more_draws, 'draw')} was asked for before and interrupted: the "
            "command completes that, and adds no others."
        )
        return None, command
    return more_draws, command


def way_out(run: RunDirectory, more_draws: int | None) -> str:
    """Say what to do about a run of other inputs; draws are added with its own ones alone."""
    command = run.read_manifest().get("command")
    if more_draws is None or command is None:
        return "choose another --out, or --overwrite to replace it"
    return (
        f"draws can be added with the inputs and options of its command, {command}; for others "
        "choose another --out, without --more-draws"
    )


def _asked(run: RunDirectory, more_draws: int | None) -> list[int]:
    """Return the draws of all extensions, of which the manifest then knows."""
    asked: list[int] = list(run.read_manifest().get("more_draws", []))
    if more_draws is None:
        return asked
    lacking = asked[run.n_extensions() :]
    for draws in lacking:
        logger.info(f"Adding {counted(draws, 'draw')} was asked for before and is completed first.")
    # The same command again means what it was interrupted in.
    if more_draws in lacking:
        return asked
    asked.append(more_draws)
    run.update_manifest({"more_draws": asked})
    return asked


def as_recorded(
    run: RunDirectory, options: SamplerOptions, command: str, more_draws: int | None
) -> tuple[SamplerOptions, dict[str, Any]]:
    """Return options that make the draws of a claimed run, and `made_by` of `run_record`.

    If the run has more chains, finished or put aside, than are asked for, it keeps their number and
    its command. If nothing is to be sampled, it keeps its command and versions.
    """
    known, finished = run.read_manifest(), run.finished_chains()
    made_by = made_now_by(command)
    if "command" not in known:
        return options, made_by
    aside = [int(one.name.split("_")[1]) for one in run.path.glob("superseded/*/chain_*")]
    keeps_more = max([*finished, *aside], default=0) > options.chains
    if keeps_more:
        chains = max(known["sampler"]["chains"], *finished, *aside)
        logger.info(f"The run keeps its {chains} chains, although chains is {options.chains}.")
        options = replace(options, chains=chains)
    has_chains = {*range(1, options.chains + 1)} <= {*finished}
    if more_draws is None and (keeps_more or has_chains):
        made_by["command"] = known["command"]
    if more_draws is None and has_chains and run.n_extensions() == len(known.get("more_draws", [])):
        made_by["versions"] = known["versions"]
    return options, made_by


def run_record(
    run: RunDirectory,
    wanted: Mapping[str, Any],
    *,
    name: str,
    data_kind: str,
    identity: str,
    made_by: Mapping[str, Any],
) -> dict[str, Any]:
    """Note in one record what will run: what is asked for, command, versions, hashes of the inputs.

    The directory has inputs and Stan data; `name` and `data_kind` are those of experiment or table,
    `identity` is the `fingerprint`, `made_by` is as of `as_recorded`.
    """
    read_by_chains = [file for file in (run.stan_data_file, run.metric_file) if file.is_file()]
    return {
        **wanted,
        "fingerprint": identity,
        "experiment": name,
        "data_kind": data_kind,
        **origin_record(run, made_by, [*files_in(run.inputs), *read_by_chains]),
        "failures": [],
    }


def origin_record(
    run: RunDirectory, made_by: Mapping[str, Any], inputs: Sequence[Path]
) -> dict[str, Any]:
    """Note what regenerates a folder: command, versions, hashes of the inputs; and that it runs."""
    # A folder that holds a part of the same was begun when that says.
    known = run.read_manifest() if run.manifest_file.is_file() else {}
    return {
        **made_by,
        "started": known.get("started", datetime.now(UTC).isoformat(timespec="seconds")),
        "status": "sampling",
        "hashes": run.hashes(inputs),
    }


def files_in(folder: Path) -> list[Path]:
    """Return all files below a folder, in order."""
    return sorted(file for file in folder.rglob("*") if file.is_file())


def made_now_by(command: str) -> dict[str, Any]:
    """Return command and versions of what is made now, for manifests."""
    return {"command": command, "versions": software_versions()}


def software_versions() -> dict[str, str | None]:
    """Return the versions of what makes the draws, for manifests."""
    found = find_cmdstan()
    try:
        compiler = compiler_version()
    except ToolchainError:
        compiler = None  # compiled programs run without it
    return {
        "python": platform.python_version(),
        **{package: version(package) for package in PACKAGES},
        "cmdstan": None if found is None else cmdstan_version(found),
        "compiler": compiler,
    }
