"""What stands in the cells of a table: numbers, time stamps, names, units, or nothing."""

import math
import re
from collections.abc import Sequence
from datetime import date
from typing import Literal

from pyburgers.common.units import FOREIGN_UNIT_NAMES, UNIT_TABLE, unit_spelled

CellKind = Literal["number", "text", ""]

Row = tuple[int, tuple[str, ...]]
"""Number of the line from 1, and cells."""

MINUS_SIGNS = "\u2212\u2013\u2012\ufe63\uff0d"
"""Characters that look like a minus sign and are none to a reader of numbers."""

ODD_MINUS = re.compile(rf"^[{MINUS_SIGNS}]\s*[\d.]")

NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eEdD][+-]?[0-9]+)?")
"""Digits of other scripts and underscores between digits are in no number of a table."""

DECIMAL_COMMA = re.compile(r"^[+-]?[0-9]+,[0-9]+(?:[eE][+-]?[0-9]+)?$")
THOUSANDS = re.compile(r"^[+-]?[1-9][0-9]{0,2},[0-9]{3}$")
HUNDREDS = re.compile(r"[1-9][0-9]{2}")
"""A decimal comma that may separate thousands, and a number that comes before the first of them."""

THOUSANDS_POINTS = re.compile(r"^[+-]?[1-9][0-9]{0,2}(?:\.[0-9]{3})+(?:,[0-9]+)?$")
"""A number whose points may separate thousands: beside decimal commas no point is a decimal one."""

NOTHING = re.compile(
    r"nan|n/?a|#n/?a|null|none|n\.a\.|-+|#(?:div/0|value|ref|num|null|name)[!?]", re.IGNORECASE
)
"""Words, and errors of spreadsheets, that stand for no reading."""

_MAY_BE_MISSING = re.compile(rf"(?:{NOTHING.pattern})|-99[0-9.,]*(?:[eE].*)?|-9\..*", re.IGNORECASE)

SENTINELS = frozenset((-999.0, -999.25, -9999.0, -99999.0, -999999.0))
"""Numbers that stand for no reading where all others lie far above them."""

MIN_SENTINEL_DISTANCE = 3.0
"""Ranges of the other numbers that a sentinel lies below them."""

LONGEST_NUMBER = 200
"""Letters of a cell that can hold a number or a time stamp."""

_KNOWN_UNITS = "|".join(re.escape(unit) for units in UNIT_TABLE.values() for unit in units)
_OTHER_UNITS = (
    r"sec(?:onds?)?|minutes?|hrs?|hours?|days?|[mµμu]s|%|°?c|°?f|deg(?: ?c)?|°|psi|ksi"
    r"|k?n|lbf?|[cµμ]m|in|khz|[mµμu]?v|[mµμu]strain|[µμu]ε|ohm|k?g|ml|counts?|h?h:mm(?::ss)?"
)
_UNIT = rf"{_OTHER_UNITS}|{_KNOWN_UNITS}"
_UNITS = re.compile(
    rf"(?:{_UNIT})(?: ?[*·/] ?(?:{_UNIT})| (?:{_UNIT}))*(?:\^?[-⁻]?[1-3¹²³])?", re.IGNORECASE
)
_POWER_OF_TEN = re.compile(
    r"[x×*·]? ?(?:10(?:\^|\*\*)[-−]?\d+|10[-−]\d+|10⁻?[⁰¹²³⁴⁵⁶⁷⁸⁹]+|1e-?\d+)", re.IGNORECASE
)
_TITLE_OF_UNITS = re.compile(r"units?|einheit(?:en)?|unit[eé]s?", re.IGNORECASE)
_IN_BRACKETS = re.compile(r"[(\[][^)\]]*[)\]]")


def kind_of(cell: str) -> CellKind:
    """Return whether a cell holds a number or a time stamp, text, or nothing."""
    if len(cell) > LONGEST_NUMBER:
        return "text"
    if NUMBER.fullmatch(cell):  # most cells
        return "number"
    if not cell or NOTHING.fullmatch(cell):
        return ""
    if as_number(cell) is not None or has_clock(cell) or has_date(cell):
        return "number"
    return "text"


def is_unit(cell: str) -> bool:
    """Whether a cell may stand in a row of units; one without a unit is empty or has a dash."""
    factor = _POWER_OF_TEN.match(cell)
    unit = cell if factor is None else cell[factor.end() :].strip()
    return (
        unit.strip("-–") == ""
        or _IN_BRACKETS.fullmatch(cell) is not None
        or any(map(_UNITS.fullmatch, (cell, unit)))
        or any(unit_spelled(cell.lower(), quantity) for quantity in UNIT_TABLE)
        or any(re.fullmatch(FOREIGN_UNIT_NAMES[kind], cell.lower()) for kind in ("stress", "time"))
    )


def are_mostly_units(cells: Sequence[str]) -> bool:
    """Whether more than half of the cells that are filled are units, and none is a number."""
    found = [is_unit(cell) for cell in cells if kind_of(cell)]
    is_text = all(kind_of(cell) != "number" for cell in cells)
    return is_text and 2 * sum(found) > len(found)


def are_units(cells: Sequence[str]) -> bool:
    """Whether cells may be a row of units, of which at least one is no number."""
    own = cells[1:] if cells and _TITLE_OF_UNITS.fullmatch(cells[0]) else cells
    return all(map(is_unit, own)) and any(kind_of(cell) == "text" for cell in own)


def as_number(cell: str) -> float | None:
    """Return the finite number in a cell, also with decimal comma or odd minus; None without."""
    value = number_in(cell)  # most cells
    if value is not None:
        return value
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
    """Return cells for no reading: stated ones, or words and numbers far below all others."""
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
    is_far = min(others) - highest > MIN_SENTINEL_DISTANCE * (max(others) - min(others))
    return words | sentinels if is_far else words


def names_between_blanks(line: str, n_columns: int) -> list[str]:
    """Return the names in a line between blanks; units in brackets belong to names if that fits."""
    words = line.split()
    if len(words) == n_columns:
        return words
    names = re.findall(r"\S+(?: [(\[][^)\]]*[)\]])?", " ".join(words))
    return names if len(names) == n_columns else words


_CLOCK = (
    r"(?P<first>\d{1,5}):(?P<second>\d\d?)"
    r"(?:(?P<fraction>[.,]\d+)|(?::(?P<third>\d\d?(?:[.,]\d+)?))?(?: ?(?P<half>[AP])M)?)"
)
"""Hours and minutes, with seconds or without; minutes and seconds where these have a fraction."""

_DATE = (
    r"(?P<year>\d{4})[-/.](?P<month>\d\d?)[-/.](?P<day>\d\d?)"
    r"|(?P<a>\d\d?)(?P<mark>[-/.])(?P<b>\d\d?)[-/.](?P<late_year>\d{4}|\d\d)"
    r"|(?P<named_day>\d\d?)[- ](?P<name>[A-Z]{3})[A-Z]*[- ](?P<named_year>\d{4})"
)
_STAMP = re.compile(
    rf"(?:(?P<date>{_DATE})(?:(?:T| +|, *)(?={_CLOCK.replace('?P<', '?P<_')}))?)?"
    rf"(?P<clock>{_CLOCK})?(?P<zone>Z|[+-]\d\d:?\d\d)?",
    re.ASCII | re.IGNORECASE,
)
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")

DAY = 86400.0


def has_clock(cell: str) -> bool:
    """Whether a cell holds a time of a clock, with or without a date."""
    found = _matched(cell)
    return found is not None and found["clock"] is not None


def has_date(cell: str) -> bool:
    """Whether a cell holds a date, with or without a time of a clock."""
    found = _matched(cell)
    return found is not None and found["date"] is not None


def seconds_of(cells: Sequence[str]) -> tuple[list[float], bool] | None:
    """Return times (s, NaN without stamp), and if 12 AM is noon; None if there are several ways."""
    found = [_matched(cell) for cell in cells]
    stamps = [stamp for stamp in found if stamp is not None]
    dated = any(stamp["date"] is not None for stamp in stamps)
    clocks = [stamp for stamp in stamps if stamp["clock"] is not None]
    if dated and any(stamp["date"] is None for stamp in stamps):
        return None
    if any(stamp["fraction"] for stamp in clocks):
        if dated or not all(stamp["fraction"] or stamp["third"] for stamp in clocks):
            return None
    elif not dated and not any(stamp["third"] or stamp["half"] for stamp in clocks):
        return None
    usual = _readings(found, dated=dated, noon=0)
    growing = [times for times in usual if _grow(times)]
    if growing or not any(stamp["half"] for stamp in clocks):
        times = _the_only(growing or usual)
        return None if times is None else (times, False)
    unusual = [times for times in _readings(found, dated=dated, noon=12) if _grow(times)]
    times = _the_only(unusual or usual)
    return None if times is None else (times, bool(unusual))


def _readings(
    found: Sequence[re.Match[str] | None], *, dated: bool, noon: int
) -> list[list[float]]:
    """Return the times (s) in each order of day and month that gives dates."""
    readings = []
    for day_first in (True, False):
        try:
            times = [_seconds(stamp, day_first=day_first, noon=noon) for stamp in found]
        except ValueError:  # no date is in the order that is tried
            continue
        readings.append(times if dated else _past_midnight(times))
    return readings


def _the_only(readings: Sequence[list[float]]) -> list[float] | None:
    """Return one of several readings if all have the same times since the first one."""
    different = {tuple(_from_first(times)) for times in readings}
    return readings[0] if len(different) == 1 else None


def _matched(cell: str) -> re.Match[str] | None:
    found = _STAMP.fullmatch(cell)
    return found if found is not None and (found["date"] or found["clock"]) else None


def _seconds(stamp: re.Match[str] | None, *, day_first: bool, noon: int) -> float:
    """Return a time in s, `noon` the hour of 12 AM; raise ValueError where it has no such date."""
    if stamp is None:
        return float("nan")
    seconds = 0.0
    if stamp["date"] is not None:
        seconds += DAY * _day(stamp, day_first=day_first)
    if stamp["fraction"] is not None:
        second = f"{stamp['second']}{stamp['fraction']}".replace(",", ".")
        seconds += 60.0 * int(stamp["first"]) + float(second)
    elif stamp["clock"] is not None:
        hours = int(stamp["first"])
        if stamp["half"] is not None:
            is_afternoon = stamp["half"].upper() == "P"
            hours = hours % 12 + 12 * is_afternoon if hours != 12 or is_afternoon else noon
        third = (stamp["third"] or "0").replace(",", ".")
        seconds += 3600.0 * hours + 60.0 * int(stamp["second"]) + float(third)
    zone = stamp["zone"]
    if zone is not None and zone not in "Zz":
        ahead = 3600.0 * int(zone[1:3]) + 60.0 * int(zone[-2:])
        seconds += ahead if zone[0] == "-" else -ahead
    return seconds


def _day(stamp: re.Match[str], *, day_first: bool) -> int:
    """Return the number of a day."""
    if stamp["year"] is not None:
        return date(int(stamp["year"]), int(stamp["month"]), int(stamp["day"])).toordinal()
    if stamp["name"] is not None:
        month = _MONTHS.index(stamp["name"].lower()) + 1
        return date(int(stamp["named_year"]), month, int(stamp["named_day"])).toordinal()
    year, a, b = int(stamp["late_year"]), int(stamp["a"]), int(stamp["b"])
    day, month = (a, b) if day_first or stamp["mark"] == "." else (b, a)
    return date(year + 2000 * (year < 100), month, day).toordinal()


def _from_first(times: Sequence[float]) -> list[str]:
    """Return times since the first one, as text that compares NaN to NaN."""
    known = [time for time in times if time == time]
    return [repr(time - known[0]) for time in times] if known else []


def _grow(times: Sequence[float]) -> bool:
    known = [time for time in times if time == time]
    return known == sorted(known)


def _past_midnight(times: Sequence[float]) -> list[float]:
    """Return times of a clock that goes on where it starts again at midnight."""
    days, last, going_on = 0, float("-inf"), []
    for time in times:
        days += last - time > DAY / 2
        last = time if time == time else last
        going_on.append(time + DAY * days)
    return going_on
