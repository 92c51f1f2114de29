"""What stands in the cells of a table: numbers, time stamps, names, units, or nothing."""

import math
import re
from collections.abc import Sequence
from typing import Literal

from pyburgers.common.time_stamps import has_clock, has_date
from pyburgers.common.units import UNIT_TABLE

Kind = Literal["number", "text", ""]

Row = tuple[int, tuple[str, ...]]
"""Number of the line from 1, and cells."""

MINUS_SIGNS = "\u2212\u2013\u2012\ufe63\uff0d"
"""Characters that look like a minus sign and are none to a reader of numbers."""

ODD_MINUS = re.compile(rf"^[{MINUS_SIGNS}]\s*[\d.]")

NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eEdD][+-]?[0-9]+)?")
"""Digits of other scripts and underscores between digits are in no number of a table."""

DECIMAL_COMMA = re.compile(r"^[+-]?[0-9]+,[0-9]+(?:[eE][+-]?[0-9]+)?$")
THOUSANDS = re.compile(r"^[+-]?[1-9][0-9]{0,2},[0-9]{3}$")
"""A decimal comma that may separate thousands."""

NOTHING = re.compile(r"nan|n/?a|#n/?a|null|none|n\.a\.|-+", re.IGNORECASE)
"""Words that stand for no reading."""

_MAY_BE_MISSING = re.compile(rf"(?:{NOTHING.pattern})|-99[0-9.,]*(?:[eE].*)?|-9\..*", re.IGNORECASE)

SENTINELS = frozenset((-999.0, -999.25, -9999.0, -99999.0, -999999.0))
"""Numbers that stand for no reading where all others lie far above them."""

FAR = 3.0
"""Ranges of the other numbers that a sentinel lies below them."""

_KNOWN_UNITS = "|".join(re.escape(unit) for units in UNIT_TABLE.values() for unit in units)
_OTHER_UNITS = (
    r"sec(?:onds?)?|minutes?|hrs?|hours?|d|days?|[mµμu]s|%|°?c|°?f|deg(?: ?c)?|°|kpa|psi|ksi|bar"
    r"|k?n|lbf?|[cµμ]m|in|khz|m?v|[mµμu]strain|[µμu]ε|ohm"
)
_UNIT = rf"{_OTHER_UNITS}|{_KNOWN_UNITS}"
_UNITS = re.compile(
    rf"(?:{_UNIT})(?: ?[*·/] ?(?:{_UNIT})| (?:{_UNIT}))*(?:\^?[-⁻]?[1-3¹²³])?", re.IGNORECASE
)
_IN_BRACKETS = re.compile(r"[(\[][^)\]]*[)\]]")


def kind_of(cell: str) -> Kind:
    """Return whether a cell holds a number or a time stamp, text, or nothing."""
    if NUMBER.fullmatch(cell):  # most cells
        return "number"
    if not cell or NOTHING.fullmatch(cell):
        return ""
    if as_number(cell) is not None or has_clock(cell) or has_date(cell):
        return "number"
    return "text"


def is_unit(cell: str) -> bool:
    """Whether a cell may stand in a row of units; one without a unit is empty or has a dash."""
    return (
        cell.strip("-–") == ""
        or _IN_BRACKETS.fullmatch(cell) is not None
        or _UNITS.fullmatch(cell) is not None
    )


def as_number(cell: str) -> float | None:
    """Return the number that a person reads in a cell: also with a decimal comma, or an odd minus.

    None where there is none, or not a finite one.
    """
    text = re.sub(f"[{MINUS_SIGNS}]", "-", cell.strip())
    if DECIMAL_COMMA.fullmatch(text):
        text = text.replace(",", ".")
    return number_in(text)


def number_in(text: str) -> float | None:
    """Return the number that a cell holds; None where there is none, or not a finite one."""
    if not NUMBER.fullmatch(text):
        return None
    value = float(text.replace("d", "e").replace("D", "e"))
    return value if math.isfinite(value) else None


def missing_numbers(cells: Sequence[str], stated: Sequence[str] | None = None) -> set[str]:
    """Return those cells of a column, as they are written, that stand for no reading.

    Words do in a column of numbers, and numbers below all others by several times their range,
    unless it is stated which cells do.
    """
    if stated is not None:
        return set(stated) & set(cells)
    if not any(_MAY_BE_MISSING.fullmatch(cell) for cell in cells):
        return set()
    values = {cell: as_number(cell) for cell in set(cells)}
    numbers = {cell: value for cell, value in values.items() if value is not None}
    sentinels = {cell for cell, value in numbers.items() if value in SENTINELS}
    others = [value for value in numbers.values() if value not in SENTINELS]
    if not others:
        return set()
    words = {cell for cell in values if cell and NOTHING.fullmatch(cell)}
    highest = max((numbers[cell] for cell in sentinels), default=-math.inf)
    is_far = min(others) - highest > FAR * (max(others) - min(others))
    return words | sentinels if is_far else words


def names_between_blanks(line: str, n_columns: int) -> list[str]:
    """Return the names in a line with white space between them.

    A unit in brackets belongs to the name before it where there are as many columns only then:
    ``Strain (%) Stress (MPa)`` are two names.
    """
    words = line.split()
    if len(words) == n_columns:
        return words
    names = re.findall(r"\S+(?: [(\[][^)\]]*[)\]])?", " ".join(words))
    return names if len(names) == n_columns else words
