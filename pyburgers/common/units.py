"""Units of files and figures with their factors to SI, and numbers as people read them.

Units are converted where files are read and where figures are drawn, nowhere else.
"""

import math
import operator
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import SupportsIndex


@dataclass(frozen=True)
class Unit:
    """A unit: x in it is `zero` + `factor` x in SI; `spelling` finds it in lower-case names."""

    factor: float = 1.0
    spelling: str = ""
    zero: float = 0.0


UNIT_TABLE: Mapping[str, Mapping[str, Unit]] = {
    "stress": {
        "Pa": Unit(1.0, r"(?<![a-z])(?:pa(?![a-z])|pascals?|n/m\^?2)"),
        "kPa": Unit(1e3, r"(?<![a-z])kpa|kilopascals?"),
        "bar": Unit(1e5, r"(?<![a-z])bars?(?![a-z])"),
        "MPa": Unit(1e6, r"mpa|megapascals?|(?<![a-z])(?:n/mm|mn/m)\^?2"),
        "kbar": Unit(1e8, r"kbars?|kilobars?"),
        "GPa": Unit(1e9, r"gpa|(?<![a-z])kn/mm\^?2"),
    },
    "compliance": {"1/Pa": Unit(), "1/GPa": Unit(1e-9)},
    "viscosity": {"Pa s": Unit(), "MPa s": Unit(1e6), "GPa s": Unit(1e9)},
    "strain": {
        "fraction": Unit(1.0, r"fraction|(?<![a-zμ])m/m(?![a-z])|mm/mm|cm/cm|in/in|\(-\)|\[-\]"),
        "percent": Unit(1e-2, r"per ?cent|%(?!o)|pct|prozent|pourcent"),
        "microstrain": Unit(
            1e-6, r"(?:micro|(?<![a-z])[uμ])[ _-]?(?:strain|ε)|(?<![a-z])[uμ]m/m(?!m)"
        ),
    },
    "strain rate": {
        "1/s": Unit(
            1.0,
            r"1 ?/ ?s(?:ec)?(?![a-z])|(?<![a-z])s\^?-1"
            r"|(?:^|(?<!cent)(?<!pct)(?<!%)[ _])per[ _]?s(?:ec(?:ond)?)?(?![a-z])",
        ),
        "1e-6/s": Unit(1e-6, r"(?:1e|10\^?)-6 ?(?:[1 ]?/ ?s|s\^?-1)(?![a-z])"),
    },
    "time": {
        "s": Unit(1.0, r"(?<![a-zμ])s(?:e[ck]s?)?(?:ond[es]?s?|unden?)?(?![a-z])"),
        "min": Unit(60.0, r"(?<![a-z])min(?:s|ut\w*)?"),
        "h": Unit(3600.0, r"hours?|(?<![a-z])(?:hr?s?|std|stunden?|heures?)(?![a-z])"),
        "d": Unit(86400.0, r"(?<!of )days?|(?<![a-z])(?:d|tagen?|jours?)(?![a-z])"),
    },
    "frequency": {
        "Hz": Unit(1.0, r"(?<![a-zμ])(?:hz|hertz)"),
        "rad/s": Unit(
            1 / (2 * math.pi),
            r"rad(?:/s)?|omega|ω|(?<![a-z])ang|circular|(?:kreis|winkel)freq|pulsation|^w(?![a-z])",
        ),
    },
    "angle": {
        "deg": Unit(math.pi / 180, r"°|(?<![a-z])(?:deg(?:rees?)?|grad)"),
        "mrad": Unit(1e-3, r"mrad"),
        "rad": Unit(1.0, r"(?<![a-zμ])rad"),
    },
    "length": {
        "m": Unit(1.0, r"(?<![a-zμ])m(?:et(?:er|re)s?)?(?![a-z])"),
        "mm": Unit(1e-3, r"(?<![a-z])(?:mm|millimet\w+)(?![a-z])"),
        "um": Unit(1e-6, r"(?<![a-z])(?:um|μm|microns?|micromet\w+)(?![a-z])"),
    },
    "molar energy": {"J/mol": Unit(), "kJ/mol": Unit(1e3)},
    "molar volume": {"m3/mol": Unit(), "cm3/mol": Unit(1e-6)},
    "inverse molar energy": {"mol/J": Unit(), "mol/kJ": Unit(1e-3)},
    "temperature": {
        "K": Unit(1.0, r"kelvin|°? ?(?<![a-z])k(?![a-z])"),
        "C": Unit(1.0, r"celsius|° ?c|(?<![a-z])deg[_ .]*c|(?<![a-z])c(?![a-z])", zero=273.15),
    },
    "relative error": {
        "1": Unit(1.0, r"fraction|\([-1]\)|\[[-1]\]"),
        "percent": Unit(1e-2, r"per ?cent|%|pct"),
    },
    "inverse temperature": {"1/K": Unit(), "1e-6/K": Unit(1e-6)},
    "dimensionless": {"1": Unit()},
}
"""Every unit of files, by physical quantity: a unit is added here and nowhere else.

Of spellings that are found in a name the last one counts.
"""

UNITS: Mapping[str, Mapping[str, float]] = {
    quantity: {name: unit.factor for name, unit in units.items() if unit.zero == 0}
    for quantity, units in UNIT_TABLE.items()
}
"""Factor to SI of each unit whose zero is that of SI, by physical quantity."""

FORCE_UNITS = r"[km]n|kgf?|lb[fs]?|lbsf|kips?|kp"
"""Pattern of units of forces beside the newton, in lower case."""

FOREIGN_UNIT_NAMES: Mapping[str, str] = {
    "strain": r"m(?:illi)?_?(?:strain|ε)|[(\[](?:milli|micro)[)\]]|ppm|‰"
    r"|mm/m(?!m)|%o|(?<![a-z/])(?:mm|cm|μm|um|in|inch|inches)(?![a-z/])",
    "stress": rf"[hm]bar|(?<![a-z])(?:hpa|psi|ksi|atm|{FORCE_UNITS}|pounds?|ton[fs]?|tf|torr|mmhg"
    r"|dynes?)(?![a-z])|dyn ?/|n/ ?(?:cm|in)|[(\[]n[)\]]|load_?n$"
    r"|normali[sz]|(?<![a-z])[eg]/[eg]|[(\[] ?(?:-|dimensionless|unitless) ?[)\]]",
    "time": r"of day|week|month|year|(?<![a-z])(?:yrs?|[kmμun]s(?:ec)?|wochen?|monaten?"
    r"|jahren?|semaines?|mois|ann?ees?)(?![a-z])|normali[sz]|reduced",
    "temperature": r"fahrenheit|°f|(?<![a-z])f(?![a-z])",
    "frequency": r"(?<![a-z])[kmμun]hz|rpm|rev|cpm|normali[sz]|reduced",
    "strain rate": r"%|per ?cent|pct|ppm|micro|[mμ]strain|(?<![a-z])(?:[mμu]m|pa) ?/"
    r"|(?:/ ?|per[ _]?)(?:min|hr?|hour|d|day|week|yr?|year|a|annum)(?![a-z])"
    r"|(?<![a-z])(?:min|hr?|d|yr?|a)\^?-1",
    "length": r"(?<![a-z])(?:cm|nm|km|in|inch(?:es)?|phi|px|pixels?|astm|mesh)(?![a-z])|φ",
    "attenuation": r"(?<![a-z])(?:ln|db)(?![a-z])|quality|gute|%|percent|10\^?-?[2-9]|1e-?\d"
    r"|(?<![\d.])(?<!log)(?<!log_)100+(?!\d)"
    r"|(?<![a-z/])q(?![a-z]|\w*[\^{( ]*-? ?1|[ _]?inv)"
    r"|specific.?loss|energ\w*.?loss|loss.?of.?energ|per.?cycle|decrement|δ ?[ew] ?/ ?[ew]",
    "angle": r"[μun]rad",
}
"""Units as the names of columns have them, in lower case, that experiment files do not know."""


def units_text(quantity: str) -> str:
    """Return the units of a quantity as a list in words: ``s, min or h``."""
    *others, last = UNIT_TABLE[quantity]
    return f"{', '.join(others)} or {last}" if others else last


def unit_in(name: str, quantity: str) -> str | None:
    """Return the unit that a name of a column in lower case spells; None where it spells none."""
    units = UNIT_TABLE.get(quantity, {}).items()
    found = [unit for unit, own in units if own.spelling and re.search(own.spelling, name)]
    return found[-1] if found else None


def unit_spelled(text: str, quantity: str) -> str | None:
    """Return the unit that a text in lower case is and nothing else; None for any other text."""
    units = UNIT_TABLE.get(quantity, {}).items()
    found = [unit for unit, own in units if re.fullmatch(rf"(?:{own.spelling or '$^'})\.?", text)]
    return found[-1] if found else None


def rounded(value: float, sd: float) -> str:
    """Return a number with as many decimals as two significant digits of `sd` need.

    Parameters
    ----------
    value : float
        The number.
    sd : float
        Standard deviation in the same unit; without a positive one, four significant digits are
        printed.

    Examples
    --------
    >>> pyburgers.rounded(1.2345, 0.02)
    '1.234'
    """
    if not (math.isfinite(sd) and sd > 0):
        return f"{value:.4g}"
    decimals = max(0, 1 - math.floor(math.log10(sd)))
    return f"{value:.{decimals}f}"


def with_error(value: float, error: float) -> str:
    """Return a number ± its standard deviation or error, both as `rounded` has them."""
    return f"{rounded(value, error)} ± {rounded(error, error)}"


def number(value: float) -> str:
    """Return a number as a person wrote it, without the noise of unit conversion."""
    return f"{value:.6g}"


def rounded_to(value: float, digits: int = 2) -> str:
    """Return a number with few significant digits, such as ``120`` and ``0.0012``."""
    return number(float(f"{value:.{digits}g}"))


def span_text(ends: Iterable[float], digits: int) -> str:
    """Return two numbers as ``first to last``, or one where so many digits tell no difference."""
    return " to ".join(dict.fromkeys(f"{end:.{digits}g}" for end in ends))


def counted(number: SupportsIndex, what: str) -> str:
    """Return such as "1 leg", "2 legs" and so on."""
    return f"{number} {what}{'s' * (operator.index(number) != 1)}"


def count_points(number: SupportsIndex) -> str:
    """Return "1 point", "2 points" and so on."""
    return counted(number, "point")


def duration_text(seconds: float) -> str:
    """Return a time such as ``45 s``, ``12 min`` or ``3.4 h``."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    if seconds < 7200:
        return f"{seconds / 60:.0f} min"
    return f"{seconds / 3600:.1f} h"
