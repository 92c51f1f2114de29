"""What `pyburgers doctor` finds, and when it says that a fit cannot run."""

import importlib.metadata
import subprocess
import sys
from pathlib import Path

import pytest

from pyburgers.cli.doctor import Finding, can_fit, diagnose, format_findings

WITHOUT = """
import sys

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == sys.argv[1]:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing())
from pyburgers.cli.main import main
sys.exit(main(sys.argv[2:]))
"""
"""The command line where a package is missing: its name, then the arguments."""

GOOD = Finding("make", True, "GNU Make 4.3")
NEEDED = Finding("CmdStan", False, "none", "install it")
OPTIONAL = Finding("loading_history.stan", False, "not compiled yet", required=False)


@pytest.fixture
def bare_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty home folder and nothing on the PATH."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("PYBURGERS_CACHE", str(tmp_path / "cache"))
    for name in ("CMDSTAN", "CXX"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path


def finding(name: str) -> Finding:
    return next(finding for finding in diagnose() if finding.name == name)


def test_only_required_findings_decide() -> None:
    assert can_fit([GOOD, OPTIONAL])
    assert not can_fit([GOOD, OPTIONAL, NEEDED])


def test_table_shows_every_finding_and_remedy() -> None:
    lines = format_findings([GOOD, OPTIONAL, NEEDED]).splitlines()
    assert [line.split()[0] for line in lines] == ["ok", "-", "MISSING", "->"]
    assert "GNU Make 4.3" in lines[0]
    assert lines[3].endswith("install it")


def test_this_machine_can_fit() -> None:
    findings = diagnose()
    assert can_fit(findings), format_findings(findings)
    assert {"Python", "pyburgers", "cmdstanpy", "arviz", "CmdStan", "loading_history.stan"} <= {
        finding.name for finding in findings
    }


def test_bare_machine_is_told_what_to_get(bare_machine: Path) -> None:
    findings = {one.name: one for one in diagnose()}
    missing = {name for name, one in findings.items() if one.required and not one.ok}
    assert missing == {"C++ compiler", "make", "CmdStan"}
    assert not can_fit([*findings.values()])
    assert "apt-get install g++ make" in findings["make"].remedy
    assert "pyburgers install-cmdstan" in findings["CmdStan"].remedy


def test_wrong_cmdstan_variable(bare_machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CMDSTAN", str(bare_machine / "nowhere"))
    found = finding("CmdStan")
    assert not found.ok
    assert "CMDSTAN is set to" in found.remedy


def test_unusable_cache_folder(bare_machine: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (bare_machine / "file").write_text("")
    monkeypatch.setenv("PYBURGERS_CACHE", str(bare_machine / "file" / "cache"))
    found = finding("cache folder")
    assert not found.ok
    assert found.required


@pytest.mark.parametrize(
    ("package", "module"),
    [
        ("shtab", "shtab"),
        ("arviz", "arviz"),
        ("filelock", "filelock"),
        ("netcdf4", "netCDF4"),
        ("platformdirs", "platformdirs"),
        ("psutil", "psutil"),
        ("pydantic", "pydantic"),
        ("tomli-w", "tomli_w"),
    ],
)
def test_a_missing_package_is_named_with_how_to_get_it(package: str, module: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, module, "doctor"], capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (1, "")
    lines = [line.split() for line in done.stdout.splitlines()]
    missing = [k for k, line in enumerate(lines) if line[0] == "MISSING"]
    assert [lines[k] for k in missing] == [["MISSING", package, "missing"]]
    assert lines[missing[0] + 1] == ["->", "run", "`pip", "install", f"{package}`"]
    assert "CmdStan" in done.stdout


def test_every_required_package_has_its_version() -> None:
    found = {one.name: one.found for one in diagnose()}
    for requirement in importlib.metadata.requires("pyburgers") or []:
        if "extra ==" not in requirement:
            name = requirement.split(">=")[0]
            assert found[name] == importlib.metadata.version(name)


def test_other_commands_point_to_the_doctor_where_a_package_is_missing() -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, "arviz", "check", "run"], capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (1, "")
    (sentence,) = done.stderr.splitlines()
    assert "No module named 'arviz'" in sentence
    assert "pyburgers doctor" in sentence
