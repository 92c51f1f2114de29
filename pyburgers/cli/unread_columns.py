"""Columns of a table that a file does not read: what they hold, and what is against the file."""

import re
from collections.abc import Collection, Iterator, Mapping
from typing import Any

import numpy as np
from scipy.ndimage import median_filter

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.common.text_tables import TextTable
from pyburgers.common.units import UNITS, span_text
from pyburgers.kinds.column_names import (
    COLUMN_NAMES,
    LOGARITHM,
    RATE,
    plain,
    quantity_in,
    unit_in_name,
)
from pyburgers.kinds.conditions import temperature_range
from pyburgers.kinds.contradicted_names import other_form
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.guessed_columns import BY_NAME, guess_columns
from pyburgers.kinds.new_file import MIN_RUN_READINGS, Columns, NewFile, facts_of

MAX_TEMPERATURE_DIFFERENCE, MAX_RATE_RATIO, MAX_MODULUS_RATIO = 2.0, 2.0, 1.1
"""Kelvin, and ratios, by which a column that is not read may lie outside what a file states."""

MAX_UNREAD_TOLD = 10
"""Columns that are not read of which it is told what they hold."""

NEARLY_ALL = (5.0, 95.0)
"""Percentiles between which readings are compared: a few of them may be of another state."""

START_OF_LOGARITHM = re.compile(rf"^-? ?(?:{LOGARITHM.pattern})_?(?:10)?[\W_]*")
"""Pattern of what stands ahead of the quantity in the name of a column of its logarithms."""

WITH_ERROR = re.compile(r"\d ?(?:±|\+/?-|\(\d+\))")
"""Pattern of cells that hold a number with its error."""


def unread_columns(look: TextTable, content: Mapping[str, Any]) -> list[str | int]:
    """Return the columns of a table that a file does not name."""
    named = {column for key, column in content["data"].items() if key.endswith("_column")}
    for rows in _selections(content):
        named |= rows.keys()
    others = [column for column in look.columns if column != "" and column not in named]
    return [column for column in others if not look.is_date_of(column, named)]


def unread_note(look: TextTable, content: Mapping[str, Any]) -> str | None:
    """Say which columns of a table a file does not read, and what they hold; None without any."""
    found, columns = [], unread_columns(look, content)
    for column in columns[:MAX_UNREAD_TOLD]:
        numbers = [] if look.is_time_stamps(column) else look.numbers(column)
        ends = f" ({span_text((min(numbers), max(numbers)), digits=6)})" if numbers else ""
        found.append(f"{column!r}{ends}")
    more = f" and {len(columns) - MAX_UNREAD_TOLD} more" if len(columns) > MAX_UNREAD_TOLD else ""
    return f"{look.path.name}: columns not read: {', '.join(found)}{more}." if found else None


def _selections(content: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Return the keys `rows` of a file, which say by columns which rows are read."""
    tables = [content["data"]]
    for key in ("segments", "tests"):
        own = content.get(key)
        tables += own if isinstance(own, list) else []
    for table in tables:
        if isinstance(table, dict) and isinstance(table.get("rows"), dict):
            yield table["rows"]


def rates_told(look: TextTable, columns: Columns) -> str | None:
    """Say where rows look like tests of their own, or like creep; None where they do not."""
    if "time" in columns or "stress" not in columns:
        return None
    if "strain" in columns and not facts_of(columns["strain"]).turns:
        stress = facts_of(columns["stress"])
        is_read_on_its_way_up = stress.held_from > 1
        if is_read_on_its_way_up or stress.values.size < MIN_RUN_READINGS or not stress.is_steady:
            return None
        return (
            f"column {columns['stress'].column!r} stays the same while the strain grows, and no "
            "time is read. If the stress was imposed, add a column of times "
            "(docs/loading_history.md)"
        )
    for column in look.columns:
        name = plain(look.described(column))
        if look.numbers(column) and unit_in_name(name, "strain rate"):
            return (
                f"column {column!r} holds strain rates, and no time is read. If each row is a "
                "test, write the file of a table of rates (docs/rates.md)"
            )
    return None


def contradictions(
    look: TextTable, content: Mapping[str, Any], experiment: Experiment
) -> Iterator[str]:
    """Say where columns that are not read hold something else than the test has."""
    unread = unread_columns(look, content)
    if any(_selections(content)):  # other rows are of other tests
        return
    columns = guess_columns(look)
    yield from _contradicting_moduli(look, content["data"], columns)
    guessed = columns.get("temperature")
    is_unread = guessed is not None and guessed.column in unread
    if guessed is not None and is_unread and guessed.told_by == BY_NAME and guessed.unit:
        ends = _nearly_all(guessed.si)
        own, sd = temperature_range(experiment), float(content.get("temperature_sd_K", 0.0))
        words = COLUMN_NAMES["temperature"].words
        is_beside = any(place > 2 and re.search(word, plain(guessed.name)) for word, place in words)
        outside = max(own[0] - ends[0], ends[1] - own[1]) - 2 * sd
        if outside >= MAX_TEMPERATURE_DIFFERENCE and not is_beside:
            yield (
                f"{look.path.name}: column {guessed.column!r} holds mostly "
                f"{span_text(ends, digits=6)} K, but the test is at {span_text(own, digits=6)} K; "
                "check both."
            )
    strains = "|".join(COLUMN_NAMES["strain"].names)
    rates = [segment["strain_rate_per_s"] for segment in content.get("segments", ())]
    for column in unread:
        name, numbers = plain(look.described(column)), np.abs(look.numbers(column))
        unit = unit_in_name(name, "strain rate")
        # A logarithmic strain has a rate too, which is no logarithm itself.
        if LOGARITHM.search(name) and re.search(RATE, name) and np.all(numbers > 1):
            unit, numbers = "1/s", 10**-numbers
        if not (unit and numbers.size and rates and re.search(strains, name)):
            continue
        # Of readings that scatter, ends of single ones would be far from the rates.
        smooth = median_filter(numbers, 1 + numbers.size // 20, mode="nearest")
        ends = _nearly_all(smooth * UNITS["strain rate"][unit])
        if ends[1] > MAX_RATE_RATIO * max(rates) or 0 < ends[0] < min(rates) / MAX_RATE_RATIO:
            yield (
                f"{look.path.name}: column {column!r} holds mostly "
                f"{span_text(ends, digits=3)} 1/s, but the stated rates are "
                f"{span_text((min(rates), max(rates)), digits=3)} 1/s; check both."
            )


def _contradicting_moduli(
    look: TextTable, data: Mapping[str, Any], columns: Columns
) -> Iterator[str]:
    """Say where a loss modulus that is not read is another than the attenuation that is."""
    storage, loss = columns.get("storage_modulus"), columns.get("loss_modulus")
    attenuation = columns.get("attenuation")
    if attenuation is None or storage is None or loss is None:
        return
    is_foreign = attenuation.is_foreign or storage.is_foreign or loss.is_foreign
    if is_foreign or data.get("attenuation_column") != attenuation.column:
        return
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = float(np.nanmedian(loss.si / (storage.si * attenuation.tan_delta)))
    if not 1 / MAX_MODULUS_RATIO < ratio < MAX_MODULUS_RATIO:
        yield (
            f"{look.path.name}: column {loss.column!r} over {storage.column!r} is {ratio:.2g} "
            f"times the tan(delta) of {attenuation.column!r} in the median; check all three."
        )


def _nearly_all(numbers: FloatArray) -> tuple[float, float]:
    """Return the numbers between which nearly all lie."""
    least, largest = np.nanpercentile(numbers, NEARLY_ALL)
    return float(least), float(largest)


def proposed_temperature(new_file: NewFile, columns: Columns) -> float | None:
    """Median temperature (K) of the table, or the highest of one that has one in each row."""
    column = columns.get("temperature")
    if column is None or column.is_foreign or not column.is_decided:
        return None
    usual = np.nanmax if "temperature" in new_file.quantities else np.nanmedian
    return round(float(usual(column.si)), 6)


def temperature_use(
    new_file: NewFile, columns: Columns, given: Mapping[str, Any]
) -> Mapping[str, str]:
    """Say what becomes of a column of temperatures, by the quantity."""
    proposed, stated = proposed_temperature(new_file, columns), given["temperature_K"]
    if proposed is None:
        return {}
    use = "its median alone is used, as the temperature of the test"
    if stated is not None:
        use = f"--temperature-K {stated:g} takes its place"
    si = columns["temperature"].si
    ends = float(np.nanmin(si)), float(np.nanmax(si))
    use += f"; it holds {span_text(ends, digits=6)} K"
    if ends[1] - ends[0] > MAX_TEMPERATURE_DIFFERENCE:
        use += (
            "; state how uncertain it is as temperature_sd_K, or, in a loading history, the "
            "temperatures of stages as temperature_K"
        )
    return {"temperature": use}


def refuse_obstacle(
    table: TextTable, column: str | int, quantities: Collection[str | None]
) -> None:
    """Refuse a column of some quantities by its name that holds logarithms, or no numbers."""
    name = plain(table.described(column))
    bare = START_OF_LOGARITHM.sub("", name)
    if quantity_in(bare) not in quantities:
        return
    if bare != name and table.numbers(column):
        raise InputError(
            f"{table.path}: column {column!r} is a logarithm by its name, expected the numbers "
            "themselves: write 10 to its power, or e to that of ln."
        )
    require_numbers(table, column)


def form_told(table: TextTable, quantities: Collection[str]) -> str:
    """Say which column holds another form of some quantities, to follow a sentence; else empty."""
    for column in table.columns:
        for quantity in quantities:
            form = other_form(plain(table.described(column)), quantity)
            if form is not None:
                return f" The name of column {column!r} is that of {form.what}: {form.remedy}."
    return ""


def require_numbers(table: TextTable, column: str | int) -> None:
    """Refuse a column without any number, but for an empty one."""
    index = table.columns.index(column)
    filled = (
        (line, cell) for (line, _), cell in zip(table.rows, table.cells(index), strict=True) if cell
    )
    line, cell = next(filled, (0, ""))
    if cell and not table.numbers(column):
        remedy = "; write the error in a column of its own" * bool(WITH_ERROR.search(cell))
        raise InputError(
            f"{table.path}: {table.row_name} {line}, column {column!r}: found {cell!r}, expected "
            f"a number{remedy}."
        )
