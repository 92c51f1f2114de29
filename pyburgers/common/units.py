"""Units of files and figures with their factors to SI, and numbers as people read them.

Units are converted where files are read and where figures are drawn, nowhere else.
"""

import math
import operator
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import SupportsIndex

UNITS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "stress": {"Pa": 1.0, "MPa": 1e6, "GPa": 1e9},
        "compliance": {"1/Pa": 1.0, "1/GPa": 1e-9},
        "viscosity": {"Pa s": 1.0, "MPa s": 1e6, "GPa s": 1e9},
        "strain": {"fraction": 1.0, "percent": 1e-2},
        "strain rate": {"1/s": 1.0, "1e-6/s": 1e-6},
        "time": {"s": 1.0, "min": 60.0, "h": 3600.0},
        "frequency": {"Hz": 1.0, "rad/s": 1 / (2 * math.pi)},
        "angle": {"deg": math.pi / 180, "mrad": 1e-3, "rad": 1.0},
        "length": {"m": 1.0, "mm": 1e-3, "um": 1e-6},
        "molar energy": {"J/mol": 1.0, "kJ/mol": 1e3},
        "inverse molar energy": {"mol/J": 1.0, "mol/kJ": 1e-3},
        "temperature": {"K": 1.0},
        "relative error": {"1": 1.0, "percent": 1e-2},
        "inverse temperature": {"1/K": 1.0, "1e-6/K": 1e-6},
        "dimensionless": {"1": 1.0},
    }
)
"""Factor to SI of each unit, by physical quantity."""

UNIT_NAMES: Mapping[str, Mapping[str, str]] = MappingProxyType(
    {
        "strain": {"percent": r"percent|%|pct", "fraction": r"fraction|m/m|\(-\)|\[-\]"},
        "stress": {
            "GPa": r"gpa|(?<![a-z])kn/mm\^?2",
            "MPa": r"mpa|(?<![a-z])(?:n/mm|mn/m)\^?2",
            "Pa": r"(?<![a-z])(?:pa(?![a-z])|n/m\^?2)",
        },
        "time": {
            "min": r"(?<![a-z])min",
            "h": r"hour|(?<![a-z])(?:hr?s?|std)(?![a-z])",
            "s": r"(?<![a-zμ])s(?:ec|ek)?(?:onds?)?(?![a-z])",
        },
        "temperature": {
            "C": r"celsius|°c|(?<![a-z])deg_?c|(?<![a-z])c(?![a-z])",
            "K": r"kelvin|(?<![a-z])k(?![a-z])",
        },
        "frequency": {
            "rad/s": r"rad|omega|ω|(?<![a-z])ang|circular|(?:kreis|winkel)freq|pulsation"
            r"|^w(?![a-z])",
            "Hz": r"(?<![a-zμ])hz",
        },
        "angle": {
            "mrad": r"mrad",
            "rad": r"(?<![a-zμ])rad",
            "deg": r"°|(?<![a-z])(?:deg|grad)",
        },
    }
)
"""Units as the names of columns have them, in lower case; the first that is found is taken."""

FOREIGN_UNIT_NAMES: Mapping[str, str] = MappingProxyType(
    {
        "strain": r"[mμ](?:icro|illi)?_?(?:strain|ε)|ppm|‰|10\^?-\d|1e-\d"
        r"|[mμu]m/m(?!m)|(?<![a-z/])(?:mm|cm|μm|um|in|inch|inches)(?![a-z/])",
        "stress": r"[khm]bar|(?<![a-z])(?:[kh]pa|psi|ksi|bar|atm|[km]n|kgf?|lb[fs]?|lbsf|pounds?"
        r"|kips?|tons?)(?![a-z])|[(\[]n[)\]]|load_?n$",
        "time": r"day|week|month|year|(?<![a-z])(?:d|yrs?|[mμun]s(?:ec)?)(?![a-z])",
        "temperature": r"fahrenheit|°f|(?<![a-z])f(?![a-z])",
        "frequency": r"(?<![a-z])[kmμun]hz|rpm|rev|cpm",
        "attenuation": r"(?<![a-z])(?:ln|db)(?![a-z])|^q$|quality|gute|%|percent|10\^?-?[2-9]"
        r"|1e-?\d|1000",
        "angle": r"[μun]rad",
    }
)
"""Units as the names of columns have them, in lower case, that experiment files do not know."""


def rounded(value: float, sd: float) -> str:
    """Return a number with as many decimals as two significant digits of `sd` need.

    Parameters
    ----------
    value : float
        The number.
    sd : float
        Standard deviation in the same unit; without a positive one, four significant digits are
        printed.
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
