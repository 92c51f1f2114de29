"""Settings of the sampler and their defaults."""

import math
from collections.abc import Container, Mapping
from dataclasses import dataclass, fields
from numbers import Integral
from typing import Any, get_args, get_type_hints

from pydantic import Field, create_model

from pyburgers.common.errors import InputError, require_type
from pyburgers.common.toml_files import Table

COORDINATES = ("auto", "plain", "valley", "sheared", "stretched")
"""What may be asked for; a test can have plain ones and those of its chart."""

MOST_DRAWS = 10**6
"""Of a chain, at once."""

LIMITS = {
    "chains": (1, 1000),
    "warmup": (20, 10**6),
    "draws": (4, MOST_DRAWS),
    "seed": (0, 2**31 - 1),
    "max_treedepth": (1, 20),
    "parallel_chains": (1, 1000),
}
"""Least and largest value of options."""

ENOUGH_DRAWS = 1000
"""Draws of a chain from which on a fit is meant to be final; fewer are a quick look."""

DEFAULT_MINUTES = 5.0
"""Minutes of sampling of such a fit."""

INDECISIVE = frozenset({"chains", "chain_timeout", "max_minutes", "parallel_chains"})
"""Options that change no draw of a chain."""


RETIRED = ("threads_per_chain",)
"""Entries that manifests may hold beside the options, without effect."""


def _refused(name: str, found: object, expected: str) -> InputError:
    """Return the error of a value, which names the option of the command line that gives it."""
    option = f"--{name.replace('_', '-')}"
    return InputError(f"{name} is {found}, expected {expected} (option {option}).")


SOME_OPTIONS = "options, as of pyburgers.SamplerOptions"


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
        Chains that run side by side; None runs as many as there are cores.

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

    def __post_init__(self) -> None:
        """Check the values; raise `InputError` if one is out of range."""
        for name, (least, most) in LIMITS.items():
            value = getattr(self, name)
            if value is None:
                continue
            require_type(name, value, Integral, "a whole number")
            if not least <= value <= most:
                raise _refused(name, value, f"a number from {least} to {most}")
        delta, minutes, timeout = self.adapt_delta, self.max_minutes, self.chain_timeout
        if delta is not None and not 0 < delta < 1:
            raise _refused("adapt_delta", delta, "between 0 and 1")
        if self.coordinates not in COORDINATES:
            raise InputError(
                f"coordinates is {self.coordinates!r}, expected one of {', '.join(COORDINATES)}."
            )
        if minutes is not None and not 0 <= minutes < math.inf:
            raise _refused("max_minutes", minutes, "a number of minutes or 0")
        if timeout is not None and not 0 < timeout < math.inf:
            raise _refused("chain_timeout", f"{timeout} s", "a finite number above 0")

    @property
    def warmup_iterations(self) -> int:
        """Warm-up of options in which nothing is left to the kind of test."""
        assert self.warmup is not None  # only settled options are sampled with
        return self.warmup

    @property
    def minutes_of_sampling(self) -> float:
        """Minutes within which chains get more draws, 0 for none."""
        if self.max_minutes is None:
            return DEFAULT_MINUTES if self.draws >= ENOUGH_DRAWS else 0.0
        return self.max_minutes


def options_table(*, settled: bool, without: Container[str] = ()) -> type[Table]:
    """Return the table of a file that holds the options but for some, within limits if settled."""
    keys: dict[str, Any] = {}
    hints = get_type_hints(SamplerOptions)
    for option in fields(SamplerOptions):
        name, hint, default = option.name, hints[option.name], option.default
        if name in without:
            continue
        # What decides the draws, and the number of chains, has to be there.
        if settled and name not in INDECISIVE - {"chains"}:
            hint, default = next(iter(get_args(hint)), hint), ...
        least, most = LIMITS.get(name, (None, None)) if settled else (None, None)
        keys[name] = hint, Field(default, ge=least, le=most, description=f"the sampler's {name}")
    if settled:
        keys |= {name: (int, Field(1, description="without effect")) for name in RETIRED}
    return create_model("OptionsTable", __base__=Table, **keys)


def recorded_options(record: Mapping[str, Any]) -> SamplerOptions:
    """Return the options in a manifest, which may hold retired ones beside them."""
    return SamplerOptions(**{name: own for name, own in record.items() if name not in RETIRED})
