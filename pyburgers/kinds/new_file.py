"""Experiment files as a person would write them, keys with comments: what all kinds share."""

import itertools
import json
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import import_module
from typing import Any, ClassVar, cast

import numpy as np

from pyburgers.common.array_types import FloatArray
from pyburgers.common.columns import SEPARATORS
from pyburgers.common.text_tables import TextTable
from pyburgers.common.units import UNIT_TABLE
from pyburgers.kinds.experiment import CONDITION_KEYS, Experiment
from pyburgers.kinds.experiment_file import Compression
from pyburgers.kinds.guessed_columns import GuessedColumn
from pyburgers.kinds.likelihood import NAMES

MAX_STEADY_RANGE = 0.05
"""Relative range of readings that count as one value."""


MIN_TURN_ABOUT_LINE, MIN_TURN = 0.2, 0.02
"""Ways back that count as turning points, in shares of the range about a straight line and of the
whole range."""


MIN_CYCLES = 2
"""Cycles from which readings count as oscillating."""


MIN_LEVEL_GAP, MIN_LEVEL_DISTANCE, MIN_LEVEL_READINGS, MIN_LEVELS_SHARE = 0.1, 2.0, 3, 0.8
"""Of levels: the least distance to the next in shares of the range, and in widths of the widest;
readings of each, and the share of all readings that they are together."""


MIN_RUN_READINGS, MAX_RUN_RISE = 10, 0.2
"""Readings of a run that stays, and how little it may rise or fall, in shares of its band."""


@dataclass(frozen=True, eq=False)
class Facts:
    """What readings do.

    `values` (n,): readings that are there, in the order of the rows.
    """

    values: FloatArray

    @property
    def is_steady(self) -> bool:
        """Whether they stay the same, but for the first tenth and the first reading."""
        if self.values.size < 2:
            return False
        level = abs(float(np.median(self.values)))
        return level > 0 and self._range(max(1, self.values.size // 10)) < MAX_STEADY_RANGE * level

    @property
    def relative_range(self) -> float:
        """Range over the largest value; 0 where all are zero."""
        largest = float(np.abs(self.values).max())
        return self._range() / largest if largest > 0 else 0.0

    @property
    def only_falls(self) -> bool:
        """Whether the first is the largest by size and they fall without a turning point."""
        sizes = np.abs(self.values)
        first_is_largest = sizes[0] >= (1 - MAX_STEADY_RANGE) * sizes.max()
        return sizes[0] > sizes[-1] and first_is_largest and not self.turns

    @cached_property
    def turns(self) -> tuple[int, ...]:
        """Turning points, from 0: largest and least readings between ways back that count."""
        n = self.values.size
        if n < 3:
            return ()
        place = np.arange(n)
        about = self.values - np.polyval(np.polyfit(place, self.values, 1), place)
        way_back = max(MIN_TURN_ABOUT_LINE * float(np.ptp(about)), MIN_TURN * self._range())
        return _turning_points(self.values, way_back)

    @property
    def oscillates(self) -> bool:
        """Whether they turn as often as those of some cycles."""
        return len(self.turns) >= 2 * MIN_CYCLES - 1

    @property
    def is_in_levels(self) -> bool:
        """Whether most readings lie at two or more levels, few between or in flat runs."""
        if self._is_in_flat_runs:
            return True
        ordered = np.sort(self.values)
        gaps = np.flatnonzero(np.diff(ordered) > MIN_LEVEL_GAP * self._range())
        levels = [one for one in np.split(ordered, gaps + 1) if one.size >= MIN_LEVEL_READINGS]
        widest = max((float(np.ptp(one)) for one in levels), default=0.0)
        pairs = itertools.pairwise(levels)
        are_apart = all(low[-1] + MIN_LEVEL_DISTANCE * widest < high[0] for low, high in pairs)
        n_readings = sum(one.size for one in levels)
        return len(levels) > 1 and are_apart and n_readings >= MIN_LEVELS_SHARE * ordered.size

    @property
    def _is_in_flat_runs(self) -> bool:
        """Whether most readings are in runs that stay, of several values, with ramps between."""
        band = MAX_STEADY_RANGE * float(np.abs(self.values).max())
        starts = [0]
        for k, value in enumerate(self.values):
            if abs(value - self.values[starts[-1]]) > band:
                starts.append(k)

        def rise(run: FloatArray) -> float:
            early, late = np.split(run, [run.size // 2])
            return abs(float(late.mean() - early.mean()))

        runs = [one for one in np.split(self.values, starts[1:]) if one.size >= MIN_RUN_READINGS]
        flat = [one for one in runs if rise(one) < MAX_RUN_RISE * band]
        return (
            any(abs(one.mean() - flat[0].mean()) > band for one in flat)
            and sum(one.size for one in flat) >= MIN_LEVELS_SHARE * self.values.size
        )

    @cached_property
    def held_from(self) -> int:
        """First reading, from 0, from which on all stay at the last one."""
        allowed = MAX_STEADY_RANGE * np.abs(self.values).max()
        away = np.flatnonzero(np.abs(self.values - self.values[-1]) > allowed)
        return int(away[-1]) + 1 if away.size else 0

    def _range(self, start: int = 0) -> float:
        return float(np.ptp(self.values[start:]))


def _turning_points(values: FloatArray, way_back: float) -> tuple[int, ...]:
    """Return where readings turn and go back by more than so much."""
    turns, highest, lowest, direction = [], 0, 0, 0
    for k, value in enumerate(values):
        highest = k if value > values[highest] else highest
        lowest = k if value < values[lowest] else lowest
        if direction >= 0 and value < values[highest] - way_back:
            turns += [highest] if direction or highest else []
            direction, lowest = -1, k
        elif direction <= 0 and value > values[lowest] + way_back:
            turns += [lowest] if direction or lowest else []
            direction, highest = 1, k
    return tuple(turns)


def facts_of(column: GuessedColumn) -> Facts:
    """Return what the readings of a column do, in SI."""
    return Facts(column.si[np.isfinite(column.si)])


def read_together(*values: FloatArray) -> tuple[FloatArray, ...]:
    """Return readings of the rows in which all of some columns have one."""
    there = np.all(np.isfinite(values), axis=0)
    return tuple(own[there] for own in values)


NAMED_SEPARATORS = {sign: name for name, sign in SEPARATORS.items()}


COMMENTS_AT = 36
"""Column at which comments start."""


UNCERTAIN_CONDITIONS: Mapping[str, tuple[float, str]] = {
    "temperature_error": (2.0, "how well the temperature is known"),
    "stress_calibration_error": (0.02, "relative error of the load cell"),
}
"""Standard deviations that are proposed, and what they are of, by the condition's error."""


HEAD = """\
id = {id}  # names the run and its files
material = {material}  # its priors are taken unless --priors is given
protocol = {protocol}  # the kind of test
temperature_K = {temperature_K}
initial_grain_size_m = {grain_size_m}  # mean, at the start
{conditions}
"""


PROVENANCE = """
[provenance]
kind = {kind}  # measured, digitised or synthetic
source = {source}  # who, when, where
# doi = "..."
"""


LAYOUT = """\
separator = {separator}  # what stands between columns
header = {header}  # columns are named by their numbers from 1
"""
"""Parts of templates that all kinds of test share."""


@dataclass(frozen=True)
class Question:
    """Something that a text file does not say of its test.

    `name`, `text`: of the answer and its option; what is asked.
    `kind`, `choices`: makes the answer from text; what it may be.
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

    `file`, `table`: its text file, as seen from the file that is written, and how it looks.
    `columns`, `values`: what its columns hold; answers, by the name of the question.
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
    `template`: its part of a file, as `filled` takes it.
    """

    experiment: ClassVar[type[Experiment]]
    needed: ClassVar[Sequence[Sequence[str]]]
    quantities: ClassVar[Collection[str]]
    questions: ClassVar[Sequence[Question]] = ()
    template: ClassVar[str]

    @abstractmethod
    def recognise(self, columns: Columns) -> str | None:
        """Return why a text file looks like such a test, as the end of a sentence, if it does."""

    def select_columns(self, columns: Columns) -> Columns:
        """Return those of the columns of a text file that its files name."""
        return {name: one for name, one in columns.items() if name in self.quantities}

    def propose_answers(self, columns: Columns, given: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return answers that columns suggest, beside `given` ones (None: none), by question."""
        return {}

    def required_answers(self, columns: Columns, given: Mapping[str, Any]) -> Collection[str]:
        """Return the names of those of its questions that are asked."""
        return self.allowed_answers(columns, given)

    def allowed_answers(self, columns: Columns, given: Mapping[str, Any]) -> Collection[str]:
        """Return the names of those of its questions whose answers the file can hold."""
        return {question.name for question in self.questions}

    def describe_decisions(self, test: Description) -> Sequence[str]:
        """Return sentences about what the lines say that neither columns nor answers say."""
        return ()

    def filling(self, test: Description) -> Mapping[str, object]:
        """Return what the template holds beside answers, columns and the text file's layout."""
        return {}


@cache
def new_files() -> Mapping[str, NewFile]:
    """Return what new files have of their own, by the name of the protocol."""
    return {name: import_module(f"{__package__}.{name}.new_file").NEW_FILE for name in NAMES}


def experiment_text(new_file: NewFile, test: Description) -> str:
    """Return the text of an experiment file of a kind of test."""
    values = test.values
    conditions = [
        with_comment(f"# {CONDITION_KEYS[name][0]} = {sd}", comment)
        for name, (sd, comment) in UNCERTAIN_CONDITIONS.items()
        if name in new_file.experiment.may_be_uncertain
    ]
    environment = "if laws depend on it; also water_fugacity_Pa, melt_fraction"
    conditions.append(with_comment("# pressure_Pa = 0.0", environment))
    filling = {
        **values,
        "protocol": new_file.experiment.protocol,
        "conditions": conditions,
        **_data_values(test),
        **new_file.filling(test),
    }
    lines = filled(HEAD + new_file.template + PROVENANCE, filling)
    return "\n".join(lines) + "\n"


def filled(template: str, values: Mapping[str, object]) -> Iterator[str]:
    """Fill a template of a file, line by line, with comments in one column.

    ``key = {name}`` is left out where the value is None, ``#? key = ...`` where the key or its
        column has a value. ``{name}`` stands for lines. A unit without a comment gets the other
        units as one.
    """
    last = ""
    for template_line in template.splitlines():
        text, _, comment = template_line.partition("  # ")
        name = text[text.find("{") + 1 : text.find("}")] if "{" in text else ""
        if text == f"{{{name}}}":
            new = list(cast(Sequence[str], values[name]))
        elif name:
            key, value = text.partition(" = ")[0], values.get(name)
            if not comment and key.endswith("_unit"):
                comment = _other_units(value)
            new = [] if value is None else [line(key, value, comment.format_map(values))]
        else:
            proposal = with_comment(text.replace("#?", "#", 1), comment.format_map(values))
            new = [] if _is_answered(text, values) else [proposal]
        for one in new:
            if one or last:
                yield one
            last = one


def _is_answered(text: str, values: Mapping[str, object]) -> bool:
    """Whether a line proposes a key, of which a value or a column of values is there."""
    found = re.match(r"#\? (\w+?)(_Pa)? =", text)
    return found is not None and any(
        values.get(name) is not None for name in (found[1], f"{found[1]}_column")
    )


def _other_units(unit: object) -> str:
    """Return a comment with the other units of the quantity."""
    units = next((own for own in UNIT_TABLE.values() if unit in own), {})
    others = ", ".join(one for one in units if one != unit)
    return f"or {others}" if others else ""


def line(key: str, value: object, comment: str = "") -> str:
    """Return a key with its value and a comment."""
    return with_comment(f"{key} = {_toml(value)}", comment)


def with_comment(text: str, comment: str) -> str:
    """Return a line with a comment, if there is one."""
    return f"{text:<{COMMENTS_AT}}# {comment}" if comment else text


def _toml(value: object) -> str:
    return repr(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)


def _data_values(test: Description) -> dict[str, object]:
    """Return the text file, its layout where it is not as by default, and its columns and units."""
    separator = test.table.separator
    found: dict[str, object] = {
        "file": test.file,
        "separator": None if separator == "," else NAMED_SEPARATORS.get(separator, separator),
        "header": False if test.table.names is None else None,
    }
    for quantity, guessed in test.columns.items():
        found[f"{quantity}_column"] = guessed.column
        if not quantity.endswith("_uncertainty"):
            found[f"{quantity}_unit"] = guessed.unit
    return found


def compression_of(test: Description, *imposed: float | None) -> Compression:
    """Return the sign of a compression: negative where all that was read and imposed is so."""
    medians = [
        float(np.median(test.table.numbers(test.columns[name].column)))
        for name in ("strain", "stress")
        if name in test.columns
    ]
    known = [*medians, *(value for value in imposed if value is not None)]
    return "negative" if len(known) > 1 and max(known) < 0 else "positive"
