"""Exceptions: one class for each exit code of the command line."""


class PyburgersError(Exception):
    """A run could not be done; the message is one sentence for the user.

    The command line prints the message and exits with `exit_code`.
    """

    exit_code = 1


class InputError(PyburgersError):
    """A file, a key, a column or an option is not what it has to be."""

    exit_code = 2


class ToolchainError(PyburgersError):
    """CmdStan, the C++ compiler or make is missing or failed."""


class SamplingError(PyburgersError):
    """Stan ran but gave nothing usable."""


class SystemFailureError(PyburgersError):
    """The system did not start a program, or ended it: says nothing about model and data."""
