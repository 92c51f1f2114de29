"""Fits under neighbouring laws: how to make one, and how far parameters move between two."""

import shlex
from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.drawing.page_parts import PageTable
from pyburgers.fitting.fit import Fit
from pyburgers.model.display import shown_quantity
from pyburgers.model.neighbouring_laws import neighbouring_laws

MOVED = " moved"
"""What names of columns with differences end with."""

FAR = 1.645
"""Standard deviations to either side that hold 90 % of a normal posterior."""


def what_a_yes_leaves_open(fit: Fit) -> tuple[str, ...]:
    """Return what a fit that describes its data does not exclude, and commands that show it.

    Returns
    -------
    tuple of str
        A sentence, then commands; empty where the model is not shown to describe the data.
    """
    if fit.verdicts()[CheckKind.DESCRIPTION].outcome is not Outcome.YES:
        return ()
    first = next(iter(fit.tests().values())).experiment
    laws = neighbouring_laws(fit.variant, first)
    if not laws:
        return ()
    said = (
        f"This yes does not exclude {' or '.join(laws)}: under another law parameters may lie "
        "outside of the intervals above."
    )
    if fit.is_joint or fit.is_part:
        return (f"{said} Fit the same tests with --variant {laws[0]} and compare.",)
    run = fit.directory
    other = f"{run.path}_{laws[0].replace('=', '_')}"
    inputs: list[str | Path] = [run.test_file(first.id), "--priors", run.priors_file]
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
    """Return how far each parameter moves from the first fit to the others.

    Parameters
    ----------
    fits : mapping of str to Fit
        Of the same data, at least two.

    Returns
    -------
    DataFrame
        Index parameter, of those that all fits infer; columns unit, mean and sd (of the first fit,
        SI), then for each other fit ``NAME mean`` and ``NAME moved``, the difference of the means
        over the sd.
    """
    summaries = {name: fit.summary("SI") for name, fit in fits.items()}
    (_, first), *others = summaries.items()
    table = first[["unit", "mean", "sd"]]
    for name, other in others:
        table = table.join(other["mean"].rename(f"{name} mean"), how="inner")
        table[f"{name}{MOVED}"] = (table[f"{name} mean"] - table["mean"]) / table["sd"]
    return table.rename_axis("parameter")


def shifts_table(fits: Mapping[str, Fit]) -> PageTable:
    """Return how far each parameter moves between fits of the same data, for a page.

    Parameters
    ----------
    fits : mapping of str to Fit
        As for `parameter_shifts`.
    """
    table = parameter_shifts(fits)
    moved = table.filter(like=MOVED)
    shown = pd.DataFrame({name: [f"{by:+.1f}" for by in moved[name]] for name in moved})
    labels = [shown_quantity(str(name)).label for name in table.index]
    return PageTable(
        "shifts",
        f"How far each parameter moves from {next(iter(fits))}, in its sd there",
        pd.concat([pd.Series(labels, name="quantity"), shown], axis=1),
        table.reset_index(),
        words=("quantity",),
        bad={str(name): (moved[name].abs() > FAR).tolist() for name in moved},
    )
