"""What a page calls its fits, and the names of their files and anchors."""

import hashlib
import re
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Sequence
from pathlib import Path
from typing import TypeVar

from pyburgers.common.errors import InputError
from pyburgers.fitting.sampled_fit import SampledFit

T = TypeVar("T")
K = TypeVar("K", bound=Hashable)

_NOT_IN_FILES = re.compile(r"[^A-Za-z0-9_.+-]")


def page_keys(fits: Sequence[SampledFit]) -> list[str]:
    """Return keys of fits: the run directory, of a test of a joint fit with the test behind it."""
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


def page_names(fits: Sequence[SampledFit]) -> list[str]:
    """Return what a page calls fits: ``dunite 4581, kelvin power law`` of the run of that name."""
    keys = page_keys(fits)
    names = [in_words(key, fit.manifest["experiment"]) for key, fit in zip(keys, fits, strict=True)]
    count = Counter(names)
    return [name if count[name] == 1 else key for name, key in zip(names, keys, strict=True)]


def in_words(key: str, test: str) -> str:
    """Return a key in words; behind the name of what is fitted stands what the directory adds."""
    run, _, part = (_spaced(text) for text in key.partition(": "))
    if part:
        return f"{part} in {run}"
    test = _spaced(test)
    return run.replace(f"{test} ", f"{test}, ", 1) if run.startswith(f"{test} ") else run


def _spaced(text: str) -> str:
    return text.replace("_", " ").replace("+", " + ")


def file_key(name: str) -> str:
    """Return a name as a part of file names and anchors, which cannot leave their folder."""
    text = name.replace(": ", ".")
    safe = _NOT_IN_FILES.sub("_", text).lstrip(".")
    if safe == text:
        return safe
    return f"{safe}_{hashlib.sha256(name.encode('utf-8', 'surrogateescape')).hexdigest()[:6]}"


def alike(items: Iterable[T], said: Callable[[T], K]) -> dict[K, list[T]]:
    """Put items together, in their order, of which the same is said."""
    found: dict[K, list[T]] = {}
    for one in items:
        found.setdefault(said(one), []).append(one)
    return found


def joint_key(name: str) -> str:
    """Anchor of the part of a page about a joint fit, by its name."""
    return f"joint_{file_key(name)}"


def names_of_runs(directories: Sequence[Path]) -> list[str]:
    """Name runs by their folders, with as many of the folders above as tell them apart."""
    parts = [directory.resolve().parts for directory in directories]
    for depth in range(1, max(map(len, parts), default=1) + 1):
        names = ["_".join(part[-depth:]) for part in parts]
        if len(set(names)) == len(names):
            return names
    raise InputError(
        f"found the same run twice among {', '.join(map(str, directories))}, expected "
        "different ones."
    )
