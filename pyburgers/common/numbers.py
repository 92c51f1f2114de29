"""Numbers in sentences and tables."""

import math
import operator
from typing import SupportsIndex


def rounded(value: float, sd: float) -> str:
    """Return a number with as many decimals as two significant digits of `sd` need.

    Parameters
    ----------
    value : float
        What to print.
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


def count_points(number: SupportsIndex) -> str:
    """Return "1 point", "2 points" and so on."""
    return "1 point" if operator.index(number) == 1 else f"{number} points"
