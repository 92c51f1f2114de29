"""`pyburgers new`: an experiment file for a text file of readings, after asking."""

import argparse
import os
import re
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from pyburgers.cli.check_file import all_errors, check
from pyburgers.cli.parser import is_text
from pyburgers.cli.shared import writing
from pyburgers.cli.unread_columns import (
    form_told,
    proposed_temperature,
    rates_told,
    refuse_obstacle,
    require_numbers,
    temperature_use,
)
from pyburgers.common.atomic_files import write_atomically
from pyburgers.common.errors import InputError
from pyburgers.common.paths import shown
from pyburgers.common.scratch import scratch_folder
from pyburgers.common.text_tables import TextTable, look_at
from pyburgers.common.toml_files import read_tables
from pyburgers.common.units import UNIT_TABLE, unit_spelled, units_text
from pyburgers.kinds.column_names import ALONG_AXIS, COLUMN_NAMES, plain, stated_unit
from pyburgers.kinds.contradicted_names import contradicted_form
from pyburgers.kinds.guessed_columns import (
    GuessedColumn,
    first_of_tests,
    guess_columns,
    left_out,
    sorted_by_time,
    units_in_comments,
)
from pyburgers.kinds.likelihood import NAMES
from pyburgers.kinds.new_file import (
    Columns,
    Description,
    NewFile,
    Question,
    experiment_text,
    new_files,
)
from pyburgers.model.priors import shipped_prior_files

MATERIAL = Question("material", "material", example="ice")

FIRST_QUESTIONS = (
    Question("id", "name of the test", example="test"),
    MATERIAL,
    Question("temperature_K", "temperature in kelvin", float, example=263.0),
    Question(
        "grain_size_m",
        "mean grain size at the start in m (230 um: 230e-6)",
        float,
        example=1e-3,
        key="initial_grain_size_m",
    ),
)
LAST_QUESTIONS = (
    Question(
        "kind", "kind of data", choices=("measured", "digitised", "synthetic"), default="measured"
    ),
    Question("source", "source: who, when, where", default="unknown"),
)
"""What is asked about every kind of test, before and after its own questions."""

EXPECTED_COLUMNS = {
    "attenuation": f"tan(delta), 1/Q, log10 of them, or an angle in {units_text('angle')}",
    "attenuation_uncertainty": "a standard deviation of tan(delta), or of the angle in its unit",
    "relaxation_modulus": "a modulus E(t)",
}
"""What a column has to hold."""

OTHER_NAME = (
    "a name that states another unit, a factor, a logarithm, a shear or a relative error, "
    "or leaves the unit open"
)
"""A name that states no unit of its quantity, in words."""


def _every_question() -> tuple[Question, ...]:
    """Return the questions of all kinds of test, in the order in which they are asked."""
    own = dict.fromkeys(
        question for new_file in new_files().values() for question in new_file.questions
    )
    return (*FIRST_QUESTIONS, *own, *LAST_QUESTIONS)


def _column_question(quantity: str) -> Question:
    """Return the question which column holds a quantity."""
    return Question(f"{quantity}_column", f"column of the {quantity.replace('_', ' ')}")


def _column_questions() -> dict[str, Question]:
    """Return the questions which column holds what, by the quantities that files can name."""
    named = {quantity for new_file in new_files().values() for quantity in new_file.quantities}
    errors = (f"{quantity}_uncertainty" for quantity in COLUMN_NAMES)
    return {name: _column_question(name) for name in (*COLUMN_NAMES, *errors) if name in named}


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
    for question in _column_questions().values():
        command.add_argument(
            question.option, metavar="NAME", help=f"{question.text}: its name, or number from 1"
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
    if not out.parent.is_dir():
        raise InputError(
            f"{out}: the folder {out.parent} does not exist; make it, or choose another --out."
        )
    for note in (*table.notes, *table.problems):
        print(shown(f"note: {note}"))
    given = {question.name: vars(options)[question.name] for question in _every_question()}
    new_file, reason, columns, order = _recognised_kind(table, options)
    for sentence in filter(None, (order, rates_told(table, columns))):
        print(f"check: {sentence}")
    _require_columns(table, new_file, columns)
    read = new_file.select_columns(columns)
    for guessed in read.values():
        print(f"guessed: {guessed.sentence}")
    if options.protocol is None:
        print(f"guessed: protocol {new_file.experiment.protocol}, because {reason}")
    for sentence in units_in_comments(table, read):
        print(f"check: {sentence}")
    for sentence in left_out(table, columns, read, temperature_use(new_file, columns, given)):
        print(f"left out: {sentence}")
    named = [one for one in new_file.quantities if vars(options).get(f"{one}_column") is not None]
    _require_units(options.csv, {**read, **{quantity: columns[quantity] for quantity in named}})
    _refuse_needless_options(new_file, read, vars(options))
    file = os.path.relpath(options.csv, out.parent)
    if not is_text(file):
        raise InputError(
            f"{file!r}: found bytes that are no text in its name, expected a name that the "
            "experiment file can hold; rename it."
        )
    proposed = {"id": _identifier(table), "temperature_K": proposed_temperature(new_file, columns)}
    draft = _Draft(new_file, Description(file, table, read, given), proposed)
    answers = _answers(draft)
    for sentence in new_file.describe_decisions(replace(draft.test, values=answers)):
        print(f"decided: {sentence}")
    text = draft.text(answers)
    with writing(out):
        write_atomically(out, lambda draft: _write_checked(draft, out, text, file))
    print(shown(f"written: {out}"))
    code = check(out, tells_unread=False)  # they are told above, with reasons
    if code == 0:
        print(f"next: {shlex.join(['pyburgers', 'fit', shown(out)])}")
    else:
        print(f"next: mend the rows, then {shlex.join(['pyburgers', 'check-file', shown(out)])}")
    return code


def _errors_of(draft: Path, text: str) -> list[str]:
    """Write a draft; return its errors."""
    draft.write_text(text, encoding="utf-8")
    try:
        errors, _ = all_errors(draft, read_tables(draft))
    except InputError as error:  # such as of a control character
        return list(error.sentences)
    return errors


def _write_checked(draft: Path, out: Path, text: str, file: str) -> None:
    """Write a draft beside `out`; comments at its top name faults of the text file `file`."""
    errors = _errors_of(draft, text)
    sentences = [error.replace(f"{draft}: ", "").replace(str(draft), str(out)) for error in errors]
    if not all(error.startswith(str(draft.parent / file)) for error in errors):
        said = "; ".join(error.rstrip(".") for error in sentences)
        raise InputError(f"{out}: not written, because it would be wrong: {said}.")
    if sentences:
        head = ["# This draft cannot be used yet:", *(f"# - {error}" for error in sentences), ""]
        draft.write_text("\n".join([*head, text]), encoding="utf-8")


def _recognised_kind(
    table: TextTable, options: argparse.Namespace
) -> tuple[NewFile, str, Columns, str | None]:
    """Return the kind, why it was guessed, what columns hold, and doubts on the order of rows."""
    given = vars(options)
    chosen = {
        quantity: _column_named(table, question, given[question.name])
        for quantity, question in _column_questions().items()
        if given[question.name] is not None
    }
    while True:
        columns, order = first_of_tests(table, guess_columns(table, chosen))
        guessed, reason = _guess_protocol(sorted_by_time(columns))
        new_file = new_files()[options.protocol or guessed]
        tied = [one for one in new_file.select_columns(columns).values() if not one.is_decided]
        if not tied:
            return new_file, reason, columns, order
        # Which of several columns is meant is asked.
        chosen[tied[0].quantity] = _chosen_column(table, tied[0])


def _column_named(table: TextTable, question: Question, name: str) -> str | int:
    """Return the column that an option names."""
    numbered = (column for k, column in enumerate(table.columns, start=1) if str(k) == name)
    found = name if name in table.columns else next(numbered, None)
    if found is not None:
        require_numbers(table, found)
    if found is None or not table.numbers(found):
        names = ", ".join(repr(str(column)) for column in table.columns)
        raise InputError(
            f"{question.option} {name}: expected a column of {table.path} that holds numbers, of "
            f"{names}."
        )
    return found


def _chosen_column(table: TextTable, tied: GuessedColumn) -> str | int:
    """Return the column of a quantity of which there are several, after asking."""
    question = _column_question(tied.quantity)
    names = [str(one.column) for one in (tied, *tied.rivals)]
    if not sys.stdin.isatty():
        ways = " or ".join(shlex.join([question.option, name]) for name in names)
        raise InputError(
            f"{table.path}: found {len(names)} columns that may be the {tied.says}, expected one; "
            f"give {ways}."
        )
    answer = _ask(replace(question, choices=names), lambda _: ())
    return _column_named(table, question, answer)


def _guess_protocol(columns: Columns) -> tuple[str, str]:
    """Return the last protocol that a text file suits, and why; any curve suits the first."""
    reasons = ((name, new_files()[name].recognise(columns)) for name in reversed(NAMES))
    return next((name, reason) for name, reason in reasons if reason is not None)


def _require_columns(
    table: TextTable, new_file: NewFile, columns: Mapping[str, GuessedColumn]
) -> None:
    for quantities in new_file.needed:
        if not any(name in columns for name in quantities):
            for column in table.columns:
                refuse_obstacle(table, column, quantities)
            names = " or ".join(quantities).replace("_", " ")
            among = f" among {', '.join(map(str, table.columns))}" if table.columns else ""
            raise InputError(
                f"{table.path}: found no column of numbers that looks like {names}{among}, "
                f"expected one for the protocol {new_file.experiment.protocol}; name it so in the "
                f"first row, give {_column_question(quantities[0]).option}, or give --protocol."
                f"{form_told(table, quantities)}"
            )


def _require_units(path: Path, columns: Mapping[str, GuessedColumn]) -> None:
    """Refuse columns whose names have units that the file could not hold."""
    for guessed in columns.values():
        where = f"{path}: column {guessed.column!r}"
        if guessed.is_foreign:
            quantity, kind = guessed.quantity, guessed.kind
            what = EXPECTED_COLUMNS.get(quantity, kind)
            along = " along the axis" if quantity in ALONG_AXIS else ""
            expected = f"{what}{along} in {units_text(kind)}" if kind in UNIT_TABLE else what
            for sentence in contradicted_form(guessed.column, plain(guessed.name), quantity):
                raise InputError(f"{path}: {sentence}")
            unit = stated_unit(plain(guessed.name)) if kind in UNIT_TABLE else ""
            as_written = re.search(re.escape(unit), guessed.name, re.IGNORECASE)
            is_other = bool(unit) and unit_spelled(unit, kind) is None
            found = f"the unit {as_written[0]!r}" if as_written and is_other else OTHER_NAME
            raise InputError(
                f"{where}: found {found}, expected {expected}; convert the numbers and name the "
                "unit."
            )
        if guessed.confined_by is not None:
            raise InputError(
                f"{where}: found a stress that is never below column {guessed.confined_by!r}, "
                "expected the differential stress; write the difference as a column, or give "
                f"{shlex.join([_column_question('stress').option, str(guessed.column)])} if it is."
            )
        of = columns.get(guessed.shares_unit_with or "")
        if of is not None and of.unit != guessed.unit:
            raise InputError(
                f"{where}: found {guessed.unit}, expected {of.unit}, the unit of column "
                f"{of.column!r}; convert the numbers and name the unit."
            )


def _refuse_needless_options(new_file: NewFile, columns: Columns, given: Mapping[str, Any]) -> None:
    """Refuse options that the file would not hold."""
    taken = {question.name for question in (*FIRST_QUESTIONS, *LAST_QUESTIONS)}
    taken |= set(new_file.allowed_answers(columns, given))
    own = [question for question in new_file.questions if given[question.name] is not None]
    others = ", ".join(question.option for question in own if question.name in taken)
    for question in _every_question():
        value = given[question.name]
        if value is not None and question.name not in taken:
            beside = f" beside {others}" if question in own and others else ""
            why = f"such a test of the protocol {new_file.experiment.protocol} takes none{beside}"
            if question.name in columns:
                why = f"{question.name} is read from column {columns[question.name].column!r}"
            raise InputError(f"{question.option} {value}: expected no such option, because {why}.")
    for quantity, question in _column_questions().items():
        value = given[question.name]
        if value is not None and quantity not in (*columns, "temperature"):  # which is proposed
            ways = "".join(
                f"; give {own.option}" for own in new_file.questions if own.name == quantity
            )
            raise InputError(
                f"{question.option} {value}: expected no such option, because this file of the "
                f"protocol {new_file.experiment.protocol} does not read that column{ways}."
            )


def _identifier(table: TextTable) -> str:
    """Return a name of the test that its text file suggests."""
    name = re.sub(r"[^A-Za-z0-9._-]", "_", table.path.stem)[:100]
    return name if re.match(r"[A-Za-z0-9_]", name) else f"_{name}"


@dataclass(frozen=True)
class _Draft:
    """A file that is being asked about, with answers that options give and the file suggests."""

    new_file: NewFile
    test: Description
    proposed: Mapping[str, Any]

    def text(self, answers: Mapping[str, Any]) -> str:
        """Return the text of the file with some answers."""
        return experiment_text(self.new_file, replace(self.test, values=answers))

    def questions(self, given: Mapping[str, Any]) -> list[Question]:
        """Return what is still to be asked, with what the file suggests."""
        columns = self.test.columns
        known = {**self.proposed, **self.new_file.propose_answers(columns, given)}
        asked = {question.name for question in (*FIRST_QUESTIONS, *LAST_QUESTIONS)}
        asked |= set(self.new_file.required_answers(columns, given))
        return [
            replace(question, default=known.get(question.name, question.default))
            for question in _every_question()
            if question.name in asked and given[question.name] is None
        ]

    def completed(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return answers with what stands in for those that are still missing."""
        answers = dict(given)
        while questions := self.questions(answers):
            first = questions[0]
            answers[first.name] = first.example if first.default is None else first.default
        return answers

    def objections(self, question: Question, given: Mapping[str, Any], answer: Any) -> list[str]:
        """Return errors of the file that the answer to a question makes."""
        answers = {**given, question.name: answer}
        file = str(self.test.table.path.absolute())
        whole = replace(self, test=replace(self.test, file=file))
        with scratch_folder() as folder:
            path = folder / "draft.toml"
            errors = _errors_of(path, whole.text(self.completed(answers)))
        key = f"key {question.key or question.name!r}"
        mine = [error for error in errors if key in error or "not a valid TOML" in error]
        return [error.removeprefix(f"{path}: ") for error in mine]


def _answers(draft: _Draft) -> dict[str, Any]:
    """Return the answers: options, what is typed in a terminal, or defaults."""
    given = dict(draft.test.values)
    asking = sys.stdin.isatty()
    # What is asked next may depend on the answer before.
    while questions := draft.questions(given):
        question = questions[0]
        if asking:
            given[question.name] = _ask(question, partial(draft.objections, question, given))
            continue
        missing = [one.option for one in questions if one.default is None]
        if missing:
            raise InputError(
                f"Missing: {', '.join(missing)}. Prompts are off because standard input is not a "
                "terminal: give the missing options."
            )
        print(f"taken: {question.option} {question.default}")
        given[question.name] = question.default
    return given


def _ask(question: Question, objections: Callable[[Any], Sequence[str]]) -> Any:
    """Ask until there is an answer to which there are no objections."""
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
        try:
            answer = question.kind(typed) if typed else question.default
        except ValueError:
            print(f"found {typed!r}, expected a number")
            continue
        if answer is None or (question.choices is not None and answer not in question.choices):
            continue
        reasons = objections(answer)
        if not reasons:
            return answer
        print("\n".join(reasons))
