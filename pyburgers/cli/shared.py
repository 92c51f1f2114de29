"""Shared by commands: arguments, the command line as typed, exit codes."""

import argparse
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

from pyburgers.common.errors import InputError
from pyburgers.kinds.likelihood import Likelihood, likelihoods
from pyburgers.model.variants import CHOICES
from pyburgers.sampling.options import COORDINATES, DEFAULT_MINUTES, ENOUGH_DRAWS, SamplerOptions

EXIT_CHECK_FAILED = 3
"""Of a fit: its posterior was not sampled well, or too few draws tell whether it was."""
SAMPLER_OPTIONS = tuple(field.name for field in fields(SamplerOptions))
DEFAULT_OPTIONS = SamplerOptions()


def add_model_options(command: argparse.ArgumentParser) -> None:
    """Add the options that choose laws of the model, and what tests share."""
    command.add_argument(
        "--pool",
        action="append",
        default=[],
        metavar="NAME=HOW",
        help="how tests of a joint fit share parameter NAME (or all): shared, one value; separate, "
        "a value for each; partial or partial:SCALE, values around a common centre with a spread "
        "whose prior has this scale; may be repeated",
    )
    add_variant_option(command)


def add_variant_option(command: argparse.ArgumentParser) -> None:
    """Add the option that chooses laws of the model."""
    variant = command.add_argument(
        "--variant",
        action="append",
        default=[],
        metavar="PART=LAW",
        help="another law for a part of the model, such as kelvin=power_law; may be repeated: "
        + ", ".join(f"{part}={'|'.join(laws)}" for part, laws in CHOICES.items()),
    )
    # A shell offers these; others are possible too.
    offered = [f"{part}={law}" for part, laws in CHOICES.items() for law in laws]
    vars(variant)["offered"] = offered


def add_sampler_options(
    command: argparse.ArgumentParser,
    names: Sequence[str] = SAMPLER_OPTIONS,
    defaults: SamplerOptions = DEFAULT_OPTIONS,
) -> None:
    """Add options named after fields of `SamplerOptions`, with the values of given ones."""
    for name in SAMPLER_OPTIONS:
        if name not in names:
            continue
        command.add_argument(
            f"--{name.replace('_', '-')}",
            type=_SAMPLER[name].type,
            choices=COORDINATES if name == "coordinates" else None,
            default=(default := getattr(defaults, name)),
            help=_SAMPLER[name].help + (_SAMPLER[name].unless_given if default is None else ""),
        )


def add_options_of_runs_there(command: argparse.ArgumentParser) -> None:
    """Add the options that say what becomes of a run that is in --out already."""
    command.add_argument(
        "--more-draws",
        type=int,
        metavar="N",
        help="add N draws to every chain of the run in --out, after what it still lacks",
    )
    command.add_argument(
        "--overwrite", action="store_true", help="replace a run of other inputs in --out"
    )


def by_protocol(value: Callable[[Likelihood[Any]], float]) -> str:
    """Return the default of an option that depends on the kind of test, for its help."""
    values = {name: f"{value(one):g}" for name, one in likelihoods().items()}
    same = set(values.values())
    listed = same if len(same) == 1 else (f"{found} {name}" for name, found in values.items())
    return f"; default {', '.join(listed)}"


class _Option(NamedTuple):
    """An option of the sampler: its help, what it says of a default of None, and its type."""

    help: str
    unless_given: str = ""
    type: Callable[[str], object] = int


_SAMPLER = {
    "chains": _Option("number of chains"),
    "warmup": _Option("iterations ahead of the draws", by_protocol(lambda one: one.warmup)),
    "draws": _Option("draws of each chain"),
    "seed": _Option("seed of initial values and chains"),
    "adapt_delta": _Option(
        "target acceptance", by_protocol(lambda one: one.target_acceptance), float
    ),
    "max_treedepth": _Option("trajectories have at most 2**max_treedepth - 1 leapfrog steps"),
    "coordinates": _Option(
        "coordinates of the sampler (docs/coordinates.md); auto takes those that suit the test",
        type=str,
    ),
    "max_minutes": _Option(
        "minutes of sampling within which all chains get more draws, if draws are all that is "
        "lacking; 0 adds none",
        f"; default {DEFAULT_MINUTES:g} with at least {ENOUGH_DRAWS} draws of each chain, else 0",
        float,
    ),
    "chain_timeout": _Option("seconds after which a chain is stopped", "; default no limit", float),
    "parallel_chains": _Option("chains side by side", "; default as many as there are cores"),
}


def sampler_options(
    options: argparse.Namespace, names: Sequence[str] = SAMPLER_OPTIONS
) -> SamplerOptions:
    """Return what was chosen of the options that `add_sampler_options` added."""
    return SamplerOptions(**{name: getattr(options, name) for name in names})


def command_line() -> str:
    """Return the command as the user typed it, for manifests; bytes that are no text escaped."""
    script = Path(sys.argv[0]).name
    program = "pyburgers" if script == "__main__.py" else script
    typed = shlex.join([program, *sys.argv[1:]])
    return typed.encode("utf-8", "backslashreplace").decode("utf-8")


@contextmanager
def writing(out: Path) -> Iterator[None]:
    """Name the option where results cannot be written."""
    try:
        yield
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror}).") from error


def exit_code(passed: bool) -> int:
    """Return the code of a command that did what it should, with its verdict."""
    return 0 if passed else EXIT_CHECK_FAILED
