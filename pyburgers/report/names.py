"""What a page calls its fits, and the names of their files and anchors."""

import hashlib
import re
from collections import Counter
from collections.abc import Sequence

from pyburgers.common.errors import InputError
from pyburgers.fitting.sampled_fit import SampledFit
from pyburgers.sampling.run_directory import names_of_runs

_NOT_IN_FILES = re.compile(r"[^A-Za-z0-9_.+-]")


def page_keys(fits: Sequence[SampledFit]) -> list[str]:
    """Name each fit after its run directory, and a test of a joint fit after both.

    Parameters
    ----------
    fits : sequence of SampledFit
        Of single tests, joint ones, tests of joint fits, and of tables of peak stresses.

    Raises
    ------
    InputError
        If one is there twice.
    """
    directories = list(dict.fromkeys(fit.directory.path.resolve() for fit in fits))
    names = dict(zip(directories, names_of_runs(directories), strict=True))
    keys = [
        names[fit.directory.path.resolve()] + (f": {fit.part_name}" if fit.part_name else "")
        for fit in fits
    ]
    twice = [key for key, count in Counter(keys).items() if count > 1]
    if twice:
        raise InputError(f"{twice[0]}: found this run twice, expected different ones.")
    return keys


def file_key(name: str) -> str:
    """Return a name as a part of file names and anchors, which cannot leave their folder.

    Names that differ only in what these cannot hold stay different.
    """
    text = name.replace(": ", ".")
    safe = _NOT_IN_FILES.sub("_", text).lstrip(".")
    if safe == text:
        return safe
    return f"{safe}_{hashlib.sha256(name.encode('utf-8', 'surrogateescape')).hexdigest()[:6]}"


def joint_key(name: str) -> str:
    """Anchor of the part of a page about a joint fit, by its name."""
    return f"joint_{file_key(name)}"
