"""Many fits: each a task that one process does, on this machine or another, in its own folder."""

import logging
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pyburgers.common.errors import PyburgersError
from pyburgers.common.messages import messages_to
from pyburgers.common.paths import given_path
from pyburgers.common.processes import cores
from pyburgers.common.tasks import ALL_HERE, Workers, run_tasks
from pyburgers.fitting.fit import Fit, fit_problem
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.kinds.together import pooling_for
from pyburgers.model.priors import PriorSet
from pyburgers.sampling.options import SamplerOptions

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Task:
    """One fit of several.

    Attributes
    ----------
    problem : Problem
        Tests, priors, pooling.
    options : SamplerOptions
        Chains, iterations, seed. On this machine, how many chains run side by side is set by how
        many fits do.
    solver : SolverOptions or None
        None takes that of the protocol.
    remark : str
        Text behind the command in the run's manifest.

    Examples
    --------
    >>> task = pyburgers.task_of([test], priors, options)
    >>> task.options.chains
    2
    """

    problem: Problem
    options: SamplerOptions
    solver: SolverOptions | None = None
    remark: str = ""


def task_of(
    experiments: Sequence[Experiment],
    priors: PriorSet,
    options: SamplerOptions,
    pool: Mapping[str, str] | None = None,
) -> Task:
    """Return the task of a fit of one test, or of several together.

    Parameters
    ----------
    experiments, priors, options, pool
        As for `pyburgers.fit`.

    Returns
    -------
    Task
        For `fit_side_by_side`.

    Raises
    ------
    InputError
        If an input is wrong.

    Examples
    --------
    >>> task = pyburgers.task_of([test], priors, options)
    """
    return Task(problem_of(experiments, priors, pooling_for(experiments, pool)), options)


def run_fits(
    tasks: Mapping[Path, Task],
    *,
    workers: Workers = ALL_HERE,
    command: str,
    keep_going: bool = False,
    after: Callable[[Path], None] = lambda _: None,
) -> dict[Path, PyburgersError]:
    """Do several fits, each in a process of its own; continue where a call stopped.

    The fits begin in the order of their run directories in `tasks`, so those that take longest
    should come first. Cores of this machine that are left over run chains. Messages of a fit go to
    standard error of its process, each line with the name of the fit before it. When a fit is done,
    `after` receives its run directory. If `keep_going`, fits that cannot be done are returned with
    their errors, and the others go on. Else raises InputError if an input is wrong or a run
    directory holds something else, and SamplingError if no chain of a fit finished. Raises
    SystemFailureError if the system killed a process.
    """
    mine = workers.mine(tasks)
    if not mine:
        return {}
    above = os.path.commonpath([out.absolute().parent for out in mine])
    calls = {}
    processes = workers.processes(len(mine))
    for number, (out, task) in enumerate(mine.items(), start=1):
        name = out.absolute().relative_to(above).as_posix()
        if workers.executor is None:
            # The last fit begins when another has ended, and soon has all cores to itself.
            beside = 1 if number == len(mine) > processes else processes
            chains = max(1, cores() // beside)
            task = replace(task, options=replace(task.options, parallel_chains=chains))
        # Elsewhere the working directory may be another one.
        calls[out] = (name, task, out.absolute(), command, keep_going)
    failed = {}
    with run_tasks(_do, calls, workers=workers, out=Path(above)) as done:
        for n_done, (out, error) in enumerate(done, start=1):
            how = "is done" if error is None else f"could not be done ({error})"
            logger.info(f"Fit {calls[out][0]} {how}, {n_done} of {len(mine)}.")
            if error is not None:
                failed[out] = error
            else:
                after(out)
    return failed


def fit_side_by_side(
    tasks: Mapping[str, Task],
    folder: str | Path,
    *,
    workers: Workers = ALL_HERE,
    command: str,
    after: Callable[[str, Fit], None] = lambda _name, _fit: None,
) -> dict[str, Fit]:
    """Do several fits, each in a process of its own; continue where a call stopped.

    Parameters
    ----------
    tasks : mapping of str to Task
        Fits by name. They begin in this order, so those that take longest should come first.
    folder : path
        Folder of the run directories, each with the name of its fit.
    workers : Workers
        Processes or executor, and the part of the fits that this call does.
    command : str
        Command that repeats the fits, for their manifests.
    after : callable
        Receives the name of a fit and the fit when it is done.

    Returns
    -------
    dict of str to Fit
        Fits of this part, in their order.

    Raises
    ------
    InputError
        If an input is wrong or a run directory holds something else.
    SamplingError
        If no chain of a fit finished.
    SystemFailureError
        If the system killed a process.

    Examples
    --------
    >>> tasks = {"mine": pyburgers.task_of([test], priors, options)}
    >>> fits = pyburgers.fit_side_by_side(tasks, Path("runs"), command="python my_script.py")
    """
    names = {given_path(folder) / name: name for name in tasks}
    found: dict[str, Fit] = {}

    def keep(out: Path) -> None:
        name = names[out]
        found[name] = Fit.load(out)
        after(name, found[name])

    run_fits(
        {out: tasks[name] for out, name in names.items()},
        workers=workers,
        command=command,
        after=keep,
    )
    return {name: found[name] for name in workers.mine(tasks)}


def _do(name: str, task: Task, out: Path, command: str, keep_going: bool) -> PyburgersError | None:
    """Do a fit, in a process of its own; its folder holds all that comes of it."""
    with messages_to(sys.stderr, name):
        try:
            fit_problem(
                task.problem,
                out=out,
                options=task.options,
                solver=task.solver,
                command=f"{command} {task.remark}".rstrip(),
            )
        except PyburgersError as error:
            if not keep_going:
                raise
            return error
    return None
