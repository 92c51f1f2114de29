"""The sign of a compression in files, which is positive in the model."""

from typing import Literal

Compression = Literal["positive", "negative"]

SIGNS_WERE_TURNED = "Compression is negative in the file: the signs were turned."


def sign_of(compression: Compression) -> int:
    """Return what turns a number of a file into one whose compression is positive: 1 or -1."""
    return 1 if compression == "positive" else -1
