"""Experiment files as a person would write them, keys with comments: what all kinds of test share.

What the file of a kind of test has of its own says ``NEW_FILE`` in the module ``new_file`` of its
folder.
"""

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from pyburgers.common.columns import SEPARATORS
from pyburgers.common.text_tables import TextTable
from pyburgers.common.units import UNIT_TABLE
from pyburgers.protocols.experiment import CONDITION_KEYS, Compression, Experiment
from pyburgers.protocols.guessed_columns import GuessedColumn
from pyburgers.protocols.protocol import NAMES

NAMED_SEPARATORS = {sign: name for name, sign in SEPARATORS.items()}

COMMENTS_AT = 36
"""Column at which comments start."""

UNCERTAIN_CONDITIONS: Mapping[str, tuple[float, str]] = MappingProxyType(
    {
        "temperature_error": (2.0, "how well the temperature is known"),
        "stress_calibration_error": (0.02, "relative error of the load cell"),
    }
)
"""Standard deviations that are proposed, and what they are of, by the condition's error."""


@dataclass(frozen=True)
class Question:
    """Something that a text file does not say of its test.

    `name`: of the answer; the option has dashes in place of underscores.
    `text`: what is asked.
    `kind`: makes the answer from text.
    `choices`: what it may be.
    `default`: where nothing is answered; None where something has to be.
    `example`: an answer that stands in where others are checked before this one is given.
    `key`: key of the file that takes the answer, for its check; empty for that of its name.
    """

    name: str
    text: str
    kind: Callable[[str], Any] = str
    choices: Sequence[str] | None = None
    default: Any = None
    example: Any = None
    key: str = ""

    @property
    def option(self) -> str:
        """Name of the option that answers it."""
        return f"--{self.name.replace('_', '-')}"


STRAIN_RATE = Question("strain_rate_per_s", "imposed strain rate in 1/s", float, example=1e-5)
STRESS_ERROR = Question(
    "stress_uncertainty", "standard deviation of a stress, in its unit", float, example=1.0
)
"""Several kinds of test can have one, or the other."""


Columns = Mapping[str, GuessedColumn]
"""Columns of a text file, by quantity."""


@dataclass(frozen=True)
class Description:
    """What is known of a test that a file is written for.

    `file`: its text file, as seen from the file that is written.
    `table`: how that looks.
    `columns`: what its columns hold.
    `values`: answers, by the name of the question.
    """

    file: str
    table: TextTable
    columns: Columns
    values: Mapping[str, Any]


class NewFile(ABC):
    """What a new file of a kind of test needs and says beside what those of all kinds do.

    `experiment`: what the file is read as.
    `needed`: quantities whose columns it needs, one of each.
    `quantities`: those whose columns its files name.
    `questions`: what may be asked for it alone.
    """

    experiment: ClassVar[type[Experiment]]
    needed: ClassVar[Sequence[Sequence[str]]]
    quantities: ClassVar[Collection[str]]
    questions: ClassVar[Sequence[Question]] = ()

    @abstractmethod
    def suits(self, columns: Columns) -> str | None:
        """Return why a text file looks like such a test, as the end of a sentence, if it does."""

    def read(self, columns: Columns) -> Columns:
        """Return those of the columns of a text file that its files name."""
        return {name: one for name, one in columns.items() if name in self.quantities}

    def proposed(self, columns: Columns, given: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return answers that the columns suggest, by the name of the question.

        `given`: answers that are there already, None where there is none.
        """
        return {}

    def asked(self, columns: Columns, given: Mapping[str, Any]) -> Collection[str]:
        """Return the names of those of its questions that are asked; as for `proposed`."""
        return self.taken(columns, given)

    def taken(self, columns: Columns, given: Mapping[str, Any]) -> Collection[str]:
        """Return the names of those of its questions whose answers the file can hold."""
        return {question.name for question in self.questions}

    def decided(self, test: Description) -> Sequence[str]:
        """Return sentences about what the lines say that neither columns nor answers say."""
        return ()

    @abstractmethod
    def lines(self, test: Description) -> Sequence[str]:
        """Return the lines about what drives the test, and about its text file."""


@cache
def new_files() -> Mapping[str, NewFile]:
    """Return what new files have of their own, by the name of the protocol."""
    return MappingProxyType(
        {name: import_module(f"{__package__}.{name}.new_file").NEW_FILE for name in NAMES}
    )


def experiment_text(protocol: str, new_file: NewFile, test: Description) -> str:
    """Return the text of an experiment file of a protocol."""
    values = test.values
    lines = [
        line("id", values["id"], "names the run and its files"),
        line("material", values["material"], "its priors are taken unless --priors is given"),
        line("protocol", protocol, "the kind of test"),
        line("temperature_K", values["temperature_K"]),
        line("initial_grain_size_m", values["grain_size_m"], "mean, at the start"),
        *(
            optional(f"{CONDITION_KEYS[name][0]} = {sd}", comment)
            for name, (sd, comment) in UNCERTAIN_CONDITIONS.items()
            if name in new_file.experiment.may_be_uncertain
        ),
        "",
        *new_file.lines(test),
        "",
        "[provenance]",
        line("kind", values["kind"], "measured, digitised or synthetic"),
        line("source", values["source"], "who, when, where"),
        '# doi = "..."',
    ]
    return "\n".join(lines) + "\n"


def line(key: str, value: object, comment: str = "") -> str:
    """Return a key with its value and a comment."""
    text = f"{key} = {_toml(value)}"
    return with_comment(text, comment) if comment else text


def with_comment(text: str, comment: str) -> str:
    """Return a line with a comment."""
    return f"{text:<{COMMENTS_AT}}# {comment}"


def optional(text: str, comment: str) -> str:
    """Return a key as a comment, for whoever has it."""
    return with_comment(f"# {text}", comment)


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False)


def layout_lines(test: Description) -> Iterator[str]:
    """Return how the text file is laid out, where it is not as by default."""
    if test.table.separator != ",":
        separator = NAMED_SEPARATORS.get(test.table.separator, test.table.separator)
        yield line("separator", separator, "what stands between columns")
    if test.table.names is None:
        yield line("header", False, "columns are named by their numbers from 1")


def compression_of(test: Description, *imposed: float | None) -> Compression:
    """Return the sign of a compression: negative where all that was read and imposed is so."""
    medians = [
        float(np.median(test.table.numbers(test.columns[name].column)))
        for name in ("strain", "stress")
        if name in test.columns
    ]
    known = [*medians, *(value for value in imposed if value is not None)]
    return "negative" if len(known) > 1 and max(known) < 0 else "positive"


def column_lines(
    test: Description, quantity: str, key: str | None = None, comment: str = ""
) -> list[str]:
    """Return the keys of a column and its unit, of one that is there."""
    guessed, key = test.columns.get(quantity), key or quantity
    if guessed is None:
        return []
    lines = [line(f"{key}_column", guessed.column, comment)]
    units = UNIT_TABLE.get(guessed.kind, ())
    if guessed.unit is not None and not quantity.endswith("_uncertainty"):
        others = ", ".join(unit for unit in units if unit != guessed.unit)
        lines.append(line(f"{key}_unit", guessed.unit, f"or {others}" if others else ""))
    return lines
