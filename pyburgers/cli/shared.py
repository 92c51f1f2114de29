"""What commands share: arguments, the run that one names, verdicts and exit codes."""

import argparse
import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

from pyburgers.checks.fit_checks import CheckKind, CheckResult, Outcome
from pyburgers.checks.verdicts import verdicts
from pyburgers.common.errors import InputError
from pyburgers.model.variants import CHOICES
from pyburgers.report.tables import checks_table
from pyburgers.sampling.options import SamplerOptions

EXIT_CHECK_FAILED = 3
"""Of a fit: its posterior was not sampled well, or too few draws tell whether it was."""
EXIT_NOT_DESCRIBED = 4
"""The posterior was sampled well, but the model is not shown to describe the data."""
SAMPLER_OPTIONS = tuple(field.name for field in fields(SamplerOptions))
DEFAULT_OPTIONS = SamplerOptions()


def add_model_options(command: argparse.ArgumentParser) -> None:
    """Add the options that choose laws of the model, and what tests share."""
    command.add_argument(
        "--pool",
        action="append",
        default=[],
        metavar="NAME=HOW",
        help="of a joint fit, what its experiments have of a parameter (or of all): shared, one "
        "value; separate, a value for each; partial or partial:SCALE, values around a common "
        "centre with a spread whose prior has this scale; may be repeated",
    )
    command.add_argument(
        "--variant",
        action="append",
        default=[],
        metavar="PART=LAW",
        help="another law for a part of the model, such as kelvin=power_law; may be repeated: "
        + ", ".join(f"{part}={'|'.join(laws)}" for part, laws in CHOICES.items()),
    )


def add_sampler_options(
    command: argparse.ArgumentParser,
    names: Sequence[str] = SAMPLER_OPTIONS,
    defaults: SamplerOptions = DEFAULT_OPTIONS,
) -> None:
    """Add options named after fields of `SamplerOptions`, with the values of given ones."""
    for name in SAMPLER_OPTIONS:
        if name not in names:
            continue
        kind = {"adapt_delta": float, "chain_timeout": float, "coordinates": str}.get(name, int)
        default = getattr(defaults, name)
        command.add_argument(
            f"--{name.replace('_', '-')}",
            type=kind,
            default=default,
            help="default: by protocol or none" if default is None else f"default {default}",
        )


def sampler_options(
    options: argparse.Namespace, names: Sequence[str] = SAMPLER_OPTIONS
) -> SamplerOptions:
    """Return what was chosen of the options that `add_sampler_options` added."""
    return SamplerOptions(**{name: getattr(options, name) for name in names})


def command_line() -> str:
    """Return the command as the user typed it, for manifests; bytes that are no text escaped."""
    typed = shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
    return typed.encode("utf-8", "backslashreplace").decode("utf-8")


@contextmanager
def writing(out: Path) -> Iterator[None]:
    """Name the option where results cannot be written."""
    try:
        yield
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror}).") from error


def print_checks(checks: Sequence[CheckResult], conflicts: Sequence[str] = ()) -> int:
    """Print both verdicts on a run with the checks behind them; return the exit code.

    What prior and data disagree about follows; it does not count for the code.
    """
    answers = verdicts(checks)
    for kind, verdict in answers.items():
        print(f"\n{kind.value} {verdict.outcome.value.upper()}\n{verdict.sentence}")
        for row in checks_table(
            [check for check in checks if check.check.kind is kind]
        ).itertuples():
            print(f"{row.verdict:<11}  {row.check}: {row.sentence}")
    if conflicts:
        print("\nDo prior and data agree? NO", *conflicts, sep="\n")
    if answers[CheckKind.SAMPLING].outcome is not Outcome.YES:
        return EXIT_CHECK_FAILED
    asked = any(check.check.kind is CheckKind.DESCRIPTION for check in checks)
    described = answers[CheckKind.DESCRIPTION].outcome is Outcome.YES
    return EXIT_NOT_DESCRIBED if asked and not described else 0


def exit_code(passed: bool) -> int:
    """Return the code of a command that did what it should, with its verdict."""
    return 0 if passed else EXIT_CHECK_FAILED
