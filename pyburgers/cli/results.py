"""What commands print alike: verdicts."""

from collections.abc import Sequence

from pyburgers.checks.fit_checks import CheckResult
from pyburgers.report.tables import checks_table

EXIT_CHECK_FAILED = 3


def print_checks(checks: Sequence[CheckResult]) -> int:
    """Print the verdicts on a run; return the exit code."""
    for row in checks_table(checks).itertuples():
        print(f"{row.verdict:<6}  {row.check}: {row.sentence}")
    return exit_code(all(check.passed for check in checks))


def exit_code(passed: bool) -> int:
    """Return the code of a command that did what it should, with its verdict."""
    return 0 if passed else EXIT_CHECK_FAILED
