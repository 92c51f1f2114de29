"""Output of a fit: tables no wider than the terminal, verdicts, colours if it has some."""

import sys
from collections.abc import Sequence

import pandas as pd
from rich.console import Console
from rich.table import Table
from rich.text import Text

from pyburgers.checks.fit_checks import CheckKind, CheckResult, Outcome
from pyburgers.checks.verdicts import verdicts
from pyburgers.cli.shared import EXIT_CHECK_FAILED
from pyburgers.common.messages import PrintableStream, printable
from pyburgers.page.tables import THE_SAME, VERDICT_WORDS

EXIT_NOT_DESCRIBED = 4
"""The posterior was sampled well, but the model is not shown to describe the data."""

WIDTH = 80
"""Columns of output that goes elsewhere than to a terminal."""

COLOURS = {Outcome.YES: "green", Outcome.NO: "bold red", Outcome.CANNOT_TELL: "yellow"}

SHORT_TITLES = {"sd / prior sd": "sd/prior", "sd joint / alone": "sd ratio"}
HIDDEN = ("symbol", "ESS tail", "prior")
"""Columns of tables for a page that a terminal has no room for."""

FOLDED, LEAST_FOLDED = "quantity", 20
"""Column whose cells may take several lines, as those of too wide ones, and its least width."""


def print_table(table: pd.DataFrame, keys: Sequence[str]) -> None:
    """Print a table of text in blocks of columns that fit, each with the columns `keys` first.

    Blocks behind the first leave out rows that say nothing but `THE_SAME`.
    """
    console = _console()
    named = [name for name in keys if name in table]
    room = console.width + 1 - sum(_width(table, name) for name in named)
    others = [str(name) for name in table if name not in (*named, *HIDDEN)]
    too_wide = [name for name in others if _width(table, name) > max(room, LEAST_FOLDED + 1)]
    blocks: list[list[str]] = [[]]
    for name in others:
        if blocks[-1] and sum(_width(table, one) for one in [*blocks[-1], name]) > room:
            blocks.append([])
        blocks[-1].append(name)
    for number, block in enumerate(blocks):
        rows = table[[*named, *block]]
        if number:
            rows = rows[(rows[block] != THE_SAME).any(axis="columns")]
            console.print()
        console.print(_drawn(rows, named, too_wide))


def print_checks(
    checks: Sequence[CheckResult], conflicts: Sequence[str] = (), decisions: Sequence[str] = ()
) -> int:
    """Print verdicts with checks, conflicts and decisions; return the code of the verdicts."""
    console, answers = _console(), verdicts(checks)
    for kind, verdict in answers.items():
        colour = COLOURS[verdict.outcome]
        heading = Text(f"\n{kind.value} ", "bold").append(verdict.outcome.value.upper(), colour)
        console.print(heading, soft_wrap=True)
        console.print(printable(verdict.sentence), soft_wrap=True)
        for check in checks:
            if check.check.kind is kind:
                word = Text(f"{VERDICT_WORDS[check.outcome]:<11}  ", COLOURS[check.outcome])
                console.print(
                    word.append(printable(f"{check.name}: {check.sentence}"), ""), soft_wrap=True
                )
    disagree = Text("\nDo prior and data agree? ", "bold").append("NO", COLOURS[Outcome.NO])
    undecided = Text("\nBounds and priors to mind", "bold")
    for heading, lines in ((disagree, conflicts), (undecided, decisions)):
        for line in (heading, *map(printable, lines)) if lines else ():
            console.print(line, soft_wrap=True)
    if answers[CheckKind.SAMPLING].outcome is not Outcome.YES:
        return EXIT_CHECK_FAILED
    asked = any(check.check.kind is CheckKind.DESCRIPTION for check in checks)
    described = answers[CheckKind.DESCRIPTION].outcome is Outcome.YES
    return EXIT_NOT_DESCRIBED if asked and not described else 0


def print_lines(lines: Sequence[str]) -> None:
    """Print lines as they are, an empty one ahead of them."""
    if lines:
        print("", *lines, sep="\n")


def _console() -> Console:
    """Return the console of output, in colours if it is a terminal and NO_COLOR is not set."""
    stream = sys.stdout.bare if isinstance(sys.stdout, PrintableStream) else sys.stdout
    console = Console(file=stream, highlight=False, markup=False, emoji=False)
    if not console.is_terminal:
        console.width = WIDTH
    return console


def _width(table: pd.DataFrame, name: str) -> int:
    """Columns of the terminal that a column takes, with the space behind it."""
    cells = max(map(len, table[name].astype(str)), default=0)
    if name == FOLDED:
        cells = min(cells, LEAST_FOLDED)
    return max(len(SHORT_TITLES.get(name, name)), cells) + 1


def _drawn(table: pd.DataFrame, keys: Sequence[str], too_wide: Sequence[str]) -> Table:
    drawn = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
    for name in map(str, table):
        drawn.add_column(
            SHORT_TITLES.get(name, name),
            justify="left" if name in (*keys, *too_wide) else "right",
            no_wrap=name not in (FOLDED, *too_wide),
        )
    for row in table.itertuples(index=False):
        drawn.add_row(*(Text(printable(str(cell))) for cell in row))
    return drawn
