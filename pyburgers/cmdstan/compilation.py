"""Stan sources -> executables, compiled with CmdStan into a cache.

Compiled programs live in a folder named by everything that decides the executable: the program,
its includes, CmdStan, the compiler and its flags. A change in any of them gives another folder, so
nothing is ever out of date, and tests, CI and users share the work. A record beside an executable
shows damage, after which the program is compiled again. If there is no compiler, the record finds
the executable.
"""

import logging
import os
import platform
import re
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import platformdirs

from pyburgers.cmdstan.installation import ensure_cmdstan
from pyburgers.cmdstan.toolchain import (
    MissingToolError,
    Toolchain,
    chosen_folder,
    cmdstan_version,
    compile_flags,
    folder_for_make,
    stan_directory,
    toolchain,
)
from pyburgers.common.atomic_files import sha256_of_file, sha256_of_json
from pyburgers.common.errors import ToolchainError
from pyburgers.common.locks import process_lock
from pyburgers.common.scratch import scratch_folder
from pyburgers.common.toml_files import Table

logger = logging.getLogger(__name__)

WITH_CPP = "with_cpp"
"""Folder below the Stan files: files that declare functions, beside headers with their bodies.

A function has the name of its file and of its header, and an argument that is not data. The file of
the same name outside the folder has a body in Stan.
"""

_INCLUDE = re.compile(r"""^[ \t]*\#include[ \t]+["<]?([^"<>\s]+)""", re.MULTILINE)


@dataclass(frozen=True)
class _Sources:
    """A Stan program with all it includes; read once, so that key and compiler see the same.

    `declared` has the files that take the places of included ones if the compiler takes `headers`.
    """

    name: str
    text: str
    included: Mapping[str, str]
    declared: Mapping[str, str]
    headers: Mapping[str, str]

    @property
    def texts(self) -> dict[str, str]:
        """Texts of the files that are compiled, by their names."""
        return {**self.included, **self.declared, **self.headers, self.name: self.text}


def cache_directory() -> Path:
    """Return the folder of compiled programs: ``$PYBURGERS_CACHE``, else in the user's cache."""
    chosen = os.environ.get("PYBURGERS_CACHE")
    if chosen:
        return chosen_folder(chosen)
    try:
        return Path(platformdirs.user_cache_dir("pyburgers"))
    except RuntimeError as error:
        raise ToolchainError(
            "There is no home folder for the cache of compiled programs; set the environment "
            "variable PYBURGERS_CACHE to a folder."
        ) from error


def program_key(program: Path, include_directory: Path, cmdstan: Path) -> str:
    """Return the SHA-256 of a program, its includes and its toolchain: its cache folder."""
    return _key(_read_sources(program, include_directory), toolchain(cmdstan))


def executable_path(program: Path, cmdstan: Path) -> Path:
    """Return the file of the executable of a program, whether or not it is compiled."""
    return cache_directory() / program_key(program, stan_directory(), cmdstan) / program.stem


def _read_sources(program: Path, include_directory: Path) -> _Sources:
    text = _read(program)
    folders = list(dict.fromkeys((program.parent, include_directory)))
    included, declared, headers = dict[str, str](), dict[str, str](), dict[str, str]()
    pending = [(program.name, text)]
    while pending:
        includer, including_text = pending.pop()
        for name in _INCLUDE.findall(including_text):
            if name in included:
                continue
            folder = next((one for one in folders if (one / name).is_file()), None)
            if folder is None:
                where = " or ".join(map(str, folders))
                raise ToolchainError(f"{includer} includes {name}, which is not in {where}.")
            included[name] = _read(folder / name)
            pending.append((name, included[name]))
            declaration = folder / WITH_CPP / name
            if declaration.is_file():
                declared[name] = _read(declaration)
                headers |= {
                    header.relative_to(folder / WITH_CPP).as_posix(): _read(header)
                    for header in sorted(declaration.parent.glob("*.hpp"))
                }
    return _Sources(program.name, text, included, declared, headers)


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise ToolchainError(f"The Stan file {path} cannot be read: {error.strerror}.") from error


def _key(sources: _Sources, tools: Toolchain) -> str:
    # An executable finds CmdStan's libraries by their full path.
    return sha256_of_json([_recipe(sources, tools), str(tools.cmdstan_path)])


def _recipe(sources: _Sources, tools: Toolchain) -> str:
    recipe = {
        "sources": asdict(sources),
        "cmdstan": tools.cmdstan_version,
        "compiler": tools.compiler,
        "compile_flags": tools.compile_flags,
        "machine": [platform.system(), platform.machine()],
    }
    return sha256_of_json(recipe)


def compile_program(program: Path) -> Path:
    """Return the executable of a Stan program; compile it unless it is in the cache."""
    cmdstan = ensure_cmdstan()
    sources = _read_sources(program, stan_directory())
    try:
        tools = toolchain(cmdstan)
    except MissingToolError:
        if (found := _compiled_before(sources, cmdstan)) is None:
            raise
        return found
    folder = cache_directory() / _key(sources, tools)
    executable = folder / program.stem
    if _is_whole(executable):
        return executable
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with process_lock(folder / ".lock", f"Another process is compiling {program.name}"):
            if not _is_whole(executable):
                _build(sources, tools, executable)
    except OSError as error:
        raise ToolchainError(
            f"{program.name} could not be compiled into the cache folder {cache_directory()}: "
            f"{error}; the environment variable PYBURGERS_CACHE can name another folder, and "
            "TMPDIR that of temporary files."
        ) from error
    return executable


class Record(Table):
    """Hashes that are noted beside an executable: `sha256` is its own."""

    sha256: str
    sources: str  # of all that decides it, but for the compiler
    recipe: str  # of all that decides its results: what decides it, but for the folder of CmdStan
    has_cpp: bool  # whether functions have their bodies in C++


def _record_file(executable: Path) -> Path:
    return executable.with_name(f".{executable.name}.json")


def recorded(executable: Path) -> Record:
    """Read what is noted beside an executable; raise ValueError or OSError if it was damaged."""
    return Record.model_validate_json(_record_file(executable).read_bytes())


def _is_whole(executable: Path, sources: str | None = None) -> bool:
    """Tell whether an executable is as it was compiled, and of the sources if they are given."""
    # A full disk or a copy of the cache can leave one that does not run.
    try:
        record = recorded(executable)
        return (
            sources in (None, record.sources)
            and os.access(executable, os.X_OK)
            and sha256_of_file(executable) == record.sha256
        )
    except (ValueError, OSError):
        return False


def _compiled_before(sources: _Sources, cmdstan: Path) -> Path | None:
    """Return an executable of the same sources from the cache, whatever compiler made it."""
    name, wanted = Path(sources.name).stem, _sources_key(sources, cmdstan)
    found = (folder / name for folder in sorted(cache_directory().glob("*")))
    return next((executable for executable in found if _is_whole(executable, wanted)), None)


def _sources_key(sources: _Sources, cmdstan: Path) -> str:
    machine = platform.system(), platform.machine()
    flags = list(compile_flags(cmdstan))
    return sha256_of_json(
        [asdict(sources), str(cmdstan), cmdstan_version(cmdstan), flags, *machine]
    )


def _build(sources: _Sources, tools: Toolchain, executable: Path) -> None:
    """Compile a program in a temporary folder, then put the executable in place in one step.

    If the compiler refuses the headers, functions have their bodies in Stan.
    """
    logger.info(
        f"Compiling {sources.name}, once (seconds for a small program, minutes for a large one)."
    )
    own_key = _sources_key(sources, tools.cmdstan_path)
    # Not in the cache folder, whose path may hold spaces, which make cannot handle.
    with scratch_folder(folder_for_make()) as scratch:
        folder = scratch / "program"
        try:
            program = tools.compile(sources.name, sources.texts, sources.declared, folder)
        except ToolchainError as error:
            if not sources.headers:
                raise
            logger.info(
                f"{sources.name} was compiled without {', '.join(sources.headers)}, so a fit takes "
                f"longer: {error}"
            )
            sources = replace(sources, declared={}, headers={})
            program = tools.compile(sources.name, sources.texts, (), scratch / "without_cpp")
        partial = executable.with_name(f".{executable.name}.partial")
        try:
            shutil.copy2(program, partial)
            record = Record(
                sha256=sha256_of_file(partial),
                sources=own_key,
                recipe=_recipe(sources, tools),
                has_cpp=bool(sources.headers),
            )
            _record_file(executable).write_text(record.model_dump_json(), encoding="utf-8")
            partial.replace(executable)
        finally:
            partial.unlink(missing_ok=True)
