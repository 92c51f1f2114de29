"""Locks between processes, on one host or on several that share a file system."""

import logging
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import filelock

from pyburgers.common.errors import InputError

logger = logging.getLogger(__name__)


@contextmanager
def process_lock(
    path: Path, taken: str, remedy: str = "", *, patience: float = -1
) -> Iterator[None]:
    """Hold a lock between processes; `taken` says what its holder does.

    If another process holds it after `patience` (s), raise InputError with the `remedy`; by default
    wait. On a file system without flock, the file itself is the lock.
    """
    lock = filelock.FileLock(path)
    try:
        lock.acquire(timeout=0)
    except filelock.Timeout:
        if patience:
            logger.info(f"{taken}: waiting for {_holder(path)}.")
        try:
            lock.acquire(timeout=patience)
        except filelock.Timeout:
            raise InputError(f"{taken}: {_holder(path)}; {remedy}.") from None
    try:
        us = [str(os.getpid()), socket.gethostname()]
        if _named_in(path) != us:  # where there is no flock, it already says who holds it
            path.write_text("\n".join(us) + "\n", encoding="utf-8")
        yield
    finally:
        lock.release()


def _named_in(path: Path) -> list[str]:
    """Return process and host in a lock file, as far as it has them."""
    try:
        return path.read_text(encoding="utf-8", errors="replace").split("\n")[:2]
    except OSError:  # it was released in the meantime
        return []


def _holder(path: Path) -> str:
    """Say which process holds a lock, and what to do if that process was lost."""
    match _named_in(path):
        case [process, host] if process and host:
            lost = "" if host == socket.gethostname() else f"; delete {path} if none runs there"
            return f"process {process} on {host} holds {path}{lost}"
        case _:
            return f"another process holds {path}"
