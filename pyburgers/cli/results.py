"""What commands read and print alike: runs and verdicts."""

from collections.abc import Sequence
from pathlib import Path

from pyburgers.checks.sampling_checks import CheckResult
from pyburgers.fitting.fit import Fit, is_joint
from pyburgers.fitting.joint_fit import JointFit
from pyburgers.report.tables import checks_table
from pyburgers.sampling.run_directory import RunDirectory

EXIT_CHECK_FAILED = 3


def load_fit(directory: Path) -> Fit | JointFit:
    """Read a run, of one test or of several."""
    if is_joint(RunDirectory(directory).read_manifest()):
        return JointFit.load(directory)
    return Fit.load(directory)


def print_checks(checks: Sequence[CheckResult]) -> int:
    """Print the verdicts on a run; return the exit code."""
    for row in checks_table(checks).itertuples():
        print(f"{row.verdict:<6}  {row.check}: {row.sentence}")
    return exit_code(all(check.passed for check in checks))


def exit_code(passed: bool) -> int:
    """Return the code of a command that did what it should, with its verdict."""
    return 0 if passed else EXIT_CHECK_FAILED
