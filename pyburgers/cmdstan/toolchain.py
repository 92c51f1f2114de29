"""The tools that turn a Stan program into an executable: CmdStan, a C++ compiler and make."""

import logging
import os
import platform
import re
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pyburgers.common.errors import ToolchainError
from pyburgers.common.paths import shipped_folder
from pyburgers.common.processes import start
from pyburgers.common.scratch import scratch_folder

logger = logging.getLogger(__name__)

MINIMUM_VERSION = (2, 27)
"""The oldest CmdStan that compiles the Stan programs."""

MAKE_TAKES = re.compile(r"[\w./@+,-]+")
"""Paths that make and its shell take as they are."""

HOW_TO_GET_TOOLS = (
    "install g++ and make with `apt-get install g++ make` (Debian, Ubuntu), "
    "`dnf install gcc-c++ make` (Fedora) or `xcode-select --install` (macOS)"
)

# Set by a make that runs us (`make report`); CmdStan's own make must not inherit its options.
_MAKE_VARIABLES = frozenset({"MAKEFLAGS", "MFLAGS", "MAKEOVERRIDES", "MAKELEVEL"})
# Read by CmdStan's makefiles from the environment.
_COMPILER_VARIABLES = ("CXX", "CXXFLAGS", "CPPFLAGS", "LDFLAGS", "LDLIBS", "O")
_NAMESPACE = re.compile(r"^namespace \w+_model_namespace \{\n", re.MULTILINE)
_VERSION = re.compile(r"^CMDSTAN_VERSION\s*:=\s*((\d+)\.(\d+)\.(\d+)(?:-rc(\d+))?)", re.MULTILINE)


class MissingToolError(ToolchainError):
    """The compiler or make is missing or does not work; compiled programs run without them."""


@dataclass(frozen=True)
class Toolchain:
    """CmdStan, compiler and flags; of the compiler the first line of ``--version``.

    Compile flags are compiler variables of the environment, and the settings of CmdStan's
    ``make/local`` and ``~/.config/stan/make.local``. CmdStan's defaults (-O3, range checks on) are
    portable: a home folder, with its cache, may be shared between machines. With -march=native a
    gradient of PIL40 takes as long.
    """

    cmdstan_path: Path
    cmdstan_version: str
    compiler: str
    compile_flags: tuple[str, ...]

    def compile(
        self, name: str, texts: Mapping[str, str], declared: Iterable[str], folder: Path
    ) -> Path:
        """Compile a program in a new folder and return the executable there.

        `name` is that of the program among the `texts` of files; those of the names `declared`
        declare functions that have their bodies in headers beside them.

        Neither make alone nor cmdstanpy does this: their messages would name temporary paths, and
        cmdstanpy changes the working directory, so it cannot compile in several threads.
        """
        for file, text in texts.items():
            path = folder / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        program = folder / name
        headers = [Path(file).with_suffix(".hpp") for file in declared]
        command: list[str | Path] = [self.cmdstan_path / "bin" / "stanc", "--include-paths=."]
        command += ["--allow-undefined"] if headers else []
        stanc = run_tool([*command, f"--o={program.stem}.hpp", name], cwd=folder)
        said = stanc.stdout.strip()
        if stanc.returncode != 0:
            raise ToolchainError(f"stanc {self.cmdstan_version} does not accept {name}:\n{said}")
        if said:
            logger.info(f"stanc on {name}: {said}")
        if headers:
            _include_headers(program.with_suffix(".hpp"), headers)
        make = run_tool(["make", program.with_suffix("")], cwd=self.cmdstan_path)
        if make.returncode != 0:
            raise ToolchainError(
                f"{name} could not be compiled with CmdStan {self.cmdstan_version} and "
                f"{self.compiler}; make's last lines:\n{last_lines(make.stdout)}"
            )
        return program.with_suffix("")


def _include_headers(translated: Path, headers: Sequence[Path]) -> None:
    """Have a translated program include headers, and find their functions in its namespace.

    CmdStan's USER_HEADER would come ahead of its precompiled header, which is of no use then.
    """
    text = translated.read_text(encoding="utf-8")
    included = "".join(f'#include "{translated.parent / header}"\n' for header in headers)
    found = "".join(f"using burgers::{header.stem};\n" for header in headers)
    text = _NAMESPACE.sub(lambda line: f"{included}{line[0]}{found}", text, count=1)
    translated.write_text(text, encoding="utf-8")


def stan_directory() -> Path:
    """Return the folder of the Stan programs: in an installed wheel, else in the checkout."""
    folder = shipped_folder("stan")
    if not folder.is_dir():
        raise ToolchainError(
            f"The Stan programs are missing: {folder} does not exist, nor is there such a folder "
            "inside the package; install pyburgers again."
        )
    return folder


def cmdstan_home() -> Path:
    """Return the folder of installed CmdStans, the one that cmdstanpy uses as well."""
    return home_folder() / ".cmdstan"


def home_folder() -> Path:
    """Return the user's home folder."""
    try:
        return Path.home()
    except RuntimeError as error:
        raise ToolchainError(
            "There is no home folder: set the environment variable HOME to a folder."
        ) from error


def find_cmdstan() -> Path | None:
    """Return the CmdStan to use: ``$CMDSTAN``, else the newest usable one in ``~/.cmdstan``."""
    chosen = os.environ.get("CMDSTAN")
    if chosen:
        path = chosen_folder(chosen)
        defect = cmdstan_defect(path)
        if defect is not None:
            raise ToolchainError(
                f"The environment variable CMDSTAN is set to {path}, which {defect}; "
                "set it to a built CmdStan, or unset it and run `pyburgers install-cmdstan`."
            )
        return path
    usable = [path for path in cmdstan_home().glob("cmdstan-*") if cmdstan_defect(path) is None]
    return max(usable, key=_release, default=None)


def chosen_folder(name: str) -> Path:
    """Return the folder that an environment variable names, as a full path."""
    try:
        # `given_path` leaves the home of an unknown user as it is; here it is an error.
        return Path(name).expanduser().absolute()
    except (RuntimeError, OSError) as error:
        raise ToolchainError(f"There is no folder {name!r} ({error}); use a full path.") from error


def cmdstan_version(cmdstan: Path) -> str:
    """Return the version of the CmdStan in folder `cmdstan`, for example ``"2.27.0"``."""
    match = _version_match(cmdstan)
    if match is None:
        raise ToolchainError(f"{cmdstan / 'makefile'} does not name a version of CmdStan.")
    return match[1]


def cmdstan_defect(cmdstan: Path) -> str | None:
    """Return what keeps folder `cmdstan` from being a usable CmdStan ("is ..."), None if sound."""
    if not cmdstan.is_dir():
        return "is not a folder"
    if not MAKE_TAKES.fullmatch(str(cmdstan)):
        return (
            "has a path that make cannot take: expected letters, digits and any of . / _ @ + , - "
            "in it"
        )
    match = _version_match(cmdstan)
    if match is None:
        return "is not a CmdStan folder: it has no makefile that names a version"
    if (int(match[2]), int(match[3])) < MINIMUM_VERSION:
        minimum = ".".join(map(str, MINIMUM_VERSION))
        return f"is CmdStan {match[1]}, while {minimum} or newer is needed"
    if not os.access(cmdstan / "bin" / "stanc", os.X_OK):
        return f"is CmdStan {match[1]} but not built: bin/stanc is missing"
    if not any((cmdstan / "src" / "cmdstan").glob("main*.o")):
        return f"is CmdStan {match[1]} but not built: src/cmdstan/main.o is missing"
    return None


def compiler_version() -> str:
    """Return the first line that the C++ compiler says about its version."""
    # As in CmdStan's makefile.
    default = "clang++" if platform.system() == "Darwin" else "g++"
    chosen = os.environ.get("CXX", "")
    try:
        command = shlex.split(chosen) or [default]
    except ValueError as error:
        raise MissingToolError(f"The environment variable CXX is {chosen!r} ({error}).") from error
    return _tool_version(command, "C++ compiler")


def make_version() -> str:
    """Return the first line that make says about its version."""
    return _tool_version(["make"], "build tool")


def toolchain(cmdstan: Path) -> Toolchain:
    """Return the tools that compile programs with a CmdStan."""
    defect = cmdstan_defect(cmdstan)
    if defect is not None:
        raise ToolchainError(f"{cmdstan} {defect}.")
    version, compiler = cmdstan_version(cmdstan), compiler_version()
    make_version()
    return Toolchain(cmdstan, version, compiler, compile_flags(cmdstan))


def compile_flags(cmdstan: Path) -> tuple[str, ...]:
    """Return the settings of `Toolchain.compile_flags`."""
    flags = [f"{name}={os.environ[name]}" for name in _COMPILER_VARIABLES if os.environ.get(name)]
    for file in (cmdstan / "make" / "local", home_folder() / ".config" / "stan" / "make.local"):
        if file.is_file():
            text = file.read_text(encoding="utf-8", errors="replace")
            lines = map(str.strip, text.splitlines())
            flags += [line for line in lines if line and not line.startswith("#")]
    return tuple(flags)


def folder_for_make() -> Path:
    """Return a folder for temporary files whose path make and its shell take as it is."""
    usual = Path(tempfile.gettempdir())
    for folder in (usual, Path("/tmp"), Path("/var/tmp")):
        if MAKE_TAKES.fullmatch(str(folder)) and os.access(folder, os.W_OK | os.X_OK):
            return folder
    raise ToolchainError(
        f"The folder of temporary files {str(usual)!r} has a path that make cannot take; set the "
        "environment variable TMPDIR to a path of letters, digits and any of . / _ @ + , - alone."
    )


def run_tool(command: Sequence[str | Path], *, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command to its end; all it prints, errors included, is in ``stdout``.

    Its temporary files go with a scratch folder, and its processes with this one.
    """
    arguments = [*map(str, command)]
    with scratch_folder() as scratch:
        kept = {name: value for name, value in os.environ.items() if name not in _MAKE_VARIABLES}
        environment = {**kept, "TMPDIR": str(scratch)}
        console = scratch / "console.txt"
        running = start(arguments, console, environment=environment, folder=cwd)
        running.wait()
        running.require_not_killed()
        return subprocess.CompletedProcess(arguments, running.process.returncode, running.printed())


def last_lines(text: str, count: int = 15) -> str:
    """Return the last lines of what a tool printed, for a message."""
    return "\n".join(text.rstrip().splitlines()[-count:])


def _version_match(cmdstan: Path) -> re.Match[str] | None:
    makefile = cmdstan / "makefile"
    if not makefile.is_file():
        return None
    return _VERSION.search(makefile.read_text(encoding="utf-8", errors="replace"))


def _release(cmdstan: Path) -> tuple[float, ...]:
    """Return numbers that order releases, release candidates before their release."""
    match = _version_match(cmdstan)
    if match is None:
        return ()
    _, major, minor, patch, candidate = match.groups(default="inf")
    return (float(major), float(minor), float(patch), float(candidate))


def _tool_version(command: list[str], role: str) -> str:
    if shutil.which(command[0]) is None:
        raise MissingToolError(
            f"The {role} {command[0]} was not found on the PATH; {HOW_TO_GET_TOOLS}."
        )
    answer = run_tool([*command, "--version"], cwd=Path("/"))
    if answer.returncode != 0 or not answer.stdout.strip():
        raise MissingToolError(
            f"The {role} {command[0]} does not work: `{shlex.join(command)} --version` ended "
            f"with code {answer.returncode}; {HOW_TO_GET_TOOLS}.\n{last_lines(answer.stdout)}"
        )
    return answer.stdout.strip().splitlines()[0]
