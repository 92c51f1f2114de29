"""`pyburgers new`: an experiment file for a text file of readings, after asking."""

import argparse
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pyburgers.cli.check_file import check
from pyburgers.cli.guessing import GuessedColumn, guess_columns, guess_protocol
from pyburgers.cli.shared import writing
from pyburgers.cli.templates import Description, experiment_text
from pyburgers.common.atomic_files import write_text
from pyburgers.common.errors import InputError
from pyburgers.common.text_tables import TextTable, look_at
from pyburgers.model.priors import shipped_prior_files
from pyburgers.protocols.protocol import NAMES


@dataclass(frozen=True)
class Question:
    """Something that a text file does not say of its test.

    Attributes
    ----------
    name : str
        Of the answer; the option has dashes in place of underscores.
    text : str
        What is asked.
    kind : callable
        Makes the answer from text.
    choices : sequence of str, optional
        What it may be.
    default : object
        Where nothing is answered; None where something has to be.
    """

    name: str
    text: str
    kind: Callable[[str], Any] = str
    choices: Sequence[str] | None = None
    default: Any = None

    @property
    def option(self) -> str:
        """Name of the option that answers it."""
        return f"--{self.name.replace('_', '-')}"


QUESTIONS = {
    question.name: question
    for question in (
        Question("id", "name of the test"),
        Question("material", "material"),
        Question("temperature_K", "temperature in kelvin", float),
        Question("grain_size_m", "mean grain size at the start in m (230 um: 230e-6)", float),
        Question("strain_rate_per_s", "imposed strain rate in 1/s", float),
        Question("stress_MPa", "imposed stress in MPa", float),
        Question("strain_uncertainty", "standard deviation of a strain, in its unit", float),
        Question("stress_uncertainty", "standard deviation of a stress, in its unit", float),
        Question("deformation", "deformation", choices=("axial", "shear")),
        Question("poisson_ratio", "Poisson's ratio", float, default=0.25),
        Question("kind", "kind of data", choices=("measured", "digitised", "synthetic"),
                 default="measured"),
        Question("source", "source: who, when, where", default="unknown"),
    )
}  # fmt: skip
"""In the order in which they are asked, as far as a kind of test needs them."""


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument("csv", type=Path, metavar="CSV", help="text file of readings")
    command.add_argument(
        "--protocol", choices=NAMES, help="kind of test; default what the columns look like"
    )
    for question in QUESTIONS.values():
        command.add_argument(
            question.option, type=question.kind, choices=question.choices, help=question.text
        )
    command.add_argument(
        "--out", type=Path, metavar="FILE.toml", help="default CSV with the ending .toml"
    )


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    table = look_at(options.csv)
    out: Path = options.out or options.csv.with_suffix(".toml")
    if out.exists():
        raise InputError(f"{out}: exists already, expected a new file; choose another --out.")
    if table.separator == ";":
        raise InputError(
            f"{table.path}: found semicolons between its columns, expected commas or white space; "
            "write commas in their place, and points in numbers."
        )
    columns = guess_columns(table)
    for guessed in columns.values():
        print(f"guessed: {guessed.sentence}")
    protocol = options.protocol
    if protocol is None:
        protocol, reason = guess_protocol(table, columns)
        print(f"guessed: protocol {protocol}, because {reason}")
    _require_columns(options.csv, protocol, columns)
    questions = list(_questions(protocol, table, columns, options))
    values = {"protocol": protocol, **_answers(questions, options)}
    file = os.path.relpath(options.csv, out.parent)
    with writing(out):
        write_text(out, experiment_text(Description(file, table, columns, values)))
    print(f"written: {out}")
    code = check(out)
    if code == 0:
        print(f"next: pyburgers fit {out}")
    return code


NEEDED: Mapping[str, Sequence[Sequence[str]]] = {
    "constant_rate": (("strain", "time"), ("stress",)),
    "forced_oscillation": (("time",), ("strain",), ("stress",)),
    "loading_history": (("time",), ("strain", "stress")),
    "attenuation": (("period", "frequency"), ("attenuation",)),
}
"""Quantities whose columns a kind of test needs, one of each."""


def _require_columns(path: Path, protocol: str, columns: Mapping[str, GuessedColumn]) -> None:
    for quantities in NEEDED[protocol]:
        if not any(name in columns for name in quantities):
            raise InputError(
                f"{path}: found no column that looks like {' or '.join(quantities)}, expected one "
                f"for the protocol {protocol}; name it so in the first row, or give --protocol."
            )


def _questions(
    protocol: str,
    table: TextTable,
    columns: Mapping[str, GuessedColumn],
    options: argparse.Namespace,
) -> Iterator[Question]:
    """Return what has to be asked about a kind of test, with what the file suggests."""
    name = re.sub(r"[^A-Za-z0-9._-]", "_", table.path.stem)[:100]
    known = {
        "id": name if re.match(r"[A-Za-z0-9_]", name) else f"_{name}",
        "temperature_K": _temperature(table, columns),
    }
    asked = {"id", "material", "temperature_K", "grain_size_m", "kind", "source"}
    match protocol:
        case "constant_rate":
            asked.add("strain_rate_per_s")
        case "loading_history" if options.strain_rate_per_s is None:
            if options.stress_MPa is not None or not {"stress", "strain"} <= columns.keys():
                asked.add("stress_MPa")
        case "forced_oscillation":
            errors = ("strain_uncertainty", "stress_uncertainty")
            asked |= {error for error in errors if error not in columns}
        case "attenuation":
            asked |= {"deformation", "poisson_ratio"}
    for question in QUESTIONS.values():
        if question.name in asked:
            default = known.get(question.name, question.default)
            yield Question(question.name, question.text, question.kind, question.choices, default)


def _temperature(table: TextTable, columns: Mapping[str, GuessedColumn]) -> float | None:
    """Highest temperature (K) of the table."""
    column = columns.get("temperature")
    if column is None:
        return None
    highest = max(table.numbers(column.column))
    return round(highest + (273.15 if column.unit == "C" else 0.0), 6)


def _answers(questions: Sequence[Question], options: argparse.Namespace) -> dict[str, Any]:
    """Return the answers: options, what is typed in a terminal, or defaults."""
    given = {question.name: getattr(options, question.name) for question in QUESTIONS.values()}
    asking = sys.stdin.isatty()
    missing = [
        question.option
        for question in questions
        if given[question.name] is None and question.default is None
    ]
    if missing and not asking:
        raise InputError(
            f"{', '.join(missing)}: missing, expected them because there is no terminal to ask in."
        )
    for question in questions:
        if given[question.name] is None:
            given[question.name] = _ask(question) if asking else question.default
            if not asking:
                print(f"taken: {question.option} {given[question.name]}")
    return given


def _ask(question: Question) -> Any:
    """Ask until there is an answer."""
    choices = question.choices
    if question.name == "material":
        choices = sorted(shipped_prior_files())
    among = f" ({', '.join(choices)})" if choices else ""
    proposed = "" if question.default is None else f" [{question.default}]"
    while True:
        try:
            typed = input(f"{question.text}{among}{proposed}: ").strip()
        except EOFError:
            raise InputError(f"{question.option}: found no answer, expected one.") from None
        if not typed and question.default is not None:
            return question.default
        try:
            answer = question.kind(typed)
        except ValueError:
            print(f"found {typed!r}, expected a number")
            continue
        if typed and (question.choices is None or answer in question.choices):
            return answer
