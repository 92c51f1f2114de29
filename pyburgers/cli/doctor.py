"""`pyburgers doctor`: what a fit needs of the machine, and how to get what is missing.

So that it can tell which package is missing, no required one is imported with this module.
"""

import argparse
import importlib.metadata
import importlib.util
import platform
import re
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pyburgers.cmdstan.toolchain import (
    cmdstan_home,
    cmdstan_version,
    compiler_version,
    find_cmdstan,
    make_version,
    stan_directory,
)
from pyburgers.common.errors import ToolchainError


@dataclass(frozen=True)
class Finding:
    """The state of one thing, how to mend it if need be, and whether a fit needs it."""

    name: str
    ok: bool
    found: str
    remedy: str = ""
    required: bool = True


def add_options(_: argparse.ArgumentParser) -> None:
    """Add no arguments: the command takes none."""


def run(_: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    findings = diagnose()
    print(format_findings(findings))
    return 0 if can_fit(findings) else 1


def diagnose() -> tuple[Finding, ...]:
    """Look at Python, the packages, the compiler, make, CmdStan, the cache and the programs."""
    return (
        # Too old a Python is refused when pyburgers is installed.
        Finding("Python", True, f"{platform.python_version()} ({sys.executable})"),
        *_packages(),
        _tool("C++ compiler", compiler_version),
        _tool("make", make_version),
        _cmdstan(),
        *_compilation(),
    )


def can_fit(findings: Sequence[Finding]) -> bool:
    """Tell whether a fit could run."""
    return all(finding.ok for finding in findings if finding.required)


def format_findings(findings: Sequence[Finding]) -> str:
    """Return a plain-text table of findings, each remedy in a line of its own."""
    width = max((len(finding.name) for finding in findings), default=0)
    lines = []
    for finding in findings:
        lines.append(f"{_verdict(finding):<8} {finding.name:<{width}}  {finding.found}")
        if finding.remedy:
            lines.append(f"{'':<8} {'':<{width}}  -> {finding.remedy}")
    return "\n".join(lines)


def _verdict(finding: Finding) -> str:
    if finding.ok:
        return "ok"
    return "MISSING" if finding.required else "-"


def _packages() -> list[Finding]:
    """Return a finding for pyburgers and for each package its metadata asks for."""
    try:
        requirements = importlib.metadata.requires("pyburgers") or []
    except importlib.metadata.PackageNotFoundError:
        return [Finding("pyburgers", False, "not installed", "run `pip install -e .`")]
    required = [text for text in requirements if "extra ==" not in text]
    names = ["pyburgers", *(re.split(r"[^\w.-]", text, maxsplit=1)[0] for text in required)]
    modules = {module.lower(): module for module in importlib.metadata.packages_distributions()}
    return [_package(name, modules) for name in names]


def _package(name: str, modules: Mapping[str, str]) -> Finding:
    module = name.replace("-", "_")
    try:
        # A damaged installation may have a version and no module. Metadata is in lower case.
        there = importlib.util.find_spec(modules.get(module, module))
        version = importlib.metadata.version(name) if there else None
    except (ImportError, importlib.metadata.PackageNotFoundError):
        version = None
    if version is None:
        return Finding(name, False, "missing", f"run `pip install {name}`")
    return Finding(name, True, version)


def _tool(name: str, version: Callable[[], str]) -> Finding:
    try:
        return Finding(name, True, version())
    except ToolchainError as error:
        return Finding(name, False, "not usable", str(error))


def _cmdstan() -> Finding:
    try:
        cmdstan = find_cmdstan()
    except ToolchainError as error:
        return Finding("CmdStan", False, "not usable", str(error))
    if cmdstan is None:
        found = f"none in {cmdstan_home()}, and CMDSTAN is not set"
        return Finding("CmdStan", False, found, "run `pyburgers install-cmdstan`")
    return Finding("CmdStan", True, f"{cmdstan_version(cmdstan)} ({cmdstan})")


def _compilation() -> list[Finding]:
    """Look at the cache and the programs; not where a package is missing that this takes."""
    try:
        from pyburgers.cmdstan import compilation
    except ModuleNotFoundError:
        return []  # the package has a finding of its own
    found = []
    try:
        found.append(_cache(compilation.cache_directory()))
        cmdstan, folder = find_cmdstan(), stan_directory()
        if cmdstan is not None:
            programs = [*sorted(folder.glob("*.stan")), *sorted(folder.glob("reference/*.stan"))]
            found += [_program(one, compilation.executable_path(one, cmdstan)) for one in programs]
    except ToolchainError:
        pass  # what keeps a program from being compiled has a finding of its own
    return found


def _cache(folder: Path) -> Finding:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        found = f"{folder} cannot be written ({error.strerror})"
        remedy = "make it writable, or set PYBURGERS_CACHE to another folder"
        return Finding("cache folder", False, found, remedy)
    return Finding("cache folder", True, str(folder))


def _program(program: Path, executable: Path) -> Finding:
    is_there = executable.is_file()
    found = "compiled" if is_there else "not compiled yet; the first fit that needs it does that"
    return Finding(program.name, is_there, found, required=False)
