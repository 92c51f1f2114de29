"""Chains that did not run to their end, and why."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ChainFailure:
    """A chain that did not finish.

    Attributes
    ----------
    chain : int
        Identifier.
    reason : str
        What ended it, where, and what to try, as one sentence.
    by_system : bool
        Whether the system killed it or the disk was full: another try may end well.
    """

    chain: int
    reason: str
    by_system: bool = False


def missing_chains(
    finished: Iterable[int], manifest: Mapping[str, Any]
) -> tuple[ChainFailure, ...]:
    """Return the chains that a run was asked for and does not have, and why.

    Parameters
    ----------
    finished : iterable of int
        Chains that are there.
    manifest : mapping
        Of the run.
    """
    there = set(finished)
    noted = {failure["chain"]: ChainFailure(**failure) for failure in manifest["failures"]}
    return tuple(
        noted.get(
            chain,
            ChainFailure(
                chain,
                f"Chain {chain} has not run to its end because the run was stopped; run the "
                "same command again: it runs only the missing chains.",
            ),
        )
        for chain in range(1, manifest["sampler"]["chains"] + 1)
        if chain not in there
    )
