"""Draws that are added to finished chains: how many may be asked for, and sampling them."""

import logging

from pyburgers.cmdstan.program import Program
from pyburgers.common.errors import InputError
from pyburgers.common.units import counted
from pyburgers.sampling.chains import Extension, run_side_by_side
from pyburgers.sampling.manifest import ChainFailure
from pyburgers.sampling.options import MOST_DRAWS, SamplerOptions
from pyburgers.sampling.run_directory import RunDirectory

logger = logging.getLogger(__name__)


def require_extendable(run: RunDirectory, more_draws: int, *, overwrite: bool) -> None:
    """Raise `InputError`, before anything is done, if so many draws cannot be added to a run.

    The number may be out of range, there may be no run, or it may be removed.
    """
    option = f"--more-draws {more_draws}"
    if not 1 <= more_draws <= MOST_DRAWS:
        raise InputError(f"{option}: expected a number from 1 to {MOST_DRAWS}.")
    if overwrite:
        raise InputError(
            f"{option}: found it beside --overwrite, expected one of them: draws are added to a "
            "run that stays."
        )
    if not run.manifest_file.is_file():
        raise InputError(
            f"{option}: found no run in {run.path}, expected one to add draws to; run the same "
            "command without it first."
        )


def extend_chains(
    model: Program, run: RunDirectory, options: SamplerOptions, more_draws: int | None
) -> tuple[ChainFailure, ...]:
    """Extend the finished chains of a claimed run as often as was asked for, now or before.

    Returns the chains that could not be extended. An extension that fails in all chains leaves the
    run as it was: it would fail again whenever the run is continued. If it ends in some chains, it
    stays, and is completed first.
    """
    asked = _asked(run, more_draws)
    for number, draws in enumerate(asked, start=1):
        finished = run.finished_chains()
        chains = [one for one in finished if not run.extended_folder(one, number).is_dir()]
        if not chains:
            continue
        logger.info(f"Extending {counted(len(chains), 'chain')} by {counted(draws, 'draw')}.")
        failures = run_side_by_side(model, run, chains, options, Extension(number, draws))
        if len(failures) == len(finished):
            run.update_manifest({"more_draws": asked[: number - 1]})
        if failures:
            return failures
    return ()


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
