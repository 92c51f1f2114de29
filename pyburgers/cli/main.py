"""Command line: which command, what its errors and an interrupt come to."""

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module

from pyburgers.common.errors import PyburgersError
from pyburgers.common.messages import messages_to

EXIT_INTERRUPTED = 130

COMMANDS = {
    "doctor": "what is installed, what is missing",
    "install-cmdstan": "get and build CmdStan",
    "fit": "fit an experiment, or several in a joint fit",
    "check": "the checks of a run again",
    "simulate": "forward solution at given parameters",
    "predict": "what a fit says about other experiments",
    "fit-peak-stress": "fit a flow law to a table of peak stresses",
    "compare": "which of several fits, or joint fits, of the same data predicts best",
    "sbc": "is the fit calibrated: truths from the prior, data, fits, ranks",
    "report": "one HTML page about one or several runs, joint fits among them",
    "reproduce": "the study: fits of three ice tests and an olivine record, and the page",
}
"""What each does. Its module in this room has ``add_options`` and ``run``."""


EXIT_CODES = (
    "exit codes: 0 done, and of a fit both verdicts are yes; 1 it could not run; 2 bad input; 3 a "
    "posterior was not sampled well, or a check of another kind failed; 4 it was sampled well, but "
    "the model is not shown to describe the data; 130 interrupted"
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        Default: those of the process.

    Returns
    -------
    int
        What `EXIT_CODES` says.
    """
    try:
        options = _parse(sys.argv[1:] if arguments is None else arguments)
        with messages_to(sys.stderr):
            code: int = options.run(options)
            return code
    except PyburgersError as error:
        print(f"pyburgers: {error}", file=sys.stderr)
        return error.exit_code
    except ModuleNotFoundError as error:
        print(f"pyburgers: {error}; `pyburgers doctor` says what to do.", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(
            "pyburgers: interrupted; the same command continues with what is missing.",
            file=sys.stderr,
        )
        return EXIT_INTERRUPTED


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Parse the command line, with no other module than that of the command."""
    parser = argparse.ArgumentParser(
        prog="pyburgers",
        description="Fit a nonlinear Burgers model to deformation tests, one by one or together.",
        epilog=EXIT_CODES,
    )
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for name, purpose in COMMANDS.items():
        command = commands.add_parser(name, help=purpose, epilog=EXIT_CODES)
        if name in arguments[:1]:
            module = import_module(f"pyburgers.cli.{name.replace('-', '_')}")
            module.add_options(command)
            command.set_defaults(run=module.run)
            if hasattr(module, "with_default"):
                arguments = [name, *module.with_default(arguments[1:])]
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
