"""Options about workers: processes of this machine or of Dask, and the part of the tasks."""

import argparse
import logging
import re
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager

from pyburgers.common.errors import InputError, SystemFailureError
from pyburgers.common.tasks import Workers

ANSWER_SECONDS = 30
"""How long to wait for a scheduler."""


def add_worker_options(command: argparse.ArgumentParser, when: str = "") -> None:
    """Add the options that say who does tasks; `when` begins their help."""
    command.add_argument(
        "--jobs",
        type=int,
        metavar="N",
        help=f"{when}tasks at the same time, default one for each core",
    )
    command.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help=f"{when}address of a Dask scheduler, such as tcp://node1:8786: its workers do the "
        "tasks (needs Dask: docs/campaign.md)",
    )
    command.add_argument(
        "--part",
        type=_part,
        metavar="I/N",
        help=f"{when}do the I-th of N parts of the tasks and nothing else, such as in a job array; "
        "the same command without it then gathers the results",
    )


def require_no_worker_options(options: argparse.Namespace, beside: str) -> None:
    """Refuse options that say who does tasks beside an option with which no task is done."""
    for name in ("jobs", "scheduler", "part"):
        if getattr(options, name) is not None:
            raise InputError(f"--{name}: expected no such option beside {beside}.")


def _part(text: str) -> tuple[int, int]:
    """Parse one part of several."""
    found = re.fullmatch(r"([1-9]\d{0,5})/([1-9]\d{0,5})", text)
    if found is None:
        raise argparse.ArgumentTypeError(f"found {text!r}, expected I/N such as 1/8")
    return int(found[1]), int(found[2])


@contextmanager
def workers_of(options: argparse.Namespace) -> Iterator[Workers]:
    """Return who does the tasks while the block runs."""
    address: str | None = options.scheduler
    if address is None:
        yield Workers(jobs=options.jobs, part=options.part)
        return
    if options.jobs is not None:
        raise InputError("--jobs: does not go with --scheduler, whose workers are what they are.")
    try:
        from distributed import Client, KilledWorker
        from distributed.comm.core import CommClosedError
    except ModuleNotFoundError as error:
        raise InputError(
            "--scheduler: Dask is not installed; get it with pip install '.[cluster]' in the "
            "folder of the checkout."
        ) from error
    try:
        client = Client(address, timeout=ANSWER_SECONDS)
    except (OSError, ValueError) as error:
        raise InputError(f"--scheduler {address}: no scheduler of Dask answers there.") from error
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # errors are told here
    with client:
        # Equal tasks are not one: each writes its own folder.
        executor = client.get_executor(pure=False)
        try:
            yield Workers(executor, part=options.part)
        except KilledWorker as error:
            raise SystemFailureError(
                f"--scheduler {address}: several workers ended during the same task; see what "
                "they wrote, then run the same command again: it does only what is missing."
            ) from error
        except (CancelledError, CommClosedError) as error:
            raise SystemFailureError(
                f"--scheduler {address}: the scheduler was lost; its workers may still run, so end "
                "them, start scheduler and workers again, then run the same command with the new "
                "address: it does only what is missing."
            ) from error
