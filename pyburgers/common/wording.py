"""Numbers in sentences."""

import operator
from typing import SupportsIndex


def count_points(number: SupportsIndex) -> str:
    """Return "1 point", "2 points" and so on."""
    return "1 point" if operator.index(number) == 1 else f"{number} points"
