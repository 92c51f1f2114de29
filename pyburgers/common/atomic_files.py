"""Files that several processes may use: written whole or not at all, told by hashes."""

import hashlib
import json
import os
import re
import uuid
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

UNFINISHED = ".unfinished-"
"""Start of the name of a file that is being written; a killed process leaves it behind."""


def is_unfinished(name: str) -> bool:
    """Tell whether `write_atomically` gave a file this name, which a killed process left behind."""
    return re.fullmatch(rf"{re.escape(UNFINISHED)}[0-9a-f]{{32}}(\.\w+)?", name) is not None


def sha256_of_json(content: Any) -> str:
    """Hash of a JSON-serialisable object, independent of key order."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def sha256_of_file(path: Path) -> str:
    """Hash of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def copy_and_hash(source: Path, copy: Path) -> str:
    """Copy a file and return the hash of the bytes that the copy holds, which are read once."""
    digest = hashlib.sha256()
    copy.parent.mkdir(parents=True, exist_ok=True)
    with source.open("rb") as read, copy.open("wb") as written:
        while block := read.read(1 << 20):
            digest.update(block)
            written.write(block)
    return digest.hexdigest()


def flush_to_disk(path: Path) -> None:
    """Make sure that what was written to a file or folder is on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a temporary file of the same suffix beside `path`, then rename it."""
    temporary = path.with_name(f"{UNFINISHED}{uuid.uuid4().hex}{path.suffix}")
    try:
        write(temporary)
        flush_to_disk(temporary)
        temporary.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        # A file system that can only be read raises here as well, with the wrong name.
        with suppress(OSError):
            temporary.unlink()


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically."""
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def write_bytes(path: Path, content: bytes) -> None:
    """Write a binary file atomically."""
    write_atomically(path, lambda temporary: temporary.write_bytes(content))


def json_text(content: Any) -> str:
    """Return the text of a JSON file; floats keep every digit, infinities are allowed."""
    return json.dumps(content, indent=1) + "\n"


def write_json(path: Path, content: Any) -> None:
    """Write a JSON file atomically (`json_text`)."""
    write_text(path, json_text(content))
