"""Settings of the sampler and their defaults."""

import math
from dataclasses import dataclass, replace
from typing import Any, Self

from pyburgers.common.errors import InputError
from pyburgers.common.processes import cores
from pyburgers.kinds.likelihood import Likelihood, likelihoods

COORDINATES = ("auto", "plain", *dict.fromkeys(one.chart.name for one in likelihoods().values()))
"""What may be asked for; a test can have plain ones and those of its chart."""

MOST_DRAWS = 10**6
"""Of a chain, at once."""

ENOUGH_DRAWS = 1000
"""Draws of a chain from which on a fit is meant to be final; fewer are a quick look."""

DEFAULT_MINUTES = 5.0
"""Minutes of sampling of such a fit."""

INDECISIVE = frozenset(
    {"chains", "chain_timeout", "max_minutes", "parallel_chains", "threads_per_chain"}
)
"""Options that change no draw of a chain.

Draws in several threads are others than in one, by rounding, but those programs are two.
"""


def _option(name: str) -> str:
    """Say which option of the command line gives a field, at the end of a sentence."""
    return f" (option --{name.replace('_', '-')})"


@dataclass(frozen=True)
class SamplerOptions:
    """How NUTS runs.

    Attributes
    ----------
    chains, draws : int
        Number of chains, and kept iterations of each.
    warmup : int or None
        Iterations before them; None takes the protocol's default.
    seed : int
        Seed of initial values and chains.
    adapt_delta : float or None
        Target acceptance rate; None takes the protocol's default.
    max_treedepth : int
        Trajectories have at most 2**max_treedepth - 1 leapfrog steps.
    coordinates : str
        Coordinates of the sampler (`docs/coordinates.md`), one of `COORDINATES`; the posterior is
        the same. "auto" takes those of the protocol if priors and record suit them.
    max_minutes : float or None
        Minutes of sampling within which all chains get more draws, if draws are all that is
        lacking; 0 adds none. None means `DEFAULT_MINUTES` with at least `ENOUGH_DRAWS` draws a
        chain, else 0.
    chain_timeout : float or None
        Seconds after which a chain is stopped and reported as failed.
    parallel_chains : int or None
        Chains that run side by side; None runs as many as there are cores for their threads.
    threads_per_chain : int
        Threads that share the tests of a joint fit, see `threads_for`.

    Examples
    --------
    >>> options = pyburgers.SamplerOptions(chains=2, draws=500, seed=7)
    """

    chains: int = 4
    warmup: int | None = None
    draws: int = ENOUGH_DRAWS
    seed: int = 1
    adapt_delta: float | None = None
    max_treedepth: int = 10
    coordinates: str = "auto"
    max_minutes: float | None = None
    chain_timeout: float | None = None
    parallel_chains: int | None = None
    threads_per_chain: int = 1

    def __post_init__(self) -> None:
        """Check the values.

        Raises
        ------
        InputError
            If one is out of range.
        """
        limits = {
            "chains": (self.chains, 1, 1000),
            "draws": (self.draws, 4, MOST_DRAWS),
            "seed": (self.seed, 0, 2**31 - 1),
            "max_treedepth": (self.max_treedepth, 1, 20),
            "threads_per_chain": (self.threads_per_chain, 1, 1000),
        }
        if self.parallel_chains is not None:
            limits["parallel_chains"] = (self.parallel_chains, 1, 1000)
        if self.warmup is not None:
            limits["warmup"] = (self.warmup, 20, 10**6)
        for name, (value, least, most) in limits.items():
            if not least <= value <= most:
                raise InputError(
                    f"{name} is {value}, expected a number from {least} to {most}{_option(name)}."
                )
        if self.adapt_delta is not None and not 0 < self.adapt_delta < 1:
            raise InputError(
                f"adapt_delta is {self.adapt_delta}, expected between 0 and 1"
                f"{_option('adapt_delta')}."
            )
        if self.coordinates not in COORDINATES:
            raise InputError(
                f"coordinates is {self.coordinates!r}, expected one of {', '.join(COORDINATES)}."
            )
        if self.max_minutes is not None and not 0 <= self.max_minutes < math.inf:
            raise InputError(
                f"max_minutes is {self.max_minutes}, expected a number of minutes or 0"
                f"{_option('max_minutes')}."
            )
        if self.chain_timeout is not None and self.chain_timeout <= 0:
            raise InputError(
                f"chain_timeout is {self.chain_timeout} s, expected more than 0"
                f"{_option('chain_timeout')}."
            )

    @property
    def warmup_iterations(self) -> int:
        """Warm-up of settled options (`suited_to`)."""
        assert self.warmup is not None  # only settled options are sampled with
        return self.warmup

    @property
    def minutes_of_sampling(self) -> float:
        """Minutes within which chains get more draws, 0 for none."""
        if self.max_minutes is None:
            return DEFAULT_MINUTES if self.draws >= ENOUGH_DRAWS else 0.0
        return self.max_minutes

    @property
    def chains_at_once(self) -> int:
        """Chains that run side by side on this machine."""
        return self.parallel_chains or min(self.chains, max(1, cores() // self.threads_per_chain))

    def threads_for(self, n_tests: int) -> int:
        """Return the threads of a chain: at most as many as there are tests to share.

        Parameters
        ----------
        n_tests : int
            Tests of the fit.

        Returns
        -------
        int
            At least 1.
        """
        return min(self.threads_per_chain, n_tests)

    def suited_to(self, likelihood: Likelihood[Any], tests: str) -> Self:
        """Fill in what is left to the kind of test.

        Parameters
        ----------
        likelihood : Likelihood
            That of the tests of a fit.
        tests : str
            Names of the tests, for messages.

        Returns
        -------
        SamplerOptions
            With numbers for warm-up and target acceptance.

        Raises
        ------
        InputError
            If such tests do not have the coordinates.
        """
        chart = likelihood.chart.name
        if self.coordinates not in ("auto", "plain", chart):
            raise InputError(
                f"{tests}: {self.coordinates} coordinates are not for tests of the protocol "
                f"{likelihood.name}, expected --coordinates auto, plain or {chart}."
            )
        return replace(
            self,
            warmup=self.warmup or likelihood.warmup,
            adapt_delta=self.adapt_delta or likelihood.target_acceptance,
        )
