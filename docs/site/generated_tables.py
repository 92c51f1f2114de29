"""Tables of the reference pages as lines of Markdown.

    python docs/site/generated_tables.py NAME

prints a table: that of a kind of file, or one of `TABLES`.
"""

import argparse
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from importlib import import_module
from itertools import groupby
from typing import Any

from combinations import (
    FROZEN,
    FROZEN_THIRD,
    POSSIBLE,
    REFUSED,
    STANDARD,
    THIRD,
    combinations,
    materials,
)
from file_keys import key_tables, structures

from pyburgers.cli.main import COMMANDS, EXIT_CODES
from pyburgers.cli.parser import HelpWithDefaults, OneLineParser
from pyburgers.common.units import UNITS
from pyburgers.kinds.likelihood import NAMES
from pyburgers.model.display import symbol_text
from pyburgers.model.parameters import (
    CONDITION_PARAMETERS,
    ENVIRONMENT_PARAMETERS,
    PARAMETERS,
    VARIANT_PARAMETERS,
    Parameter,
)
from pyburgers.model.prior_families import FAMILIES, MAX_STRESS

FREE_IN_HISTORIES = ("strain_noise", "residual_correlation_time", "residual_correlated_share")
"""Parameters of variants that are free where a loading history reads strain."""

SHOWN = {
    STANDARD: "**yes**",
    POSSIBLE: "yes",
    FROZEN: "yes ¹",
    THIRD: "yes ²",
    FROZEN_THIRD: "yes ¹ ²",
    REFUSED: "–",
}


def key_lines(name: str) -> list[str]:
    """Return the tables of a file, `name` as in `file_keys.structures`."""
    lines = []
    for table in key_tables(structures()[name]):
        heading = f"`{table.heading}`" if table.heading else "Top of the file"
        about = [table.meaning, "" if table.needed else "may be left out"]
        lines += [f"### {heading}", "", f"{_sentence(about)}", ""]
        rows = ((f"`{k.name}`", k.holds, k.unit, k.default, k.meaning) for k in table.keys)
        lines += _table(("key", "holds", "unit", "default", "what it is"), rows)
    return lines


def parameter_lines() -> list[str]:
    """Return every parameter that files may give, with the units that each may be given in."""
    groups: Sequence[tuple[str, Sequence[Parameter]]] = (
        ("Every prior file has these", PARAMETERS),
        ("Of variants: they may be left out", VARIANT_PARAMETERS),
        ("Errors of conditions: given by files of tests", CONDITION_PARAMETERS),
        ("The environment of a test: stated in its file", ENVIRONMENT_PARAMETERS),
    )
    lines = []
    for heading, parameters in groups:
        rows = (
            (
                f"`{p.name}`",
                symbol_text(p),
                p.label,
                ", ".join(f"`{unit}`" for unit in _units(p)),
                _left_out(p),
            )
            for p in parameters
        )
        names = ("parameter", "symbol", "what it is", "units in files", "if left out (SI)")
        lines += [f"### {heading}", "", *_table(names, rows)]
    return lines


def family_lines() -> list[str]:
    """Return families of priors and the numbers that each needs."""
    rows = (
        (f"`{family}`", _codes(rules.required), _codes(rules.optional))
        for family, rules in FAMILIES.items()
    )
    return _table(("family", "needed numbers", "may have"), rows)


def combination_lines() -> list[str]:
    """Return what can be combined, a table for each kind of test."""
    lines = []
    for protocol in NAMES:
        found = [c for c in combinations() if c.protocol == protocol]
        rows = [
            (f"`{part}={law}`", *(SHOWN[c.outcome] for c in group))
            for (part, law), group in groupby(found, key=lambda c: (c.part, c.law))
        ]
        lines += [f"## `{protocol}`", "", *_table(("law", *materials()), rows)]
        refused = dict.fromkeys(
            (f"`{c.part}={c.law}`", c.reason.partition(": ")[2].replace("\n", " "))
            for c in found
            if c.outcome == REFUSED
        )
        lines += [
            ":::{dropdown} What is refused, and why",
            *(f"- {law}: {why}" for law, why in refused),
            ":::",
            "",
        ]
    return lines


def command_lines() -> list[str]:
    """Return the help of every command."""
    lines = []
    for name, purpose in COMMANDS.items():
        parser = _WideParser(prog=f"pyburgers {name}")
        import_module(f"pyburgers.cli.{name.replace('-', '_')}").add_options(parser)
        lines += _helps(parser, purpose)
    return [*lines, _sentence([EXIT_CODES])]


def _helps(parser: argparse.ArgumentParser, purpose: str, level: int = 2) -> list[str]:
    """Return the help of a command and of those below it."""
    lines = [f"{'#' * level} `{parser.prog}`", "", _sentence([purpose]), ""]
    lines += ["```text", *parser.format_help().splitlines(), "```", ""]
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            purposes = {one.dest: one.help or "" for one in action._choices_actions}
            for name, below in action.choices.items():
                lines += _helps(below, purposes[name], level + 1)
    return lines


class _Wide(HelpWithDefaults):
    """Help as wide as a page, whatever the terminal."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, width=100)


class _WideParser(OneLineParser):
    """Has such help, as have the commands below it."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **{"formatter_class": _Wide, **kwargs})


def _units(parameter: Parameter) -> list[str]:
    units = list(UNITS[parameter.quantity])
    return [*units, MAX_STRESS] if parameter.name == "stress_noise" else units


def _left_out(parameter: Parameter) -> str:
    """Return the value of a parameter that a file does not name."""
    if parameter.name in FREE_IN_HISTORIES:
        return "see [loading histories](../loading_history.md#how-it-is-solved-and-fitted)"
    if parameter.standard is None:
        return ""
    unit = "" if parameter.si_unit == "1" else f" {parameter.si_unit}"
    return f"{parameter.standard:g}{unit}"


def _codes(names: Iterable[str]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _sentence(parts: Iterable[str]) -> str:
    text = "; ".join(part for part in parts if part)
    return f"{text[0].upper()}{text[1:]}." if text else ""


def _table(names: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return a table in Markdown."""
    body = [" | ".join(re.sub(r"\|", r"\\|", cell) for cell in row) for row in rows]
    return [
        f"| {' | '.join(names)} |",
        f"|{'---|' * len(names)}",
        *(f"| {row} |" for row in body),
        "",
    ]


TABLES: dict[str, Callable[[], list[str]]] = {
    "all-parameters": parameter_lines,
    "prior-families": family_lines,
    "combinations": combination_lines,
    "commands": command_lines,
}
"""Tables that the site and the command line know by name, beside those of kinds of files."""


def main(arguments: Sequence[str]) -> None:
    """Print the table that the command line names."""
    parser = argparse.ArgumentParser(description="Print a table of the reference pages.")
    parser.add_argument("name", choices=[*structures(), *TABLES])
    name = parser.parse_args(arguments).name
    print("\n".join(TABLES[name]() if name in TABLES else key_lines(name)))


if __name__ == "__main__":
    main(sys.argv[1:])
