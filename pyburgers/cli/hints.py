"""What may lie behind the errors of an experiment file, and what its names of columns say."""

import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pyburgers.common.cells import DECIMAL_COMMA, ODD_MINUS, THOUSANDS
from pyburgers.common.columns import may_be_quoted
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path, shown
from pyburgers.common.tables_in_files import table_in
from pyburgers.common.text_tables import TextTable
from pyburgers.common.toml_files import read_tables
from pyburgers.flow_law_tables.tables import IN_SHEAR, SI_COLUMNS
from pyburgers.flow_law_tables.tables import KIND as RATES
from pyburgers.kinds.column_names import (
    COLUMN_NAMES,
    ERRORS,
    LOGARITHM,
    OTHER_QUANTITIES,
    OTHER_WORDS,
    PART_OF_STRAIN,
    RATE,
    SHARES,
    SHEAR,
    deformation_in,
    plain,
    quantity_in,
    unit_in_name,
)
from pyburgers.kinds.contradicted_names import (
    contradicted_form,
    contradicted_measure,
    contradicted_unit,
    unit_stated,
)
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.guessed_columns import confined_by
from pyburgers.kinds.new_file import NAMED_SEPARATORS, new_files

logger = logging.getLogger(__name__)

SEPARATORS = {";": "semicolons", "\t": "tabs", " ": "white space", ",": "commas"}

LARGEST_PERCENT = 2000.0
"""Strain beyond which it is none in percent."""

FILE_KEYS = ("file", "strain_file", "stress_file")


def text_files(content: Mapping[str, Any]) -> Iterator[tuple[dict[str, Any], str]]:
    """Return the tables of a file that name text files, with the keys that do."""
    segments = content.get("segments")
    for table in (content.get("data"), *(segments if isinstance(segments, list) else ())):
        if isinstance(table, dict):
            for key in FILE_KEYS:
                if isinstance(table.get(key), str):
                    yield table, key


def looks(path: Path, content: Mapping[str, Any]) -> Iterator[TextTable]:
    """Return how the text files that an experiment file names look."""
    data = content.get("data")
    if not isinstance(data, dict):
        return
    stated = data.get("missing")
    missing = [str(cell) for cell in stated] if isinstance(stated, list) else None
    for table, key in text_files(content):
        with suppress(InputError):  # the error itself is told
            file = given_path(path).parent / str(data.get("data_root", "")) / table[key]
            if may_be_quoted(file, path):
                yield table_in(file, missing=missing)


def hints(tables: Sequence[TextTable], content: Mapping[str, Any]) -> list[str]:
    """Say what may be behind errors: how the text files look beside what the file says of them."""
    data = content.get("data")
    if not isinstance(data, dict):
        return []
    kind = new_files().get(str(content.get("protocol")))
    small_strain = (Experiment if kind is None else kind.experiment).small_strain
    found = [
        f"{look.path}: {hint}"
        for look in tables
        for hint in (*_hints_of(look, data, small_strain), *hints_of_names(look, content))
    ]
    if content.get("compression") != "negative":
        found += [f"{look.path}: {hint}" for look in tables for hint in _hints_of_signs(look, data)]
    return list(dict.fromkeys(found))


def log_hints(paths: Sequence[Path]) -> None:
    """Tell what the text files of some input files say beside them."""
    for path in paths:
        content = read_tables(path)
        for hint in hints([*looks(path, content)], content):
            logger.info(f"hint: {shown(hint)}")
        for note in unchecked_rates(content):
            logger.info(f"note: {note}")


def unchecked_rates(content: Mapping[str, Any]) -> list[str]:
    """Say that rates of a real test are not compared with strain over time, where they are not."""
    data = content.get("data")
    if "segments" not in content or not isinstance(data, dict):
        return []
    absent = [name for name in ("strain", "time") if data.get(f"{name}_column") is None]
    if not absent or content["provenance"]["kind"] == "synthetic":
        return []
    return [f"No {absent[0]}s are read, so that nothing checks the stated strain rates."]


def _hints_of(look: TextTable, data: Mapping[str, Any], small_strain: float) -> Iterator[str]:
    named = any(key.endswith("_column") and isinstance(data[key], str) for key in data)
    header = data.get("header")
    if look.hidden_names is not None and named:
        names = ", ".join(look.hidden_names)
        yield (
            f"the names ({names}) stand in a line that starts with '#', which is passed over: "
            "remove that '#', or write the numbers of the columns from 1."
        )
    elif look.names is None and look.rows and (named or header):
        yield (
            "there are no names above the numbers: write the numbers of the columns from 1, such "
            "as strain_column = 1, and no header = true."
        )
    elif look.names is not None and header is False:
        yield f"the first row holds names ({', '.join(look.names)}): remove header = false."
    said = data.get("separator")
    fits = [NAMED_SEPARATORS.get(look.separator, look.separator)]
    if look.separator == "\t" and look.is_alike_by_blanks:
        fits.append("whitespace")
    if len(look.columns) > 1 and said is not None and said not in fits:
        yield (
            f"columns look as if {SEPARATORS[look.separator]} stood between them: remove the key "
            "separator from [data]."
        )
    found = [(ODD_MINUS, "starts with a character that is no minus sign", "write '-'")]
    if not look.has_decimal_commas:
        what = "has a comma that separates thousands or decimals"
        remedy = "write a decimal point and no other mark"
        if all(THOUSANDS.fullmatch(cell) for _, cell in look.cells_like(DECIMAL_COMMA)):
            remedy = "remove a comma between thousands, write a point for a decimal comma"
        found.append((DECIMAL_COMMA, what, remedy))
    for looks_like, what, remedy in found:
        if cells := look.cells_like(looks_like):
            line, cell = cells[0]
            more = f" (and {len(cells) - 1} more)" if len(cells) > 1 else ""
            yield f"line {line}: {cell!r}{more} {what}: {remedy}."
    yield from _hints_of_strain(look, data, small_strain)


def _hints_of_strain(
    look: TextTable, data: Mapping[str, Any], small_strain: float
) -> Iterator[str]:
    column, unit = data.get("strain_column"), data.get("strain_unit")
    if column not in look.columns or not (strain := look.numbers(column)):
        return
    largest = float(np.max(np.abs(strain)))
    if unit == "fraction" and largest > 1:
        other = "microstrain" if largest > LARGEST_PERCENT else "percent"
        yield f"{column!r} reaches {largest:g}: is it in {other} rather than a fraction?"
    is_named = unit_in_name(look.described(column), "strain") == unit
    if unit == "percent" and not is_named and 0 < largest < 100 * small_strain:
        yield f"{column!r} reaches {largest:g} only: is it a fraction rather than percent?"


def _hints_of_signs(look: TextTable, data: Mapping[str, Any]) -> Iterator[str]:
    column = data.get("strain_column")
    strain = look.numbers(column) if column in look.columns else []
    if sum(value < 0 for value in strain) > len(strain) / 2:
        yield (
            f"strains in {column!r} are negative, but compression is positive in this model: if it "
            'is negative in this file, write compression = "negative".'
        )


OTHER_THAN_RATES = {"strain_rate": r"viscos|complian", "grain_size": r"radi(?:us|i)|area|flache"}
"""Patterns of what columns of tables of rates are not."""

NO_CONFLICTS = {
    ("amplitude", "stress"),
    ("loss_modulus", "attenuation"),
    ("median_stress", "stress"),
    ("period", "time"),
    ("storage_modulus", "modulus"),
}
"""Quantities that a file reads, with what the names of their columns may be those of."""

ONE_LETTER = re.compile(r"[a-z](?![a-z'\"′’”])")
"""Pattern of names such as t, which may be a time or a temperature."""


@dataclass(frozen=True)
class _Named:
    """A column that a file names, and what its key says of it."""

    column: str | int
    name: str  # plain, with the unit under it
    quantity: str
    kind: str  # of the quantity
    is_error: bool  # of the quantity
    unit: object  # that the file states for it, if any


def hints_of_names(look: TextTable, content: Mapping[str, Any]) -> Iterator[str]:
    """Name columns whose names say something else than the file that names them."""
    for one in _named(look, content):
        yield from contradicted_unit(one.column, one.name, one.kind, one.unit)
        if other := _other_quantity(one, content):
            yield (
                f"column {one.column!r} is read as the {one.quantity.replace('_', ' ')}, but its "
                f"name is that of {other}: check it."
            )
        numbers = look.numbers(one.column)
        yield from _hints_of_measures(one, content, numbers)
        is_stress = one.quantity == "stress" and numbers and content.get("protocol") != RATES
        if is_stress and (beside := confined_by(look, one.column)) is not None:
            yield (
                f"column {one.column!r} is never below column {beside!r}: if it is a total stress "
                "along the axis, write the differential stress, their difference."
            )


def _named(look: TextTable, content: Mapping[str, Any]) -> Iterator[_Named]:
    """Return the columns of a table that a file names, by what its keys say."""
    data = content["data"]
    kinds = {name: one.kind for name, one in COLUMN_NAMES.items() if name != "limit"}
    if content.get("protocol") == RATES:
        kinds = {quantity: kind for quantity, (kind, _) in SI_COLUMNS.items()}
    for key, column in data.items():
        stem = key.removesuffix("_column")
        of = stem.removesuffix("_uncertainty")
        quantity = of if of in kinds else of.removeprefix("strain_").removeprefix("stress_")
        is_there = column in look.columns and not look.is_time_stamps(column)
        if stem == key or quantity not in kinds or not is_there:
            continue
        kind = kinds[quantity]
        unit = unit_stated(of, kind, data, has_default=content.get("protocol") != RATES)
        yield _Named(column, plain(look.described(column)), quantity, kind, stem != of, unit)


def _other_quantity(one: _Named, content: Mapping[str, Any]) -> str:
    """Return what else than the quantity of its key a name is that of, in words, if anything."""
    if one.quantity not in COLUMN_NAMES:
        return _other_than_of_rates(one)
    if OTHER_QUANTITIES.search(one.name):
        return OTHER_WORDS
    if ERRORS.search(one.name) and not one.is_error:
        return "an error"
    found = quantity_in(one.name)
    if found == "relaxation_modulus" and "relaxation_strain" in content["data"]:
        found = "stress"
    is_alike = found in (None, one.quantity) or (one.quantity, found) in NO_CONFLICTS
    return "" if is_alike or ONE_LETTER.match(one.name) else f"the {str(found).replace('_', ' ')}"


def _other_than_of_rates(one: _Named) -> str:
    """Return what else a name is that of than a quantity that tables of rates alone read."""
    rate_unit = unit_in_name(one.name, "strain rate")
    if one.quantity == "reading_error":
        is_absolute = rate_unit and not re.search(SHARES, one.name)
        return "an error in the unit of a rate, not relative" if is_absolute else ""
    if ERRORS.search(one.name):
        return "an error"
    if re.search(OTHER_THAN_RATES.get(one.quantity, "$^"), one.name):
        return "another quantity"
    if rate_unit or re.search(RATE, one.name):
        return "a rate" if rate_unit and one.quantity == "grain_size" else ""
    found = quantity_in(one.name)
    is_other = one.quantity in OTHER_THAN_RATES and found in ("strain", "stress", "time")
    return f"the {found}" if is_other else ""


def _hints_of_measures(
    one: _Named, content: Mapping[str, Any], numbers: Sequence[float]
) -> Iterator[str]:
    """Say where a name and a file differ on shear, the measure or the form of a quantity."""
    column, quantity, protocol = one.column, one.quantity, content.get("protocol")
    is_rate = protocol == RATES and quantity in ("stress", "strain_rate")
    if is_rate and re.search(SHEAR, one.name) and _are_axial(content.get("tests")):
        yield (
            f"column {column!r} is read as that of axial tests, but its name is that of shear: "
            "check the keys geometry and measure in [[tests]]."
        )
    if protocol != RATES:
        yield from contradicted_form(column, one.name, quantity)
    attenuation, stated = content.get("attenuation"), deformation_in(one.name)
    deformation = attenuation.get("deformation") if isinstance(attenuation, dict) else None
    if "modulus" in quantity and deformation and stated not in (None, deformation):
        yield (
            f"deformation {deformation!r} holds for the modulus too, but the name of column "
            f"{column!r} states {stated}: check it."
        )
    form = content["data"].get("attenuation_form")
    is_logarithm, is_read_so = LOGARITHM.search(one.name), form == "log10_tan_delta"
    doubt = "name says a logarithm" if is_logarithm and not is_read_so else ""
    if is_read_so and not is_logarithm and min(numbers, default=0.0) > 0:
        doubt = "numbers are all positive, so that every tan delta is above 1"
    if quantity == "attenuation" and not one.is_error and doubt:
        said = f"attenuation_form {form!r} is stated for column {column!r}"
        yield f"{said}, whose {doubt}: check it."
    if not {"stages", "segments"} & content.keys() or not numbers:
        return
    yield from contradicted_measure(
        column, one.name, quantity, content, np.array(numbers), is_history="stages" in content
    )
    if quantity == "strain" and re.search(PART_OF_STRAIN, one.name):
        yield (
            f"column {column!r} is taken as the total strain, with its elastic part, though its "
            "name says a part of the strain: check it."
        )


def _are_axial(tests: object) -> bool:
    """Whether no table [[tests]] says that stresses and rates are those of shear, or octahedral."""
    return isinstance(tests, list) and not any(
        one.get("geometry") in IN_SHEAR or one.get("measure") == "octahedral"
        for one in tests
        if isinstance(one, dict)
    )
