"""Who does tasks that each keep what they make, and which of them this call does."""

import copyreg
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from pyburgers.common.errors import InputError
from pyburgers.common.processes import completed, number_of_processes

Key = TypeVar("Key")
Value = TypeVar("Value")
Outcome = TypeVar("Outcome")


@dataclass(frozen=True)
class Workers:
    """Who does tasks.

    Attributes
    ----------
    executor : Executor or None
        Any of `concurrent.futures` whose workers see the same files as this process; None takes
        processes of this machine.
    jobs : int or None
        How many processes of this machine; None takes one for each core.
    part : tuple of two int, or None
        The part of the tasks that this call does, from 1, and the number of parts. Other calls,
        such as those of a job array, do the other parts. None does all tasks.
    """

    executor: Executor | None = None
    jobs: int | None = None
    part: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        """Check the values.

        Raises
        ------
        InputError
            If there are no processes, or there is no such part.
        """
        number_of_processes(self.jobs, 1)
        which, number = self.part or (1, 1)
        if not 1 <= which <= number:
            raise InputError(
                f"part is {which}/{number}, expected one from 1/{number} to {number}/{number}."
            )

    def mine(self, tasks: Mapping[Key, Value]) -> dict[Key, Value]:
        """Return the tasks of this part: every so many-th, so that parts take about as long."""
        which, number = self.part or (1, 1)
        return {key: tasks[key] for key in list(tasks)[which - 1 :: number]}

    def processes(self, n_tasks: int) -> int:
        """Return how many processes of this machine do a number of tasks."""
        return number_of_processes(self.jobs, n_tasks)

    def completed(
        self,
        work: Callable[..., Outcome],
        calls: Mapping[Key, Sequence[object]],
        *,
        folder: Path,
    ) -> Generator[tuple[Key, Outcome], None, None]:
        """Call a function for each set of arguments, as `pyburgers.common.processes.completed`."""
        if self.executor is None:
            return completed(work, calls, processes=self.processes(len(calls)), folder=folder)
        others = {key: (work, *arguments) for key, arguments in calls.items()}
        return completed(_elsewhere, others, processes=1, folder=folder, executor=self.executor)


def _elsewhere(work: Callable[..., Outcome], *arguments: object) -> Outcome:
    """Call a function on a worker of somebody else's executor.

    Where that is Dask's, xarray would lock each file that it writes through the scheduler, which
    may have gone; the folder of a task is its own.
    """
    dask = sys.modules.get("dask")
    with nullcontext() if dask is None else dask.config.set(scheduler="synchronous"):
        return work(*arguments)


ALL_HERE = Workers()
"""Processes of this machine, one for each core."""


def _read_only(content: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(content)


# Tests and priors hold mappings that nobody can change, which do not travel by themselves.
copyreg.pickle(MappingProxyType, lambda found: (_read_only, (dict(found),)))
