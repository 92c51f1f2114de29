"""Folders of temporary files, which the next process removes if a kill left them behind."""

import fcntl
import os
import re
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

PREFIX = "pyburgers-scratch-"
"""Start of a name that nobody else gives to a folder: it may be removed."""

LEAST_AGE = 60.0
"""Seconds after the last change of a folder until it may be removed: its process may lock later."""


@contextmanager
def scratch_folder(parent: Path | None = None, prefix: str = PREFIX) -> Iterator[Path]:
    """Give a new folder, locked by this process, for the block; clear abandoned ones once."""
    parent = parent or Path(tempfile.gettempdir())
    _clear_once(parent, prefix, os.getpid())
    while True:
        folder = Path(tempfile.mkdtemp(prefix=prefix, dir=parent))
        held = _lock(folder, fcntl.LOCK_EX)
        if folder.is_dir():  # else another process cleared it before it had its lock
            break
        _release(held)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
        _release(held)


def clear_abandoned(parent: Path, prefix: str = PREFIX) -> None:
    """Remove folders of this user in `parent` that killed processes left over `LEAST_AGE` ago."""
    for folder in parent.glob(f"{prefix}*"):
        with suppress(OSError):
            if not _is_abandoned(folder, prefix):
                continue
            held = _lock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if held is not None:
                shutil.rmtree(folder, ignore_errors=True)
                _release(held)


def _is_abandoned(folder: Path, prefix: str) -> bool:
    """Tell whether `mkdtemp` named a folder of this user that has not changed for `LEAST_AGE`."""
    state = folder.lstat()
    return (
        re.fullmatch(rf"{re.escape(prefix)}[a-z0-9_]{{8}}", folder.name) is not None
        and stat.S_ISDIR(state.st_mode)
        and state.st_uid == os.getuid()
        and time.time() - state.st_mtime > LEAST_AGE
    )


@cache
def _clear_once(parent: Path, prefix: str, process: int) -> None:
    """Clear a folder once in each process."""
    clear_abandoned(parent, prefix)


def _lock(folder: Path, how: int) -> int | None:
    """Lock a folder; return the open descriptor, None if it is locked or cannot be."""
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, how)
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _release(descriptor: int | None) -> None:
    if descriptor is not None:
        os.close(descriptor)
