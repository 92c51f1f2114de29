"""`pyburgers new`: an experiment file for a text file of readings, after asking."""

import argparse
import os
import re
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from pyburgers.cli.check_file import all_errors, check
from pyburgers.cli.parser import is_text
from pyburgers.cli.shared import writing
from pyburgers.common.atomic_files import write_atomically
from pyburgers.common.errors import InputError
from pyburgers.common.paths import shown
from pyburgers.common.text_tables import TextTable, look_at
from pyburgers.common.toml_files import read_tables
from pyburgers.model.priors import shipped_prior_files
from pyburgers.protocols.guessed_columns import UNITS, GuessedColumn, guess_columns
from pyburgers.protocols.new_file import (
    Description,
    NewFile,
    Question,
    experiment_text,
    new_files,
)
from pyburgers.protocols.protocol import NAMES

MATERIAL = Question("material", "material")

FIRST = (
    Question("id", "name of the test"),
    MATERIAL,
    Question("temperature_K", "temperature in kelvin", float),
    Question("grain_size_m", "mean grain size at the start in m (230 um: 230e-6)", float),
)
LAST = (
    Question(
        "kind", "kind of data", choices=("measured", "digitised", "synthetic"), default="measured"
    ),
    Question("source", "source: who, when, where", default="unknown"),
)
"""What is asked about every kind of test, before and after its own questions."""


def _every_question() -> tuple[Question, ...]:
    """Return the questions of all kinds of test, in the order in which they are asked."""
    own = dict.fromkeys(
        question for new_file in new_files().values() for question in new_file.questions
    )
    return (*FIRST, *own, *LAST)


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument("csv", type=Path, metavar="CSV", help="text file of readings")
    command.add_argument(
        "--protocol", choices=NAMES, help="kind of test; default what the columns look like"
    )
    for question in _every_question():
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
    for note in (*table.notes, *table.problems):
        print(f"note: {note}")
    columns = guess_columns(table)
    for guessed in columns.values():
        print(f"guessed: {guessed.sentence}")
    guessed_name, reason = _guess_protocol(table, columns)
    name = options.protocol or guessed_name
    new_file = new_files()[name]
    _require_columns(options.csv, name, new_file, columns)
    if options.protocol is None:
        print(f"guessed: protocol {name}, because {reason}")
    read = new_file.read(columns)
    for quantity in columns:
        if quantity not in read:
            print(f"left out: column {columns[quantity].column!r}, which such a file does not name")
    _require_units(options.csv, read)
    _refuse_what_is_not_taken(name, new_file, columns, options)
    file = _named_in_text(os.path.relpath(options.csv, out.parent))
    answers = _answers(new_file, table, columns, options)
    description = Description(file, table, columns, answers)
    text = experiment_text(name, new_file, description)
    with writing(out):
        write_atomically(out, lambda draft: _write_checked(draft, out, text, file))
    print(shown(f"written: {out}"))
    code = check(out)
    if code == 0:
        print(f"next: {shlex.join(['pyburgers', 'fit', shown(out)])}")
    else:
        print(f"next: mend the rows, then {shlex.join(['pyburgers', 'check-file', shown(out)])}")
    return code


def _named_in_text(file: str) -> str:
    """Return the name of a text file, if another file can hold it."""
    if not is_text(file):
        raise InputError(
            f"{file!r}: found bytes that are no text in its name, expected a name that the "
            "experiment file can hold; rename it."
        )
    return file


def _write_checked(draft: Path, out: Path, text: str, file: str) -> None:
    """Write an experiment file; `draft` lies beside `out`, whose name it gets.

    Where the text file `file` alone is at fault, comments at the top of the draft say so.

    Raises
    ------
    InputError
        If the experiment file would be wrong.
    """
    draft.write_text(text, encoding="utf-8")
    try:
        errors, _ = all_errors(draft, read_tables(draft))
    except InputError as error:  # such as of a control character
        errors = list(error.sentences)
    told = [error.replace(f"{draft}: ", "").replace(str(draft), str(out)) for error in errors]
    if not all(error.startswith(str(draft.parent / file)) for error in errors):
        said = "; ".join(error.rstrip(".") for error in told)
        raise InputError(f"{out}: not written, because it would be wrong: {said}.")
    if told:
        head = ["# This draft cannot be used yet:", *(f"# - {error}" for error in told), ""]
        draft.write_text("\n".join([*head, text]), encoding="utf-8")


def _guess_protocol(table: TextTable, columns: Mapping[str, GuessedColumn]) -> tuple[str, str]:
    """Return the protocol that a text file looks like, and why: of several that it suits the last.

    Any curve suits the first one.
    """
    return next(
        (name, reason)
        for name in reversed(NAMES)
        if (reason := new_files()[name].suits(table, columns)) is not None
    )


def _require_columns(
    path: Path, protocol: str, new_file: NewFile, columns: Mapping[str, GuessedColumn]
) -> None:
    for quantities in new_file.needed:
        if not any(name in columns for name in quantities):
            raise InputError(
                f"{path}: found no column that looks like {' or '.join(quantities)}, expected one "
                f"for the protocol {protocol}; name it so in the first row, or give --protocol."
            )


def _require_units(path: Path, columns: Mapping[str, GuessedColumn]) -> None:
    """Refuse columns whose names have units that the file could not hold."""
    for guessed in columns.values():
        where = f"{path}: column {guessed.column!r}"
        if guessed.is_foreign:
            units = " or ".join(unit for unit, _ in UNITS.get(guessed.kind, ()))
            raise InputError(
                f"{where}: found a name of other units or of logarithms, expected "
                f"{f'{guessed.kind} in {units}' if units else 'tan(delta), 1/Q or log10 of them'}; "
                "turn its numbers and name it so."
            )
        of = columns.get(guessed.shares_unit_with or "")
        if of is not None and of.unit != guessed.unit:
            raise InputError(
                f"{where}: found {guessed.unit}, expected {of.unit}, the unit of column "
                f"{of.column!r}; turn its numbers and name it so."
            )


def _refuse_what_is_not_taken(
    protocol: str,
    new_file: NewFile,
    columns: Mapping[str, GuessedColumn],
    options: argparse.Namespace,
) -> None:
    """Refuse options that the file would not hold."""
    given = vars(options)
    taken = {question.name for question in (*FIRST, *LAST)}
    taken |= set(new_file.taken(columns.keys(), given))
    own = [question for question in new_file.questions if given[question.name] is not None]
    others = ", ".join(question.option for question in own if question.name in taken)
    for question in _every_question():
        value = given[question.name]
        if value is not None and question.name not in taken:
            beside = f" beside {others}" if question in own and others else ""
            why = (
                f"{question.name} is read from column {columns[question.name].column!r}"
                if question.name in columns
                else f"such a test of the protocol {protocol} takes none{beside}"
            )
            raise InputError(f"{question.option} {value}: expected no such option, because {why}.")


def _questions(
    new_file: NewFile,
    table: TextTable,
    columns: Mapping[str, GuessedColumn],
    given: Mapping[str, Any],
) -> Iterator[Question]:
    """Return what is still to be asked about a kind of test, with what the file suggests.

    Parameters
    ----------
    new_file, table, columns
        The kind of test, and the text file.
    given : mapping
        Answers that are there already, None where there is none.
    """
    name = re.sub(r"[^A-Za-z0-9._-]", "_", table.path.stem)[:100]
    known = {
        "id": name if re.match(r"[A-Za-z0-9_]", name) else f"_{name}",
        "temperature_K": _temperature(table, columns),
    }
    asked = {question.name for question in (*FIRST, *LAST)}
    asked |= set(new_file.asked(columns.keys(), given))
    for question in _every_question():
        if question.name in asked and given[question.name] is None:
            yield replace(question, default=known.get(question.name, question.default))


def _temperature(table: TextTable, columns: Mapping[str, GuessedColumn]) -> float | None:
    """Highest temperature (K) of the table."""
    column = columns.get("temperature")
    if column is None:
        return None
    highest = max(table.numbers(column.column))
    return round(highest + (273.15 if column.unit == "C" else 0.0), 6)


def _answers(
    new_file: NewFile,
    table: TextTable,
    columns: Mapping[str, GuessedColumn],
    options: argparse.Namespace,
) -> dict[str, Any]:
    """Return the answers: options, what is typed in a terminal, or defaults."""
    given = {question.name: vars(options)[question.name] for question in _every_question()}
    asking = sys.stdin.isatty()
    # What is asked next may depend on the answer before.
    while questions := list(_questions(new_file, table, columns, given)):
        question = questions[0]
        if not asking:
            _require_defaults(questions)
            print(f"taken: {question.option} {question.default}")
        given[question.name] = _ask(question) if asking else question.default
    return given


def _require_defaults(questions: Sequence[Question]) -> None:
    """Refuse questions that have to be answered where there is no terminal to ask in."""
    missing = [question.option for question in questions if question.default is None]
    if missing:
        them = "it" if len(missing) == 1 else "them"
        raise InputError(
            f"{', '.join(missing)}: missing, expected {them} because there is no terminal to ask "
            "in."
        )


def _ask(question: Question) -> Any:
    """Ask until there is an answer."""
    choices = question.choices
    if question.name == MATERIAL.name:
        choices = sorted(shipped_prior_files())
    among = f" ({', '.join(choices)})" if choices else ""
    proposed = "" if question.default is None else f" [{question.default}]"
    while True:
        try:
            typed = input(f"{question.text}{among}{proposed}: ").strip()
        except EOFError:
            raise InputError(f"{question.option}: found no answer, expected one.") from None
        except UnicodeDecodeError:
            typed = None
        if typed is None or not is_text(typed):
            print("found bytes that are no text, expected text")
            continue
        if not typed and question.default is not None:
            return question.default
        try:
            answer = question.kind(typed)
        except ValueError:
            print(f"found {typed!r}, expected a number")
            continue
        if typed and (question.choices is None or answer in question.choices):
            return answer
