"""What has changed in a run directory since the run, told by the hashes that the run noted."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from pyburgers.common.atomic_files import sha256_of_file
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import read_json_table
from pyburgers.sampling.manifest import ChainRecord

REMEDY = (
    "put back what the run wrote, or remove the directory and run the command in its manifest "
    "again (without posterior.nc it is gathered again, without a folder in chains/ that chain is "
    "run again)"
)
"""What to do about a file that is not as the run wrote it."""


def chain_record(timing_file: Path) -> ChainRecord:
    """Read what a finished chain noted.

    Raises
    ------
    InputError
        If the file is missing or was damaged; the sentence says what to do.
    """
    try:
        return read_json_table(timing_file, ChainRecord)
    except InputError as error:
        raise InputError(f"{str(error).rstrip('.')}; {REMEDY}.") from error


@dataclass(frozen=True)
class NotedDraws:
    """Draws of a chain, and the hash that is noted of them in up to two places.

    Attributes
    ----------
    file, timing_file : Path
        The draws, and the file beside them that notes their hash.
    own : str
        That hash.
    in_manifest : str or None
        The one in the manifest; None where it has none of these draws.
    """

    file: Path
    timing_file: Path
    own: str
    in_manifest: str | None


def require_as_noted(
    run: Path,
    noted: Mapping[Path, str],
    draws: list[NotedDraws],
    made: list[Path],
    hash_of: Callable[[Path], str] = sha256_of_file,
) -> None:
    """Check that files are those that a run has written.

    Parameters
    ----------
    run : Path
        Its directory.
    noted : mapping of Path to str
        Hash of each file that has to be there.
    draws : list of NotedDraws
        Those of its chains.
    made : list of Path
        Files that are made of the draws, and made again where they are missing.
    hash_of : callable
        Returns the hash of a file; it may keep what it reads.

    Raises
    ------
    InputError
        If one has changed or is missing; the sentence names them all.
    """
    wrong = [
        *(f"{file.relative_to(run).as_posix()} {what}" for file, what in _changed(noted, hash_of)),
        *(text for one in draws for text in _at_odds(one, run, hash_of)),
        *(
            f"{file.relative_to(run).as_posix()} has become a folder"
            for file in made
            if file.is_dir()
        ),
    ]
    if wrong:
        raise InputError(f"{run}: {', '.join(wrong)} since the run, whose hashes say so; {REMEDY}.")


def _changed(
    noted: Mapping[Path, str], hash_of: Callable[[Path], str]
) -> Iterator[tuple[Path, str]]:
    """Return files that are not as their hashes say, and what has become of each."""
    for file, digest in noted.items():
        if not file.is_file():
            yield file, "is missing"
        elif hash_of(file) != digest:
            yield file, "has changed"


def _at_odds(draws: NotedDraws, run: Path, hash_of: Callable[[Path], str]) -> Iterator[str]:
    """Say which has changed: the draws of a chain, or what one of two files notes of them."""
    name, timing = (file.relative_to(run).as_posix() for file in (draws.file, draws.timing_file))
    found = hash_of(draws.file) if draws.file.is_file() else None
    if found is None:
        yield f"{name} is missing"
    elif found == draws.in_manifest != draws.own:
        yield f"{timing} has changed"
    elif found == draws.own and draws.in_manifest not in (None, found):
        yield f"the hash of {name} in manifest.json has changed"
    elif found != draws.own:
        yield f"{name} has changed" if draws.in_manifest else f"{name} or {timing} has changed"
