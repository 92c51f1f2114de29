"""Fits under neighbouring laws: how to make one, and how far parameters move between two."""

import shlex
from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.fitting.fit import Fit
from pyburgers.model.display import shown_quantity
from pyburgers.model.neighbouring_laws import neighbouring_laws, redefined

MOVED = " moved"
"""What names of columns with differences end with."""


def what_a_yes_leaves_open(fit: Fit) -> tuple[str, ...]:
    """Return a sentence on laws that a yes does not exclude, then commands; none without a yes."""
    if fit.verdicts()[CheckKind.DESCRIPTION].outcome is not Outcome.YES:
        return ()
    problem = (fit.whole or fit).problem
    laws = neighbouring_laws(problem.variant, *problem.experiments)
    if not laws:
        return ()
    said = (
        f"This yes does not exclude {', '.join(laws)}: under another law parameters may lie "
        "outside of the intervals above."
    )
    if fit.is_joint or fit.is_part:
        return (f"{said} Fit the same tests with --variant {laws[0]} and compare.",)
    run = fit.directory
    other = f"{run.path}_{laws[0].replace('=', '_')}"
    inputs: list[str | Path] = [run.test_file(problem.name), "--priors", run.priors_file]
    return (
        f"{said} To see how far each moves:",
        _command("fit", *inputs, "--variant", laws[0], "--out", Path(other)),
        _command("compare", run.path, Path(other)),
    )


def _command(*words: str | Path) -> str:
    """Return a command, paths as they are seen from the working directory."""
    here = Path.cwd()
    return shlex.join(
        [
            "pyburgers",
            *(
                str(word.relative_to(here))
                if isinstance(word, Path) and word.is_relative_to(here)
                else str(word)
                for word in words
            ),
        ]
    )


def parameter_shifts(fits: Mapping[str, Fit]) -> pd.DataFrame:
    """Return unit, mean, sd of the first fit; of others the mean, and its move over that sd.

    Rows are quantities that all fits have, and that mean the same in all.
    """
    (_, first), *others = fits.items()
    table = first.si_summary()[["unit", "mean", "sd"]]
    for name, other in others:
        mean = other.si_summary()["mean"].rename(f"{name} mean")
        apart = redefined(first.variant, other.variant) | _of_other_units(first, other)
        table = table.join(mean.drop([*apart], errors="ignore"), how="inner")
        table[f"{name}{MOVED}"] = (table[f"{name} mean"] - table["mean"]) / table["sd"]
    return table.rename_axis("parameter")


def _of_other_units(one: Fit, other: Fit) -> frozenset[str]:
    """Return beta if A has the unit Pa^-n of an n that only one fit knows, or knows otherwise."""
    exponents = [fit.problem.priors[0]["stress_exponent"] for fit in (one, other)]
    known = {prior.location if prior.is_fixed else None for prior in exponents}
    return frozenset({"beta"} if len(known) > 1 else ())


def shift_sentences(fits: Mapping[str, Fit]) -> tuple[str, ...]:
    """Say how far each parameter moves from the first fit to each other one, the farthest first."""
    table = parameter_shifts(fits).filter(like=MOVED)
    sentences = []
    for name in table if len(table) else ():
        by = table[name].sort_values(key=abs, ascending=False)
        moves = ", ".join(f"{shown_quantity(str(k)).label} {one:+.1f}" for k, one in by.items())
        other = str(name).removesuffix(MOVED)
        sentences.append(
            f"From {next(iter(fits))} to {other} parameters move by, in their sd: {moves}."
        )
    return tuple(sentences)
